"""Noise levels of the filters, by maximum likelihood of the innovations of a model on its log.

    (q, r, rho) = argmin C(q, r, rho),   C as in `calibration.gap.model.fit`

Ball: process noise q (white acceleration) [m/s2/sqrt(Hz)], camera noise r [m] and its AR(1)
coefficient rho from frame to frame. Servo, per axis: process noise q and the encoder's r [rad],
where it moves: the error of a resting encoder is a constant. The levels depend on the model: beside
a wrong one they take its misfit in.
"""

from collections.abc import Callable

import numpy as np
from scipy.optimize import minimize

from calibration.gap.model.data import Evidence
from calibration.gap.model.fit import loss
from calibration.gap.model.parameters import BALL, SERVO, Model

MIN_COLOUR_GAIN = 6.0  # log-likelihood that an AR(1) camera noise has to gain; chosen
DIVERGED_COST = 1e9  # of noise levels under which a filter overflows
SMALLEST_M, LARGEST_RHO = 2e-6, 0.95


def estimate(evidence: Evidence, model: Model, outputs: tuple[str, ...]) -> np.record:
    """Noise levels (dtype NOISE) that make the innovations of `model` on these outputs most likely
    (the module's equation); levels of other outputs stay as in the evidence."""
    levels = evidence.levels.copy()
    for output in outputs:
        if output == BALL:
            _ball(evidence, model, levels)
        else:
            _servo(evidence, model, levels, SERVO.index(output))
    return levels


def _search(cost: Callable[[np.ndarray], float], start: list[float]) -> np.ndarray:
    """argmin by Nelder and Mead over logarithms: first steps of a factor 2, 5 % at the end."""
    simplex = np.array(
        [start] + [[v + 0.7 * (i == j) for j, v in enumerate(start)] for i in range(len(start))]
    )
    options = {"initial_simplex": simplex, "xatol": 0.05, "fatol": 0.5, "maxfev": 60}

    def finite(x: np.ndarray) -> float:
        value = cost(x)
        return value if np.isfinite(value) else DIVERGED_COST

    return minimize(finite, start, method="Nelder-Mead", options=options).x


def _servo(evidence: Evidence, model: Model, levels: np.record, a: int) -> None:
    smallest = 0.02 * levels["servo_measured"][a]

    def cost(x: np.ndarray) -> float:
        levels["servo_process"][a], levels["servo_measured"][a] = np.exp(x)
        penalty = 1e6 if np.exp(x[1]) < smallest or not -12 < x[0] < 8 else 0.0
        trial = evidence.with_levels(levels)
        return loss(trial.roll(model, SERVO[a]), evidence.masks[SERVO[a]]) + penalty

    start = [float(np.log(levels[n][a])) for n in ("servo_process", "servo_measured")]
    best = np.exp(_search(cost, start))
    levels["servo_process"][a], levels["servo_measured"][a] = best


def _ball(evidence: Evidence, model: Model, levels: np.record) -> None:
    frame_s = float(
        np.median(
            np.concatenate(
                [np.diff(run.exposed_s) for run in evidence.runs if len(run.exposed_s) > 1]
            )
        )
    )

    def put(x: np.ndarray) -> None:
        levels["ball_process"], levels["ball_measured"] = np.exp(x[:2])
        rho = LARGEST_RHO / (1 + np.exp(-x[2])) if len(x) > 2 else 0.0
        levels["ball_memory_s"] = -frame_s / np.log(rho) if rho > 0.02 else 0.0

    def cost(x: np.ndarray) -> float:
        put(x)
        penalty = 1e6 if np.exp(x[1]) < SMALLEST_M or x[0] < -14 else 0.0
        return loss(evidence.with_levels(levels).roll(model, BALL), evidence.masks[BALL]) + penalty

    white = _search(cost, [float(np.log(levels[n])) for n in ("ball_process", "ball_measured")])
    put(white)
    if _coloured(evidence.with_levels(levels), model):
        coloured = _search(cost, [*white, 0.0])
        put(coloured if cost(coloured) < cost(white) - MIN_COLOUR_GAIN else white)


def _coloured(evidence: Evidence, model: Model) -> bool:
    """True if residuals of neighbouring frames are correlated under white camera noise: an
    autocorrelation at lag 1 to 3 beyond 3.5/sqrt(n)."""
    z = (evidence.roll(model, BALL).z * evidence.masks[BALL]).reshape(-1, 2)
    for lag in (1, 2, 3):
        correlation = np.sum(z[lag:] * z[:-lag], axis=0) / np.maximum(np.sum(z**2, axis=0), 1e-30)
        if np.abs(correlation).max() > 3.5 / np.sqrt(len(z)):
            return True
    return False
