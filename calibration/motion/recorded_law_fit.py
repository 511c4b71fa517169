"""The law of one axis whose commands differ least from the recorded ones.

It begins from linear least squares, for with the filter's T given c is linear in K_p x, K_i int(x),
K_d D(x) and, between two changes of the target, a constant and a slope; there the rate's limit is
left out. From the best of these every number and the targets are fitted together, limits included.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.optimize import least_squares

from calibration.motion.recorded_law import KI, KP, OF_TARGET, follow, started
from calibration.motion.target_changes import SETTLE_S

FILTERS_S = (0.01, 0.03, 0.1, 0.3)  # where the fit begins; chosen: factors of 3 about the usual
# ln T ends a factor of 10 beyond them: farther out no command depends on it, and a fit that strays
# there does not come back.
LEAST_LN_T, MOST_LN_T = np.log(min(FILTERS_S) / 10), np.log(max(FILTERS_S) * 10)
EXACT = 1e-3  # relative; commands nearer to the largest are at a limit
OFTEN = 10  # rows at a limit that make it one; chosen: noise reaches its own maximum once
ROBUST = 0.1  # of the commands' deviation: larger residuals count linearly; chosen
# Without an integral, targets and I at the begin are told apart by where the ball settles alone:
# within 2 cm of its target, which counts as 7 commands; chosen.
NEAR_M, SETTLED = 0.02, 7.0
INTEGRAL_S = 5.0  # K_p/K_i where the fit begins; chosen: slower than the ball settles
LEAST = 1e-3  # of a gain where the fit begins
BEST_STARTS = 6  # of eight; chosen: the best one need not be nearest to where its fit ends
FEW_STEPS = 8  # from each of them, before the best goes on; chosen: a wrong one stands far off then
MOST_STEPS = 60  # of a fit; chosen: it needs 10 to 30


@dataclass(frozen=True, eq=False)
class Told:
    """What was seen and told: t_s (n,); ball [m] and told [rad] (n, 2), without gaps; the stretches
    of rows; targets (n, 2) [m] where they were recorded."""

    t_s: np.ndarray
    ball: np.ndarray
    told: np.ndarray
    rows: tuple[slice, ...]
    targets: np.ndarray | None

    @property
    def tick_s(self) -> float:
        """The period of the log [s]."""
        return float(np.median(np.diff(self.t_s)))


@dataclass(frozen=True, eq=False)
class AxisFit:
    """The fit of one axis: law (7,), I at the stretches' begins [rad], the target (n,) [m], NaN
    outside the stretches, and its levels between changes; explained: share of the variance."""

    law: np.ndarray
    integrals: np.ndarray
    targets: np.ndarray
    levels: np.ndarray
    explained: float


def sections(data: Told, changes: Sequence[int]) -> list[slice]:
    """The rows between changes, stretch by stretch."""
    found = []
    for s in data.rows:
        edges = [s.start, *[k for k in changes if s.start < k < s.stop], s.stop]
        found += [slice(i, j) for i, j in pairwise(edges)]
    return found


def targets_of(data: Told, changes: Sequence[int], levels: np.ndarray) -> np.ndarray:
    """The target (n,) [m] that has these levels between changes, NaN outside the stretches."""
    targets = np.full(len(data.t_s), np.nan)
    for section, level in zip(sections(data, changes), levels, strict=True):
        targets[section] = level
    return targets


def missed(
    data: Told, a: int, law: np.ndarray, integrals: np.ndarray, targets: np.ndarray
) -> np.ndarray:
    """Commands of the law less the recorded ones [rad], all judged rows in a row."""
    found, skip = [], round(SETTLE_S / data.tick_s)
    for s, integral in zip(data.rows, integrals, strict=True):
        out = np.empty(s.stop - s.start)
        follow(
            law,
            started(integral, data.told[s.start, a]),
            targets[s],
            data.ball[s, a],
            data.tick_s,
            out,
        )
        found.append((out - data.told[s, a])[skip:])
    return np.concatenate(found)


def fit_axis(data: Told, a: int, changes: Sequence[int], begin: AxisFit | None = None) -> AxisFit:
    """Fit axis a; begin: a fit with other changes, else the best of the linear starts."""
    judged = np.concatenate([data.told[s, a] for s in data.rows])
    levels = np.array([_late_ball(data.ball[s, a]) for s in sections(data, changes)])
    given = None if data.targets is None else data.targets[:, a]

    def targets(levels: np.ndarray) -> np.ndarray:
        return targets_of(data, changes, levels) if given is None else given

    scale, late = ROBUST * float(judged.std()), levels

    def residuals(p: np.ndarray, law: np.ndarray) -> np.ndarray:
        trial, integrals, tried = _unpacked(p, law, len(data.rows))
        off = (tried - late[: len(tried)]) * (SETTLED * scale / NEAR_M)
        return np.append(missed(data, a, trial, integrals, targets(tried)), off)

    def from_there(p: np.ndarray, law: np.ndarray, steps: int) -> tuple[float, np.ndarray]:
        low, high = np.full(len(p), -np.inf), np.full(len(p), np.inf)
        low[:3] = 0.0  # gains
        low[3], high[3] = LEAST_LN_T, MOST_LN_T
        found = least_squares(
            residuals,
            p,
            args=(law,),
            loss="soft_l1",
            f_scale=scale,
            max_nfev=steps,
            x_scale="jac",
            bounds=(low, high),
        )
        return float(found.cost), found.x

    starts = [begin.law] if begin else list(_linear_starts(data, a, changes))
    integrals = begin.integrals if begin else np.zeros(len(data.rows))
    if begin and len(begin.levels) == len(levels):
        levels = begin.levels
    begins = [_packed(one, integrals, levels if given is None else levels[:0]) for one in starts]
    first = [float(np.mean(abs(residuals(p, one)))) for p, one in zip(begins, starts, strict=True)]
    tried = [
        (*from_there(begins[i], starts[i], FEW_STEPS), starts[i])
        for i in np.argsort(first)[:BEST_STARTS]
    ]
    _, p, law = min(tried, key=lambda one: one[0])
    p = from_there(p, law, MOST_STEPS)[1]
    law, integrals, levels = _unpacked(p, law, len(data.rows))
    rest = missed(data, a, law, integrals, targets(levels))
    explained = 1.0 - float(np.mean(rest**2) / judged.var())
    return AxisFit(law, integrals, targets(levels), levels, explained)


def _packed(law: np.ndarray, integrals: np.ndarray, levels: np.ndarray) -> np.ndarray:
    return np.concatenate([law[:3], [np.log(law[3])], integrals, levels])


def _unpacked(
    p: np.ndarray, law: np.ndarray, stretches: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    trial = np.concatenate([p[:3], [np.exp(p[3])], law[4:]])
    return trial, p[4 : 4 + stretches], p[4 + stretches :]


def _late_ball(ball: np.ndarray) -> float:
    return float(np.median(ball[2 * len(ball) // 3 :]))


def _at_most(values: np.ndarray) -> float:
    """The limit that values are held at, infinite where there is none."""
    top = float(values.max())
    return top if np.sum(values >= (1 - EXACT) * top) >= OFTEN else np.inf


def _linear_starts(data: Told, a: int, changes: Sequence[int]) -> Iterator[np.ndarray]:
    """Laws of the module's linear least squares, one for each filter."""
    dt = data.tick_s
    slopes = np.concatenate([abs(np.diff(data.told[s, a])) / dt for s in data.rows])
    rate = _at_most(slopes)
    limit = _at_most(np.concatenate([abs(data.told[s, a]) for s in data.rows]))
    parts = sections(data, changes)
    told = np.concatenate([data.told[s, a] for s in parts])
    free = np.concatenate(
        [np.append(abs(np.diff(data.told[s, a])) < 0.99 * rate * dt, False) for s in parts]
    )
    for filter_s in FILTERS_S:
        blocks = [_terms(data.ball[s, a], filter_s, dt) for s in parts]
        own = np.zeros((len(told), 2 * len(parts)))
        row = 0
        for i, block in enumerate(blocks):
            own[row : row + len(block), 2 * i] = 1.0
            own[row : row + len(block), 2 * i + 1] = np.arange(len(block)) * dt
            row += len(block)
        X = np.hstack([np.vstack(blocks), own])[free]
        found = np.linalg.lstsq(X, told[free], rcond=None)[0][:3]
        law = np.array([*-found, filter_s, 1.0, rate, limit])
        law[:3] = np.maximum(law[:3], LEAST)
        law[KI] = law[KP] / INTEGRAL_S  # the slopes between changes take its part
        for share in (1.0, 0.0):  # the derivative is of the error, or of the ball alone
            law[OF_TARGET] = share
            yield law.copy()


def _terms(ball: np.ndarray, filter_s: float, dt: float) -> np.ndarray:
    """x, its integral and its filtered derivative (n, 3), which K_p, K_i and K_d multiply."""
    law = np.array([0.0, 0.0, -1.0, filter_s, 0.0, np.inf, np.inf])
    slope = np.empty(len(ball))
    follow(law, started(0.0, 0.0), np.zeros(len(ball)), ball, dt, slope)
    return np.column_stack([ball, np.cumsum(ball) * dt, slope])
