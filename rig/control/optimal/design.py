"""The gains of LQG and MPC, from what a controller may know of the rig alone.

One axis of the nominal table is linear: p'' = b theta + d (Eq. 15; d: level, wind), and a servo
tau omega' + omega = K (V + w) (w: friction, offset), theta' = omega. With the volts held over a
period h and x = (p, p', theta, omega) the step is exact,

    x+ = A x + B V,   [A B; 0 1] = exp([F G; 0 0] h)

(Van Loan, IEEE Trans. Autom. Control 23, 1978). The regulator minimises sum x'Qx + R V^2, the filter
the variance of the estimate; both from the discrete algebraic Riccati equation (Kalman 1960):

    P = A'PA - A'PB (R + B'PB)^-1 B'PA + Q,   u = -k x,   k = (R + B'PB)^-1 B'PA
    S = ASA' - ASC' (CSC' + N)^-1 CSA' + W,   x += l (y - Cx),   l = SC' (CSC' + N)^-1

The states d and w of the filter are random walks; the regulator aims at the angle and volts that
hold against them, which leaves no offset (Pannocchia and Rawlings, AIChE J. 49, 2003).
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm, solve_discrete_are

from rig.parameters import Rig

# Bryson's rule: Q and R are inverse squares of what counts as large (Bryson and Ho, 1975). Of the
# 16 settings of tests/benchmarks/optimal_arms.py the one with the smallest error; the PID's
# rivals in experiments/grids/default.toml are chosen from four.
LARGE_M, LARGE_M_S, LARGE_RAD, LARGE_RAD_S, LARGE_V = 0.01, 0.06, 0.3, 3.0, 3.0
# Spectral densities of the filter's process noise: of the ball's acceleration [m/s2/sqrt(Hz)], of d
# [m/s3/sqrt(Hz)], of the servo's volts and of w [V/sqrt(Hz), V/s/sqrt(Hz)]; tuned with the above.
BALL_NOISE, D_NOISE, VOLT_NOISE, W_NOISE = 0.02, 0.05, 0.02, 1.0


@dataclass(frozen=True)
class Weights:
    """What counts as large, by the square of whose inverse Q and R weigh: of p [m], p' [m/s], theta
    [rad], theta' [rad/s] and V [V]."""

    m: float = LARGE_M
    m_s: float = LARGE_M_S
    rad: float = LARGE_RAD
    rad_s: float = LARGE_RAD_S
    volts: float = LARGE_V

    def cost(self) -> tuple[np.ndarray, np.ndarray]:
        """Q (4, 4) and R (1, 1) for a period of one second; times the period for another."""
        size = np.array([self.m, self.m_s, self.rad, self.rad_s])
        return np.diag(size**-2.0), np.array([[self.volts**-2.0]])


def axis_step(rig: Rig, period_s: float) -> tuple[np.ndarray, np.ndarray]:
    """A (4, 4) and B (4, 1) of one axis over a period [s] (the module's equation)."""
    k, tau = rig.servo.gain_rad_s_V, rig.servo.time_constant_s
    f = np.zeros((5, 5))
    f[0, 1], f[1, 2], f[2, 3] = 1.0, rig.ball_gain_m_s2, 1.0
    f[3, 3], f[3, 4] = -1.0 / tau, k / tau
    step = expm(f * period_s)
    return step[:4, :4], step[:4, 4:]


def regulator(
    rig: Rig, period_s: float, weights: Weights | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Gain k (4,) [V per unit of p, p', theta, omega] and the Riccati solution P (4, 4)."""
    a, b = axis_step(rig, period_s)
    q, r = (weights or Weights()).cost()
    p = solve_discrete_are(a, b, q * period_s, r * period_s)
    k = np.linalg.solve(r * period_s + b.T @ p @ b, b.T @ p @ a)
    return k[0], p


def steady_gain(
    a: np.ndarray, c: np.ndarray, process: np.ndarray, measured: float
) -> tuple[np.ndarray, np.ndarray]:
    """Steady-state Kalman gain l (n,) after a measurement y = c x of variance `measured`, and the
    variance S (n, n) before it; a (n, n), c (1, n), process (n, n)."""
    s = solve_discrete_are(a.T, c.T, process, np.array([[measured]]))
    return (s @ c.T / (c @ s @ c.T + measured))[:, 0], s


def ball_filter(rig: Rig) -> np.ndarray:
    """Gain (3,) of p, p' and d for a camera's frame [1, 1/s, 1/s2]."""
    f = np.zeros((3, 3))
    f[0, 1] = f[1, 2] = 1.0
    noise = np.diag([0.0, BALL_NOISE**2, D_NOISE**2])
    a, process = sampled(f, noise, 1.0 / rig.camera.rate_hz)
    seen = max(rig.camera.noise_m, 1e-5) ** 2
    return steady_gain(a, np.array([[1.0, 0.0, 0.0]]), process, seen)[0]


def servo_filter(rig: Rig, period_s: float) -> np.ndarray:
    """Gain (3,) of theta, omega and w for an encoder's reading [1, 1/s, V/rad]."""
    k, tau = rig.servo.gain_rad_s_V, rig.servo.time_constant_s
    f = np.array([[0.0, 1.0, 0.0], [0.0, -1.0 / tau, k / tau], [0.0, 0.0, 0.0]])
    noise = np.diag([0.0, (VOLT_NOISE * k / tau) ** 2, W_NOISE**2])
    a, process = sampled(f, noise, period_s)
    count = rig.servo.encoder_step_rad**2 / 12.0
    return steady_gain(a, np.array([[1.0, 0.0, 0.0]]), process, count)[0]


def sampled(f: np.ndarray, noise: np.ndarray, period_s: float) -> tuple[np.ndarray, np.ndarray]:
    """A = exp(F h) and the process noise's variance over a period, both (n, n), from F and the
    spectral densities `noise` (n, n), by Van Loan's block exponential."""
    n = len(f)
    block = np.zeros((2 * n, 2 * n))
    block[:n, :n], block[:n, n:], block[n:, n:] = -f, noise, f.T
    both = expm(block * period_s)
    a = both[n:, n:].T
    return a, a @ both[:n, n:]
