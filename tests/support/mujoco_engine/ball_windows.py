"""The ball's equations alone, on a plate that moves as another engine's did: window by window.

Each window starts from the true position, velocity and spin; what a start could explain (a constant
and a drift, which any fit would take out) is taken off the residual.
"""

import numpy as np

from rig.parameters import GRAVITY_M_S2, Ball
from rig.plant.ball import rolling, velocity
from tests.support.mujoco_engine.comparison import TICK_S, Trajectory

WINDOW_S = 0.75


def residuals(run: Trajectory, ball: Ball, *, moving_plate: bool) -> np.ndarray:
    """Predicted minus true positions (windows, ticks, 2) [m].

    `moving_plate` False: Eq. 15 alone, x'' = k g sin(phi). Heun's steps of one tick: (2 ms)^2.
    """
    sines = np.sin(run.plate_rad)
    rates = np.gradient(sines, TICK_S, axis=0, edge_order=2)
    rates = rates / np.sqrt(1 - (sines**2).sum(axis=1, keepdims=True))
    turning = np.column_stack([-rates[:, 1], rates[:, 0]]) * (1.0 if moving_plate else 0.0)
    n = round(WINDOW_S / TICK_S)
    drift = np.column_stack([np.ones(n + 1), np.arange(n + 1)])
    found = []
    for i in range(0, len(sines) - n, n):
        part = slice(i, i + n + 1)
        first = (run.ball_m[i], run.velocity_m_s[i], run.spin_rad_s[i])
        d = _roll(ball, sines[part], turning[part], *first) - run.ball_m[part]
        found.append(d - drift @ np.linalg.lstsq(drift, d, rcond=None)[0])
    return np.array(found)


def _roll(ball: Ball, sines, turning, xy, v, spin) -> np.ndarray:
    """Positions (n, 2) of a ball on a plate with tilt sines (n, 2) and rates (n, 2)."""
    k, r = ball.rolling_factor, ball.radius_m
    still = not turning.any()

    def slope(j: int, s: np.ndarray) -> np.ndarray:
        if still:
            return np.array([s[2], s[3], *(k * GRAVITY_M_S2 * sines[j]), 0.0])
        o1, o2 = turning[j]
        v_x, v_y = velocity(s[2], s[3], o1, o2, r)
        s_x, s_y = sines[j]
        a_x, a_y, spun = rolling(s[0], s[1], v_x, v_y, s[4], s_x, s_y, o1, o2, k, r)
        return np.array([v_x, v_y, a_x, a_y, spun])

    s = np.array([*xy, v[0] + r * turning[0, 1], v[1] - r * turning[0, 0], spin])
    path = [s[:2]]
    for j in range(len(sines) - 1):
        before = slope(j, s)
        s = s + TICK_S / 2 * (before + slope(j + 1, s + TICK_S * before))
        path.append(s[:2])
    return np.array(path)


def rms_mm(residual_m: np.ndarray) -> float:
    return 1e3 * float(np.sqrt(np.mean(residual_m**2)))
