"""The analyses compute on one thread of the linear algebra, whoever calls them."""

import numpy as np
from threadpoolctl import threadpool_info, threadpool_limits

from calibration.gap import investigate
from rig.log import NAMES, Log
from rig.parameters import Rig


def threads() -> set[int]:
    return {one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"}


def test_an_investigation_takes_one_thread_and_gives_the_others_back():
    seen = []
    t = np.arange(0.0, 4.0, 0.002)
    columns = {name: np.zeros(len(t)) for name in NAMES} | {"t_s": t}
    with threadpool_limits(2, user_api="blas"):
        before = threads()
        investigate([Log.from_columns(columns)], Rig(), progress=lambda *_: seen.append(threads()))
        assert threads() == before
    assert seen
    assert all(one == {1} for one in seen)
