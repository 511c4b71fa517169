"""Backlash from a table's own signals: known truths come back, wherever they sit."""

from dataclasses import replace
from math import radians

import numpy as np
import pytest

from calibration.camera.sheet import CalibrationError
from calibration.motion.backlash import (
    BacklashEstimate,
    gear_by_strikes,
    gear_by_tachometer,
    offset_V,
    whole_by_motor,
)
from calibration.motion.manoeuvres import Trace, perform, strikes, sweeps
from rig.parameters import Rig, Servo
from rig.simulation.simulator import SimulatedTable

SERVO = Servo(gain_rad_s_V=1.735, time_constant_s=0.046)


def table(gear_deg: float, joint_deg: float, middle_deg: float = 0.0) -> Rig:
    def by_axis(**pair):
        return {"x": dict(pair), "y": dict(pair)}

    return Rig(
        servo=SERVO,
        effects={
            "gear_backlash": by_axis(play_rad=radians(gear_deg), offset_rad=radians(middle_deg)),
            "joint_backlash": by_axis(play_rad=radians(joint_deg)),
            "coulomb_friction": by_axis(friction_V=0.05),
            "voltage_offset": by_axis(offset_V=-0.1),
        },
    )


def swept(rig: Rig, *, encoder: bool = True, count: int = 8) -> Trace:
    with SimulatedTable(rig, np.random.default_rng(5), held=True) as one:
        return perform(
            one, (sweeps(one.period_s, count), sweeps(one.period_s, count)), encoder=encoder
        )


@pytest.fixture(scope="module")
def one_sided() -> tuple[Rig, Trace]:
    rig = table(1.6, 1.0, 0.5)
    return rig, swept(rig)


def test_gear_play_and_its_middle_by_tachometer_and_encoder(one_sided):
    rig, motion = one_sided
    for axis in range(2):
        play = gear_by_tachometer(motion, axis, replace(rig, effects={}))
        assert play.width_rad == pytest.approx(radians(1.6), abs=radians(0.08))
        assert play.middle_rad == pytest.approx(radians(0.5), abs=radians(0.12))
        assert play.symmetric is False


def test_the_offset_is_found_from_sweeps_to_and_fro(one_sided):
    _, motion = one_sided
    assert offset_V(motion, 0) == pytest.approx(0.1, abs=0.03)  # volts that undo it


def test_gear_play_by_encoder_and_volts_alone():
    rig = table(1.5, 1.0)
    with SimulatedTable(rig, np.random.default_rng(6), held=True) as one:
        motion = perform(one, tuple(strikes(one.period_s, 0.1, 10) for _ in range(2)))  # pyright: ignore
    play = gear_by_strikes(motion, 0, replace(rig, effects={}), 0.1)
    low, high = play.interval_rad
    assert low < radians(1.5) < high
    assert high - low < radians(1.0)


def test_the_motor_side_alone_shows_the_whole():
    rig = table(1.0, 1.5)
    play = whole_by_motor(swept(rig, encoder=False), 0, replace(rig, effects={}))
    assert play.width_rad == pytest.approx(radians(2.5), abs=radians(0.2))
    assert play.symmetric is None


def test_a_table_that_does_not_move_is_refused():
    n = 500
    zero = np.zeros((n, 2))
    still = Trace(np.arange(n) * 0.002, zero, zero, zero, np.ones((n, 2), int))
    for work in (gear_by_tachometer, whole_by_motor):
        with pytest.raises(CalibrationError):
            work(still, 0, Rig())


def test_intervals_never_reach_below_no_play():
    low, high = BacklashEstimate(0.001, 0.002, 10).interval_rad
    assert low == 0.0
    assert high > 0.004
