"""Times and observations of a hardware table's readings."""

import math

from rig.hardware.choose import Eye
from vision.clock import ForeignClock
from vision.frames import Observation

# Ticks come so often that the fastest of so short a time is fast. A resonator that is half a
# percent slow falls back by 2.5 ms meanwhile; in 30 s it would by more than a camera's delay. What
# waits in a halted host's buffer is less than this, and so is seen to be old.
TICKS_S = 0.5


class FromFirst:
    """Moments on the host's monotonic clock -> seconds from the first, strictly increasing."""

    def __init__(self) -> None:
        self.zero_s = math.nan  # the first reading's moment; NaN before it
        self._last_s = 0.0

    def seconds(self, host_s: float, least_step_s: float) -> float:
        if math.isnan(self.zero_s):
            self.zero_s = host_s
        else:
            self._last_s = max(host_s - self.zero_s, self._last_s + least_step_s)
        return self._last_s


class TickClock(FromFirst):
    """Ticks counted by a device -> seconds from the first reading.

    The device's clock has no jitter, the host's is the one that the camera is stamped by: the
    fastest delivery of the last half second ties one to the other.
    """

    def __init__(self) -> None:
        super().__init__()
        self._foreign = ForeignClock(TICKS_S)

    def time(self, device_s: float, arrived_s: float, period_s: float) -> float:
        """Seconds from the first reading; `device_s` must have grown since the last call."""
        return self.seconds(self._foreign.to_rig(device_s, arrived_s), 0.1 * period_s)


class Seen:
    """Picks up what an eye saw: each observation once, and never before its light.

    What the eye raises is raised once: levelling afterwards needs no camera.
    """

    def __init__(self, eye: Eye | None) -> None:
        self._eye, self._last_s = eye, float("-inf")

    def look(self, t_s: float) -> Observation | None:
        """The newest observation that was not given yet and is not of the future."""
        if self._eye is None:
            return None
        try:
            ball = self._eye.latest(self._last_s)
        except OSError:
            self._eye = None
            raise
        if ball is None or not self._last_s < ball.exposed_s <= t_s:
            return None
        self._last_s = ball.exposed_s
        return ball
