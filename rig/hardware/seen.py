"""Times and observations of a hardware table's readings."""

from rig.hardware.choose import Eye
from vision.clock import ForeignClock
from vision.frames import Observation


class TickClock:
    """Ticks counted by a device -> seconds from the first, on the host's monotonic clock.

    The device's clock has no jitter, the host's is the one that the camera is stamped by: the
    fastest delivery of the last seconds ties one to the other. Times strictly increase.
    """

    def __init__(self) -> None:
        self._foreign = ForeignClock()
        self._zero_s: float | None = None
        self._last_s = -1.0

    @property
    def zero_s(self) -> float:
        """The first reading's moment on the host's clock. RuntimeError before it."""
        if self._zero_s is None:
            raise RuntimeError("no reading yet")
        return self._zero_s

    def time(self, device_s: float, arrived_s: float, period_s: float) -> float:
        """Seconds from the first reading; `device_s` must have grown since the last call."""
        host_s = self._foreign.to_rig(device_s, arrived_s)
        if self._zero_s is None:
            self._zero_s, self._last_s = host_s, 0.0
            return 0.0
        self._last_s = max(host_s - self._zero_s, self._last_s + 0.1 * period_s)
        return self._last_s


class Seen:
    """Picks up what an eye saw: each observation once, and never before its light."""

    def __init__(self, eye: Eye | None) -> None:
        self._eye, self._last_s = eye, float("-inf")

    def look(self, t_s: float) -> Observation | None:
        """The newest observation that was not given yet and is not of the future."""
        if self._eye is None:
            return None
        ball = self._eye.latest(self._last_s)
        if ball is None or not self._last_s < ball.exposed_s <= t_s:
            return None
        self._last_s = ball.exposed_s
        return ball
