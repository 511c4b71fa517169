"""The readout of a rolling shutter, from pictures of a plate that wiggles and nothing else."""

import numpy as np
import pytest

from calibration.motion.readout import ReadoutRecorder
from experiments.runs.assemble import virtual_scene
from rig.parameters import Rig
from tests.support.poses import tilt
from tests.support.rolling_shutter import rolling_picture
from vision.plate.markers import track_pose
from vision.synthetic.synthetic import Renderer, virtual_view

FRAME_S = 1 / 60


def sines(t_s: float) -> tuple[float, float]:
    """(sin phi_x, sin phi_y): 0.06 rad on both axes, as `rig calibrate time` wiggles a plate."""
    return 0.06 * np.sin(2 * np.pi * 2.3 * t_s), 0.06 * np.cos(2 * np.pi * 1.7 * t_s)


def motion(t_s: float):
    return tilt(*sines(t_s)), None, (0.0, 0.0)


def pictures(readout_s: float, frames: int, *, band_px: int = 24):
    made = Renderer(virtual_scene(Rig()), virtual_view(), np.random.default_rng(7))
    for k in range(frames):
        at = k * FRAME_S
        yield at, rolling_picture(made, motion, at, readout_s, band_px=band_px)


def measured(readout_s: float, frames: int):
    layout, view = virtual_scene(Rig()).layout, virtual_view()
    recorder = ReadoutRecorder(layout)
    for t_s, image in pictures(readout_s, frames):
        fit = track_pose(image, layout, view)
        view = fit.view
        recorder.add(t_s, fit.view if fit.accepted else None, image)
    return recorder.readout_s()


@pytest.mark.slow
@pytest.mark.parametrize("readout_s", [0.016, -0.008])
def test_the_readout_comes_back(readout_s: float):
    found = measured(readout_s, 60)
    assert found is not None
    assert found.low <= readout_s <= found.high
    assert found.high - found.low < 0.002


@pytest.mark.slow
def test_a_global_shutter_is_told_as_one():
    found = measured(0.0, 40)
    assert found is not None
    assert abs(found.value) < 0.0005


def test_too_few_frames_tell_nothing():
    assert measured(0.0, 4) is None
