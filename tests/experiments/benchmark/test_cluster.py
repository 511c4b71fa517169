"""The same set on a Dask cluster of two worker processes: the same answers, bit for bit."""

from pathlib import Path

import pytest

from experiments.benchmark.answers import answer_set
from experiments.benchmark.design import Case
from experiments.benchmark.make import make_case
from experiments.blind.seal import seal
from tests.support.parts import need

need("distributed")


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.filterwarnings("default")  # what a cluster warns of at its end is its own
def test_rig_gap_on_a_cluster_gives_the_same_answers_bit_for_bit(tmp_path: Path):
    kinds = ("healthy", "one effect, real size")
    cases = [Case(i + 1, "foreign", kind) for i, kind in enumerate(kinds)]
    trials = [make_case(case, 6, tmp_path / "set/cases") for case in cases]
    seal(trials, tmp_path / "set")
    assert answer_set(tmp_path / "set", tmp_path / "here", jobs=1) == 0
    import distributed

    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        address = cluster.scheduler_address
        assert answer_set(tmp_path / "set", tmp_path / "there", cluster=address) == 0
    for trial in trials:
        one, other = (tmp_path / place / f"{trial.name}.json" for place in ("here", "there"))
        assert one.read_bytes() == other.read_bytes()
