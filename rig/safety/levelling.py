"""Bringing the plate level by its encoders, as long as they show that the arms follow."""

from math import ceil, inf
from types import TracebackType
from typing import Self

from rig.safety.limits import Braking, limit
from rig.safety.monitor import MonitorLimits, StallWatch, watch_stall
from rig.table import Table, takes_angle

LEVEL_GAIN_V_RAD = 14.0
LEVEL_LIMIT_V = 3.0  # at most, and never above the table's own limit
MOST_TICKS = 1.1  # chosen: of those that levelling takes, where the table's time hardly passes
_AT_REST = Braking(delay_s=0.0, time_constant_s=0.0, top_speed_rad_s=1.0)  # no angle limit
_FOLLOWS = MonitorLimits(0.0, inf, inf, inf)  # of these only what a stall is


class Levelling:
    """Volts that bring the plate level, tick by tick.

    An arm that strong volts do not move towards level (blocked, its plug turned round, its encoder
    off) gets none any more: levelling would drive it into its stop.
    """

    def __init__(self, voltage_limit_V: float) -> None:
        self._most_V = min(LEVEL_LIMIT_V, voltage_limit_V)
        self._volts, self._pushes = [0.0, 0.0], [StallWatch(), StallWatch()]
        self._follows = [True, True]

    def volts(self, theta_rad: tuple[float, float], t_s: float) -> tuple[float, float]:
        """Return the volts (x, y) [V] from this reading to the next; theta_rad: encoder angles (x,
        y), t_s: the reading's time.
        """
        most = self._most_V
        for a, theta in enumerate(theta_rad):
            one = watch_stall(self._pushes[a], _FOLLOWS, self._volts[a], theta, t_s)
            stalled = one.sign != 0.0 and t_s - one.since_s > _FOLLOWS.stall_s
            self._pushes[a], self._follows[a] = one, self._follows[a] and not stalled
            commanded = -LEVEL_GAIN_V_RAD * theta if self._follows[a] else 0.0
            self._volts[a] = limit(commanded, theta, 0.0, 0.0, most, inf, inf, _AT_REST)
        return self._volts[0], self._volts[1]


class LevelOnExit:
    """Mixin of a table: leaving the context levels the plate for `level_s`, gives 0 V and closes
    it.

    A table that has ended (`_end`) is closed only: it levels by itself, or cannot be told to.
    """

    level_s: float = 0.6
    _ended: OSError | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            if self._ended is None:
                bring_level(self, self.level_s)  # pyright: ignore[reportArgumentType]
        finally:
            self.close()  # pyright: ignore[reportAttributeAccessIssue]

    def _end(self, error: OSError) -> OSError:
        """Remember how it ended: every later call says the same."""
        self._ended = error
        return error


def bring_level(table: Table, seconds: float) -> None:
    """Drive both servos to zero for `seconds` of the table's time, or as many ticks where that
    stands still, then 0 V whatever happened.

    Servos that take an angle are told 0 and stay told so.

    OSError: as `read` and `drive` of the table raise it.
    """
    levelling = Levelling(table.voltage_limit_V)
    try:
        first = table.read()
        now = first
        for _ in range(ceil(MOST_TICKS * seconds / table.period_s)):
            if now.t_s - first.t_s >= seconds:
                break
            level = (0.0, 0.0)
            if not takes_angle(table):
                level = levelling.volts(now.theta_rad, now.t_s)
            table.drive(level)
            now = table.read()
    finally:
        table.drive((0.0, 0.0))
