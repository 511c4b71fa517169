"""A simulated table held to the wall clock."""

import time

from rig.table import LevelOnExit, Reading


class Paced(LevelOnExit):
    """Holds a simulated table to the wall clock: absolute deadlines, late ticks counted."""

    def __init__(self, table, *, clock=time.monotonic, sleep=time.sleep) -> None:
        self._table, self._clock, self._sleep = table, clock, sleep
        self.period_s = table.period_s
        self.voltage_limit_V = table.voltage_limit_V
        self.late_ticks = 0
        self._due: float | None = None

    def read(self) -> Reading:
        now = self._clock()
        if self._due is None:
            self._due = now
        elif now > self._due + self.period_s:  # never caught up in a burst: start counting anew
            self.late_ticks += 1
            self._due = now
        if self._due > now:
            self._sleep(self._due - now)
        self._due += self.period_s
        return self._table.read()

    def drive(self, volts: tuple[float, float]) -> None:
        self._table.drive(volts)

    def close(self) -> None:
        self._table.close()
