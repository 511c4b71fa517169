"""Where servos that take an angle stood, from a log of what they were told.

Where nobody measures the angle, the ball is predicted from the servos' answer to the commands by
the simulator's own equations (`rig.plant.position_servo`), never from the commands themselves: a
command jumps, the plate does not. Where servos read their angle back, the commands predict the next
reading (`predict_told_axis`).
"""

from math import ceil, exp, sqrt

import numpy as np

from rig.compiled import compiled
from rig.effects import CATALOGUE
from rig.plant.position_servo import (
    ANGLE,
    SERVOS,
    aim,
    arriving,
    drawn_off,
    move_servos,
    moved_servo,
    rounded,
    servo_dead_time,
    servos_at_level,
    table_angles,
    told_at,
)

LONGEST_STEP_S = 0.0025  # between two angles: the ball's predictor goes straight between them
# Where the angle is read, a servo that turns by a count in a millisecond is seen; chosen.
READ_STEP_S = 0.0005
# What lies behind the servos: their answer does not depend on it.
BEHIND = tuple(e.field(p.key) for e in CATALOGUE if e.side != "servo" for p in e.parameters)
BEHIND += ("joint_1", "joint_2", "camera_height", "unknown", "own")
KEPT = 4  # answers: of the present model and of what is tried on one servo beside it; chosen


@compiled
def _mean_told(p, a, t, told, begin, h, row):
    """Mean of what reaches the servo of axis `a` from `begin` on for h [s] [rad], and the row of
    the command with which that begins; `row`: one at or before it.

    Over a step so short the mean is what counts; it also makes the angle a smooth function of a
    dead time, which a fit needs.
    """
    first, last = told_at(p, a, begin), told_at(p, a, begin + h)
    while row + 1 < t.shape[0] and t[row + 1] <= first + 1e-9:
        row += 1
    if p.period_s[a] > 0.0 or last <= first:
        held = rounded(p, a, told[row, a])
        if last <= first:
            return held, row
        k = row
        while k + 1 < t.shape[0] and t[k + 1] <= last + 1e-9:
            k += 1
        late = servo_dead_time(p.dead_time_s[a], p.servo_dead_time_delay_s[a])
        share = min(max((last + late - begin) / h, 0.0), 1.0)  # until the newer pulse arrives
        return share * held + (1.0 - share) * rounded(p, a, told[k, a]), row
    total, at, k = 0.0, first, row
    while at < last:
        until = min(t[k + 1], last) if k + 1 < t.shape[0] and t[k + 1] > at else last
        if k + 1 < t.shape[0] and t[k + 1] <= at:
            k += 1
            continue
        total += rounded(p, a, told[k, a]) * (until - at)
        at = until
    return total / (last - first), row


@compiled
def _follow(p, t, told, parts, state, times, angles):
    """Fill times (m,) [s] and angles (m, 2) [rad], m = sum(parts[:-1]) + 1; see `answers`."""
    wanted, at_x, at_y, row = np.zeros(SERVOS), 0, 0, 0
    x, y = rounded(p, 0, told[0, 0]), rounded(p, 1, told[0, 1])
    aim(p, arriving(p, 0, x), arriving(p, 1, y), wanted)
    for i in range(SERVOS):
        state[ANGLE + i] = wanted[i]
    table_angles(p, state, angles[0])
    times[0] = t[0]
    for k in range(t.shape[0] - 1):
        h = (t[k + 1] - t[k]) / parts[k]
        for i in range(parts[k]):
            begin = t[k] + i * h
            x, at_x = _mean_told(p, 0, t, told, begin, h, at_x)
            y, at_y = _mean_told(p, 1, t, told, begin, h, at_y)
            aim(p, arriving(p, 0, x), arriving(p, 1, y), wanted)
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


@compiled
def predict_told_axis(p, levels, a, t, told, theta, corrected, tau, out, std):
    """Fill column `a` of `out` and `std` (n, 2) [rad]: innovations of the angle that the servo of
    axis `a` of two rods reads back, and their deviations.

    p: record PLANT; levels: record NOISE; t (n,) [s]; told, theta (n, 2) [rad]; corrected (n,):
    rows whose angle corrects the filter; the first row and the others are left as they were. The
    servo moves on from the filtered angle; to its rate a disturbance is added that decays in tau
    [s], as the speed of a motor does (`rig.prediction.servo`).
    """
    r = levels.servo_measured[a] ** 2
    angle, rate, more, row = theta[0, a], 0.0, 0.0, 0
    p00, p01, p11 = r, 0.0, 0.5 * levels.servo_process[a] ** 2 * tau
    for k in range(t.shape[0] - 1):
        parts = max(int(ceil((t[k + 1] - t[k]) / READ_STEP_S - 1e-9)), 1)
        h = (t[k + 1] - t[k]) / parts
        decay = exp(-h / tau)
        reach, q = tau * (1.0 - decay), levels.servo_process[a] ** 2 * h
        for i in range(parts):
            now = t[k] + i * h
            mean, row = _mean_told(p, a, t, told, now, h, row)
            goal = drawn_off(p, a, arriving(p, a, mean), angle, rate, now, h)
            angle, rate = moved_servo(p, a, goal, angle, rate, h)
            angle, more = angle + reach * more, decay * more
            p00 += 2.0 * reach * p01 + reach * reach * p11 + q * h * h / 3.0
            p01 = decay * (p01 + reach * p11) + 0.5 * q * h
            p11 = decay * decay * p11 + q
        if not corrected[k + 1]:
            continue
        total = p00 + r
        miss, g0, g1 = theta[k + 1, a] - angle, p00 / total, p01 / total
        out[k + 1, a], std[k + 1, a] = miss, sqrt(total)
        angle, more = angle + g0 * miss, more + g1 * miss
        p11 -= g1 * p01
        p01 -= g0 * p01
        p00 -= g0 * p00


class Answers:
    """The last few `answers`: most of what a fit moves lies behind the servos."""

    def __init__(self) -> None:
        self._kept: list[tuple[bytes, np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray]]] = []

    def of(
        self, p: np.record, t_s: np.ndarray, told_rad: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """As `answers`; the arrays are not to be changed. Threads may ask at once."""
        front = p.copy()
        for name in BEHIND:
            front[name] = np.zeros_like(front[name])
        key = front.tobytes()
        for kept in self._kept:
            if kept[1] is t_s and kept[2] is told_rad and kept[0] == key:
                return kept[3]
        found = answers(p, t_s, told_rad)
        self._kept = [*self._kept[1 - KEPT :], (key, t_s, told_rad, found)]
        return found
