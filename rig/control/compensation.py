"""The inverse of backlash: where it acts decides whether it helps.

*Joint play* (behind the encoder): the servo's reference is shifted across the gap, theta_r =
theta_wanted + s alpha, with s the side on which the plate must be pushed to where it should be.
*Gear play* (before the encoder): the loop already sees the arm, so a shifted reference does harm;
the motor is given extra volts in proportion to the part of the gap that it still has to cross.
"""

import numpy as np

from rig.compiled import compiled
from rig.plant.shaft import play_operator

INVERSE = np.dtype([("plate", np.float64, (2,)), ("shift", np.float64, (2,))])


def start() -> np.record:
    """Return the state (dtype INVERSE) of an inverse at rest, with no shift."""
    return np.zeros(1, INVERSE)[0]


@compiled
def joint_reference(inv, a, wanted, theta, backlash, least):
    """Servo reference on axis `a` that puts the plate at `wanted` through the joint's backlash
    [rad].

    inv: record INVERSE, changed in place; wanted, theta: wanted plate angle and encoder angle
    [rad]; backlash: full width [rad]; least: smallest error that counts [rad]. The plate is taken
    to be where the play operator leaves it. While it is nearer than `least` to `wanted`, the
    reference keeps its side: an inverse that chatters is worse than none.
    """
    half = 0.5 * backlash
    inv.plate[a] = play_operator(inv.plate[a], theta, half, -half)
    missing = wanted - inv.plate[a]
    if missing > least:
        inv.shift[a] = half
    elif missing < -least:
        inv.shift[a] = -half
    else:
        inv.shift[a] = min(max(inv.shift[a], -half), half)
    return wanted + inv.shift[a]


@compiled
def gear_volts(error, twist, backlash, gain, least):
    """Extra volts that carry the motor across the gear's gap to the side that must push [V].

    error: reference minus encoder angle [rad], whose sign names the side (none within `least`
    [rad]); twist: theta_d about the middle of the play [rad]; backlash: full width [rad]; gain
    [V/rad].
    """
    half = 0.5 * backlash
    if error > least:
        return gain * min(max(half - twist, 0.0), backlash)
    if error < -least:
        return gain * max(min(-half - twist, 0.0), -backlash)
    return 0.0
