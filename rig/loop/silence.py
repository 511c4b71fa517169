"""How long another process has been silent, but for the time in which this one was held up."""

import time

# A side that looks less often than this was held up itself; chosen: ten times the program's step
# between two looks.
LOOK_S = 0.1


class Silence:
    """The silence of one process, as another one hears it that looks again and again.

    A machine that stands still as a whole (suspended, swapping) holds up both, and the one that
    wakes first would find the other silent. Time between two looks therefore counts up to LOOK_S.
    """

    def __init__(self) -> None:
        self._beat_s, self._looked_s, self._held_up_s = 0.0, time.monotonic(), 0.0

    def seconds(self, beat_s: float) -> float:
        """Time since the other's last sign of life, at `beat_s` of the monotonic clock, less what
        this side was held up since then [s].
        """
        now_s = time.monotonic()
        if beat_s != self._beat_s:
            self._beat_s, self._held_up_s = beat_s, 0.0
        since_s = max(self._looked_s, beat_s)
        self._held_up_s += max(0.0, now_s - since_s - LOOK_S)
        self._looked_s = now_s
        return now_s - beat_s - self._held_up_s
