"""`rig home` with a camera: pictures of the virtual table over HTTP, its markers seen by the real
vision chain in a process of its own, in real time. A ball so seen:
tests/benchmarks/hardware/camera_run.py. The same without real time:
tests/rig/firmware/test_firmware_commands.py.
"""

import json
from collections.abc import Iterator

import numpy as np
import pytest

from rig.hardware.board.link import LinkLost
from tests.support.rig_lab import Lab

pytestmark = pytest.mark.realtime


@pytest.fixture(scope="module")
def lab() -> Iterator[Lab]:
    with Lab(film=True) as one:
        yield one


@pytest.mark.slow
def test_the_markers_find_signs_and_level(lab: Lab):
    with lab.rig.open("a") as file:
        file.write("sign_angle = [-1, 1]\n")  # a wrong word: what the markers see goes before it
    try:
        out = lab.home()
    except LinkLost as lost:
        pytest.skip(f"THIS MACHINE IS TOO BUSY for a camera in real time: {lost}")
    assert "the markers see the plate level to" in out
    kept = json.loads(lab.rig.with_suffix(".home.json").read_text())
    assert kept["confirmed"]
    assert kept["wiring"]["sign_angle"] == [1, 1]
    assert np.abs(kept["wiring"]["zero_counts"]).max() <= 8
