"""How large a score chance alone brings on a log like this: the threshold for its own excitation.

Where nothing is missing, what is left of the innovations has no part in common with the shape of
any effect. So each second of it gets a sign at random (wild cluster bootstrap: Cameron, Gelbach and
Miller 2008), which keeps its size, its colour and the motion, and the linear gain of every effect
is taken again. A draw costs no roll-out: the gain needs only the blocks' sums of J'Wz.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from calibration.gap.fit import weights
from calibration.gap.intervals import BLOCK_S
from calibration.gap.knobs import Believed
from calibration.gap.screen import Candidates, beyond_knobs, candidates
from calibration.gap.state import State

DRAWS, ONE_IN, SEED = 300, 100, 1
FEWEST_BLOCKS = 12  # of a short log; its blocks are shorter


@dataclass(frozen=True)
class Chance:
    """scores: by part (servo_x, servo_y, ball) the best one of all its effects that chance exceeds
    in one of ONE_IN logs like this."""

    scores: Mapping[str, float]
    draws: int

    def of(self, parts: Iterable[str]) -> float:
        """What an effect that is felt in these parts has to score."""
        return max((self.scores[part] for part in parts if part in self.scores), default=0.0)


def by_chance(state: State, parts: Iterable[str], *, draws: int = DRAWS) -> Chance:
    """What the best effect of each part scores by chance, given a model that lacks nothing.

    Each part by itself: what is left in one (a servo that is modelled roughly) says nothing of how
    surely another is known.
    """
    rng = np.random.default_rng(SEED)
    scores = {}
    for part in parts:
        tried = candidates(state, part, set())
        matrix, sums = _equations(state, part, tried)
        turned = rng.choice([-1.0, 1.0], (draws, len(sums))) @ sums
        best = _best(tried, state.believed, matrix, turned)
        scores[part] = float(np.quantile(best, 1.0 - 1.0 / ONE_IN))
    return Chance(scores, draws)


def _equations(state: State, part: str, tried: Candidates) -> tuple[np.ndarray, np.ndarray]:
    """J'WJ (m, m) of nuisance and all candidates, and J'Wz block by block (blocks, m)."""
    z = state.fit.rolls[part].z
    w = weights(z, state.evidence.masks[part])
    j = np.column_stack([tried.nuisance, *(one.columns for one in tried.effects)])
    t, run = state.evidence.times(part)
    seconds = sum(float(np.ptp(t[run == r])) for r in np.unique(run))
    block_s = min(BLOCK_S, seconds / FEWEST_BLOCKS)
    number = run * 2**32 + np.floor(t / block_s).astype(np.int64)
    starts = np.flatnonzero(np.diff(number, prepend=-1))
    sums = np.add.reduceat(j * (w * z)[:, None], starts, axis=0)
    return (j * w[:, None]).T @ j, sums


def _best(tried: Candidates, believed: Believed, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The best score (draws,) of all candidates; b (draws, m) are the gradients of the draws."""
    best = np.zeros(len(b))
    widths = np.array([high - low for low, high in tried.bounds.values()])
    prior = 12.0 / np.maximum(widths, 1e-12) ** 2  # a box of this width
    first = len(tried.knobs)
    for one in tried.effects:
        own = np.arange(first, first + one.columns.shape[1])
        first += len(own)
        rest = one.others(tried.knobs)
        inner = a[np.ix_(rest, rest)] + np.diag(prior[rest] + 1e-9 * np.diag(a)[rest] + 1e-12)
        share = np.linalg.solve(inner, a[np.ix_(rest, own)])
        left = a[np.ix_(own, own)] - a[np.ix_(own, rest)] @ share
        way = b[:, own] - b[:, rest] @ share
        if np.linalg.matrix_rank(left) < len(own):
            continue
        gain = 0.5 * np.sum(way * np.linalg.solve(left, way.T).T, axis=1)
        if not one.two_sided(believed):
            gain[way[:, 0] > 0.0] = 0.0
        knobs = len({name for start in one.group for name in start})
        best = np.maximum(best, beyond_knobs(gain, knobs))
    return best
