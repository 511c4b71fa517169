"""Sparse regression of the discrepancy: PySINDy's ensemble of thresholded least squares.

As its authors describe it (Brunton, Proctor and Kutz 2016; discrepancy models: Kaheman et al. 2019;
ensembles: Fasel et al. 2022): what the nominal equations leave is regressed on a library of
candidate terms by sequentially thresholded ridge regression, on bagged rows; a term's inclusion
probability is the share of bags that keep it. Terms kept by more than half and beyond their
tolerance are the model. Columns have unit norm; the threshold is chosen by BIC (Mangan et al.
2017).
"""

import warnings
from pathlib import Path

import numpy as np
import pysindy as ps

from tests.benchmarks.entries.signals import Equation, answer, counts, effect, read_case
from tests.benchmarks.entries.terms import equations

BAGS, KEPT = 20, 0.5
THRESHOLDS = (0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 0.9)  # of the discrepancy's standard deviation
BLOCK = 25  # rows, 1 s: neighbours are not independent


def regression(parts: list[Equation]) -> tuple[np.ndarray, np.ndarray, list, np.ndarray]:
    """Theta (n, k), e (n,), keys, scales (k,) of a group of equations; what a calibration leaves is
    taken out of both sides first. Every equation weighs by its own spread.
    """
    keys = list(dict.fromkeys(key for part in parts for key in part.columns))
    blocks, sides = [], []
    for part in parts:
        zero = np.zeros(len(part.e))
        X = np.column_stack([part.columns.get(key, zero) for key in keys])
        weight = part.e.std()
        free = np.column_stack([part.free, np.zeros(len(part.e))])
        out = free @ np.linalg.lstsq(free, np.column_stack([X, part.e]), rcond=None)[0]
        blocks.append((X - out[:, :-1]) / weight)
        sides.append((part.e - out[:, -1]) / weight)
    Theta, e = np.vstack(blocks), np.concatenate(sides)
    scale = np.maximum(np.sqrt(np.mean(Theta**2, axis=0)), 1e-12)
    return Theta / scale, e, keys, scale


def fitted(Theta: np.ndarray, e: np.ndarray, threshold: float) -> np.ndarray:
    """Coefficients (k,) of thresholded ridge regression; all zero where nothing is left."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that nothing is left
        model = ps.STLSQ(threshold=threshold, alpha=0.01 * len(e))
        return model.fit(Theta, e[:, None]).coef_.ravel()


def chosen(Theta: np.ndarray, e: np.ndarray) -> float:
    """The threshold of least BIC, n ln(RSS/n) + k ln n, with one independent row a block."""
    n, scores = len(e) / BLOCK, []
    for threshold in THRESHOLDS:
        used = np.flatnonzero(fitted(Theta, e, threshold * e.std()))
        left = e - Theta[:, used] @ np.linalg.lstsq(Theta[:, used], e, rcond=None)[0]
        scores.append(n * np.log(np.mean(left**2)) + len(used) * np.log(n))
    return THRESHOLDS[int(np.argmin(scores))] * float(e.std())


def bagged(Theta: np.ndarray, e: np.ndarray) -> np.ndarray:
    """Coefficients (BAGS, k) of thresholded least squares on blocks of rows drawn anew."""
    rng, found, threshold = np.random.default_rng(0), [], chosen(Theta, e)
    starts = np.arange(0, len(e) - BLOCK, BLOCK)
    for _ in range(BAGS):
        rows = (rng.choice(starts, len(starts))[:, None] + np.arange(BLOCK)).ravel()
        found.append(fitted(Theta[rows], e[rows], threshold))
    return np.array(found)


def answer_of(folder: Path) -> dict:
    parts = equations(read_case(folder))
    groups = [[p for p in parts if p.channel.startswith(side)] for side in ("servo", "ball")]
    names: dict[str, list] = {}
    for group in filter(None, groups):
        Theta, e, keys, scale = regression(group)
        coefficients = bagged(Theta, e)
        share = np.mean(coefficients != 0, axis=0)
        for k in np.flatnonzero(share > KEPT):
            used = coefficients[coefficients[:, k] != 0, k] / scale[k]
            if not counts(keys[k][0], used.mean()):
                continue
            names.setdefault(keys[k][0], []).append((keys[k], share[k], used.mean(), used.std()))
    effects = []
    for name, kept in names.items():
        sizes = {(key[1], key[2]): (float(v), float(s)) for key, _, v, s in kept}
        effects.append(effect(name, float(max(one[1] for one in kept)), sizes))
    return answer("named", effects) if effects else answer("nothing-missing")
