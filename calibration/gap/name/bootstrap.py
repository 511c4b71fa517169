"""The score that chance alone reaches on a log like this: a threshold for its own excitation.

Wild cluster bootstrap (Cameron, Gelbach and Miller, Rev. Econ. Stat. 90, 2008). If nothing is
missing, the residuals z left by the final model are uncorrelated with the shape of any effect. A
draw multiplies each block of time by a random sign v_b = -+1, which keeps size, colour and motion,
and takes the linear gain of every effect again:

    g = sum_b v_b J_b'W_b z_b,   A = J'WJ
    G = g_e' A_ee^-1 g_e / 2     with the nuisance parameters eliminated (Schur complement)

The threshold of an output is the quantile 1 - 1/CHANCE_ONE_IN of the largest penalised gain over
all its effects. A draw needs no new prediction, only the sums of J'Wz by block. It answers for the
linear screen: the exact refit that follows may gain more.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from calibration.gap.decision_rule import (
    BOOTSTRAP_DRAWS,
    CHANCE_ONE_IN,
    MIN_BLOCKS,
    penalised_gain,
)
from calibration.gap.model.cost import weights
from calibration.gap.model.intervals import BLOCK_S
from calibration.gap.model.parameters import NominalModel
from calibration.gap.model.state import State
from calibration.gap.name.screen import Candidates, candidates

SEED = 1


@dataclass(frozen=True)
class ChanceScores:
    """Thresholds of chance. `scores`: by output (servo_x, servo_y, ball), the score that the best
    of all its effects exceeds by chance in 1 of CHANCE_ONE_IN logs; `draws`: of the bootstrap."""

    scores: Mapping[str, float]
    draws: int

    def of(self, outputs: Iterable[str]) -> float:
        """The threshold of an effect that moves these outputs: their largest; 0 where none is
        known."""
        return max(
            (self.scores[output] for output in outputs if output in self.scores), default=0.0
        )


def chance_scores(
    state: State, outputs: Iterable[str], *, draws: int = BOOTSTRAP_DRAWS
) -> ChanceScores:
    """The thresholds of the outputs by the wild cluster bootstrap (Cameron, Gelbach and Miller
    2008), from a state whose model is taken to lack nothing. The seed is fixed.

    Each output is judged by itself: the residuals of one say nothing of how well another is
    modelled.
    """
    rng = np.random.default_rng(SEED)
    scores = {}
    for output in outputs:
        tried = candidates(state, output, set())
        matrix, sums = _equations(state, output, tried)
        turned = rng.choice([-1.0, 1.0], (draws, len(sums))) @ sums
        best = _best(tried, state.nominal, matrix, turned)
        scores[output] = float(np.quantile(best, 1.0 - 1.0 / CHANCE_ONE_IN))
    return ChanceScores(scores, draws)


def _equations(state: State, output: str, tried: Candidates) -> tuple[np.ndarray, np.ndarray]:
    """J'WJ (m, m) of the free parameters and all candidates, and J'Wz by block (blocks, m)."""
    z = state.fit.rolls[output].z
    w = weights(z, state.evidence.masks[output])
    j = tried.columns
    t, run = state.evidence.times(output)
    seconds = sum(float(np.ptp(t[run == r])) for r in np.unique(run))
    block_s = min(BLOCK_S, seconds / MIN_BLOCKS)
    number = run * 2**32 + np.floor(t / block_s).astype(np.int64)
    starts = np.flatnonzero(np.diff(number, prepend=-1))
    sums = np.add.reduceat(j * (w * z)[:, None], starts, axis=0)
    return (j * w[:, None]).T @ j, sums


def _best(tried: Candidates, nominal: NominalModel, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The largest score (draws,) over all candidates; b (draws, m): gradients of the draws."""
    best = np.zeros(len(b))
    widths = np.array([high - low for low, high in tried.bounds.values()])
    prior = 12.0 / np.maximum(widths, 1e-12) ** 2  # inverse variance of a uniform of this width
    for one in tried.effects:
        own, rest = one.places, one.others(tried.parameters)
        inner = a[np.ix_(rest, rest)] + np.diag(prior[rest] + 1e-9 * np.diag(a)[rest] + 1e-12)
        share = np.linalg.solve(inner, a[np.ix_(rest, own)])
        left = a[np.ix_(own, own)] - a[np.ix_(own, rest)] @ share
        gradient = b[:, own] - b[:, rest] @ share
        if np.linalg.matrix_rank(left) < len(own):
            continue
        gain = 0.5 * np.sum(gradient * np.linalg.solve(left, gradient.T).T, axis=1)
        if not one.two_sided(nominal):
            gain[gradient[:, 0] > 0.0] = 0.0
        parameters = len({name for start in one.group for name in start})
        best = np.maximum(best, penalised_gain(gain, parameters))
    return best
