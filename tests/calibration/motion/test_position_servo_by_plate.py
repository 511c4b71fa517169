"""Servos whose angle nobody reads: their numbers from the plate's tilt at the times of frames."""

from dataclasses import replace
from functools import cache
from math import degrees

import numpy as np
import pytest

from calibration.camera.sheet import CalibrationError
from calibration.motion.commanded_moves import moves_in_turn, tell
from calibration.motion.position_servo import expected_angles, fit_position_servos
from calibration.motion.position_servo_by_plate import (
    followed_by_plate,
    seen_by_plate,
    servo_angles,
)
from calibration.motion.timing import Wiggle
from experiments.runs.assemble import load_rig
from rig.parameters import CameraTiming, Rig, Servo
from rig.simulation.simulator import SimulatedTable
from tests.calibration.motion.test_position_servo import SHIPPED

HIDDEN = Servo(
    kind="position", angle_measured=True, lag_s=0.05, dead_time_s=0.01, rate_limit_rad_s=4.0,
    dead_band_rad=0.006, period_s=0.02, stop_rad=1.3, y={"lag_s": 0.03},
)  # fmt: skip
BELIEVED = replace(HIDDEN, angle_measured=False, lag_s=0.02, y={}, rate_limit_rad_s=9.0)
LATE_S, RATE_HZ, PLAY_RAD, NOISE = 0.03, 60.0, 0.01, 2e-4


def sine_of(theta: np.ndarray, rig: Rig) -> np.ndarray:
    """Eq. 14: sin(phi) = 2 R_d sin(theta)/L."""
    return np.array(rig.linkage.ratios) * np.sin(theta)


def behind_play(theta: np.ndarray) -> np.ndarray:
    """Angles (n, 2) behind PLAY_RAD of play: pushed along by its ends."""
    out, at = np.empty_like(theta), theta[0]
    for k, now in enumerate(theta):
        at = np.clip(at, now - PLAY_RAD / 2, now + PLAY_RAD / 2)
        out[k] = at
    return out


@cache
def filmed() -> Wiggle:
    """Moves of a table with HIDDEN servos, filmed: the tilt behind play, noise on its sines."""
    rig, rng = Rig(servo=HIDDEN), np.random.default_rng(4)
    with SimulatedTable(rig, np.random.default_rng(2), held=True) as table:
        told = tell(table, moves_in_turn(table.period_s, 0.5, 1), 0.5)
    light = np.arange(told.t_s[0], told.t_s[-1], 1 / RATE_HZ)
    plate = behind_play(told.seen_rad)
    angles = np.column_stack([np.interp(light, told.seen_s, plate[:, a]) for a in range(2)])
    sines = sine_of(angles, rig) + rng.normal(0.0, NOISE, angles.shape)
    return Wiggle(told.t_s, told.told_rad, light + LATE_S, sines)


def believed() -> Rig:
    return Rig(servo=BELIEVED, camera=CameraTiming(rate_hz=RATE_HZ, delay_s=LATE_S))


@cache
def record():
    fit = fit_position_servos(followed_by_plate(filmed(), believed()), believed())
    return seen_by_plate(fit.record)


@pytest.mark.parametrize("axis", ["x", "y"])
def test_lag_dead_time_rate_scale_and_zero_come_back(axis: str):
    found = getattr(record(), axis)
    for key in ("lag_s", "dead_time_s", "rate_limit_rad_s"):
        true, value = HIDDEN.pair(key)["xy".index(axis)], getattr(found, key)
        assert value.low <= true <= value.high
        assert value.high - value.low < (0.012 if key.endswith("time_s") else 0.8)
    for value in (found.scale, found.zero_rad):
        assert value.low <= 0.0 <= value.high
        assert value.high - value.low < 0.02


def test_dead_band_and_play_are_told_as_one_and_kept_as_neither():
    both = degrees(HIDDEN.dead_band_rad + PLAY_RAD / 2)
    for axis in (record().x, record().y):
        assert axis.dead_band_rad is None
        told = float(axis.not_seen["dead_band_rad"].split("together ")[1].split()[0])
        assert told == pytest.approx(both, abs=0.05)
    assert record().source == "plate"


def test_an_error_of_the_cameras_delay_is_one_of_the_dead_time():
    later = replace(believed(), camera=CameraTiming(rate_hz=RATE_HZ, delay_s=LATE_S - 0.005))
    found = fit_position_servos(followed_by_plate(filmed(), later), later).record
    assert found.x.dead_time_s.value - record().x.dead_time_s.value == pytest.approx(
        0.005, abs=1e-3
    )


@pytest.mark.parametrize("begin_s", [0.004, 1.013])
def test_nobody_needs_to_know_when_the_servos_periods_begin(begin_s: float):
    """HIDDEN servos take a command every 20 ms, ten ticks, counted from the log's zero."""
    other = replace(filmed(), t_s=filmed().t_s + begin_s, stamp_s=filmed().stamp_s + begin_s)
    followed = replace(followed_by_plate(other, believed()), in_phase=False)
    fit = fit_position_servos(followed, believed())
    left = expected_angles(followed, fit, believed()) - followed.seen_rad
    assert np.sqrt(np.nanmean(left**2, axis=0)).max() < 0.002
    for axis, name in ((fit.record.x, "x"), (fit.record.y, "y")):
        lag, dead = (HIDDEN.pair(key)["xy".index(name)] for key in ("lag_s", "dead_time_s"))
        assert axis.lag_s is not None
        assert axis.rms_rad is not None
        assert axis.lag_s.low <= lag <= axis.lag_s.high
        assert axis.dead_time_s.low <= dead <= axis.dead_time_s.high
        assert axis.rms_rad < 0.002


def test_too_few_frames_are_refused():
    sparse = replace(filmed(), stamp_s=filmed().stamp_s[::4], sines=filmed().sines[::4])
    with pytest.raises(CalibrationError, match=r"seen 15\.0 times a second .* 20 are needed"):
        followed_by_plate(sparse, believed())
    none = replace(filmed(), stamp_s=np.zeros(0), sines=np.zeros((0, 2)))
    with pytest.raises(CalibrationError, match=r"seen 0\.0 times a second"):
        followed_by_plate(none, believed())


def test_a_film_that_leaves_repeats_of_a_still_plate_out_tells_the_same():
    still = np.linalg.norm(np.diff(filmed().sines, axis=0, prepend=0.0), axis=1) < 3 * NOISE
    moving = replace(filmed(), stamp_s=filmed().stamp_s[~still], sines=filmed().sines[~still])
    assert still.mean() > 0.3
    found = fit_position_servos(followed_by_plate(moving, believed()), believed()).record
    assert found.x.lag_s is not None
    assert found.x.lag_s.low <= HIDDEN.pair("lag_s")[0] <= found.x.lag_s.high


@pytest.mark.parametrize("name", ["hobby-two-servos", "bus-servos", "three-arms", "default"])
def test_the_linkages_inverse_gives_the_angles_back(name: str):
    from rig.plant.plant_record import pack
    from rig.plant.position_plant import felt_sines

    rig = load_rig(SHIPPED / f"{name}.toml")
    limit = rig.servo.angle_limit_rad
    angles = np.random.default_rng(1).uniform(-limit, limit, (50, 2))
    p = pack(replace(rig, effects={}))
    sines = np.array([felt_sines(p, x, y) for x, y in angles])
    np.testing.assert_allclose(servo_angles(sines, replace(rig, effects={})), angles, atol=2e-5)
    far = np.full((1, 2), 0.999)
    if rig.linkage.kind != "three-arms":
        assert np.isnan(servo_angles(far, rig)).all()
