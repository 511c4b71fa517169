"""A board's clock on the host's, and the times of its readings."""

import math
from collections.abc import Callable

from rig.hardware.seen import TICKS_S, FromFirst
from vision.clock import ForeignClock


class BoardClock(FromFirst):
    """The board's clock (microseconds, wrapping) -> seconds from the first reading."""

    def __init__(self, clock: Callable[[], float]) -> None:
        super().__init__()
        self._clock, self._foreign = clock, ForeignClock(TICKS_S)
        self._board_us: int | None = None  # counted on beyond its 32 bits
        self._host_s = math.nan

    def heard(self, clock_us: int) -> bool:
        """Note a stamp on its arrival: its place on the host's clock, by the fastest deliveries.

        False for one that is not newer than the last: doubled or overtaken on its way.
        """
        if self._board_us is None:
            self._board_us = clock_us
        else:
            passed_us = (clock_us - self._board_us) % 2**32
            if not 0 < passed_us < 2**31:
                return False
            self._board_us += passed_us
        self._host_s = self._foreign.to_rig(1e-6 * self._board_us, self._clock())
        return True

    def age_s(self) -> float:
        """How long ago the last stamp heard was given: large after a halt of this program."""
        return self._clock() - self._host_s

    def reading(self) -> float:
        """Seconds of the last stamp heard from the first reading; strictly increasing."""
        return self.seconds(self._host_s, 1e-4)
