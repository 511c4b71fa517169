"""Where servos that take an angle stood, from a log of what they were told.

Where nobody measures the angle, the ball is predicted from the servos' answer to the commands by
the simulator's own equations (`rig.plant.position_servo`), never from the commands themselves: a
command jumps, the plate does not. Where servos read their angle back, the commands predict the next
reading (`predict_told_axis`, of three arms `predict_told_arms`).
"""

from math import ceil, exp, sin, sqrt

import numpy as np

from rig.compiled import compiled, inlined
from rig.effects import CATALOGUE
from rig.plant.position_servo import (
    ANGLE,
    POSE,
    SERVOS,
    aim,
    arriving,
    drawn_off,
    move_servos,
    moved_servo,
    rounded,
    servo_dead_time,
    servo_law,
    servo_laws,
    servos_at_level,
    table_angles,
    told_at,
)
from rig.prediction.last_results import LastResults
from rig.three_arms import arm_angle

LONGEST_STEP_S = 0.0025  # between two angles: the ball's predictor goes straight between them
# Where the angle is read, a servo that turns by a count in a millisecond is seen; chosen.
READ_STEP_S = 0.0005
# What lies behind the servos: their answer does not depend on it.
BEHIND = tuple(e.field(p.key) for e in CATALOGUE if e.side != "servo" for p in e.parameters)
BEHIND += ("joint_1", "joint_2", "camera_height", "unknown", "own")
SMALL_TILT_RAD = 1e-4  # of a numerical derivative


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
    wanted, rows, row = np.zeros(SERVOS), np.zeros(2, np.int64), 0
    goal, aimed = np.empty(2), np.empty(2)
    for a in range(2):
        aimed[a] = arriving(p, a, rounded(p, a, told[0, a]))
    aim(p, aimed[0], aimed[1], wanted)
    for i in range(SERVOS):
        state[ANGLE + i] = wanted[i]
    table_angles(p, state, angles[0])
    times[0] = t[0]
    for k in range(t.shape[0] - 1):
        h = (t[k + 1] - t[k]) / parts[k]
        laws = servo_laws(p, h)
        for i in range(parts[k]):
            begin = t[k] + i * h
            for a in range(2):
                mean, rows[a] = _mean_told(p, a, t, told, begin, h, rows[a])
                goal[a] = arriving(p, a, mean)
            if goal[0] != aimed[0] or goal[1] != aimed[1]:
                aim(p, goal[0], goal[1], wanted)
                aimed[:] = goal
            move_servos(p, laws, wanted, h, state)
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


@inlined
def _spread(cov, reach, decay, process, h):
    """Covariance (p00, p01, p11) of angle and disturbance after h [s] in which the disturbance has
    moved the angle by `reach` times itself and decayed; process: white noise [rad/s/sqrt(s)]."""
    p00, p01, p11 = cov
    q = process * process * h
    p00 += 2.0 * reach * p01 + reach * reach * p11 + q * h * h / 3.0
    p01 = decay * (p01 + reach * p11) + 0.5 * q * h
    return p00, p01, decay * decay * p11 + q


@inlined
def _read(cov, r):
    """Standard deviation of an innovation of variance `r` [rad2] beside that of the angle, the
    gains of angle and disturbance, and the covariance after it."""
    p00, p01, p11 = cov
    total = p00 + r
    g0, g1 = p00 / total, p01 / total
    return sqrt(total), g0, g1, (p00 - g0 * p00, p01 - g0 * p01, p11 - g1 * p01)


@compiled
def predict_told_axis(p, levels, a, t, told, theta, corrected, resumed, tau, out, std):
    """Fill column `a` of `out` and `std` (n, 2) [rad]: innovations of the angle that the servo of
    axis `a` of two rods reads back, and their deviations.

    p: record PLANT; levels: record NOISE; t (n,) [s]; told, theta (n, 2) [rad]; corrected (n,):
    rows whose angle corrects the filter; resumed (n,): those before which rows are missing, where
    it starts anew; these, the first row and others than the former are left as they were. The servo
    moves on from the filtered angle; to its rate a disturbance is added that decays in tau [s], as
    the speed of a motor does (`rig.prediction.servo`).
    """
    r, process = levels.servo_measured[a] ** 2, levels.servo_process[a]
    angle, rate, more, row = theta[0, a], 0.0, 0.0, 0
    cov = r, 0.0, 0.5 * process * process * tau
    for k in range(t.shape[0] - 1):
        parts = max(int(ceil((t[k + 1] - t[k]) / READ_STEP_S - 1e-9)), 1)
        h = (t[k + 1] - t[k]) / parts
        decay = exp(-h / tau)
        reach, law = tau * (1.0 - decay), servo_law(p, a, h)
        for i in range(parts):
            now = t[k] + i * h
            mean, row = _mean_told(p, a, t, told, now, h, row)
            goal = drawn_off(p, a, arriving(p, a, mean), angle, rate, now, h)
            angle, rate = moved_servo(p, law, goal, angle, rate, h)
            angle, more = angle + reach * more, decay * more
            cov = _spread(cov, reach, decay, process, h)
        if resumed[k + 1]:
            angle, cov = theta[k + 1, a], (r, 0.0, 0.5 * process * process * tau)
            continue
        if not corrected[k + 1]:
            continue
        miss = theta[k + 1, a] - angle
        std[k + 1, a], g0, g1, cov = _read(cov, r)
        out[k + 1, a], angle, more = miss, angle + g0 * miss, more + g1 * miss


