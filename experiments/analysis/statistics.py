"""What a handful of runs can say: paired differences, means, shares, many claims at once.

Pure functions of plain arrays; every interval is at 95 %. The verdict on a claim is fixed before
the runs: it holds where the whole interval lies beyond a relevant size, fails where it lies below.
"""

from dataclasses import dataclass
from math import ceil, inf, nan, sqrt

import numpy as np

LEVEL = 0.95
FEWEST_PAIRS = 6  # 2^5 sign patterns give no two-sided p below 0.0625
EXACT_PAIRS = 12  # up to here all 2^n subsets are listed
SUBSETS = 9999  # drawn beyond; (SUBSETS + 1) * 0.025 is whole
RESAMPLES = 1999


@dataclass(frozen=True)
class Paired:
    """Paired comparison in the unit of the values: effect = mean(without - with), > 0 = it helps.

    low, high: 95 % interval; p: two-sided, by sign flips; n: pairs used; relevant: the size fixed
    before the runs; holds: True (the interval lies above `relevant`), False (it lies below) or None
    (undecided, see `reason`); left_out: pairs with a NaN.
    """

    effect: float
    low: float
    high: float
    p: float
    n: int
    relevant: float
    holds: bool | None
    reason: str = ""
    left_out: int = 0


@dataclass(frozen=True)
class ConfidenceInterval:
    """A value with its 95 % interval low to high, and the number n of values behind it."""

    value: float
    low: float
    high: float
    n: int


def paired(
    without: np.ndarray, with_: np.ndarray, *, relevant: float, rng: np.random.Generator
) -> Paired:
    """Compare two arms seed by seed, `without` (n,) and `with_` (n,), by the sign-flip test.

    Where the differences d are symmetric about the effect, all 2^n sign patterns are equally
    likely. The effects which that test does not reject lie between order statistics of the subset
    means: flipping the subset F exceeds what was observed exactly if mean_F(d) <= effect (Hartigan,
    J. Am. Stat. Assoc. 64, 1969). All subsets for n <= 12, else 9999 drawn with `rng`. Skewed
    differences cost coverage: 92 % instead of 95 % at n = 24 for exponential ones. relevant: the
    size, in the unit of the values, that the interval is compared with. Fewer than 6 pairs are
    undecided. ValueError: the arms' shapes are not one (n,), or relevant < 0.
    """
    without, with_ = np.asarray(without, float), np.asarray(with_, float)
    if without.ndim != 1 or without.shape != with_.shape:
        raise ValueError(
            f"paired values have one shape (n,), these have {without.shape} and {with_.shape}: "
            "give one value a seed and arm"
        )
    if not relevant >= 0:
        raise ValueError(f"relevant = {relevant}: the relevant size must be 0 or more")
    d = without - with_
    d = d[np.isfinite(d)]
    n, left_out = len(d), len(without) - len(d)
    effect = float(d.mean()) if n else nan
    if n < FEWEST_PAIRS:
        p = _p_of(_subset_sums(d, rng)[0]) if n else nan
        reason = f"{n} pairs: fewer than {FEWEST_PAIRS} cannot reach 95 %"
        return Paired(effect, -inf, inf, p, n, relevant, None, reason, left_out)
    sums, counts = _subset_sums(d, rng)
    means = np.sort(sums / counts)
    k = int((1 - LEVEL) / 2 * (len(means) + 1) + 1e-9)
    low, high = float(means[k - 1]), float(means[-k])
    holds, reason = _verdict(low, high, relevant)
    return Paired(effect, low, high, _p_of(sums), n, relevant, holds, reason, left_out)


