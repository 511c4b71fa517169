"""Both play observers as one: what the loop believes of gear and joint play.

Each starts every run at zero play and sees readings alone. The *lost motion* is what an inverse
must undo: play plus the shafts' wind-up against friction. The *play* is what a person wants to
know: the wind-up that the rig file's stiffness and friction explain is taken off.
"""

from math import sqrt

import numpy as np

from rig.compiled import compiled
from rig.estimation import gear_observer, joint_observer
from rig.estimation.gear_observer import observe_gear
from rig.estimation.joint_observer import observe_joint
from rig.parameters import Rig

BACKLASH_STATE = np.dtype(
    [("gear", gear_observer.GEAR_STATE), ("joint", joint_observer.JOINT_STATE)]
)
BACKLASH_SETTINGS = np.dtype(
    [("gear", gear_observer.GEAR_SETTINGS), ("joint", joint_observer.JOINT_SETTINGS)]
)


def settings(rig: Rig) -> np.record:
    """Return the settings of both observers (dtype BACKLASH_SETTINGS) from the rig without its
    effects.
    """
    q = np.zeros(1, BACKLASH_SETTINGS)[0]
    q["gear"], q["joint"] = gear_observer.settings(rig), joint_observer.settings(rig)
    return q


def start(q: np.record) -> np.record:
    """Return the state of both observers (dtype BACKLASH_STATE): zero play, with the variances
    of `q`.
    """
    e = np.zeros(1, BACKLASH_STATE)[0]
    e["gear"], e["joint"] = gear_observer.start(q["gear"]), joint_observer.start(q["joint"])
    return e


@compiled
def observe_backlash(e, q, reading):
    """Run one control tick of both observers on reading (READING_SIZE,).

    e, q: of `start` and `settings`; e is changed in place.
    """
    observe_gear(e.gear, q.gear, reading)
    observe_joint(e.joint, q.joint, reading)


@compiled
def gear_backlash(e, q, a):
    """Full width of the gear's play on axis `a` and its standard deviation [rad].

    e, q: of `start` and `settings`. The deviation includes the assumed wind-up, of which half may
    be wrong either way.
    """
    return 2.0 * max(e.gear.mean[a, 1], 0.0), 2.0 * sqrt(
        e.gear.cov[a, 1, 1] + (0.5 * q.gear.windup) ** 2
    )


@compiled
def joint_backlash(e, q, a):
    """Full width of the joint's play on axis `a` and its standard deviation [rad].

    e, q: of `start` and `settings`. The shaft's wind-up is taken off the width; the deviation
    includes it, as half of it may be wrong either way.
    """
    width = 2.0 * max(e.joint.alpha[a] - q.joint.windup, 0.0)
    return width, 2.0 * sqrt(e.joint.variance[a] + (0.5 * q.joint.windup) ** 2)


@compiled
def lost_in_joint(e, q, a):
    """Lost motion of the joint on axis `a`, full width [rad]; 0 where it is unknown or the plate
    drops.

    e, q: of `start` and `settings`. The plate drops where the ball's weight, not friction, decides
    on which side of the gap it lies.
    """
    if e.joint.keeps[a] < 0.5:
        return 0.0
    return known_width(2.0 * e.joint.alpha[a], 2.0 * sqrt(e.joint.variance[a]))


@compiled
def lost_in_gear(e, q, a):
    """Lost motion of the gear on axis `a`, full width [rad]; 0 while it is unknown. e, q: of
    `start` and `settings`.
    """
    return known_width(2.0 * (e.gear.mean[a, 1] + q.gear.windup), 2.0 * sqrt(e.gear.cov[a, 1, 1]))


@compiled
def known_width(width, deviation):
    """The full width where it is known, else 0 [rad].

    It is known when it is above twice its standard deviation `deviation` [rad].
    """
    return width if width > 2.0 * deviation else 0.0
