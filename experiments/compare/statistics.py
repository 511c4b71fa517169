"""What a grid of paired runs can say: exact sign flips, Holm over all cells, equal activity.

Effects are (rival - condition) of an error: above zero the condition helps. Pure functions.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict

import numpy as np

from experiments.analysis.numbers import MEASURES
from experiments.analysis.relevance import RELEVANT
from experiments.analysis.statistics import holm, paired

MOST_EXACT = 20
Rows = Mapping[str, Sequence[Mapping[str, float]]]  # condition -> one row of measures a seed
HELPS, HARMS, EVEN, OPEN = "helps", "harms", "no difference", "undecided"
SURE = 0.05  # p, corrected over all tests, up to which a difference is certain; chosen, as usual


def exact_p(differences: np.ndarray, rng: np.random.Generator) -> float:
    """Two-sided p of "no effect" by all 2^n sign flips of the differences (n,).

    For n > 20 by 2^18 flips drawn with `rng`. Values that are not finite are left out; NaN without
    any. With many cells a p of drawn flips alone could never pass Holm: its floor is 1/drawn. Not
    scipy's permutation_test: it lists the same patterns a thousand times slower (n = 14: 0.4 s).
    """
    d = np.asarray(differences, float)
    d = d[np.isfinite(d)]
    if not len(d):
        return float("nan")
    seen = abs(d.sum()) - 1e-12 * np.abs(d).sum()
    if len(d) <= MOST_EXACT:
        sums = np.zeros(1)
        for value in d:
            sums = np.concatenate((sums + value, sums - value))
        return float(np.mean(np.abs(sums) >= seen))
    count, found = 2**18, 1
    for _ in range(2**6):
        signs = rng.integers(0, 2, (count // 2**6, len(d)), dtype=np.int8) * 2.0 - 1.0
        found += int(np.sum(np.abs(signs @ d) >= seen))
    return found / (count + 1)


def _values(rows: Rows, condition: str, measure: str) -> np.ndarray:
    return np.array([row[measure] for row in rows[condition]], float)


def against(rows: Rows, condition: str, rival: str, measure: str, seed: Sequence[int]) -> dict:
    """Compare a condition with a rival in one measure, seed by seed.

    Returns the fields of `Paired` (effect = rival - condition in the unit of the measure, 95 %
    interval, exact p, relevant size), "rival", "unit" and "failed", the condition's runs that did
    not complete. seed: of the drawn sign flips.
    """
    one, other = _values(rows, rival, measure), _values(rows, condition, measure)
    unit = MEASURES[measure][0]
    rng = np.random.default_rng([*seed])
    result = paired(one, other, relevant=RELEVANT[unit], rng=rng)
    found = asdict(result) | {"rival": rival, "unit": unit, "p": exact_p(one - other, rng)}
    found["failed"] = int(np.isnan(other).sum())
    return found


def mean(rows: Rows, condition: str, measure: str) -> float:
    """Mean of a measure over the completed runs of a condition.

    NaN where fewer than three quarters of the runs completed.
    """
    values = _values(rows, condition, measure)
    done = values[np.isfinite(values)]
    return float(done.mean()) if len(done) >= 0.75 * len(values) else float("nan")


def equal_activity_rival(rows: Rows, condition: str, family: Sequence[str], measure: str) -> str:
    """Name of the rival of a condition at equal servo activity.

    That is, of "without" and the retuned PIDs `family`, the one with the smallest mean `measure`
    that moves the servo at most 2 % more than the condition; the calmest where none does. Chosen on
    the same runs, which favours the rival.
    """
    effort = mean(rows, condition, "servo_activity")
    tried = []
    for name in ["without", *family]:
        activity, error = mean(rows, name, "servo_activity"), mean(rows, name, measure)
        if np.isfinite(error):
            busy = bool(activity > 1.02 * effort)
            tried.append((busy, activity if busy else error, name))
    return min(tried)[2] if tried else "without"


def verdict(found: Mapping) -> str:
    """Verdict of a test: HELPS, HARMS, EVEN or OPEN.

    HELPS, HARMS: the 95 % interval lies beyond the relevant size, above or below zero, with a p of
    Holm <= SURE; EVEN: it lies within the relevant size on both sides; OPEN: undecided.
    """
    sure = found["p_holm"] is not None and found["p_holm"] <= SURE
    if found["low"] > found["relevant"] and sure:
        return HELPS
    if found["high"] < -found["relevant"] and sure:
        return HARMS
    if -found["relevant"] < found["low"] and found["high"] < found["relevant"]:
        return EVEN
    return OPEN


def correct_p_values(tests: Sequence[dict]) -> None:
    """Add "p_holm" (Holm over all tests at once) and "verdict" to every test, in place.

    ValueError: a p is not from 0 to 1.
    """
    adjusted = holm(np.array([t["p"] for t in tests]))
    for test, p in zip(tests, adjusted, strict=True):
        test["p_holm"] = float(p)
        test["verdict"] = verdict(test)
