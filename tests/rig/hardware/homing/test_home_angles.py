"""Homing of servos that take an angle: trim, order and signs found by small slow moves."""

from dataclasses import replace
from itertools import product
from math import sin

import numpy as np
import pytest

from experiments.runs.hardware import rehearse_home
from rig.hardware.homing.home_angles import home_angles
from rig.hardware.homing.homing_moves import HomingRefused
from rig.hardware.wiring import Wiring
from rig.parameters import Rig, Servo, TableChoice
from rig.table import Reading

PERIOD_S, LAG_S, EVERY_S, SPEED_RAD_S = 0.004, 0.04, 1 / 60, 0.5
STEP_RAD = 2 * np.pi / 4096
RIG = Rig(servo=Servo(kind="position", angle_measured=True), control_rate_hz=1 / PERIOD_S)
ZEROS = (2048, 2048)
SIGNS = [(1, 1), (-1, 1), (1, -1), (-1, -1)]


class Servos:
    """Two servos behind any order of cables; angles by channel from the guess of level.

    levels: where each, by channel, holds the plate level; stuck: a channel that does not turn.
    """

    takes_angle, travel_rad = True, (2 * np.pi, 2 * np.pi)

    def __init__(self, *, swap=False, signs=(1, 1), levels=(0.0, 0.0), at=(0.0, 0.0)) -> None:
        self.swap, self.signs, self.levels = swap, np.array(signs), np.array(levels)
        self.theta, self.told = np.array(at, float), np.array(at, float)
        self.stuck: int | None = None
        self.ratio, self.lean = RIG.linkage.ratio, np.zeros(2)
        self.t_s, self.next_s, self.fastest, self.farthest = 0.0, 0.0, 0.0, 0.0
        self.rng = np.random.default_rng(1)

    def drive(self, angles) -> None:
        most = SPEED_RAD_S * PERIOD_S  # as a table that is not homed lets goals go
        step = np.clip(np.array(angles) - self.told, -most, most)
        self.told += step
        self.farthest = max(self.farthest, *np.abs(self.told - self.levels))

    def read(self) -> Reading:
        self.t_s += PERIOD_S
        move = (self.told - self.theta) * (1 - np.exp(-PERIOD_S / LAG_S))
        if self.stuck is not None:
            move[self.stuck] = 0.0
        self.theta += move
        self.fastest = max(self.fastest, *np.abs(move) / PERIOD_S)
        return Reading(self.t_s, (float(self.theta[0]), float(self.theta[1])))

    def tilt(self, t_s: float):
        if t_s < self.next_s:
            return None
        self.next_s = t_s + EVERY_S
        by_channel = self.signs * (self.theta - self.levels)
        axes = by_channel[::-1] if self.swap else by_channel
        sines = [self.ratio * sin(a) for a in axes] + self.lean
        x, y = sines + 1e-3 * self.rng.standard_normal(2)
        return float(x), float(y)


def found(table: Servos, rig: Rig = RIG, *, markers: bool = True):
    return home_angles(table, rig, ZEROS, table.tilt if markers else lambda t_s: None)  # pyright: ignore


@pytest.mark.parametrize(("swap", "signs"), list(product([False, True], SIGNS)))
def test_order_signs_and_trim_are_found(swap: bool, signs):
    table = Servos(swap=swap, signs=signs, levels=(0.09, -0.06), at=(0.4, -0.3))
    result = found(table)
    assert (result.wiring.swap, result.wiring.sign_angle) == (swap, signs)
    right = [2048 + 0.09 / STEP_RAD, 2048 - 0.06 / STEP_RAD]
    # Markers: 1e-3 of noise in some 24 pictures, over the ratio 0.185: 1.1 mrad, 0.7 counts.
    assert result.wiring.zero_counts == pytest.approx(right, abs=4)
    assert result.confirmed
    assert max(map(abs, result.level)) < 2e-3  # pyright: ignore
    assert result.travel_rad == pytest.approx(sorted_by(swap, (6.28 - 0.18, 6.28 - 0.12)), abs=0.02)


def sorted_by(swap: bool, pair):
    return pair[::-1] if swap else pair


def test_moves_are_small_and_slow():
    table = Servos(levels=(0.09, -0.06))
    found(table)
    assert table.fastest < 1.05 * SPEED_RAD_S
    assert table.farthest < 0.2 + 0.09 + 0.01


def test_without_markers_all_is_the_rig_files_word_and_each_servo_follows():
    rig = replace(RIG, table=TableChoice(swap=True, sign_angle=(1, -1)))
    table = Servos()
    result = found(table, rig, markers=False)
    assert result.wiring == Wiring(True, (1, -1), (1, -1), ZEROS)
    assert not result.confirmed
    assert table.farthest == pytest.approx(0.2, abs=0.01)


def refused(table: Servos, rig: Rig = RIG, *, markers: bool = True) -> HomingRefused:
    with pytest.raises(HomingRefused) as caught:
        found(table, rig, markers=markers)
    assert "\n" not in str(caught.value)
    assert table.farthest < 0.6
    return caught.value


@pytest.mark.parametrize("channel", [0, 1])
@pytest.mark.parametrize("markers", [False, True])
def test_a_servo_that_does_not_follow_is_named(channel: int, markers: bool):
    table = Servos()
    table.stuck = channel
    assert refused(table, markers=markers).name == "stuck"


def test_a_horn_that_sits_a_tooth_off_is_named():
    error = refused(Servos(levels=(0.3, 0.0)))
    assert error.name == "not level"
    assert "set the horns" in str(error)


def test_a_plate_that_does_not_follow_is_named():
    table = Servos()
    table.ratio = 0.02
    assert refused(table).name == "plate does not follow"


def test_a_linkage_of_a_third_more_is_homed_and_level_checked_again():
    table = Servos(levels=(0.1, -0.1))
    table.ratio *= 1.3
    assert found(table).wiring.zero_counts == pytest.approx((2113, 1983), abs=4)


def test_markers_that_vanish_are_named():
    table, seen = Servos(), 0

    def tilt(t_s: float):
        nonlocal seen
        seen += 1
        return Servos.tilt(table, t_s) if seen < 400 else None

    table.tilt = tilt
    assert refused(table).name == "no markers"


def test_a_small_angle_limit_makes_small_swings():
    rig = replace(RIG, servo=replace(RIG.servo, angle_limit_rad=0.15))
    table = Servos()
    found(table, rig)
    assert table.farthest == pytest.approx(0.12, abs=0.01)


@pytest.mark.parametrize("told", [True, False])
def test_the_virtual_table_is_homed_whether_its_servos_tell_their_angle_or_not(told: bool):
    servo = replace(RIG.servo, quantum_rad=0.0015, angle_measured=told)
    result = rehearse_home(replace(RIG, servo=servo))
    assert result.confirmed
    assert np.abs(np.subtract(result.wiring.zero_counts, 0)).max() <= 2