def _subset_sums(d: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Sums (m,) of d (n,) over its non-empty subsets and their sizes (m,): all, or a drawn lot."""
    n = len(d)
    if n <= EXACT_PAIRS:
        inside = (np.arange(1, 2**n)[:, None] >> np.arange(n)) & 1
    else:
        inside = rng.integers(0, 2, (SUBSETS, n), dtype=np.int8)
        inside[~inside.any(axis=1), 0] = 1
    inside = inside.astype(float)  # (m, n)
    return inside @ d, inside.sum(axis=1)


def _p_of(sums: np.ndarray) -> float:
    """Two-sided p of "no effect": twice the rarer side; the unflipped pattern always counts."""
    total = len(sums) + 1
    slack = 1e-12 * float(np.abs(sums).max(initial=0.0))  # rounding must not break ties
    rarer = min(int((sums <= slack).sum()), int((sums >= -slack).sum()))
    return min(1.0, 2 * (1 + rarer) / total)


def _verdict(low: float, high: float, relevant: float) -> tuple[bool | None, str]:
    if low > relevant:
        return True, ""
    if high < relevant:
        return False, ""
    return None, f"the interval {low:.3g} to {high:.3g} includes the relevant size {relevant:.3g}"


def mean_interval(values: np.ndarray) -> ConfidenceInterval:
    """Mean of independent values (n,) and its 95 % interval by Student's t.

    NaN and infinite values are left out; with fewer than two values the interval is infinite.
    Not scipy's ttest_1samp: it warns of nearly identical values, which runs without play have.
    Not BCa: with few values it is far too narrow (measured, for 95 %: normal values n = 24 92.5 %,
    n = 4 80 %; t 95 % and 96 %). Exponential values (skewness 2) leave t 91.6 % at n = 24.
    """
    values = np.asarray(values, float).ravel()
    values = values[np.isfinite(values)]
    n = len(values)
    if n < 2:
        return ConfidenceInterval(float(values[0]) if n else nan, -inf, inf, n)
    mean = float(values.mean())
    half = float(_student(n - 1) * values.std(ddof=1) / sqrt(n))
    return ConfidenceInterval(mean, mean - half, mean + half, n)


def mean_difference(first: np.ndarray, second: np.ndarray) -> ConfidenceInterval:
    """mean(second) - mean(first) of independent values (n,) and (m,) of any variances, and its 95 %
    interval by Welch (Biometrika 34, 1947); n: the smaller number of values.

    NaN and infinite values are left out; with fewer than two of either the interval is infinite.
    """
    one, other = mean_interval(first), mean_interval(second)
    value, n = other.value - one.value, min(one.n, other.n)
    if n < 2:
        return ConfidenceInterval(value, -inf, inf, n)
    parts = [((i.high - i.value) / _student(i.n - 1)) ** 2 for i in (one, other)]
    spread = sum(parts) ** 2
    steps = sum(part**2 / (i.n - 1) for part, i in zip(parts, (one, other), strict=True))
    half = _student(spread / steps) * sqrt(sum(parts)) if steps > 0 else 0.0
    return ConfidenceInterval(value, value - half, value + half, n)


@dataclass(frozen=True, eq=False)
class WithinRun:
    """95 % intervals of one run's long-term mean position and spread [m]; arrays (2,) are x, y.

    block_s: length of the bootstrap's blocks; blocks: how many of them the run holds (not a whole
    number). The intervals are NaN with fewer than 2 blocks.
    """

    mean_low_m: np.ndarray
    mean_high_m: np.ndarray
    spread_low_m: float
    spread_high_m: float
    block_s: float
    blocks: float


def within_run_interval(
    xy_m: np.ndarray, *, sample_s: float, period_s: float = nan, rng: np.random.Generator
) -> WithinRun:
    """Intervals of ONE run's mean and spread by a moving-block bootstrap of samples xy (n, 2).

    The samples are settled and correlated. sample_s: time between samples; period_s: of the limit
    cycle, NaN where there is none; rng draws the blocks. Blocks are whole limit-cycle periods (a
    sixth of the run where there is none), so long that about four to six fit in: resampled blocks
    keep the correlation within (Kuensch, Ann. Stat. 17, 1989). So few blocks make the bootstrap's
    spread too small, which Student's t and k/(k - 1), k the number of blocks, correct. Measured on
    a sine plus AR(1), 8 to 45 s: 89 to 99 % of the intervals hold the truth. An axis of NaN only is
    left out; rows with another NaN are dropped.
    """
    xy = np.asarray(xy_m, float)
    missing = np.isnan(xy).all(axis=0) if len(xy) else np.array([True, True])
    xy = np.where(missing, 0.0, xy)
    xy = xy[~np.isnan(xy).any(axis=1)]
    if len(xy) < 2 or missing.all():
        return WithinRun(np.full(2, nan), np.full(2, nan), nan, nan, nan, 0.0)
    duration = len(xy) * sample_s
    periods = duration / period_s if period_s > 0 else nan
    block_s = duration / 6 if np.isnan(periods) else max(1, int(periods / 4)) * period_s
    length = max(1, ceil(block_s / sample_s - 1e-9))
    k = len(xy) / length
    if k < 2:
        return WithinRun(np.full(2, nan), np.full(2, nan), nan, nan, block_s, k)
    terms = np.column_stack([xy, (xy**2).sum(axis=1)])
    sums = np.vstack([np.zeros(3), np.cumsum(terms, axis=0)])
    block = (sums[length:] - sums[:-length]) / length  # mean x, y, x2 + y2 of every block
    drawn = block[rng.integers(0, len(block), (RESAMPLES, ceil(k)))].mean(axis=1)
    widen = sqrt(ceil(k) / k * k / (k - 1))
    wide = _student(k - 1) * widen
    centre = block.mean(axis=0)
    half = wide * drawn[:, :2].std(axis=0)
    lost = (widen * drawn[:, :2].std(axis=0)) ** 2  # a run's own mean hides so much of its spread
    tiny = np.finfo(float).tiny
    variance = max(centre[2] - (centre[:2] ** 2).sum() + lost.sum(), tiny)
    each = np.log(np.maximum(drawn[:, 2] - (drawn[:, :2] ** 2).sum(axis=1), tiny)) / 2
    low, high = np.exp(np.log(variance) / 2 + np.array([-1, 1]) * wide * each.std())
    mean = np.where(missing, nan, centre[:2])
    return WithinRun(mean - half, mean + half, float(low), float(high), block_s, k)


def _student(freedom: float) -> float:
    """Two-sided 95 % point of Student's t."""
    from scipy.special import stdtrit

    return float(stdtrit(freedom, 0.5 + LEVEL / 2))


