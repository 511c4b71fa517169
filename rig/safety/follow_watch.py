"""A watch for a servo that takes an angle and does not go there: a pure function.

Where the servo tells its angle, one that is told another by more than ELSEWHERE_RAD moves by
MOVED_RAD within its dead time, its lag and PATIENCE_S; a held one does not. Whatever its zero and
its scale are: only changes are compared.
"""

from dataclasses import dataclass

from rig.parameters import Servo
from rig.safety.motion_watch import MOVED_RAD

ELSEWHERE_RAD = 0.15  # chosen: half of it moves an arm whose dead band is 0.06 rad by MOVED_RAD
PATIENCE_S = 0.3  # chosen: as a board has it with volts


@dataclass(frozen=True)
class FollowWatch:
    """One axis: told_rad, theta_rad: its command and angle when it last moved; since_s: since when
    it should move.
    """

    told_rad: float = 0.0
    theta_rad: float = 0.0
    since_s: float = 0.0


def patience_s(servo: Servo) -> float:
    """How long an arm of these servos may wait until it moves [s]."""
    return PATIENCE_S + max(servo.pair("dead_time_s")) + max(servo.pair("lag_s"))


def watch_following(
    before: FollowWatch, told_rad: float, theta_rad: float, t_s: float
) -> FollowWatch:
    """Return the next state of one axis; told_rad: until this angle, theta_rad at t_s."""
    if abs(theta_rad - before.theta_rad) >= MOVED_RAD:
        return FollowWatch(told_rad, theta_rad, t_s)
    if abs(told_rad - before.told_rad) <= ELSEWHERE_RAD:
        return FollowWatch(before.told_rad, before.theta_rad, t_s)
    return before
