"""Breakaway, K, tau and direction signs come back from simulated tables, several units."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from calibration.camera.sheet import CalibrationError
from calibration.motion.manoeuvres import rest
from calibration.motion.servo import calibrate_servos, mean_value
from experiments.runs.assemble import another_unit, load_rig
from rig.parameters import Rig, torque_per_volt
from rig.simulation.simulator import SimulatedTable

SEEDS = (0, 1, 2)


def unit(seed: int) -> Rig:
    rig = load_rig(None)
    return another_unit(rig, seed) if seed else rig


def table(rig: Rig, seed: int = 0) -> SimulatedTable:
    return SimulatedTable(rig, np.random.default_rng(seed), held=True)


@cache
def measured(seed: int):
    with table(unit(seed), seed) as one:
        return calibrate_servos(one)[0]


def truth(rig: Rig, axis: str) -> tuple[float, float]:
    """Volts that move the servo down and up."""
    bearings = (rig.drive.arm_friction_nm + rig.drive.joint_friction_nm) / torque_per_volt()
    dry = rig.effects["coulomb_friction"][axis]["friction_V"] + bearings
    offset = rig.effects["voltage_offset"][axis]["offset_V"]
    return -dry - offset, dry - offset


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("axis", ["x", "y"])
def test_breakaway_volts_come_back_within_5_mV(seed, axis):
    found = getattr(measured(seed), axis)
    down, up = truth(unit(seed), axis)
    assert found.breakaway_negative_V.value == pytest.approx(down, abs=0.005)
    assert found.breakaway_positive_V.value == pytest.approx(up, abs=0.005)
    assert found.sign == 1


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("axis", ["x", "y"])
def test_gain_and_time_constant_come_back_within_2_and_3_percent(seed, axis):
    found, servo = getattr(measured(seed), axis), unit(seed).servo
    assert found.gain_rad_s_V.value == pytest.approx(servo.gain_rad_s_V, rel=0.02)
    assert found.time_constant_s.value == pytest.approx(servo.time_constant_s, rel=0.03)


def test_intervals_hold_the_truth():
    """Six axes, two numbers each; a 95 % interval may miss one."""
    missed = 0
    for seed in SEEDS:
        servo = unit(seed).servo
        for axis in ("x", "y"):
            found = getattr(measured(seed), axis)
            for value, true in (
                (found.gain_rad_s_V, servo.gain_rad_s_V),
                (found.time_constant_s, servo.time_constant_s),
            ):
                missed += not value.low <= true <= value.high
    assert missed <= 1


class Miswired:
    """A table with a plug in the wrong place: `mix` maps what is asked to what is driven."""

    def __init__(self, inner: SimulatedTable, mix, encoders=(1, 1)) -> None:
        self._inner, self._mix, self._encoders = inner, mix, encoders
        self.period_s, self.voltage_limit_V = inner.period_s, inner.voltage_limit_V

    def read(self):
        reading = self._inner.read()
        theta = tuple(s * a for s, a in zip(self._encoders, reading.theta_rad, strict=True))
        return replace(reading, theta_rad=theta)

    def drive(self, volts):
        self._inner.drive(self._mix(volts))

    def close(self):
        self._inner.close()


@pytest.mark.parametrize(
    ("mix", "encoders", "message"),
    [
        (lambda v: (-v[0], v[1]), (1, 1), "lowers the servo angle of x"),
        (lambda v: v, (1, -1), "lowers the servo angle of y"),
        (lambda v: (v[1], v[0]), (1, 1), "motor x turn the encoder of y"),
        (lambda v: (0.0, v[1]), (1, 1), "servo x does not answer"),
    ],
)
def test_wrong_directions_are_refused_before_anything_moves_far(mix, encoders, message):
    inner = table(Rig())
    with pytest.raises(CalibrationError, match=f"direction signs: .*{message}"):
        calibrate_servos(Miswired(inner, mix, encoders))
    assert np.abs(inner.truth()["arm_rad"]).max() < 0.4


def test_too_few_ramps_are_said():
    with pytest.raises(CalibrationError, match="2 ramps"):
        mean_value([0.1, 0.2])


def test_a_rest_is_at_least_one_tick():
    assert len(list(rest(0.0, 0.002, 0.1))) == 1
