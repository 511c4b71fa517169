"""A simulated table held to the wall clock."""

import time
from collections.abc import Callable

from rig.deadlines import Ticker, sleep_until
from rig.levelling import LevelOnExit
from rig.table import Reading


class Paced(LevelOnExit):
    """Holds a simulated table to the wall clock: absolute deadlines, late ticks counted.

    `clock` and `sleep` (seconds) stand for those of the system in tests.
    """

    def __init__(
        self,
        table,
        *,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] | None = None,
    ) -> None:
        self._table = table
        self.period_s = table.period_s
        self.voltage_limit_V = table.voltage_limit_V
        until = sleep_until if sleep is None else lambda due_s: sleep(due_s - clock())
        self.ticker = Ticker(self.period_s, clock=clock, sleep_until=until)

    @property
    def table(self):
        """The table that is paced."""
        return self._table

    @property
    def late_ticks(self) -> int:
        return self.ticker.late_ticks

    def read(self) -> Reading:
        self.ticker.wait()
        return self._table.read()

    def drive(self, volts: tuple[float, float]) -> None:
        self._table.drive(volts)

    def close(self) -> None:
        self._table.close()
