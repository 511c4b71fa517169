"""A watch for a link that is late: the servo loop closes over it, and swings where it is too slow.

The inner loop is V = P (reference - theta), the servo tau w' = K V - w. With k = K P and a round
trip T of command and answer

    L(s) = k exp(-s T) / (s (1 + tau s)),
    |L(i w)| = 1    at    w^2 = 2 k^2 / (1 + sqrt(1 + (2 tau k)^2)),

so that the loop is stable for T below its delay margin (pi/2 - atan(tau w)) / w. A round trip of
half of that takes half of the phase margin; what is left is for the tick, the filters and a servo
that is not quite the rig file's, and for a derivative part of the servo loop, which is not counted.
"""

from math import atan, inf, pi, sqrt

from rig.parameters import Rig

MARGIN_SHARE = 0.5  # of the delay margin that a link may take; chosen: half of the phase is left
ADAPTER_S = 0.016  # an FTDI adapter may keep bytes so long: a loop that swings by it is at fault


def delay_margin_s(gain_1_s: float, time_constant_s: float) -> float:
    """Return the round trip at which the servo loop becomes unstable [s]; inf without feedback.

    gain_1_s: k [1/s], of the servo [rad/s/V] times that of its controller [V/rad].
    """
    if gain_1_s == 0.0:
        return inf
    w = gain_1_s * sqrt(2.0 / (1.0 + sqrt(1.0 + (2.0 * time_constant_s * gain_1_s) ** 2)))
    return (0.5 * pi - atan(time_constant_s * w)) / w


def longest_round_trip_s(rig: Rig) -> float:
    """Return the longest round trip of a link [s] over which the rig's servo loop may close."""
    gain_1_s = rig.servo.gain_rad_s_V * rig.gains.servo_proportional_V_rad
    margin_s = delay_margin_s(gain_1_s, rig.servo.time_constant_s)
    return max(ADAPTER_S, MARGIN_SHARE * margin_s)


class LateWatch:
    """Says when a link is late: its round trip has been above longest_s [s] at every tick of as
    long a time.

    A single hiccup is none, as what comes after it is fresh. Patience is no longer than that, since
    the monitor, which sees old angles, soon calls them a stall.
    """

    def __init__(self, longest_s: float) -> None:
        self.longest_s, self._since_s = longest_s, inf

    def is_late(self, trip_s: float, now_s: float) -> bool:
        """Take a tick at now_s [s]; trip_s: the round trip [s] as far as that tick knows it."""
        self._since_s = min(self._since_s, now_s) if trip_s > self.longest_s else inf
        return now_s - self._since_s >= self.longest_s

    def why(self, trip_s: float, cure: str) -> str:
        """Return what is said of a link whose round trip takes trip_s [s], in one line."""
        return (
            f"the round trip takes {1e3 * trip_s:.0f} ms or more, longer than the "
            f"{1e3 * self.longest_s:.0f} ms that the servo loop's delay margin allows: {cure}"
        )


LONGEST_ROUND_TRIP_S = longest_round_trip_s(Rig())  # of the default servo and gains
