"""Homing on simulated tables behind every order of cables, with play, friction and faults."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from experiments.runs.assemble import load_rig
from rig.hardware.homing.home import Homing, home, plan
from rig.hardware.homing.homing_moves import MOST_V, HomingRefused, Sight
from rig.hardware.wiring import Wiring
from rig.parameters import Rig, TableChoice
from tests.support.hardware.miswired import STEP_RAD, Miswired

REAL = replace(load_rig(None), control_rate_hz=200.0)  # play, friction, offsets, not quite level
SIGNS = [(1, 1), (-1, 1), (1, -1), (-1, -1)]


def found(table: Miswired, rig: Rig = REAL, *, markers: bool = True) -> Homing:
    with table:
        if markers:
            return home(table, rig, table.tilt)
        return home(table, rig)


def truth(table: Miswired) -> Wiring:
    """The `Wiring` that undoes the table's cables."""
    return Wiring(
        (1, 0) if table.swap else (0, 1),
        table.volt_signs,
        table.count_signs,
        table.zeros,
        crossed=table.crossed,
    )


@pytest.mark.parametrize("swap", [False, True])
@pytest.mark.parametrize("crossed", [False, True])
@pytest.mark.parametrize(("volts", "counts"), list(product(SIGNS, SIGNS))[::3])
def test_every_order_of_cables_is_found(swap, crossed, volts, counts):
    table = Miswired(
        REAL, swap=swap, crossed=crossed, volt_signs=volts, count_signs=counts,
        zeros=(1234, -777),
    )  # fmt: skip
    result = found(table)
    right = truth(table)
    assert replace(result.wiring, zero_counts=right.zero_counts) == right
    # The middle of two stops that a motor is pressed against: good to a few counts.
    assert np.abs(np.subtract(result.wiring.zero_counts, (1234, -777))).max() <= 8
    assert result.confirmed
    assert result.travel_rad == pytest.approx((1.22, 1.22), abs=0.03)
    assert max(abs(v) for pair in table.volts for v in pair) <= MOST_V
    assert table.plant.volts_V == (0.0, 0.0)
    assert np.abs(table.plant.truth()["arm_rad"]).max() < 0.05


@pytest.mark.parametrize("swap", [False, True])
@pytest.mark.parametrize("angle", SIGNS)
def test_without_a_camera_axes_and_directions_are_the_rig_files_word(swap, angle):
    rig = replace(REAL, table=TableChoice(swap=swap, sign_angle=angle))
    table = Miswired(REAL, swap=swap, volt_signs=(-1, 1), count_signs=angle, zeros=(90, 40))
    result = found(table, rig, markers=False)
    assert not result.confirmed
    right = truth(table)
    assert replace(result.wiring, zero_counts=right.zero_counts) == right


@pytest.mark.parametrize("angle", [-0.6, 0.6])
def test_an_arm_that_lies_at_its_stop_is_homed_too(angle):
    table = Miswired(REAL)
    table.read()
    while abs(table.plant.truth()["arm_rad"][0]) < abs(angle):
        table.drive((np.sign(angle) * 1.5, np.sign(angle) * 1.5))
        table.read()
    assert np.abs(found(table).wiring.zero_counts).max() <= 8


def test_heavy_friction_and_wide_play_are_homed(monkeypatch):
    effects = dict(REAL.effects)
    effects["gear_backlash"] = {axis: {"play_rad": 0.05} for axis in ("x", "y")}
    effects["joint_backlash"] = {axis: {"play_rad": 0.05} for axis in ("x", "y")}
    effects["coulomb_friction"] = {axis: {"friction_V": 0.5} for axis in ("x", "y")}
    table = Miswired(replace(REAL, effects=effects), swap=True, volt_signs=(-1, 1))
    result = found(table)
    assert result.wiring.swap
    assert result.wiring.sign_volts == (-1, 1)
    assert np.abs(result.wiring.zero_counts).max() <= 12
    assert min(result.moving_V) > 0.5


def refused(table: Miswired, rig: Rig = REAL, *, markers: bool = True) -> HomingRefused:
    with pytest.raises(HomingRefused) as caught:
        found(table, rig, markers=markers)
    assert "\n" not in str(caught.value)
    assert table.plant.volts_V == (0.0, 0.0)
    assert max(abs(v) for pair in table.volts for v in pair) <= MOST_V
    return caught.value


@pytest.mark.parametrize("axis", [0, 1])
def test_a_dead_motor_is_named(axis):
    table = Miswired(REAL)
    table.dead_motor = axis
    error = refused(table)
    assert error.name == "stuck"
    assert f"channel {axis}" in str(error)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sense", ["tachometer", "markers", "none"])
def test_a_missing_encoder_is_told_from_a_stuck_arm_where_something_shows_it(axis, sense):
    table = Miswired(REAL)
    table.dead_encoder, table.tachometer = axis, sense == "tachometer"
    error = refused(table, markers=sense == "markers")
    assert error.name == ("stuck" if sense == "none" else "missing encoder")
    assert "encoder" in str(error)


def test_something_in_the_way_of_an_arm_is_named():
    table = Miswired(REAL)
    table.blocked_rad = (-0.2, 0.9)
    error = refused(table)
    assert error.name == "short way"
    assert "angle_limit_rad" in str(error)


