"""`rig home` with a camera: pictures of the virtual table over HTTP, its markers seen by the real
vision chain in a process of its own, in real time. A ball so seen:
tests/benchmarks/hardware/camera_run.py. The same without real time:
tests/rig/firmware/test_firmware_commands.py.
"""

import json
from collections.abc import Iterator

import numpy as np
import pytest

from tests.support.rig_lab import Lab

pytestmark = pytest.mark.realtime

TRIES = 3
# A busy machine's doing: a process that had no turn in time is a lost table or camera.
LOST = ("silent for", "heard nothing", "no new frame for", "no frame for", "no first frame")


@pytest.fixture(scope="module")
def lab() -> Iterator[Lab]:
    one = Lab(film=True)
    try:
        yield one
    finally:
        one.end()


def homed(lab: Lab) -> tuple[int, str, str]:
    """Once more where the link was lost; in the end skipped, loudly."""
    said = (1, "", "never tried")
    for _ in range(TRIES):
        said = lab.call("home", "--yes")
        if said[0] != 1 or not any(word in said[1] + said[2] for word in LOST):
            return said
    pytest.skip(f"THIS MACHINE IS TOO BUSY for a camera in real time, {TRIES} tries: {said}")


@pytest.mark.slow
def test_the_markers_find_signs_and_level(lab: Lab):
    with lab.rig.open("a") as file:
        file.write("sign_angle = [-1, 1]\n")  # a wrong word: what the markers see goes before it
    code, out, error = homed(lab)
    assert code == 0, error
    assert "the markers see the plate level to" in out
    kept = json.loads(lab.rig.with_suffix(".home.json").read_text())
    assert kept["confirmed"]
    assert kept["wiring"]["sign_angle"] == [1, 1]
    assert np.abs(kept["wiring"]["zero_counts"]).max() <= 8
