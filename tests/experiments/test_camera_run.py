"""`rig home` and `rig run` by a camera alone: pictures of the virtual table over HTTP, seen by the
real vision chain in a process of its own, in real time."""

import json
from collections.abc import Iterator

import numpy as np
import pytest
from rig_lab import Lab
from virtual_film import measured_and_true

TRIES = 3
# A busy machine's doing: a process that had no turn in time is a lost table or camera.
LOST = ("  link lost", "  camera stall", "silent for", "heard nothing", "no new frame for")


@pytest.fixture(scope="module")
def lab() -> Iterator[Lab]:
    one = Lab(film=True)
    try:
        yield one
    finally:
        one.end()


def tried(lab: Lab, *words: str) -> tuple[int, str, str]:
    """Once more where the link was lost; in the end skipped, loudly."""
    said = (1, "", "never tried")
    for _ in range(TRIES):
        said = lab.call(*words, "--yes")
        if said[0] != 1 or not any(word in said[1] + said[2] for word in LOST):
            return said
    pytest.skip(f"THIS MACHINE IS TOO BUSY for a camera in real time, {TRIES} tries: {said}")


def test_the_markers_find_signs_and_level_and_the_camera_balances_the_ball(lab: Lab):
    with lab.rig.open("a") as file:
        file.write("sign_angle = [-1, 1]\n")  # a wrong word: what the markers see goes before it
    code, out, error = tried(lab, "home")
    assert code == 0, error
    assert "the markers see the plate level to" in out
    kept = json.loads(lab.rig.with_suffix(".home.json").read_text())
    assert kept["confirmed"]
    assert kept["wiring"]["sign_angle"] == [1, 1]
    assert np.abs(kept["wiring"]["zero_counts"]).max() <= 8

    protocol = lab.protocol(6.0)
    code, out, error = tried(lab, "run", protocol, "--out", str(lab.out), "--arm", "with")
    assert code == 0, (out, error)
    run = lab.runs()[-1]
    assert run.meta["outcome"] == "completed"
    assert run.meta["camera"].startswith("http://127.0.0.1:")
    assert run.meta["calibration"] == "calibration.json"
    pairs = measured_and_true(run.log, lab.folder)
    print(
        len(pairs),
        np.sqrt(np.mean((pairs[:, :2] - pairs[:, 2:]) ** 2)),
        np.hypot(*pairs[-20:, 2:].T),
    )
    assert len(pairs) > 60
    off = pairs[:, :2] - pairs[:, 2:]
    rms_mm = 1000 * np.sqrt(np.mean(off**2))
    print(f"{len(pairs)} observations, {rms_mm:.2f} mm rms from the truth")
    assert rms_mm < 2.0
    assert np.hypot(*pairs[-20:, 2:].T).max() < 0.03  # where the ball truly was in the end
    assert lab.volts()[-1, 1:].tolist() == [0.0, 0.0]