def test_an_arm_without_a_linkage_is_named():
    free = replace(REAL, servo=replace(REAL.servo, stop_rad=30.0))
    assert refused(Miswired(free)).name == "no stop"


def test_a_plate_that_is_not_level_in_the_middle_is_named():
    table = Miswired(REAL)
    table.tilt = lambda t_s, see=table.tilt: (s := see(t_s)) and (s[0] + 0.05, s[1])
    error = refused(table)
    assert error.name == "not level"
    assert "degrees" in str(error)


def test_a_plate_that_does_not_follow_and_a_turned_camera_are_named():
    table = Miswired(REAL)
    table.tilt = lambda t_s, see=table.tilt: (s := see(t_s)) and (0.1 * s[0], s[1])
    assert refused(table).name == "plate does not follow"
    table = Miswired(REAL)
    table.tilt = lambda t_s, see=table.tilt: (s := see(t_s)) and (s[0], 1.5 * s[1])
    assert "pulse_us_per_rad" in str(refused(table))  # it went 1.5 times as far as it was told
    table = Miswired(REAL)
    table.tilt = lambda t_s, see=table.tilt: (s := see(t_s)) and (s[0] + s[1], s[0] - s[1])
    assert refused(table).name == "camera turned"


def test_one_cable_that_moves_both_encoders_is_named():
    table = Miswired(REAL)
    read = table.read

    def both():
        reading = read()
        return replace(reading, theta_rad=(reading.theta_rad[0],) * 2)

    table.read = both
    assert refused(table).name == "coupled"


@settings(max_examples=60)
@given(
    st.lists(
        st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.booleans()), min_size=5, max_size=300
    )
)
def test_whatever_the_encoders_say_the_volts_stay_low_and_it_ends(told):
    steps, t_s = plan(REAL), 0.0
    volts = next(steps)
    for a, b, seen in told * 20:
        assert max(map(abs, volts)) <= MOST_V
        t_s += 0.02
        try:
            volts = steps.send(Sight(t_s, (a, b), None, (0.001, 0.0) if seen else None))
        except (HomingRefused, StopIteration):
            return
    assert t_s < 150


def test_a_slow_camera_is_waited_for():
    table = Miswired(REAL, count_signs=(-1, 1))
    pictures = iter(range(10**9))

    def slow(t_s: float, see=table.tilt):
        seen = see(t_s)
        return seen if seen is not None and next(pictures) % 15 == 0 else None  # 4 Hz

    table.tilt = slow
    result = found(table)
    assert result.confirmed
    assert result.wiring.sign_angle == (-1, 1)


def test_zero_is_where_the_arms_are_level():
    table = Miswired(REAL, zeros=(500, -900))
    result = found(table)
    for arm, zero, right in zip((0, 1), result.wiring.zero_counts, (500, -900), strict=True):
        assert abs(zero - right) * STEP_RAD < 0.012, arm


@pytest.mark.parametrize("friction_V", [0.0, 0.3, 0.5])
@pytest.mark.parametrize("play_rad", [0.0, 0.052])
def test_it_measures_what_moves_each_arm_each_way(friction_V, play_rad):
    """Friction of motor, arm and joint, less or more the offset, as the rig's own numbers say; arms
    that are knocked by their motor through its play move a little early."""
    effects = dict(REAL.effects)
    effects["gear_backlash"] = {axis: {"play_rad": play_rad} for axis in ("x", "y")}
    effects["coulomb_friction"] = {axis: {"friction_V": friction_V} for axis in ("x", "y")}
    rig = replace(REAL, effects=effects)
    table = Miswired(rig, swap=True, volt_signs=(-1, 1), count_signs=(1, -1))
    result = found(table, rig)
    drive = rig.drive.arm_friction_nm + rig.drive.joint_friction_nm
    dry = friction_V + drive / rig.servo.torque_per_volt_nm
    for (up, down), axis in zip(result.breakaway_V, ("x", "y"), strict=True):
        offset = effects["voltage_offset"][axis]["offset_V"]
        assert up == pytest.approx(max(dry - offset, 0.0), abs=0.12)
        assert down == pytest.approx(max(dry + offset, 0.0), abs=0.12)
        # What surely moves it counts friction twice.
        assert up + 0.5 * (up + down) > dry - offset
        assert down + 0.5 * (up + down) > dry + offset


class Jumping(Miswired):
    """The encoder of a channel jumps by `jump_rad` at `jump_s`, or gives no number from then on."""

    jump_s, jump_rad, channel = np.inf, 0.0, 0

    def read(self):
        found = super().read()
        theta = list(found.theta_rad)
        if found.t_s >= self.jump_s:
            theta[self.channel] += self.jump_rad
        return replace(found, theta_rad=(theta[0], theta[1]))


@pytest.mark.parametrize("jump_rad", [0.08, -0.3, np.nan, np.inf])
@pytest.mark.parametrize("jump_s", [0.5, 6.0, 13.0, 20.0])
def test_an_encoder_that_jumps_is_no_zero_to_trust(jump_rad: float, jump_s: float):
    """A jump after both stops were found was taken: the zero was wrong by all of it."""
    table = Jumping(REAL)
    table.jump_s, table.jump_rad, table.channel = jump_s, jump_rad, 1
    error = refused(table, markers=False)
    assert error.name == ("encoder jump" if np.isfinite(jump_rad) else "no number")
    assert "encoder channel 1" in str(error)
