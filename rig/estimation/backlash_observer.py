"""Both play observers as one: what the loop believes of gear and joint play.

Each starts every run at zero play and sees readings alone. The *lost motion* is what an inverse
must undo: play plus the shafts' wind-up against friction. The *play* is what a person wants to
know: the wind-up that the rig file's stiffness and friction explain is taken off.
"""

from math import sqrt

import numpy as np

from rig import gear_observer, joint_observer
from rig.compiled import compiled
from rig.gear_observer import observe_gear
from rig.joint_observer import observe_joint
from rig.parameters import Rig

PLAY_STATE = np.dtype([("gear", gear_observer.GEAR_STATE), ("joint", joint_observer.JOINT_STATE)])
PLAY_SETTINGS = np.dtype(
    [("gear", gear_observer.GEAR_SETTINGS), ("joint", joint_observer.JOINT_SETTINGS)]
)


def settings(rig: Rig) -> np.record:
    """Settings of both observers from what the controller may know of the rig (no effects)."""
    q = np.zeros(1, PLAY_SETTINGS)[0]
    q["gear"], q["joint"] = gear_observer.settings(rig), joint_observer.settings(rig)
    return q


def start(q: np.record) -> np.record:
    """Fresh observers: zero play, and honest about not knowing it."""
    e = np.zeros(1, PLAY_STATE)[0]
    e["gear"], e["joint"] = gear_observer.start(q["gear"]), joint_observer.start(q["joint"])
    return e


@compiled
def observe_play(e, q, reading):
    """One control tick of both observers: they see the reading alone."""
    observe_gear(e.gear, q.gear, reading)
    observe_joint(e.joint, q.joint, reading)


@compiled
def gear_play(e, q, a):
    """Full width of the gear's play on axis `a` and its standard deviation [rad].

    The deviation holds the assumed wind-up: half of it may be wrong either way.
    """
    return 2.0 * max(e.gear.mean[a, 1], 0.0), 2.0 * sqrt(
        e.gear.cov[a, 1, 1] + (0.5 * q.gear.windup) ** 2
    )


@compiled
def joint_play(e, q, a):
    """The same for the joint's play [rad]."""
    width = 2.0 * max(e.joint.alpha[a] - q.joint.windup, 0.0)
    return width, 2.0 * sqrt(e.joint.variance[a] + (0.5 * q.joint.windup) ** 2)


@compiled
def lost_in_joint(e, q, a):
    """Known lost motion, full width [rad], of a joint whose plate keeps its place; else 0."""
    if e.joint.keeps[a] < 0.5:
        return 0.0
    return known_play(2.0 * e.joint.alpha[a], 2.0 * sqrt(e.joint.variance[a]))


@compiled
def lost_in_gear(e, q, a):
    """Known lost motion of the gear, full width [rad]; 0 while unknown."""
    return known_play(2.0 * (e.gear.mean[a, 1] + q.gear.windup), 2.0 * sqrt(e.gear.cov[a, 1, 1]))


@compiled
def known_play(width, deviation):
    """The full width when it is known, else 0: known when 2 deviations lie below it [rad]."""
    return width if width > 2.0 * deviation else 0.0
