"""A simulated table held to the wall clock."""

import time
from collections.abc import Callable

from rig.loop.ticker import Ticker, sleep_until
from rig.safety.levelling import LevelOnExit
from rig.table import Reading, takes_angle


class Paced(LevelOnExit):
    """A simulated table held to the wall clock by absolute deadlines; late ticks are counted.

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
        self.voltage_limit_V, self.takes_angle = table.voltage_limit_V, takes_angle(table)
        until = sleep_until if sleep is None else lambda due_s: sleep(due_s - clock())
        self.ticker = Ticker(self.period_s, clock=clock, sleep_until=until)

    @property
    def table(self):
        """The table that is paced."""
        return self._table

    @property
    def late_ticks(self) -> int:
        """How often a tick came so late that points of the wall clock's grid were missed."""
        return self.ticker.late_ticks

    def read(self) -> Reading:
        """Wait for the next point of the wall clock's grid and return the table's reading."""
        self.ticker.wait()
        return self._table.read()

    def drive(self, volts: tuple[float, float]) -> None:
        """Apply volts (x, y) from now to the next tick. ValueError: volts that are not finite."""
        self._table.drive(volts)

    def close(self) -> None:
        """Close the table."""
        self._table.close()
