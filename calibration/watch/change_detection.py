"""Has a table changed from run to run? A generalised likelihood ratio over runs and parameters.

Of each run i and watched parameter there is an estimate x_i with a standard deviation s_i. Let a
change lie between the runs k - 1 and k. With weights w_i = min(1, (s/s_i)^2), s the median of all
s_i, and the weighted means a over the runs before, b over those from k on,

    t_k = (b - a)/(r sqrt(1/W_a + 1/W_b)),    W_a, W_b: sums of the weights
    r^2 = (PRIOR_RUNS PRIOR_RATIO^2 s^2 + sum_i w_i (x_i - mean of its side)^2)/(PRIOR_RUNS + n - 2)

t_k is Student's t with PRIOR_RUNS + n - 2 degrees of freedom where the table did not change: the
moderated t of Smyth (Stat. Appl. Genet. Mol. Biol. 3, 2004). Its prior stands for the spread from
run to run as long as few runs tell it, and healthy tables differ from run to run by more than their
intervals. No single run may raise an alarm, for the fit of one run may fail: of the runs from k on
the one that speaks loudest for the change is left out, so that two have to agree (after the
two-in-a-row rule of Lucas and Crosier, Commun. Stat. Theory Methods 11, 1982), and a degree of
freedom goes with it. z_k is the normal deviate of the same probability. The statistic of a run n is

    g_n = max over parameters and k of |z_k|

the generalised likelihood ratio for a change of unknown time and size (Lorden, Ann. Math. Stat. 42,
1971), here with an unknown mean before it, too. It is an alarm above the threshold h at which one
such chart of normal deviates has an average run length of p ONE_IN runs, p parameters being watched
(Bonferroni; Siegmund and Venkatraman, Ann. Stat. 23, 1995):

    sqrt(2 pi) exp(h^2/2)/(h C) = p ONE_IN,    C = int_0^inf x nu(x)^2 dx,  nu(x) = exp(-0.583 x)

k at the maximum is the first run after the change. Where g is larger than sqrt(g_n^2 - 2 LIKELY)
other k are likely, too.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, log, pi, sqrt

import numpy as np
from scipy.optimize import root_scalar
from scipy.stats import norm
from scipy.stats import t as student

from calibration.statistics import student_quantile

ONE_IN = 100  # healthy runs of which one raises an alarm; asked for
# Spread of healthy runs over their standard deviations, and of how many runs' worth that knowledge
# is: moments of log spread over 10 healthy tables (tests/benchmarks/gap/watching.py --prior), by
# deviations a quarter smaller than those of today. Of these the moments are 0.8 and 1.7. Kept,
# since an alarm costs more than one run more before it.
PRIOR_RATIO, PRIOR_RUNS = 1.45, 4.2
LIKELY = 2.0  # log-likelihood below the maximum within which a time of change is likely; chosen
OVERSHOOT = 0.583  # nu(x) of the module's equation (Siegmund, Sequential Analysis, 1985)


@dataclass(frozen=True)
class Change:
    """A change of one parameter.

    parameter: its column; since: index of the first run after the change, `earliest` and `latest`
    those that are likely, too; size: mean after minus mean before, with its 95 % interval (low,
    high); before: the mean before, all in the parameter's unit; z: the statistic, with its sign.
    """

    parameter: int
    since: int
    earliest: int
    latest: int
    before: float
    size: float
    low: float
    high: float
    z: float


def alarm_threshold(parameters: int, one_in: float = ONE_IN) -> float:
    """The threshold h of the module's equation for so many watched `parameters`, one alarm in
    `one_in` healthy runs. ValueError: fewer than 1 parameter, or `one_in` below 10."""
    if parameters < 1 or one_in < 10:
        raise ValueError(f"{parameters} parameters, one alarm in {one_in}: at least 1 and 10")

    def excess(h: float) -> float:
        return log(average_run_length(h) / (parameters * one_in))

    return float(root_scalar(excess, bracket=(1.0, 30.0)).root)


def strongest(values: np.ndarray, stds: np.ndarray, accepted: int) -> list[Change | None]:
    """The most likely change of every parameter in the runs so far; None where too few runs tell
    the parameter.

    `values`, `stds` (n, p): the estimates of n runs in order and their standard deviations in the
    units of the parameters, NaN where a run tells nothing; `accepted`: how many runs at the
    beginning are the reference, among which no change is looked for. ValueError: shapes that
    differ, or no accepted run.
    """
    values, stds = np.asarray(values, float), np.asarray(stds, float)
    if values.shape != stds.shape or values.ndim != 2 or accepted < 1:
        raise ValueError(f"values {values.shape}, stds {stds.shape}, {accepted} accepted runs")
    return [_of_one(values[:, j], stds[:, j], accepted, j) for j in range(values.shape[1])]


def alarms(found: Sequence[Change | None], threshold: float) -> list[Change]:
    """The changes whose statistic exceeds the threshold, the strongest first."""
    over = [one for one in found if one is not None and abs(one.z) > threshold]
    return sorted(over, key=lambda one: -abs(one.z))


def smallest_seen(values: np.ndarray, stds: np.ndarray, threshold: float) -> np.ndarray:
    """The smallest lasting change (p,) that five further runs would show with even chances, in the
    units of the parameters; NaN where a parameter is not told. `values`, `stds` (n, p) as of
    `strongest`, of healthy runs."""
    sizes = np.full(values.shape[1], np.nan)
    for j in range(values.shape[1]):
        told = np.isfinite(values[:, j]) & (stds[:, j] > 0)
        n = int(told.sum())
        if n == 0:
            continue
        x, (weight, typical) = values[told, j], _weights(stds[told, j])
        mean = np.sum(weight * x) / np.sum(weight)
        rest = float(np.sum(weight * (x - mean) ** 2))
        freedom = PRIOR_RUNS + n - 1 + 4
        spread = (PRIOR_RUNS * (PRIOR_RATIO * typical) ** 2 + rest) / (PRIOR_RUNS + n - 1)
        reach = float(student.isf(norm.sf(threshold), freedom))
        sizes[j] = reach * sqrt(spread * (1 / n + 1 / 5))
    return sizes


def _weights(s: np.ndarray) -> tuple[np.ndarray, float]:
    """The weights w of the runs and their typical standard deviation s."""
    typical = float(np.median(s))
    return np.minimum(1.0, (typical / s) ** 2), typical


def _of_one(values: np.ndarray, stds: np.ndarray, accepted: int, column: int) -> Change | None:
    told = np.flatnonzero(np.isfinite(values) & (stds > 0) & np.isfinite(stds))
    first = int(np.sum(told < accepted))
    n = len(told)
    if first < 1 or n - first < 2:
        return None
    x, (w, typical) = values[told] - values[told[0]], _weights(stds[told])
    k = np.arange(first, n - 1)
    moments = np.array([np.concatenate([[0.0], np.cumsum(w * x**power)]) for power in (0, 1, 2)])
    before, after = moments[:, k], moments[:, [n]] - moments[:, k]
    prior = PRIOR_RUNS * (PRIOR_RATIO * typical) ** 2
    a, b = before[1] / before[0], after[1] / after[0]
    kept = after - _furthest(x, w, b > a)[:, k]
    z = _deviates(before, kept, prior, PRIOR_RUNS + n - 3)
    z = np.where(np.sign(z) == np.sign(b - a), z, 0.0)
    best = int(np.argmax(np.abs(z)))
    likely = np.flatnonzero(z**2 >= z[best] ** 2 - 2.0 * LIKELY)
    freedom = PRIOR_RUNS + n - 2
    _, error = _difference(before[:, best], after[:, best], prior, freedom)
    reach = student_quantile(freedom) * float(error)
    size = float(b[best] - a[best])
    return Change(
        column,
        int(told[k[best]]),
        int(told[k[likely[0]]]),
        int(told[k[likely[-1]]]),
        float(a[best] + values[told[0]]),
        size,
        size - reach,
        size + reach,
        float(z[best]),
    )


def _furthest(x: np.ndarray, w: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Weight, first and second moment (3, n) of the run from each k on that speaks loudest for a
    change: the highest where it goes `up` (for each k tried), else the lowest."""
    n = len(x)
    found = np.zeros((3, n))
    high = low = n - 1
    offset = n - 1 - len(up)
    for k in range(n - 1, -1, -1):
        high = k if x[k] > x[high] else high
        low = k if x[k] < x[low] else low
        upward = up[k - offset] if offset <= k < n - 1 else True
        i = high if upward else low
        found[:, k] = w[i], w[i] * x[i], w[i] * x[i] ** 2
    return found


def _difference(before, after, prior, freedom):
    """Mean after minus mean before, and its standard error, from moments (3, ...) of weights."""
    a, b = before[1] / before[0], after[1] / after[0]
    rest = np.maximum(before[2] - before[0] * a**2, 0.0) + np.maximum(
        after[2] - after[0] * b**2, 0.0
    )
    return b - a, np.sqrt((prior + rest) / freedom * (1 / before[0] + 1 / after[0]))


def _deviates(before, after, prior, freedom) -> np.ndarray:
    """Normal deviates of the same probability as the moderated t."""
    size, error = _difference(before, after, prior, freedom)
    tail = np.maximum(student.sf(np.abs(size / error), freedom), 1e-300)
    return np.sign(size) * norm.isf(tail)


def average_run_length(threshold: float) -> float:
    """Average run length of one chart of normal deviates at a threshold: the left side of the
    module's equation."""
    return sqrt(2 * pi) * exp(0.5 * threshold**2) * (2.0 * OVERSHOOT) ** 2 / threshold
