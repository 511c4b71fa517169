"""A servo whose motor drives its arm over an elastic belt: two masses and a spring.

With J the inertia of both, s the arm's share of it, K and tau of the motor that turns both, T the
belt's torque over J/tau (rad/s) and w0 the arm's own frequency while the motor is held:

    (1 - s) tau wm' = K V - wm - T      s tau wa' = T
    T = s tau (w0^2 (qm - qa) + 2 zeta w0 (wm - wa))
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from tests.support.worlds.logs import GAIN_rad_s_V, TAU_s, steps
from tests.support.worlds.plant import STEP_s


class Belt(NamedTuple):
    """The belt of the module's equations and the friction of its motor in V."""

    share: float
    own_hz: float
    damping: float
    friction_V: float = 0.005
    gain_rad_s_V: float = GAIN_rad_s_V
    tau_s: float = TAU_s


@njit(cache=True)
def belt_step(state, V, belt, h):
    """Move `state` = (motor angle and speed, arm angle and speed) by h; friction is implicit."""
    w0 = 2.0 * math.pi * belt.own_hz
    twist, slip = state[0] - state[2], state[1] - state[3]
    T = belt.share * belt.tau_s * (w0 * w0 * twist + 2.0 * belt.damping * w0 * slip)
    reach = h / ((1.0 - belt.share) * belt.tau_s)
    free = state[1] + reach * (belt.gain_rad_s_V * V - state[1] - T)
    lost = reach * belt.gain_rad_s_V * belt.friction_V
    state[1] = np.sign(free) * max(abs(free) - lost, 0.0)
    state[3] += h * T / (belt.share * belt.tau_s)
    state[0] += h * state[1]
    state[2] += h * state[3]


@njit(cache=True)
def run_belt(belt, rows_hz, counts, inner_V_rad, limit_V, targets, torque_V):
    """V = clip(P (target - arm)); columns V and the arm's angle in counts."""
    log, state = np.empty((len(targets), 2)), np.zeros(4)
    inner = round(1.0 / (rows_hz * STEP_s))
    for row in range(len(targets)):
        theta = round(state[2] * counts / 6.283185307179586) * 6.283185307179586 / counts
        V = min(max(inner_V_rad * (targets[row] - theta), -limit_V), limit_V)
        log[row, 0], log[row, 1] = V, theta
        for _ in range(inner):
            belt_step(state, V + torque_V[row], belt, STEP_s)
    return log


def belt_log(rng, belt: Belt, seconds=40.0, rows_hz=500.0) -> dict[str, np.ndarray]:
    """The axis under random steps of the target angle, as soft as its belt allows."""
    n = int(seconds * rows_hz)
    targets = steps(rng, n, rows_hz, 0.6, (0.3, 1.5))
    log = run_belt(belt, rows_hz, 4096.0, 5.0, 6.0, targets, 0.01 * rng.normal(size=n))
    return {"t_s": np.arange(n) / rows_hz, "voltage_x_V": log[:, 0], "theta_x_rad": log[:, 1]}
