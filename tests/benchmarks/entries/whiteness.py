"""Whiteness alone: are the innovations of the nominal model's Kalman filter white?

As textbooks have it (Ljung, System Identification, ch. 16): fit what a calibration leaves open (K
and tau, and the size of the process noise, by likelihood), then test the innovations' first 20
autocorrelations with Ljung and Box's Q at 1 %, shared by the channels (Bonferroni). The test has no
names: it says "unknown-effect" or "nothing-missing".
"""

from pathlib import Path

import numpy as np
from numba import njit
from scipy.linalg import solve_discrete_are
from scipy.optimize import minimize, minimize_scalar
from scipy.stats import chi2

from tests.benchmarks.entries.signals import G_M_S2, Case, answer, read_case

LAGS, LEVEL = 20, 0.01


def innovations(F, g, u, z, q_gain, variance: float, noise: float) -> np.ndarray:
    """Steady-state innovations of x+ = F x + g u + q_gain w, z = x_1 + v."""
    H = np.array([[1.0, 0.0]])
    P = solve_discrete_are(F.T, H.T, variance * np.outer(q_gain, q_gain), np.array([[noise]]))
    gain = (F @ P @ H.T / (P[0, 0] + noise)).ravel()
    return _filtered(F, g, gain, u, z)[len(z) // 20 :]


@njit(cache=True)
def _filtered(F, g, gain, u, z):
    x, v, out = z[0], 0.0, np.empty(len(z))
    for k in range(len(z)):
        out[k] = z[k] - x
        x, v = (
            F[0, 0] * x + F[0, 1] * v + g[0] * u[k] + gain[0] * out[k],
            F[1, 0] * x + F[1, 1] * v + g[1] * u[k] + gain[1] * out[k],
        )
    return out


def misfit(e: np.ndarray) -> float:
    return float(np.log(np.mean(e * e)))


def servo(case: Case, axis: str) -> np.ndarray:
    """Innovations of theta'' = (K V - theta')/tau, K, tau and process noise by likelihood."""
    told, dt = case.rig["servo"], 1 / case.rate_hz
    every = 5  # 10 ms: the counts of an encoder are less coarse against the motion
    z = case.log[f"theta_{axis}_rad"][::every]
    V = case.log[f"voltage_{axis}_V"]
    u = V[: len(V) // every * every].reshape(-1, every).mean(axis=1)
    h, noise = every * dt, (2 * np.pi / told["encoder_counts_per_rev"]) ** 2 / 12

    def run(p: np.ndarray) -> np.ndarray:
        K, tau = told["gain_rad_s_V"] * p[0], told["time_constant_s"] * p[1]
        keep = np.exp(-h / tau)
        F = np.array([[1.0, tau * (1 - keep)], [0.0, keep]])
        g = K * np.array([h - tau * (1 - keep), 1 - keep])
        return innovations(F, g, u, z[: len(u)], g, np.exp(p[2]), noise)

    start = np.array([1.0, 1.0, -8.0])
    simplex = start + np.vstack([np.zeros(3), np.diag([0.03, 0.1, 2.0])])
    options = {"initial_simplex": simplex, "maxfev": 60, "xatol": 1e-3, "fatol": 1e-4}
    best = minimize(lambda p: misfit(run(p)), start, method="Nelder-Mead", options=options)
    return run(best.x)


def ball(case: Case, axis: str) -> np.ndarray:
    """Innovations of x'' = A sin(theta) from picture to picture, process noise by likelihood."""
    seen = np.isfinite(case.log[f"ball_{axis}_m"])
    at, z = case.log["ball_exposed_s"][seen], case.log[f"ball_{axis}_m"][seen]
    t, a = case.log["t_s"], G_M_S2 * case.ratio(axis) * np.sin(case.angle(axis))
    whole = np.r_[0.0, np.cumsum(a[:-1] * np.diff(t))]
    h = float(np.median(np.diff(at)))
    u = np.diff(np.interp(at, t, whole), append=np.nan)[:-1] / h  # mean acceleration between
    F, g = np.array([[1.0, h], [0.0, 1.0]]), np.array([0.5 * h * h, h])
    noise = case.rig["camera"]["noise_m"] ** 2

    def run(log_variance: float) -> np.ndarray:
        return innovations(F, g, u, z[:-1], g, np.exp(log_variance), noise)

    best = minimize_scalar(lambda v: misfit(run(v)), bounds=(-16, 4), method="bounded",
                           options={"maxiter": 20})  # fmt: skip
    return run(float(best.x))


def p_value(e: np.ndarray) -> float:
    """Of Ljung and Box's Q = n (n + 2) sum r_k^2/(n - k), chi-square with 20 degrees."""
    e = e - e.mean()
    r = np.array([e[k:] @ e[: len(e) - k] for k in range(1, LAGS + 1)]) / (e @ e)
    n = len(e)
    return float(chi2.sf(n * (n + 2) * np.sum(r * r / (n - np.arange(1, LAGS + 1))), LAGS))


def answer_of(folder: Path) -> dict:
    case = read_case(folder)
    tested = {f"ball_{a}": p_value(ball(case, a)) for a in "xy"}
    if case.voltage:
        tested |= {f"servo_{a}": p_value(servo(case, a)) for a in "xy"}
    worst = min(tested, key=lambda channel: tested[channel])
    if tested[worst] * len(tested) < LEVEL:
        return answer("unknown-effect", unknown={"channel": worst, "p": tested[worst]})
    return answer("nothing-missing")