@compiled
def _hold(p, tilt, state):
    """Turn the arms in `state` to where they hold the plate at `tilt` (2,) [rad] at its height;
    they stay where it is out of reach."""
    size = (p.base_radius, p.plate_radius, p.arm_length, p.rod_length)
    s_x, s_y = sin(tilt[0]), sin(tilt[1])
    turned = np.empty(SERVOS)
    for i in range(SERVOS):
        turned[i] = arm_angle(i, s_x, s_y, state[POSE + 2], size) - p.level_arm
    if np.isfinite(turned).all():
        state[ANGLE : ANGLE + SERVOS] = turned
        state[POSE], state[POSE + 1] = s_x, s_y


@compiled
def _per_tilt(p, state):
    """By how much each arm turns for a tilt of x and of y, at level (SERVOS, 2) [1]."""
    level, ends = state.copy(), np.empty((2, SERVOS))
    slopes = np.empty((SERVOS, 2))
    for a in range(2):
        for end in range(2):
            tilt = np.zeros(2)
            tilt[a] = SMALL_TILT_RAD * (2 * end - 1)
            _hold(p, tilt, level)
            ends[end] = level[ANGLE : ANGLE + SERVOS]
        slopes[:, a] = (ends[1] - ends[0]) / (2.0 * SMALL_TILT_RAD)
    return slopes


@inlined
def _begin(cov, levels, tau, a):
    """Set row `a` of cov (2, 3) to what is known of an angle that was read once."""
    cov[a, 0], cov[a, 1] = levels.servo_measured[a] ** 2, 0.0
    cov[a, 2] = 0.5 * levels.servo_process[a] ** 2 * tau[a]


@compiled
def predict_told_arms(p, levels, t, told, theta, seen, corrected, resumed, tau, state, out, std):
    """As `predict_told_axis` for the tilts (n, 2) of a plate on three arms, both columns at once.

    seen (2,): axes whose angle was read; of the others the filter knows what was told. tau (2,)
    [s]; state (SERVOS_STATE,): of arms that hold the plate level, changed in place. An arm is moved
    by its own equations; the tilt that was read moves all three, at the height that they predict.
    """
    wanted, goal, aimed = np.zeros(SERVOS), np.empty(2), np.full(2, np.nan)
    angles, rates, more, rows = theta[0].copy(), np.zeros(2), np.zeros(2), np.zeros(2, np.int64)
    cov, slopes = np.zeros((2, 3)), _per_tilt(p, state)
    decay, reach = np.empty(2), np.empty(2)
    _hold(p, angles, state)
    for a in range(2):
        _begin(cov, levels, tau, a)
    for k in range(t.shape[0] - 1):
        parts = max(int(ceil((t[k + 1] - t[k]) / READ_STEP_S - 1e-9)), 1)
        h = (t[k + 1] - t[k]) / parts
        laws = servo_laws(p, h)
        for a in range(2):
            decay[a] = exp(-h / tau[a])
            reach[a] = tau[a] * (1.0 - decay[a])
        for i in range(parts):
            now = t[k] + i * h
            for a in range(2):
                mean, rows[a] = _mean_told(p, a, t, told, now, h, rows[a])
                goal[a] = drawn_off(p, a, arriving(p, a, mean), angles[a], rates[a], now, h)
            if goal[0] != aimed[0] or goal[1] != aimed[1]:
                aim(p, goal[0], goal[1], wanted)
                aimed[:] = goal
            move_servos(p, laws, wanted, h, state)
            for a in range(2):
                for j in range(SERVOS):
                    state[ANGLE + j] += reach[a] * more[a] * slopes[j, a]
                more[a] *= decay[a]
                before = cov[a, 0], cov[a, 1], cov[a, 2]
                cov[a] = _spread(before, reach[a], decay[a], levels.servo_process[a], h)
            if p.unknown.on or i == parts - 1:  # what has no name may depend on the tilt
                rates[:] = angles
                table_angles(p, state, angles)
                rates[:] = (angles - rates) / h
        if not (corrected[k + 1] or resumed[k + 1]):
            continue
        for a in range(2):
            if not seen[a]:
                continue
            if resumed[k + 1]:
                angles[a] = theta[k + 1, a]
                _begin(cov, levels, tau, a)
                continue
            miss, before = theta[k + 1, a] - angles[a], (cov[a, 0], cov[a, 1], cov[a, 2])
            std[k + 1, a], g0, g1, cov[a] = _read(before, levels.servo_measured[a] ** 2)
            out[k + 1, a], angles[a], more[a] = miss, angles[a] + g0 * miss, more[a] + g1 * miss
        _hold(p, angles, state)


class Answers:
    """The last few `answers`: most of what a fit moves lies behind the servos."""

    def __init__(self) -> None:
        self._kept = LastResults()

    def of(
        self, p: np.record, t_s: np.ndarray, told_rad: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """As `answers`; the arrays are not to be changed. Threads may ask at once."""
        front = p.copy()
        for name in BEHIND:
            front[name] = np.zeros_like(front[name])
        return self._kept.of(front.tobytes(), (t_s, told_rad), lambda: answers(p, t_s, told_rad))
