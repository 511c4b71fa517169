"""The parametric entry's model: servo and ball simulated over short windows, many steps ahead.

A window starts from the smoothed measurement; what an error of the start explains (for the servo a
constant and an exponential, for the ball a constant and a drift) is taken off the residual. Plays
start at the side that touched last.
"""

from math import exp, sin, sqrt

import numpy as np
from numba import njit
from scipy.optimize import least_squares

# Candidates of one servo, and of the ball; "*" marks those that every axis has of its own.
SERVO = (
    ("coulomb_friction", "friction_V"), ("stribeck_friction", "extra_V"),
    ("dead_zone", "half_width_V"), ("gain_asymmetry", "fraction"),
    ("viscous_asymmetry", "fraction_1"), ("voltage_offset", "offset_V"),
    ("saturation", "cut_V"), ("input_delay", "delay_s"), ("cogging", "amplitude_V"),
    ("gain_drift", "rate_1_s"), ("supply_sag", "drop_1_V"), ("gear_backlash", "play_rad"),
)  # fmt: skip
BALL = (
    ("joint_backlash", "play_rad"), ("transmission_ripple", "amplitude_rad"),
    ("linkage_quadratic", "coefficient_1_rad"), ("linkage_cubic", "coefficient_1_rad2"),
    ("cross_coupling", "fraction"), ("level_offset", "slope_rad"), ("level_drift", "rate_rad_s"),
)  # fmt: skip
BOTH = (
    ("plate_bowl", "stiffness_1_s2"), ("rolling_resistance", "deceleration_m_s2"),
    ("viscous_drag", "rate_1_s"), ("camera_delay", "extra_s"), ("camera_scale", "fraction"),
    ("camera_yaw", "angle_rad"), ("lens_distortion", "k1_1_m2"),
)  # fmt: skip
N_SERVO = len(SERVO) + 1  # and the phase of the cogging
SERVO_TICKS, BALL_TICKS = 200, 500  # 0.4 and 1 s at 500 Hz
ALIKE = 10  # rows of a window's residual that count as one: an error lasts for half a window
G = 9.81


@njit(cache=True)
def late(values, k, ticks):
    """values at k - ticks, a fraction between two rows held."""
    m = int(np.floor(ticks))
    share = ticks - m
    first, second = min(max(k - m, 0), len(values) - 1), min(max(k - m - 1, 0), len(values) - 1)
    return (1 - share) * values[first] + share * values[second]


@njit(cache=True)
def servo_path(V, other, theta, w, side, dt, K, tau, p, starts, length):
    """Angles (windows, length) from every start; p: as SERVO, and the cogging's phase."""
    out, top = np.empty((len(starts), length)), np.abs(V).max()
    for i, s in enumerate(starts):
        load, speed = theta[s], w[s]
        motor = load + 0.5 * p[11] * side[s]
        for j in range(length):
            out[i, j] = load
            k = s + j
            v = late(V, k, p[7] / dt)
            limit = top - p[6]
            v = min(max(v, -limit), limit)
            v *= 1 - p[10] * (abs(v) + abs(other[k]))
            v = max(v - p[2], 0.0) if v > 0 else min(v + p[2], 0.0)
            v *= (1 + p[3] if v > 0 else 1 - p[3]) * (1 - p[9] * k * dt)
            v += p[5] + p[8] * sin(24 * motor + p[12])
            dry = p[0] + p[1] * exp(-((speed / 0.1) ** 2))
            if abs(speed) < 1e-9 and abs(v) <= dry:
                continue
            way = speed if abs(speed) > 1e-9 else v
            net = K * (v - (dry if way > 0 else -dry))
            brake = 1 + p[4] if way > 0 else 1 - p[4]
            keep = exp(-brake * dt / tau)
            new = speed * keep + net / brake * (1 - keep)
            if dry > 0 and new * way < 0:
                new = 0.0
            motor += 0.5 * dt * (speed + new)
            speed = new
            load = min(max(load, motor - 0.5 * p[11]), motor + 0.5 * p[11])
    return out


@njit(cache=True)
def felt(theta, side, k, shift, dt, p, q):
    """The angle behind joint and ripple, through a bent linkage; p: as BALL, q: ripple's phase."""
    angle = late(theta, k, shift / dt)
    angle += p[1] * (sin(10 * angle + q) - sin(q)) - 0.5 * p[0] * late(side, k, shift / dt)
    return sin(angle + p[2] * angle**2 + p[3] * angle**3)


@njit(cache=True)
def ball_path(theta, side, xy, v, dt, A, factor, p, both, phase, starts, length):
    """What a camera sees, (2, windows, length); theta, side, xy, v (2, n); p (2, 7), both (7,)."""
    out = np.empty((2, len(starts), length))
    for i, s in enumerate(starts):
        x, y, vx, vy = xy[0, s], xy[1, s], v[0, s], v[1, s]
        for j in range(length):
            k = s + j
            grow = (1 + both[4]) * (1 + both[6] * (x * x + y * y))
            out[0, i, j], out[1, i, j] = grow * (x - both[5] * y), grow * (y + both[5] * x)
            a = felt(theta[0], side[0], k, both[3], dt, p[0], phase[0])
            b = felt(theta[1], side[1], k, both[3], dt, p[1], phase[1])
            speed = sqrt(vx * vx + vy * vy)
            roll = both[1] / max(speed, 0.005) + both[2]
            level_x, level_y = p[0, 5] + p[0, 6] * k * dt, p[1, 5] + p[1, 6] * k * dt
            ax = A[0] * (a + p[0, 4] * b) + factor * G * level_x - both[0] * x - roll * vx
            ay = A[1] * (b + p[1, 4] * a) + factor * G * level_y - both[0] * y - roll * vy
            x, y = x + dt * vx + 0.5 * dt * dt * ax, y + dt * vy + 0.5 * dt * dt * ay
            vx, vy = vx + dt * ax, vy + dt * ay
    return out


def without_start(residual: np.ndarray, shape: np.ndarray, every: int) -> np.ndarray:
    """Residuals (windows, length) without what a wrong start (constant, `shape`) explains."""
    basis = np.column_stack([np.ones(len(shape)), shape])[::every]
    part = residual[:, ::every].T
    return (part - basis @ np.linalg.lstsq(basis, part, rcond=None)[0]).T.ravel()


def fit(residual, free: list[int], low, high, unit, start: np.ndarray, evals: int):
    """Least squares over the free places; all values, standard deviations of the free, BIC."""

    def whole(u: np.ndarray) -> np.ndarray:
        p = start.copy()
        p[free] = u * unit[free]
        return p

    first = np.clip(start[free] / unit[free], low[free] / unit[free], high[free] / unit[free])
    first = np.where(first == 0, 0.5, first)  # where a hard effect has a slope
    span = (low[free] / unit[free] - 1e-9, high[free] / unit[free] + 1e-9)
    if not free:
        e = residual(start)
        return start, np.zeros(0), len(e) / ALIKE * np.log(np.mean(e * e))
    found = least_squares(
        lambda u: residual(whole(u)), first, bounds=span, max_nfev=evals, diff_step=0.02
    )
    n, mean_square = len(found.fun) / ALIKE, np.mean(found.fun**2)
    covariance = np.linalg.pinv(found.jac.T @ found.jac) * mean_square * ALIKE
    sd = np.sqrt(np.diag(covariance)) * unit[free]
    return whole(found.x), sd, n * np.log(mean_square) + len(free) * np.log(n)