def wilson(k: int, n: int) -> ConfidenceInterval:
    """Share k/n with Wilson's score interval (1927); for n = 0 NaN within 0 to 1.

    ValueError: k not within 0 to n.
    """
    from scipy.stats import binomtest

    if not 0 <= k <= n:
        raise ValueError(f"k = {k} of n = {n}: k must lie within 0 and n")
    if n == 0:
        return ConfidenceInterval(nan, 0.0, 1.0, 0)
    interval = binomtest(k, n).proportion_ci(LEVEL, method="wilson")
    return ConfidenceInterval(k / n, float(interval.low), float(interval.high), n)


def holm(p: np.ndarray) -> np.ndarray:
    """P-values adjusted for m claims tested at once, (m,), by Holm's step-down method (1979).

    p (m,); NaN (not tested) stays NaN and does not count to m. Reject where the result is <= 0.05:
    the chance of any false rejection is then at most 5 %. ValueError: not of shape (m,), or not in
    0 to 1.
    """
    p = np.asarray(p, float)
    if p.ndim != 1 or ((p < 0) | (p > 1)).any():
        raise ValueError(f"p-values are numbers from 0 to 1 of shape (m,), got {p}")
    tested = np.flatnonzero(~np.isnan(p))
    order = tested[np.argsort(p[tested], kind="stable")]
    steps = p[order] * np.arange(len(order), 0, -1)
    adjusted = np.full(p.shape, nan)
    adjusted[order] = np.minimum(np.maximum.accumulate(steps), 1.0)
    return adjusted
