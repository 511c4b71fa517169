"""A camera whose frames are stamped late: what is seen through it is dated by its calibration."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from experiments.calibrate.given import read_given
from experiments.doctor.doctor import BAD, examine
from experiments.doctor.facts import gather
from experiments.records.recording import write_run
from experiments.runs.assemble import virtual_scene
from experiments.runs.hardware import plate_tilt
from experiments.runs.hardware_run import camera_late_s
from experiments.runs.live_eye import open_ball, open_markers
from rig.log import Log
from rig.parameters import Rig
from rig.rigfile import to_record
from tests.support.exact_bundle import exact_bundle
from vision.frames import Frame
from vision.synthetic.synthetic import Renderer, virtual_view

LATE_S = 0.041
CAMERA = """
import time

import numpy as np


class Late:
    def read(self):
        time.sleep(0.02)
        return np.zeros((480, 640, 3), np.uint8), time.monotonic()
"""


def table(folder: Path, **timing_s: float) -> Rig:
    rig = Rig()
    (folder / "own.py").write_text(CAMERA)
    path = folder / "calibration.json"
    exact_bundle(virtual_view(), virtual_scene(rig), **timing_s).save(path)
    camera = {"camera": f"{folder / 'own.py'}:Late", "calibration": str(path)}
    return replace(rig, table=replace(rig.table, kind="serial", port="nowhere", **camera))


@pytest.mark.parametrize(
    ("timing_s", "late_s"), [({"delay_s": LATE_S}, LATE_S), ({"delay_s": -0.003}, 0.0), ({}, 0.0)]
)
def test_a_ball_is_dated_by_the_measured_delay_of_its_frames(
    tmp_path: Path, timing_s: dict[str, float], late_s: float
):
    rig = table(tmp_path, **timing_s)
    source, camera = open_ball(rig)
    with source:
        pass
    made = Renderer(virtual_scene(rig), virtual_view(), np.random.default_rng(3))
    late = []
    for k in range(40):
        image = made.render(np.eye(3), (0.003 * k - 0.05, -0.03))
        seen, _, _ = camera.step(Frame(image, 7.0 + k / 30, k), np.eye(3))
        late += [7.0 + k / 30 - seen.exposed_s] if seen else []
    assert len(late) > 20
    assert late == pytest.approx([late_s] * len(late), abs=1e-9)
    assert camera_late_s(rig) == late_s


def test_a_calibration_of_the_virtual_camera_is_none_of_a_real_one(tmp_path: Path):
    rig = table(tmp_path)
    file = Path(rig.table.calibration)
    assert gather(rig, None).calibration is None
    file.write_text(file.read_text().replace('"measured"', '"simulated"'))
    for use in (open_ball, open_markers, camera_late_s):
        with pytest.raises(ValueError, match=r"virtual camera, not of yours: run rig calibrate"):
            use(rig)
    facts = gather(rig, None)
    (found,) = (one for one in examine(facts, rig) if one.what == "calibration")
    assert (found.state, found.text) == (BAD, facts.calibration)
    assert "is of the virtual camera" in found.text
    assert (
        gather(replace(rig, table=replace(rig.table, kind="simulated")), None).calibration is None
    )


def test_homing_says_what_its_calibration_lacks_as_a_run_does(tmp_path: Path):
    """It was told by the camera's process, with the name of the error's class, as failed work."""
    rig = table(tmp_path)
    file = Path(rig.table.calibration)
    file.write_text(file.read_text().replace('"measured"', '"simulated"'))
    with pytest.raises(ValueError, match=r"^[^:]*is of the virtual camera"), plate_tilt(rig):
        pass
    file.unlink()
    with pytest.raises(FileNotFoundError), plate_tilt(rig):
        pass


def test_a_calibration_with_another_ball_is_refused(tmp_path: Path):
    rig = table(tmp_path)
    radius_m = rig.ball.radius_m
    for other, fits in ((1.01, True), (0.99, True), (0.64, False), (1.03, False)):
        mine = replace(rig, ball=replace(rig.ball, radius_m=other * radius_m))
        if fits:
            assert camera_late_s(mine) == 0.0
        else:
            with pytest.raises(ValueError, match=r"of a ball of 19\.6 mm .* ball\.radius_m = 0\.0"):
                camera_late_s(mine)


@pytest.mark.parametrize(
    ("source", "more", "known_s"),
    [
        ("measured", {"camera_late_s": LATE_S}, LATE_S),
        ("measured", {}, 0.0),
        ("simulated", {}, Rig().camera.delay_s),
    ],
)
def test_a_calibration_takes_a_run_as_it_was_dated(
    tmp_path: Path, source: str, more: dict[str, float], known_s: float
):
    log = Log.from_columns({"t_s": np.arange(50) / 500})
    start = {"source": source, "protocol": {"name": "steps"}, "arm": "without", "seed": 1}
    start |= {"rig": to_record(Rig()), "created": "2026-01-01T00:00:00+00:00", **more}
    write_run(tmp_path / "run", start, log, outcome="completed")
    assert read_given(tmp_path / "run", Rig()).delay_s == known_s
