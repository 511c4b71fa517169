"""A servo that is told elsewhere and stays: named in time, and no healthy one ever is."""

from dataclasses import FrozenInstanceError, replace
from math import exp, inf, log, nan, sin

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from rig.parameters import Servo
from rig.safety.follow_watch import FollowLimits, FollowWatch, watch_following
from rig.safety.monitor import MonitorLimits, MonitorState, check
from rig.table import Reading

TICK = 0.004
SERVO = Servo(kind="position", angle_measured=True, lag_s=0.05, dead_time_s=0.02)


def ended_s(told, theta, seconds: float = 4.0, servo: Servo = SERVO) -> float | None:
    """When the monitor ends a run with a command told(t) and an arm at theta(t); None: never."""
    limits, state = MonitorLimits.of_servo(servo, TICK), MonitorState()
    for k in range(round(seconds / TICK)):
        t_s = k * TICK
        reading = Reading(t_s, (theta(t_s), 0.0))
        state, fault = check(state, limits, reading, (told(t_s - TICK), 0.0), balancing=False)
        if fault is not None:
            assert (fault.name, fault.axis, fault.level) == ("stall", 0, False)
            assert "servo x stays" in fault.reason
            return t_s
    return None


def test_an_arm_that_is_held_is_named_when_it_should_have_moved():
    """Led by a lag of 70 ms to 0.2 of 0.3 rad after 70 ln 3 ms, it has 0.3 s and these 70 ms."""
    held = ended_s(lambda t: 0.3 if t >= 1.0 else 0.0, lambda t: 0.0)
    assert held == pytest.approx(1.0 + 0.07 * log(3.0) + 0.3 + 0.07, abs=3 * TICK)
    assert ended_s(lambda t: 0.3 if t % 1.0 < 0.5 else -0.3, lambda t: 0.1) is not None


def test_small_commands_a_crooked_zero_and_servos_that_tell_nothing_are_left_alone():
    assert ended_s(lambda t: 0.199 * sin(9 * t), lambda t: 0.0) is None
    assert ended_s(lambda t: 0.0, lambda t: 0.19) is None  # its zero is off
    silent = replace(SERVO, angle_measured=False)
    assert ended_s(lambda t: 0.2, lambda t: nan, servo=silent) is None


SERVOS = st.sampled_from(
    [
        SERVO,
        replace(SERVO, dead_time_s=0.0),
        replace(SERVO, dead_time_s=0.015, lag_s=0.035, rate_limit_rad_s=4.7),
        replace(SERVO, dead_time_s=0.015, lag_s=0.035, rate_limit_rad_s=1.0),
        replace(SERVO, dead_time_s=0.015, lag_s=0.2, rate_limit_rad_s=2.0),
    ]
)
ANGLES = st.floats(-0.25, 0.25)
LONG, SHORT = st.tuples(ANGLES, st.floats(0.05, 1.0)), st.tuples(ANGLES, st.floats(0.004, 0.1))


@settings(max_examples=200, deadline=None)
@given(
    SERVOS,
    st.lists(st.one_of(LONG, SHORT), min_size=1, max_size=12),
    st.floats(0.85, 1.2),
    st.floats(-0.1, 0.1),
    st.floats(0.0, 0.06),
)
@example(SERVO, [(0.0, 0.9), (0.16, 0.008), (0.0, 0.5)], 1.0, 0.0, 0.005)
def test_no_healthy_servo_is_ever_named(servo, parts, scale, zero_rad, band_rad):
    """A lag behind a dead time, with another scale, zero and dead band than anybody knows; also
    under a command that jumps to and fro and then rests, which was called a stall.
    """
    ends, told = [0.0], []
    for angle, seconds in parts:
        ends.append(ends[-1] + seconds)
        told.append(angle)

    def command(t_s: float) -> float:
        now = next((k for k, end in enumerate(ends[1:]) if t_s < end), len(told) - 1)
        return told[now] if t_s >= 0.0 else 0.0

    seen, arm, most = [], 0.0, servo.rate_limit_rad_s * TICK
    for k in range(round(ends[-1] / TICK) + 150):
        goal = scale * command(k * TICK - servo.dead_time_s)
        way = (goal - arm) * TICK / servo.lag_s if abs(goal - arm) > band_rad else 0.0
        arm += min(max(way, -most), most)
        seen.append(zero_rad + arm)
    shown = lambda t: seen[round(t / TICK)]  # noqa: E731
    assert ended_s(command, shown, len(seen) * TICK, servo) is None


def test_one_step_by_hand():
    at_once, one = FollowLimits(0.0, inf, 0.3), FollowWatch(0.1, 0.1, 0.5, 3.0)

    def after(told: float, theta: float, limits: FollowLimits = at_once) -> FollowWatch:
        return watch_following(one, limits, told, theta, 4.0, 0.5)

    assert after(0.3, 0.512) == FollowWatch(0.3, 0.3, 0.512, 4.0)
    assert after(0.3, 0.488) == FollowWatch(0.3, 0.3, 0.488, 4.0)
    assert after(0.31, 0.511) == FollowWatch(0.31, 0.1, 0.5, 3.0)
    assert after(0.29, 0.505) == FollowWatch(0.29, 0.1, 0.5, 4.0)
    assert after(-0.5, 0.5) == FollowWatch(-0.5, 0.1, 0.5, 3.0)
    late = after(0.3, 0.5, FollowLimits(0.25, inf, 0.3))
    assert late.led_rad == pytest.approx(0.1 + 0.2 * (1 - exp(-2.0)))
    slow = FollowLimits(0.25, 0.25, 0.3)
    assert after(9.0, 0.5, slow).led_rad == pytest.approx(0.1 + 0.125)
    assert after(-9.0, 0.5, slow).led_rad == pytest.approx(0.1 - 0.125)
    level = FollowWatch()
    assert level == FollowWatch(0.0, 0.0, 0.0, 0.0)
    moved = watch_following(level, at_once, 0.3, 0.012, 4.0, 0.5)
    assert moved == FollowWatch(0.3, 0.3, 0.012, 4.0)
    assert watch_following(level, at_once, 0.2, 0.0, 4.0, 0.5) == FollowWatch(0.2, 0.0, 0.0, 4.0)
    for each, name in ((level, "since_s"), (at_once, "late_s")):
        with pytest.raises(FrozenInstanceError):
            setattr(each, name, 1.0)


def test_the_limits_are_those_of_the_slower_axis():
    own = {"x": {"lag_s": 0.2, "rate_limit_rad_s": 3.0}, "y": {"dead_time_s": 0.1}}
    servo = replace(SERVO, **own, rate_limit_rad_s=5.0)
    assert FollowLimits.of_servo(servo) == FollowLimits(pytest.approx(0.3), 3.0, pytest.approx(0.6))
