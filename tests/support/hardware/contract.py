"""The contract of a table: functions that the test of any table calls.

Each takes a fresh table that is open and ready (armed where it arms), its plate level and its ball
at rest at the centre; what only the plant knows comes in as functions.
"""

from collections.abc import Callable

import numpy as np
import pytest

from rig.table import Table

Pair = tuple[float, float]
DEAD_LINK_S = 0.1


class SabotageError(Exception):
    """What a controller's programming error looks like."""


def time_strictly_increases(
    table: Table,
    seconds: float = 1.0,
    *,
    clock: Callable[[], float] | None = None,
    jitter_s: float = 0.0,
) -> None:
    """Ticks come at the table's period; a table in real time may be late by `jitter_s`, and over
    the whole its times pass as its `clock` [s] does, since a busy machine may halt it for long."""
    n = round(seconds / table.period_s)
    times, seen = [], []
    for _ in range(n):
        times.append(table.read().t_s)
        seen.append(clock() if clock else len(seen) * table.period_s)
        table.drive((0.0, 0.0))
    gaps = np.diff(times)
    assert np.all(gaps > 0), gaps.min()
    assert np.median(gaps) == pytest.approx(table.period_s, rel=0.02, abs=jitter_s)
    assert times[-1] - times[0] == pytest.approx(seen[-1] - seen[0], rel=0.05, abs=10 * jitter_s)


def observations_follow_their_light(
    table: Table, seconds: float = 2.0, *, rate_hz: float = 60.0
) -> None:
    """Each observation comes once, in order, and never in a reading before its exposure."""
    seen = []
    for _ in range(round(seconds / table.period_s)):
        reading = table.read()
        table.drive((0.0, 0.0))
        if reading.ball is not None:
            assert reading.t_s >= reading.ball.exposed_s
            assert reading.t_s - reading.ball.exposed_s < 0.1
            seen.append(reading.ball.exposed_s)
    assert np.all(np.diff(seen) > 0)
    assert len(seen) == pytest.approx(rate_hz * seconds, rel=0.1, abs=2)


def positive_volts_raise_the_angle(
    table: Table, axis: int, sign: int, *, with_ball: bool = True
) -> None:
    """+V raises theta of its axis alone, and +theta sends the ball towards +."""
    wish = [0.0, 0.0]
    wish[axis] = 2.0 * sign
    theta, ball = (0.0, 0.0), (0.0, 0.0)
    for _ in range(round(0.5 / table.period_s)):
        reading = table.read()
        theta = reading.theta_rad
        table.drive((wish[0], wish[1]) if sign * theta[axis] < 0.2 else (0.0, 0.0))
        ball = reading.ball.xy_m if reading.ball else ball
    assert sign * theta[axis] > 0.1
    assert abs(theta[1 - axis]) < 0.01
    if with_ball:
        assert sign * ball[axis] > 0.005
        assert abs(ball[1 - axis]) < 0.002


def a_positive_angle_turns_its_arm(
    table: Table, axis: int, sign: int, arms_rad: Callable[[], Pair], most_rad: float
) -> None:
    """A servo that takes an angle goes there, alone, and +theta sends the ball towards +."""
    wish, ball = [0.0, 0.0], (0.0, 0.0)
    wish[axis] = 0.4 * most_rad * sign
    for _ in range(round(0.7 / table.period_s)):
        reading = table.read()
        table.drive((wish[0], wish[1]))
        ball = reading.ball.xy_m if reading.ball else ball
    assert arms_rad() == pytest.approx(wish, abs=0.005)
    assert sign * ball[axis] > 0.005
    assert abs(ball[1 - axis]) < 0.002


def leaving_levels_servos_that_take_an_angle(
    table,
    told_rad: Callable[[], Pair],
    arms_rad: Callable[[], Pair],
    most_rad: float,
    *,
    fails: bool,
) -> None:
    """The context ends with the angle 0 told and followed, after an exception as well."""

    def work() -> None:
        with table:
            for _ in range(round(0.4 / table.period_s)):
                table.read()
                table.drive((0.6 * most_rad, -0.6 * most_rad))
            assert min(map(abs, arms_rad())) > 0.5 * most_rad
            if fails:
                raise SabotageError

    if fails:
        with pytest.raises(SabotageError):
            work()
    else:
        work()
    assert told_rad() == pytest.approx((0.0, 0.0), abs=0.001)  # half a us of pulse
    assert np.all(np.abs(arms_rad()) < 0.03), arms_rad()


def leaving_gives_level_and_no_volts(
    table, volts_V: Callable[[], Pair], arms_rad: Callable[[], Pair], *, fails: bool
) -> None:
    """The context ends at 0 V and level, after an exception as well; the exception is told."""

    def work() -> None:
        with table:
            theta = (0.0, 0.0)
            for _ in range(round(0.2 / table.period_s)):
                theta = table.read().theta_rad
                table.drive((3.0, -3.0))
            assert min(map(abs, theta)) > 0.05
            if fails:
                raise SabotageError

    if fails:
        with pytest.raises(SabotageError):
            work()
    else:
        work()
    assert volts_V() == (0.0, 0.0)
    # What friction and offset leave of level: 0.36 V / 14 V/rad.
    assert np.all(np.abs(arms_rad()) < 0.03), arms_rad()


def a_dead_link_raises_by_name(
    table: Table,
    kill: Callable[[], None],
    clock: Callable[[], float],
    error: type[OSError],
    name: str,
    *,
    slack_s: float = 0.0,
) -> None:
    """Within 100 ms of `kill`, read or drive raises `error` with the device's name, and again."""
    for _ in range(20):
        table.read()
        table.drive((0.5, 0.5))
    kill()
    begin = clock()

    def work() -> None:
        while clock() - begin < 1.0:
            table.read()
            table.drive((0.5, 0.5))

    with pytest.raises(error, match=name):
        work()
    assert clock() - begin <= DEAD_LINK_S + slack_s
    with pytest.raises(error, match=name):
        table.read()
