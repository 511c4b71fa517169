"""Homing of servos that take an angle: trim, order and signs found by small slow moves."""

from dataclasses import replace
from itertools import permutations, product

import numpy as np
import pytest

from experiments.runs.hardware import rehearse_home
from rig.hardware.homing.home_angles import home_angles
from rig.hardware.homing.homing_moves import HomingRefused
from rig.hardware.wiring import Wiring
from rig.parameters import Rig, Servo, TableChoice
from rig.rigfile import read_rig
from rig.table import Reading
from tests.support import ROOT

PERIOD_S, LAG_S, EVERY_S, SPEED_RAD_S = 0.004, 0.04, 1 / 60, 0.5
STEP_RAD = 2 * np.pi / 4096
RIG = Rig(servo=Servo(kind="position", angle_measured=True), control_rate_hz=1 / PERIOD_S)
ARMS = read_rig(ROOT / "experiments/rigs/three-arms.toml")
SIGNS = [(1, 1), (-1, 1), (1, -1), (-1, -1)]


class Servos:
    """A linkage's servos behind any order of cables; angles by channel from the guess of level.

    order: by channel, the servo on it; levels: where each, by channel, holds the plate level;
    stuck: a channel that does not turn.
    """

    takes_angle = True

    def __init__(
        self, *, order=(0, 1), signs=(1, 1), levels=(0.0, 0.0), at=(0.0, 0.0), linkage=RIG.linkage
    ) -> None:  # fmt: skip
        self.order, self.signs, self.levels = list(order), np.array(signs), np.array(levels)
        self.linkage, self.travel_rad = linkage, (2 * np.pi,) * len(order)
        self.theta, self.told = np.array(at, float), np.array(at, float)
        self.stuck: int | None = None
        self.ratio, self.lean = linkage.ratio, np.zeros(2)
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
        return Reading(self.t_s, tuple(map(float, self.theta)))  # pyright: ignore

    def tilt(self, t_s: float):
        if t_s < self.next_s:
            return None
        self.next_s = t_s + EVERY_S
        by_servo = np.zeros(len(self.order))
        by_servo[self.order] = self.signs * (self.theta - self.levels)
        sines = self.ratio * np.sin(self.linkage.table_angles(by_servo)) + self.lean
        x, y = sines + 1e-3 * self.rng.standard_normal(2)
        return float(x), float(y)


def found(table: Servos, rig: Rig = RIG, *, markers: bool = True):
    zeros = (2048,) * len(table.order)
    return home_angles(table, rig, zeros, table.tilt if markers else lambda t_s: None)  # pyright: ignore


@pytest.mark.parametrize(("order", "signs"), list(product([(0, 1), (1, 0)], SIGNS)))
def test_order_signs_and_trim_are_found(order, signs):
    table = Servos(order=order, signs=signs, levels=(0.09, -0.06), at=(0.4, -0.3))
    result = found(table)
    assert (result.wiring.order, result.wiring.sign_angle) == (order, signs)
    right = [2048 + 0.09 / STEP_RAD, 2048 - 0.06 / STEP_RAD]
    # Markers: 1e-3 of noise in some 24 pictures, over the ratio 0.185: 1.1 mrad, 0.7 counts.
    assert result.wiring.zero_counts == pytest.approx(right, abs=4)
    assert result.confirmed
    assert max(map(abs, result.level)) < 2e-3  # pyright: ignore
    by_servo = [(6.28 - 0.18, 6.28 - 0.12)[order.index(servo)] for servo in (0, 1)]
    assert result.travel_rad == pytest.approx(by_servo, abs=0.02)


THREE = list(zip(permutations(range(3)), product([1, -1], repeat=3), strict=False))


@pytest.mark.parametrize(("order", "signs"), [*THREE, ((1, 2, 0), (-1, -1, -1))])
def test_of_three_arms_order_signs_and_trims_are_found(order, signs):
    """Trims as far as they tilt the plate: what lifts it stays the rig file's word."""
    rig = replace(ARMS, servo=replace(ARMS.servo, angle_measured=True), control_rate_hz=250.0)
    raised = np.array(signs) * [0.07, -0.05, -0.02]  # of each arm; together no height
    table = Servos(
        order=order, signs=signs, levels=raised, at=(0.2, -0.1, 0.1), linkage=ARMS.linkage
    )
    result = found(table, rig)
    assert (result.wiring.order, result.wiring.sign_angle) == (order, signs)
    assert result.confirmed
    assert max(map(abs, result.level)) < 2e-3  # pyright: ignore
    off = (np.array(result.wiring.zero_counts) - 2048) * STEP_RAD
    # 1e-3 of noise in 24 pictures over 0.37: 0.6 mrad; the columns are secants: a tenth of a trim.
    assert off == pytest.approx(raised, abs=0.01)
    assert table.farthest < 0.2 + 0.07 + 0.01


@pytest.mark.parametrize("markers", [False, True])
def test_of_three_arms_one_that_does_not_follow_is_named(markers: bool):
    rig = replace(ARMS, servo=replace(ARMS.servo, angle_measured=True), control_rate_hz=250.0)
    table = Servos(
        order=(0, 1, 2), signs=(1, 1, 1), levels=(0, 0, 0), at=(0, 0, 0), linkage=ARMS.linkage
    )
    table.stuck = 2
    assert refused(table, rig, markers=markers).name == "stuck"


def test_two_arms_on_one_joint_are_named():
    rig = replace(ARMS, servo=replace(ARMS.servo, angle_measured=True), control_rate_hz=250.0)
    table = Servos(
        order=(0, 1, 2), signs=(1, 1, 1), levels=(0, 0, 0), at=(0, 0, 0), linkage=ARMS.linkage
    )
    table.order = [0, 1, 1]
    assert refused(table, rig).name == "plate does not follow"


def test_moves_are_small_and_slow():
    table = Servos(levels=(0.09, -0.06))
    found(table)
    assert table.fastest < 1.05 * SPEED_RAD_S
    assert table.farthest < 0.2 + 0.09 + 0.01


def test_without_markers_all_is_the_rig_files_word_and_each_servo_follows():
    rig = replace(RIG, table=TableChoice(swap=True, sign_angle=(1, -1)))
    table = Servos()
    result = found(table, rig, markers=False)
    assert result.wiring == Wiring((1, 0), (1, -1), (1, -1), (2048, 2048))
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


def test_a_virtual_table_on_three_arms_is_homed():
    result = rehearse_home(replace(ARMS, effects={}))
    assert (result.wiring.order, result.wiring.sign_angle) == ((0, 1, 2), (1, 1, 1))
    assert result.confirmed
    assert np.abs(result.wiring.zero_counts).max() <= 4
