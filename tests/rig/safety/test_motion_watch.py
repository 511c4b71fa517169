"""The law of an arm that stands still: silent on whatever a healthy arm may do, and in time."""

from dataclasses import FrozenInstanceError, replace
from math import exp, inf, isnan, pi, radians

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from rig.parameters import Ball, Rig, Servo
from rig.safety.motion_watch import (
    UNKNOWN,
    MotionLimits,
    MotionWatch,
    is_overdue,
    sure_volts,
    watch_motion,
    way_of,
)

TICK = 0.002
SERVO = Servo(gain_rad_s_V=1.6, time_constant_s=0.05)
SURE = (0.75, 0.5)
STEP = 2 * pi / 4096


def limits_of() -> MotionLimits:
    return MotionLimits.of_servo(SERVO, (SURE, SURE))


def overdue_s(volts, theta=lambda k: 0.0, ticks=2000, limits=None) -> float | None:
    """When an arm at theta(k) is called still under volts(k); None: never."""
    limits, seen = limits or limits_of(), MotionWatch()
    for k in range(ticks):
        seen = watch_motion(seen, limits, limits.sure_V[0], volts(k), theta(k), TICK)
        if is_overdue(seen, limits):
            return k * TICK
    return None


@pytest.mark.parametrize(("volts", "over"), [(1.0, 0.25), (-1.0, 0.5), (3.0, 2.25), (-0.6, 0.1)])
def test_a_still_arm_is_called_so_when_volts_have_pushed_far_enough(volts: float, over: float):
    """Closed form: the lagged volts pass `sure` after tau ln(V/(V - sure)), then push the way."""
    limits = limits_of()
    sure, way, size = abs(volts) - over, 0.0, abs(volts)
    expected, lagged = 0.0, 0.0
    while way <= limits.way_rad:  # the same integral in steps of its own
        expected += 1e-4
        lagged = size * (1.0 - exp(-expected / 0.05))
        way += 1e-4 * 1.6 * max(lagged - sure, 0.0)
    assert overdue_s(lambda k: volts) == pytest.approx(expected, abs=3 * TICK)


@pytest.mark.parametrize("volts", [0.75, -0.5, 0.0])
def test_volts_that_may_leave_it_at_rest_never_make_it_overdue(volts: float):
    assert overdue_s(lambda k: volts) is None
    assert overdue_s(lambda k: 1.99, limits=MotionLimits.of_servo(SERVO)) is None  # nobody knows


