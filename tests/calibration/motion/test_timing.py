"""The camera's delay against the encoders, through rendered frames and from numbers alone."""

from dataclasses import replace

import numpy as np
import pytest

from calibration.camera.sheet import CalibrationError
from calibration.motion.manoeuvres import perform, wiggle
from calibration.motion.rolling import behind_backlash
from calibration.motion.timing import TiltRecorder, Wiggle, camera_delay, expected_sines
from experiments.runs.assemble import another_unit, known, load_rig, virtual_scene
from rig.hardware.camera.plate_tilt import sines as plate_sines
from rig.plant.ball import plate_rotation
from rig.simulation.rendered_camera import RenderedPlateCamera
from rig.simulation.simulator import SimulatedTable
from vision.frames import Frame
from vision.synthetic.synthetic import Renderer, virtual_view

KIND = known(load_rig(None))
HERTZ = (0.7, 2.3)


@pytest.mark.parametrize(
    ("seed", "late_s"),
    [(0, 0.012), pytest.param(1, 0.0231, marks=pytest.mark.slow), (2, 0.0347)],
)
def test_the_delay_comes_back_within_half_a_millisecond_through_rendered_frames(seed, late_s):
    rig = another_unit(load_rig(None), seed) if seed else load_rig(None)
    made = Renderer(virtual_scene(rig), virtual_view(), np.random.default_rng(seed))
    tilt = TiltRecorder(virtual_view(), made.scene.layout)
    eye = RenderedPlateCamera(made, late_s, tilt.add)
    table = SimulatedTable(rig, np.random.default_rng(seed), held=True, eye=eye)
    table.level_s = 0.0
    with table:
        one, two = (wiggle(table.period_s, 3.5, HERTZ) for _ in range(2))
        trace = perform(table, (one, two))
    found = camera_delay(tilt.wiggle(trace.t_s, trace.theta_rad), KIND)
    delay = found.delay_s
    assert delay.value == pytest.approx(late_s, abs=0.0005)
    assert delay.low <= late_s <= delay.high
    assert delay.high - delay.low < 0.0015
    assert found.play_rad["x"] == pytest.approx(np.radians(1.5), abs=np.radians(0.25))


def made_up(late_s, play_rad=0.02, noise=1e-4, frames=200, size=0.15, seed=0):
    t = np.arange(0, 6, 0.002)
    theta = size * np.column_stack(
        [np.sin(2 * np.pi * 0.7 * t + i) + np.sin(2 * np.pi * 2.3 * t + 2 * i) for i in (0, 1)]
    )
    stamp = np.linspace(0.4, 5.9, frames)
    rng = np.random.default_rng(seed)
    sines = np.empty((frames, 2))
    for a in range(2):
        behind = behind_backlash(theta[:, a], play_rad)
        sines[:, a] = KIND.linkage.ratio * np.sin(np.interp(stamp - late_s, t, behind))
    return Wiggle(t, theta, stamp, sines + rng.normal(0, noise, sines.shape))


@pytest.mark.parametrize("late_s", [0.0, 0.005, 0.0483, 0.12])
@pytest.mark.parametrize("play_rad", [0.0, 0.035])
def test_play_and_delay_are_told_apart(late_s, play_rad):
    wiggled = made_up(late_s, play_rad)
    found = camera_delay(wiggled, KIND)
    assert found.delay_s.value == pytest.approx(late_s, abs=0.0003)
    assert found.play_rad["y"] == pytest.approx(play_rad, abs=0.002)
    left = wiggled.sines - expected_sines(wiggled, found, KIND)
    assert left.std() < 1.5e-4


def test_offset_and_scale_of_the_mounting_do_not_matter():
    wiggled = made_up(0.02)
    moved = replace(wiggled, sines=0.97 * wiggled.sines + 0.01)
    assert camera_delay(moved, KIND).delay_s.value == pytest.approx(0.02, abs=0.0003)


def test_what_does_not_tell_a_delay_is_refused():
    with pytest.raises(CalibrationError, match="40 frames of the wiggle"):
        camera_delay(made_up(0.02, frames=40), KIND)
    with pytest.raises(CalibrationError, match="wiggle faster"):
        camera_delay(made_up(0.02, size=0.01), KIND)
    wiggled = made_up(0.02)
    swapped = replace(wiggled, sines=wiggled.sines[:, ::-1])
    with pytest.raises(CalibrationError, match="does not follow its servos"):
        camera_delay(swapped, KIND)


def test_sines_of_a_tilted_view():
    level = virtual_view()
    seen = level.tilted(plate_rotation((0.03, -0.05)))
    assert plate_sines(seen, level) == pytest.approx((0.03, -0.05))


def test_frames_of_another_size_than_the_lens_was_calibrated_at_are_refused():
    level = virtual_view()
    layout = Renderer(virtual_scene(load_rig(None)), level, np.random.default_rng(0)).scene.layout
    size = level.camera.height_px // 2, level.camera.width_px // 2, 3
    with pytest.raises(CalibrationError, match="wrong resolution"):
        TiltRecorder(level, layout).add(Frame(np.zeros(size, np.uint8), 0.0, 0))
