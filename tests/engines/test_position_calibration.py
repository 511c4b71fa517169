"""`rig calibrate servo` on servos of another engine: motors with a controller and a dead band."""

from functools import cache

import pytest

from calibration.motion.commanded_moves import check_directions, moves_in_turn, tell
from calibration.motion.position_servo import fit_position_servos
from rig.parameters import Rig, Servo
from tests.support.mujoco_engine.motor_servos import Motor, MotorServos

FAST = Motor()
SLOW = Motor(
    gain_nm_rad=2.0, damping_nm_s=0.16, stall_nm=0.4, dead_band_rad=0.012, dead_time_s=0.015,
    zero_rad=0.01,
)  # fmt: skip
LIMIT_RAD = 0.6


@cache
def measured(cycles: int):
    table = MotorServos(FAST, SLOW)
    rows = moves_in_turn(table.period_s, LIMIT_RAD, cycles)
    followed = tell(table, rows, LIMIT_RAD)
    check_directions(followed)
    believed = Rig(servo=Servo(kind="position", period_s=0.02, angle_measured=True, stop_rad=1.5))
    return fit_position_servos(followed, believed).record


@pytest.mark.parametrize("cycles", [1, pytest.param(3, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("axis", "motor"), [("x", FAST), ("y", SLOW)])
def test_a_motors_lag_dead_time_rate_and_dead_band_come_back(axis, motor, cycles):
    """Tolerances: a motor's inertia is a second lag (2 ms here), which the equations leave to lag
    and dead time; the limit is reached for less than 0.2 s a step."""
    found = getattr(measured(cycles), axis)
    for key in ("lag_s", "dead_time_s", "rate_limit_rad_s", "dead_band_rad", "zero_rad"):
        value, true = getattr(found, key), getattr(motor, key)
        assert value.low <= true <= value.high, key
    assert found.lag_s.value + found.dead_time_s.value == pytest.approx(
        motor.lag_s + motor.dead_time_s, abs=0.002
    )
    assert found.lag_s.value == pytest.approx(motor.lag_s, abs=0.004)
    assert found.rate_limit_rad_s.value == pytest.approx(motor.rate_limit_rad_s, rel=0.03)
    assert found.dead_band_rad.value == pytest.approx(motor.dead_band_rad, abs=0.0005)
    assert found.zero_rad.value == pytest.approx(motor.zero_rad, abs=0.0005)
