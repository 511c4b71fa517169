"""The gains of LQG and MPC, from what a controller may know of the rig alone.

One axis of the nominal table is linear: p'' = b theta + d (Eq. 15; d: level, wind), and a servo
tau omega' + omega = K (V + w) (w: friction, offset), theta' = omega. With the volts held over a
period h and x = (p, p', theta, omega) the step is exact,

    x+ = A x + B V,   [A B; 0 1] = exp([F G; 0 0] h)

(Van Loan, IEEE Trans. Autom. Control 23, 1978). The regulator minimises the sum of x'Qx + R V^2,
the filter the variance of the estimate; both from the discrete algebraic Riccati equation (Kalman
1960):

    P = A'PA - A'PB (R + B'PB)^-1 B'PA + Q,   u = -k x,   k = (R + B'PB)^-1 B'PA
    S = ASA' - ASC' (CSC' + N)^-1 CSA' + W,   x += l (y - Cx),   l = SC' (CSC' + N)^-1

The states d and w of the filter are random walks; the regulator aims at the angle and volts that
hold against them, which leaves no offset (Pannocchia and Rawlings, AIChE J. 49, 2003).
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm, solve_discrete_are

from rig.parameters import Rig


@dataclass(frozen=True)
class Weights:
    """What the designs weigh by.

    m, m_s, rad, rad_s, volts: of p [m], p' [m/s], theta [rad], theta' [rad/s] and V [V] what counts
    as large; Q and R are the inverse squares (Bryson's rule: Bryson and Ho, Applied Optimal
    Control, 1975). ball_noise, drift_noise, volt_noise, friction_noise: spectral densities of what
    drives p' [m/s2/sqrt(Hz)], d [m/s3/sqrt(Hz)], omega [V/sqrt(Hz)] and w [V/s/sqrt(Hz)].
    """

    m: float = 0.01
    m_s: float = 0.06
    rad: float = 0.3
    rad_s: float = 3.0
    volts: float = 3.0
    ball_noise: float = 0.1
    drift_noise: float = 0.05
    volt_noise: float = 0.02
    friction_noise: float = 1.0

    def cost(self) -> tuple[np.ndarray, np.ndarray]:
        """Q (4, 4) and R (1, 1) for a period of one second; times the period for another."""
        size = np.array([self.m, self.m_s, self.rad, self.rad_s])
        return np.diag(size**-2.0), np.array([[self.volts**-2.0]])


# For each arm the one with the smallest error of 16 settings
# (tests/benchmarks/control/optimal_arms.py).
WEIGHTS = {"lqg": Weights(), "mpc": Weights()}


def axis_step(rig: Rig, period_s: float) -> tuple[np.ndarray, np.ndarray]:
    """A (4, 4) and B (4, 1) of one axis over a period [s] (the module's equation)."""
    k, tau = rig.servo.gain_rad_s_V, rig.servo.time_constant_s
    f = np.zeros((5, 5))
    f[0, 1], f[1, 2], f[2, 3] = 1.0, rig.ball_gain_m_s2, 1.0
    f[3, 3], f[3, 4] = -1.0 / tau, k / tau
    step = expm(f * period_s)
    return step[:4, :4], step[:4, 4:]


def regulator(rig: Rig, period_s: float, weights: Weights) -> tuple[np.ndarray, np.ndarray]:
    """Gain k (4,) [V per unit of p, p', theta, omega] and the Riccati solution P (4, 4)."""
    a, b = axis_step(rig, period_s)
    q, r = weights.cost()
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


def ball_filter(rig: Rig, weights: Weights) -> np.ndarray:
    """Gain (3,) of p, p' and d for a camera's frame [1, 1/s, 1/s2]."""
    f = np.zeros((3, 3))
    f[0, 1] = f[1, 2] = 1.0
    noise = np.diag([0.0, weights.ball_noise**2, weights.drift_noise**2])
    a, process = sampled(f, noise, 1.0 / rig.camera.rate_hz)
    seen = max(rig.camera.noise_m, 1e-5) ** 2
    return steady_gain(a, np.array([[1.0, 0.0, 0.0]]), process, seen)[0]


def servo_filter(rig: Rig, period_s: float, weights: Weights) -> np.ndarray:
    """Gain (3,) of theta, omega and w for an encoder's reading [1, 1/s, V/rad]."""
    k, tau = rig.servo.gain_rad_s_V, rig.servo.time_constant_s
    f = np.array([[0.0, 1.0, 0.0], [0.0, -1.0 / tau, k / tau], [0.0, 0.0, 0.0]])
    noise = np.diag([0.0, (weights.volt_noise * k / tau) ** 2, weights.friction_noise**2])
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
