"""Times and observations of a hardware table's readings."""

import math
from collections.abc import Callable
from typing import Protocol

from vision.frames import Observation
from vision.sources.clock import ForeignClock

# Ticks come so often that the fastest of so short a time is fast. A resonator that is half a
# percent slow falls back by 2.5 ms meanwhile; in 30 s it would by more than a camera's delay. What
# waits in a halted host's buffer is less than this, and so is seen to be old.
TICKS_S = 0.5


class FromFirst:
    """Clock that turns moments of the host's monotonic clock into seconds from the first one.

    zero_s: the first moment on the host's clock; NaN before it.
    """

    def __init__(self) -> None:
        self.zero_s = math.nan  # the first reading's moment; NaN before it
        self._last_s = 0.0

    def seconds(self, host_s: float, least_step_s: float) -> float:
        """Return host_s [s] as seconds from the first moment, at least least_step_s after the
        last result.
        """
        if math.isnan(self.zero_s):
            self.zero_s = host_s
        else:
            self._last_s = max(host_s - self.zero_s, self._last_s + least_step_s)
        return self._last_s


class TickClock(FromFirst):
    """Clock that turns ticks counted by a device into seconds from the first reading.

    The device's clock has no jitter, but cameras are stamped by the host's: the fastest delivery of
    the last half second ties one to the other.
    """

    def __init__(self) -> None:
        super().__init__()
        self._foreign = ForeignClock(TICKS_S)

    def time(self, device_s: float, arrived_s: float, period_s: float) -> float:
        """Return the time of a tick in seconds from the first reading, strictly increasing.

        device_s: the device's time, which must have grown since the last call; arrived_s: when its
        tick arrived, on the host's monotonic clock; period_s: of the ticks.
        """
        return self.seconds(self._foreign.to_rig(device_s, arrived_s), 0.1 * period_s)


class ObservationSource(Protocol):
    """Whoever sees the ball."""

    def latest(self, after_s: float) -> Observation | None:
        """Return the newest observation exposed after `after_s` (run's time [s]), or None. OSError:
        the source has failed.
        """
        ...


class ObservationFeed:
    """Gives out the observations of a source: each once, and never before its exposure.

    An OSError of the source is raised once; after that there are no observations, as levelling
    needs no camera.
    """

    def __init__(self, eye: ObservationSource | None) -> None:
        self._eye, self._last_s = eye, float("-inf")

    def take(self, t_s: float) -> Observation | None:
        """Return the newest observation not given yet and exposed by `t_s` [s], or None.

        OSError: the source has failed, at the first call after it did.
        """
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


class BoardClock(FromFirst):
    """Clock that turns the board's microseconds (32 bits) into seconds from the first reading.

    clock: the host's monotonic clock [s].
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        super().__init__()
        self._clock, self._foreign = clock, ForeignClock(TICKS_S)
        self._board_us: int | None = None  # counted on beyond its 32 bits
        self._host_s = math.nan

    def heard(self, clock_us: int) -> bool:
        """Take the board's stamp clock_us at its arrival; the fastest deliveries tie it to the
        host's clock.

        Returns False for a stamp that is not newer than the last: doubled or overtaken on its way.
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
        """Time since the last stamp heard was given by the board [s]: large after this program was
        halted.
        """
        return self._clock() - self._host_s

    def reading(self) -> float:
        """Return the board's last stamp as the time of a reading: seconds since the first reading
        [s], strictly increasing.
        """
        return self.seconds(self._host_s, 1e-4)