def test_a_motion_either_way_begins_anew():
    limits = limits_of()
    for sign in (1.0, -1.0):
        creeps = lambda k, s=sign: s * 0.0121 * (k // 40)  # noqa: E731
        assert overdue_s(lambda k: 1.0, creeps) is None
        less = lambda k, s=sign: s * 0.0119 * ((k // 40) % 2)  # noqa: E731
        assert overdue_s(lambda k: 1.0, less) is not None
    seen = MotionWatch(1.0, 0.01, 0.02, 0.25)
    exact = replace(limits, moved_rad=0.25)
    for theta in (0.5, 0.0, 7.0):
        now = watch_motion(seen, exact, SURE, 1.0, theta, TICK)
        assert (now.up_rad, now.down_rad, now.theta_rad) == (0.0, 0.0, theta)
    assert watch_motion(seen, exact, SURE, 1.0, 0.45, TICK).theta_rad == 0.25


@pytest.mark.parametrize("counts", [3, 5, 7])
@pytest.mark.parametrize("volts", [1.0, 2.0, 6.0])
def test_an_encoder_that_stands_and_flickers_is_seen(counts: int, volts: float):
    """A plug that is half out; 3 counts of 4096 passed for a motion, for ever."""
    flickers = lambda k: counts * STEP * (k // 3 % 2)  # noqa: E731
    seen_s, frozen_s = overdue_s(lambda k: volts, flickers), overdue_s(lambda k: volts)
    assert seen_s == frozen_s
    assert seen_s is not None


def test_volts_to_and_fro_push_nowhere():
    assert overdue_s(lambda k: 2.0 if k % 20 < 10 else -2.0) is None
    assert overdue_s(lambda k: 1.0 if k % 50 < 25 else 0.7) is not None  # what is left adds up


def test_one_step_by_hand():
    seen = watch_motion(MotionWatch(1.0, 0.01, 0.02, 0.0), limits_of(), SURE, 2.0, 0.0, TICK)
    lagged = 2.0 - exp(-TICK / 0.05)
    up, down = 0.01 + 1.6 * TICK * (lagged - 0.75), 0.02 - 1.6 * TICK * (2.0 + 0.5)
    assert (seen.lagged_V, seen.up_rad) == (pytest.approx(lagged), pytest.approx(up))
    assert (seen.down_rad, seen.theta_rad) == (pytest.approx(down), 0.0)
    slower = watch_motion(MotionWatch(1.0, 0.01, 0.0, 0.0), limits_of(), SURE, 0.9, 0.0, TICK)
    assert slower.up_rad == pytest.approx(0.01 + 1.6 * TICK * (0.9 - 0.75))
    assert slower.down_rad == 0.0
    fresh = watch_motion(MotionWatch(), limits_of(), SURE, 6.0, 0.3, TICK)
    assert (fresh.up_rad, fresh.down_rad, fresh.theta_rad) == (0.0, 0.0, 0.3)
    assert isnan(MotionWatch().theta_rad)
    assert (MotionWatch().lagged_V, MotionWatch().up_rad, MotionWatch().down_rad) == (0.0,) * 3


def test_volts_of_a_late_tick_count_as_long_as_a_board_applies_them():
    one = MotionWatch(1.0, 0.01, 0.02, 0.0)
    late, known = (watch_motion(one, limits_of(), SURE, 2.0, 0.0, s) for s in (0.09, 0.02))
    assert late == known
    assert watch_motion(one, limits_of(), SURE, 2.0, 0.0, 0.019).up_rad < known.up_rad


def test_edges_and_what_cannot_be_changed():
    limits = replace(limits_of(), way_rad=0.25)
    assert not is_overdue(MotionWatch(0.0, 0.25, 0.25, 0.0), limits)
    assert is_overdue(MotionWatch(0.0, 0.2501, 0.0, 0.0), limits)
    assert is_overdue(MotionWatch(0.0, 0.0, 0.2501, 0.0), limits)
    for one, name in ((limits, "way_rad"), (MotionWatch(), "up_rad")):
        with pytest.raises(FrozenInstanceError):
            setattr(one, name, 0.0)


def test_the_way_follows_from_play_and_counts():
    assert way_of(STEP) == (0.012, pytest.approx(2 * (radians(3.0) + 0.012)))
    assert way_of(0.01) == (0.025, pytest.approx(2 * (radians(3.0) + 0.025)))
    known = MotionLimits.of_servo(replace(SERVO, encoder_counts_per_rev=100), (SURE, SURE))
    assert (known.moved_rad, known.way_rad) == way_of(2 * pi / 100)
    assert (known.gain_rad_s_V, known.time_constant_s) == (1.6, 0.05)
    assert known.sure_V == (SURE, SURE)
    assert ((inf, inf), (inf, inf)) == UNKNOWN
    assert MotionLimits.of_servo(SERVO).sure_V == ((2.0, 2.0), (2.0, 2.0))
    assert MotionLimits.of_servo(SERVO, ((0.5, 3.0), (inf, 1.0))).sure_V == ((0.5, 2.0), (2.0, 1.0))
    assert MotionLimits(1.0, 1.0, 1.0, 1.0).sure_V == ((2.0, 2.0), (2.0, 2.0))


@pytest.mark.parametrize(("on", "off", "rest_V"), [(38, 1, 0.0), (38, 1, 1.99), (25, 5, 0.0)])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_strong_volts_with_pauses_are_seen_without_a_homing(on, off, rest_V, way: float):
    """Ticks of full volts, and a few of what no stall begins with: the arm went to its stop."""
    limits = MotionLimits.of_servo(Servo())
    seen, k = MotionWatch(), 0
    while not is_overdue(seen, limits):
        volts = 6.0 if k % (on + off) < on else rest_V
        seen = watch_motion(seen, limits, limits.sure_V[0], way * volts, 0.1, 0.002)
        k += 1
        assert k < 50  # 100 ms


def test_volts_that_surely_move_are_of_twice_the_friction_with_the_same_offset():
    light = Rig(ball=Ball(mass_kg=1e-9))
    found = sure_volts(light, ((0.5, 0.3), (0.2, 0.4)))
    assert found == (pytest.approx((0.9, 0.7)), pytest.approx((0.5, 0.7)))
    heavy = Rig(ball=Ball(mass_kg=0.25))
    load_V = 0.25 * 9.81 * 0.18473 * 0.1375 / heavy.servo.torque_per_volt_nm
    assert sure_volts(heavy, ((0.0, 0.0), (0.0, 0.0)))[1] == pytest.approx((load_V,) * 2, rel=1e-3)
    for untold in ((), ((0.1, 0.1),), ((0.1, 0.1),) * 3):
        assert sure_volts(heavy, untold) == UNKNOWN


def healthy_arm(
    parts: list[tuple[float, int]], friction_V: float, play_rad: float, gain: float, tau: float
) -> float:
    """The largest push before a motion [share of the way] of a motor with dry friction and play,
    its arm seen by an encoder; an integrator of its own, steps of 0.25 ms."""
    limits = limits_of()
    seen, w, motor, arm, most = MotionWatch(), 0.0, 0.0, 0.0, 0.0
    for volts, ticks in parts:
        for _ in range(ticks):
            for _ in range(8):
                h = TICK / 8
                free = w + h * (gain * volts - w) / tau
                dry = h * gain * friction_V / tau
                w = max(free - dry, 0.0) + min(free + dry, 0.0)
                motor += h * w
                arm = min(max(arm, motor - play_rad / 2), motor + play_rad / 2)
            shown = STEP * round(arm / STEP)
            seen = watch_motion(seen, limits, SURE, volts, shown, TICK)
            most = max(most, seen.up_rad, seen.down_rad)
    return most / limits.way_rad


PARTS = st.lists(st.tuples(st.floats(-6.0, 6.0), st.integers(1, 150)), min_size=1, max_size=8)


@settings(max_examples=150, deadline=None)
@given(
    PARTS,
    st.floats(0.0, 0.5),
    st.floats(0.0, radians(3.0)),
    st.floats(0.5, 1.2),
    st.floats(0.7, 1.3),
)
@example([(0.52, 150)] * 8, 0.5, radians(3.0), 0.5, 1.0)
@example([(-0.76, 150), (0.76, 150)] * 4, 0.5, radians(3.0), 0.5, 1.3)
@example([(-6.0, 60), (1.0, 150)] * 4, 0.5, radians(3.0), 0.5, 1.3)
def test_no_healthy_arm_is_ever_overdue(parts, friction_V, play_rad, gain, tau):
    assert healthy_arm(parts, friction_V, play_rad, 1.6 * gain, 0.05 * tau) < 1.0


def test_an_arm_just_healthy_comes_near():
    """Half the gain, all the play, all the friction: the bound is no larger than it needs to be."""
    share = healthy_arm([(3.0, 200), (0.0, 100), (-1.1, 300)], 0.5, radians(3.0), 0.8, 0.05)
    assert 0.4 < share < 1.0
