"""A watch for a servo that takes an angle and does not go there: a pure function.

Where the servo tells its angle, one that is led elsewhere by more than ELSEWHERE_RAD moves by
MOVED_RAD within its dead time, its lag and PATIENCE_S; a held one does not. It is led as a servo
follows: at most at the rate limit, with lag and dead time as one lag, so that a command which is
gone before the arm could answer leads nowhere. Its zero may be anything: only changes are compared.
"""

from dataclasses import dataclass, replace
from math import exp

from rig.parameters import Servo
from rig.safety.motion_watch import MOVED_RAD

ELSEWHERE_RAD = 0.2  # chosen: a fifth of 1 rad, by which a scale may be off on the widest way
PATIENCE_S = 0.3  # chosen: as a board has it with volts


@dataclass(frozen=True)
class FollowLimits:
    """How a healthy arm follows: late_s, its lag and dead time; rate_rad_s, at most; patience_s:
    how long it may wait until it moves.
    """

    late_s: float
    rate_rad_s: float
    patience_s: float

    @classmethod
    def of_servo(cls, servo: Servo) -> "FollowLimits":
        """Return the limits of the slower axis of these servos."""
        late_s = max(servo.pair("dead_time_s")) + max(servo.pair("lag_s"))
        return cls(late_s, min(servo.pair("rate_limit_rad_s")), PATIENCE_S + late_s)


@dataclass(frozen=True)
class FollowWatch:
    """One axis: led_rad: where its command has led it by now; from_rad, theta_rad: that, and its
    angle, when it last moved; since_s: since when it should move.
    """

    led_rad: float = 0.0
    from_rad: float = 0.0
    theta_rad: float = 0.0
    since_s: float = 0.0


def watch_following(
    before: FollowWatch,
    limits: FollowLimits,
    told_rad: float,
    theta_rad: float,
    t_s: float,
    step_s: float,
) -> FollowWatch:
    """Return the next state of one axis; told_rad: for the step_s that end at t_s."""
    share = 1.0 - exp(-step_s / limits.late_s) if limits.late_s > 0.0 else 1.0
    most_rad = limits.rate_rad_s * step_s
    way_rad = min(max(share * (told_rad - before.led_rad), -most_rad), most_rad)
    led_rad = before.led_rad + way_rad
    if abs(theta_rad - before.theta_rad) >= MOVED_RAD:
        return FollowWatch(led_rad, led_rad, theta_rad, t_s)
    if abs(led_rad - before.from_rad) <= ELSEWHERE_RAD:
        return replace(before, led_rad=led_rad, since_s=t_s)
    return replace(before, led_rad=led_rad)
