"""The menu of `rig gap`'s next experiment: the shipped protocols that the rig can be asked for."""

from dataclasses import replace

import numpy as np

from experiments.runs.protocol import course, read_protocol, shipped
from rig.course import Course
from rig.parameters import Rig

COURSES_EACH = 2  # courses of a protocol: its start, targets and pushes are drawn


def experiment_menu(
    rig: Rig, *, seed: int = 1, ball: bool = True
) -> tuple[tuple[str, Course, float], ...]:
    """Name, course and seconds of every shipped protocol that the rig can run.

    A protocol whose start or reference lies beyond the plate or the servo's angle is left out. Each
    has COURSES_EACH courses, drawn with `seed` and the seeds after it, so that its separation does
    not depend on one draw; one with pushes also with all pushes along x, and all along y. ball
    False: only the protocols on the servos alone, for a table on which no ball is seen.
    """
    found = []
    for name in shipped():
        protocol = read_protocol(name)
        if not (ball or protocol.servo_only):
            continue
        try:
            ways = [course(protocol, rig, seed + i) for i in range(COURSES_EACH)]
        except ValueError:  # its reference or start lies beyond the plate or the servo's angle
            continue
        if protocol.pushes.kind != "none":
            ways += [_pushed_along(ways[0], a) for a in (0, 1)]
        found += [(name, way, protocol.duration_s + way.hold_s) for way in ways]
    return tuple(found)


def _pushed_along(way: Course, a: int) -> Course:
    """The same course with its pushes as strong, but all along one axis."""
    push = np.zeros_like(way.pushes_m_s2)
    push[:, a] = np.hypot(*way.pushes_m_s2.T) * np.where(way.pushes_m_s2[:, a] < 0, -1.0, 1.0)
    return replace(way, pushes_m_s2=push)
