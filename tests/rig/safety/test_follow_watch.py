"""A servo that is told elsewhere and stays: named in time, and no healthy one ever is."""

from dataclasses import FrozenInstanceError, replace
from math import nan, pi, sin

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rig.parameters import Servo
from rig.safety.follow_watch import FollowWatch, patience_s, watch_following
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
    held = ended_s(lambda t: 0.2 if t >= 1.0 else 0.0, lambda t: 0.0)
    assert held == pytest.approx(1.0 + 0.3 + 0.07, abs=2.1 * TICK)
    assert ended_s(lambda t: 0.2 if t % 1.0 < 0.5 else -0.2, lambda t: 0.1) is not None


def test_small_commands_a_crooked_zero_and_servos_that_tell_nothing_are_left_alone():
    assert ended_s(lambda t: 0.149 * sin(9 * t), lambda t: 0.0) is None
    assert ended_s(lambda t: 0.0, lambda t: 0.19) is None  # its zero is off
    silent = replace(SERVO, angle_measured=False)
    assert ended_s(lambda t: 0.2, lambda t: nan, servo=silent) is None


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(st.floats(-0.25, 0.25), st.floats(0.05, 1.0)), min_size=1, max_size=6),
    st.floats(0.5, 1.5),
    st.floats(-0.1, 0.1),
    st.floats(0.0, 0.06),
)
def test_no_healthy_servo_is_ever_named(parts, scale: float, zero_rad: float, band_rad: float):
    """A lag behind a dead time, with another scale, zero and dead band than anybody knows."""
    ends, told = [0.0], []
    for angle, seconds in parts:
        ends.append(ends[-1] + seconds)
        told.append(angle)

    def command(t_s: float) -> float:
        now = next((k for k, end in enumerate(ends[1:]) if t_s < end), len(told) - 1)
        return told[now] if t_s >= 0.0 else 0.0

    seen, arm = [], 0.0
    for k in range(round(ends[-1] / TICK) + 150):
        goal = scale * command(k * TICK - 0.02)
        arm += (goal - arm) * TICK / 0.05 if abs(goal - arm) > band_rad else 0.0
        seen.append(zero_rad + arm)
    assert ended_s(command, lambda t: seen[round(t / TICK)], len(seen) * TICK) is None


def test_one_step_by_hand():
    one = FollowWatch(0.1, 0.5, 3.0)
    assert watch_following(one, 0.3, 0.512, 4.0) == FollowWatch(0.3, 0.512, 4.0)
    assert watch_following(one, 0.3, 0.488, 4.0) == FollowWatch(0.3, 0.488, 4.0)
    assert watch_following(one, 0.3, 0.511, 4.0) is one
    assert watch_following(one, 0.24, 0.505, 4.0) == FollowWatch(0.1, 0.5, 4.0)
    assert watch_following(one, -0.06, 0.5, 4.0) is one
    level = FollowWatch()
    assert level == FollowWatch(0.0, 0.0, 0.0)
    assert watch_following(level, 0.3, 0.012, 4.0) == FollowWatch(0.3, 0.012, 4.0)
    assert watch_following(level, 0.15, 0.0, 4.0) == FollowWatch(0.0, 0.0, 4.0)
    with pytest.raises(FrozenInstanceError):
        level.since_s = 1.0  # pyright: ignore[reportAttributeAccessIssue]
    slow = replace(SERVO, x={"lag_s": 0.2}, y={"dead_time_s": 0.1})
    assert patience_s(slow) == pytest.approx(0.3 + 0.2 + 0.1)
    assert 2 * pi / SERVO.encoder_counts_per_rev < 0.012
