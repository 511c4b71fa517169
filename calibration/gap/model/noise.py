"""Noise levels estimated on the log itself, by maximum likelihood of the innovations.

Ball: process q (white acceleration), camera r and its memory (AR(1)) together: a wrong q alone
makes healthy logs look faulty. Servo, per axis: process q and the encoder's own r, while it moves:
the error of a resting encoder is one constant and no noise.
"""

from collections.abc import Callable

import numpy as np
from scipy.optimize import minimize

from calibration.gap.evidence import Evidence
from calibration.gap.fit import loss
from calibration.gap.knobs import BALL, SERVO, Model

LEAST_GAIN = 6.0  # in log-likelihood, for which camera noise is called coloured
IMPOSSIBLE = 1e9  # the cost of noise under which a filter overflows
SMALLEST_M, LARGEST_RHO = 2e-6, 0.95


def estimate(evidence: Evidence, model: Model, parts: tuple[str, ...]) -> np.record:
    """Levels (dtype NOISE) that make the innovations of `model` most likely."""
    levels = evidence.levels.copy()
    for part in parts:
        if part == BALL:
            _ball(evidence, model, levels)
        else:
            _servo(evidence, model, levels, SERVO.index(part))
    return levels


def _search(cost: Callable[[np.ndarray], float], start: list[float]) -> np.ndarray:
    """Nelder and Mead in logarithms: a factor of 2 first, a few per cent at the end."""
    simplex = np.array([start] + [[v + 0.7 * (i == j) for j, v in enumerate(start)]
                                  for i in range(len(start))])  # fmt: skip
    options = {"initial_simplex": simplex, "xatol": 0.05, "fatol": 0.5, "maxfev": 60}

    def told(x: np.ndarray) -> float:
        found = cost(x)
        return found if np.isfinite(found) else IMPOSSIBLE

    return minimize(told, start, method="Nelder-Mead", options=options).x


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
    frame_s = float(np.median(np.concatenate([np.diff(run.exposed_s) for run in evidence.runs
                                              if len(run.exposed_s) > 1])))  # fmt: skip

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
        put(coloured if cost(coloured) < cost(white) - LEAST_GAIN else white)


def _coloured(evidence: Evidence, model: Model) -> bool:
    """Do the residuals of neighbouring frames still hang together under white camera noise?"""
    z = (evidence.roll(model, BALL).z * evidence.masks[BALL]).reshape(-1, 2)
    for lag in (1, 2, 3):
        hang = np.sum(z[lag:] * z[:-lag], axis=0) / np.maximum(np.sum(z**2, axis=0), 1e-30)
        if np.abs(hang).max() > 3.5 / np.sqrt(len(z)):
            return True
    return False
