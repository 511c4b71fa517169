"""Where servos that take an angle stood, from a log of what they were told.

Where nobody measures the angle, the ball is predicted from the servos' answer to the commands by
the simulator's own equations (`rig.plant.position_servo`), never from the commands themselves: a
command jumps, the plate does not.
"""

from math import ceil

import numpy as np

from rig.compiled import compiled
from rig.plant.position_servo import (
    ANGLE,
    SERVOS,
    aim,
    move_servos,
    servos_at_level,
    table_angles,
    told_at,
)

LONGEST_STEP_S = 0.0025  # between two angles: the ball's predictor goes straight between them


@compiled
def _follow(p, t, told, parts, state, times, angles):
    """Fill times (m,) [s] and angles (m, 2) [rad], m = sum(parts[:-1]) + 1; see `answers`."""
    wanted, at, row = np.zeros(SERVOS), np.zeros(2, np.int64), 0
    aim(p, told[0, 0], told[0, 1], wanted)
    for i in range(SERVOS):
        state[ANGLE + i] = wanted[i]
    table_angles(p, state, angles[0])
    times[0] = t[0]
    for k in range(t.shape[0] - 1):
        h = (t[k + 1] - t[k]) / parts[k]
        for i in range(parts[k]):
            now = t[k] + (i + 0.5) * h
            for a in range(2):
                when = told_at(p, a, now)
                while at[a] + 1 < t.shape[0] and t[at[a] + 1] <= when + 1e-9:
                    at[a] += 1
            aim(p, told[at[0], 0], told[at[1], 1], wanted)
            move_servos(p, wanted, h, state)
            row += 1
            table_angles(p, state, angles[row])
            times[row] = t[k] + (i + 1) * h


def answers(p: np.record, t_s: np.ndarray, told_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return times (m,) [s] and the axes' angles (m, 2) [rad], every tick t_s (n,) among them.

    p: record PLANT; told_rad (n, 2): commands, each from its tick to the next, finite. The servos
    begin at rest where the first command holds them.
    """
    parts = np.ones(len(t_s), np.int64)
    steps = np.diff(t_s)
    parts[:-1] = np.maximum(np.ceil(steps / LONGEST_STEP_S - 1e-9), 1)
    longest = int(ceil(1.0 / LONGEST_STEP_S))  # of a gap longer than a second, no more
    parts = np.minimum(parts, longest)
    m = int(parts[:-1].sum()) + 1
    times, angles = np.empty(m), np.empty((m, 2))
    _follow(p, t_s, np.ascontiguousarray(told_rad), parts, servos_at_level(p), times, angles)
    return times, angles
