"""When was a stamp of another clock, on the rig's clock (`time.monotonic`)?"""

from __future__ import annotations

import time
from collections import deque

# A camera's pipeline holds a few frames; a stamp older than this is from another clock.
OLDEST_S = 2.0
# Two readings of one clock agree to this, whatever rounding a header or driver does.
AHEAD_S = 0.002
# Crystals differ by some 50 ppm: over this time their drift stays below 1.5 ms.
WINDOW_S = 30.0


def own_clock(stamp_s: float, arrived_s: float, wall_minus_monotonic_s: float) -> float | None:
    """The time on `time.monotonic` [s] of a stamp of this machine (its monotonic clock, or seconds
    since 1970); None where it cannot be one: it lies after its arrival, or over `OLDEST_S`
    before."""
    for candidate_s in (stamp_s, stamp_s - wall_minus_monotonic_s):
        if -AHEAD_S <= arrived_s - candidate_s <= OLDEST_S:
            return min(candidate_s, arrived_s)
    return None


def wall_minus_monotonic() -> float:
    """Seconds by which the wall clock (since 1970) is ahead of the monotonic clock."""
    return time.time() - time.monotonic()


class ForeignClock:
    """Maps a clock of unknown zero by the fastest delivery of the last `window_s` (of that clock).

    A delay is never negative, so the smallest difference of arrival and stamp is the clocks'
    difference plus the shortest delay (NTP's filter, RFC 5905 section 10). What remains is that
    shortest delay, a constant which `rig calibrate time` finds; the jitter of the way is gone.
    """

    def __init__(self, window_s: float = WINDOW_S) -> None:
        self._window_s = window_s
        # (stamp, difference), differences increasing: the first is the window's smallest
        self._smallest: deque[tuple[float, float]] = deque()
        self._last_stamp_s: float | None = None

    def to_rig(self, stamp_s: float, arrived_s: float) -> float:
        """The stamp's time on the rig's clock [s], never after its arrival; a clock that was set
        back starts the window anew."""
        if self._last_stamp_s is not None and stamp_s <= self._last_stamp_s:
            self._smallest.clear()
        self._last_stamp_s = stamp_s
        difference = arrived_s - stamp_s
        while self._smallest and self._smallest[-1][1] >= difference:
            self._smallest.pop()
        self._smallest.append((stamp_s, difference))
        while self._smallest[0][0] < stamp_s - self._window_s:
            self._smallest.popleft()
        return min(stamp_s + self._smallest[0][1], arrived_s)
