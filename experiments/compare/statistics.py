"""What a grid of paired runs can say: exact sign flips, Holm over all cells, equal activity.

Effects are (rival - arm): above zero the arm helps. Pure functions of plain numbers.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict

import numpy as np

from experiments.claims import RELEVANT
from experiments.numbers import MEASURES
from experiments.statistics import holm, paired

MOST_EXACT = 20
Rows = Mapping[str, Sequence[Mapping[str, float]]]  # arm -> one row of measures a seed
HELPS, HARMS, EVEN, OPEN = "helps", "harms", "no difference", "undecided"


def exact_p(differences: np.ndarray, rng: np.random.Generator) -> float:
    """Two-sided p of "no effect" by all 2^n sign flips (n <= 20; else 2^18 drawn ones).

    With many cells a p of drawn flips alone could never pass Holm: its floor is 1/drawn.
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


def _values(rows: Rows, arm: str, measure: str) -> np.ndarray:
    return np.array([row[measure] for row in rows[arm]], float)


def against(rows: Rows, arm: str, rival: str, measure: str, seed: Sequence[int]) -> dict:
    """Effect (rival - arm) with its interval, exact p and the relevant size fixed beforehand."""
    one, other = _values(rows, rival, measure), _values(rows, arm, measure)
    unit = MEASURES[measure][0]
    rng = np.random.default_rng([*seed])
    result = paired(one, other, relevant=RELEVANT[unit], rng=rng)
    found = asdict(result) | {"rival": rival, "unit": unit, "p": exact_p(one - other, rng)}
    found["failed"] = int(np.isnan(other).sum())
    return found


def mean(rows: Rows, arm: str, measure: str) -> float:
    """Mean over the completed runs; NaN where fewer than three quarters completed."""
    values = _values(rows, arm, measure)
    done = values[np.isfinite(values)]
    return float(done.mean()) if len(done) >= 0.75 * len(values) else float("nan")


def equal_activity_rival(rows: Rows, arm: str, family: Sequence[str], measure: str) -> str:
    """Of the arm without and its retuned kin, the best that moves the servo no more than the arm;
    the calmest where none does. Chosen on the same runs, which favours the rival."""
    effort = mean(rows, arm, "servo_activity")
    tried = []
    for name in ["without", *family]:
        activity, error = mean(rows, name, "servo_activity"), mean(rows, name, measure)
        if np.isfinite(error):
            busy = bool(activity > 1.02 * effort)
            tried.append((busy, activity if busy else error, name))
    return min(tried)[2] if tried else "without"


def verdict(found: Mapping) -> str:
    """In words: beyond the relevant size with the p of all cells, within it, or undecided."""
    sure = found["p_holm"] is not None and found["p_holm"] <= 0.05
    if found["low"] > found["relevant"] and sure:
        return HELPS
    if found["high"] < -found["relevant"] and sure:
        return HARMS
    if -found["relevant"] < found["low"] and found["high"] < found["relevant"]:
        return EVEN
    return OPEN


def correct(tests: Sequence[dict]) -> None:
    """Holm over all tests at once, and the verdicts that follow, written into them."""
    adjusted = holm(np.array([t["p"] for t in tests]))
    for test, p in zip(tests, adjusted, strict=True):
        test["p_holm"] = float(p)
        test["verdict"] = verdict(test)
