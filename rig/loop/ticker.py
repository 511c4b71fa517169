"""Ticks on an absolute grid of the monotonic clock: late ones are counted, never caught up."""

import ctypes
import sys
import time
from collections.abc import Callable

MONOTONIC, ABSOLUTE, INTERRUPTED = 1, 1, 4  # CLOCK_MONOTONIC, TIMER_ABSTIME, EINTR on Linux


class _Timespec(ctypes.Structure):
    _fields_ = (("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long))


def _sleeper() -> Callable[[float], None]:
    """The best way of this system to sleep until a time of `time.monotonic`."""
    if sys.platform.startswith("linux") and ctypes.sizeof(ctypes.c_long) == 8:
        nanosleep = getattr(ctypes.CDLL(None), "clock_nanosleep", None)
        if nanosleep is not None:
            nanosleep.argtypes = (ctypes.c_int, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)

            def absolute(due_s: float) -> None:
                """clock_nanosleep(2): no time is lost between reading the clock and sleeping."""
                seconds = int(due_s)
                until = _Timespec(seconds, int(1e9 * (due_s - seconds)))
                address = ctypes.addressof(until)
                while nanosleep(MONOTONIC, ABSOLUTE, address, None) == INTERRUPTED:
                    pass  # a signal's handler has run meanwhile

            return absolute

    def relative(due_s: float) -> None:
        while (left_s := due_s - time.monotonic()) > 0.0:
            time.sleep(left_s)

    return relative


sleep_until = _sleeper()


class Ticker:
    """Ticks on a grid of `period_s` from the first `wait` on; no late tick is made up for.

    late_s: how long after the point that was due the last tick came; missed: points without a tick;
    late_ticks: how often points were missed. clock, sleep_until [s]: stand for the system's in
    tests.
    """

    def __init__(
        self,
        period_s: float,
        *,
        clock: Callable[[], float] = time.monotonic,
        sleep_until: Callable[[float], None] = sleep_until,
    ) -> None:
        self.period_s, self._clock, self._sleep_until = period_s, clock, sleep_until
        self.late_s, self.missed, self.late_ticks = 0.0, 0, 0
        self._start_s: float | None = None
        self._point = 0

    def wait(self) -> float:
        """Sleep until the next point of the grid that is still to come; return `late_s` [s]."""
        now_s = self._clock()
        if self._start_s is None:
            self._start_s = now_s
            return 0.0
        wanted_s = self._due(self._point + 1)
        self._point += 1
        if now_s > wanted_s:  # resynchronise: the points that have passed are gone
            passed = 1 + int((now_s - wanted_s) / self.period_s)
            self._point += passed
            self.missed += passed
            self.late_ticks += 1
        self._sleep_until(self._due(self._point))
        self.late_s = self._clock() - wanted_s
        return self.late_s

    def _due(self, point: int) -> float:
        return (self._start_s or 0.0) + point * self.period_s
