"""Exact sign flips, verdicts, equal activity."""

from itertools import product

import numpy as np
import pytest

from experiments.compare.statistics import (
    EVEN,
    HARMS,
    HELPS,
    OPEN,
    against,
    correct_p_values,
    equal_activity_rival,
    exact_p,
    mean,
)


def test_exact_p_is_the_share_of_all_sign_patterns():
    d = np.array([0.3, -0.1, 0.5, 0.2, 0.05])
    sums = [abs(np.dot(signs, d)) for signs in product((-1, 1), repeat=5)]
    want = np.mean(np.array(sums) >= abs(d.sum()) - 1e-12)
    assert exact_p(d, np.random.default_rng(0)) == pytest.approx(want)


def test_twenty_alike_differences_reach_the_smallest_p_there_is():
    assert exact_p(np.full(20, 0.1), np.random.default_rng(0)) == 2 / 2**20


def test_many_pairs_are_drawn_and_agree_with_the_normal_law():
    d = np.random.default_rng(3).standard_normal(40)
    d = d - d.mean() + 1.96 * d.std() / np.sqrt(40)
    assert exact_p(d, np.random.default_rng(0)) == pytest.approx(0.05, abs=0.01)


def rows(**arms):
    return {
        arm: [{"settled_error": e, "servo_activity": a} for e, a in zip(*pair, strict=True)]
        for arm, pair in arms.items()
    }


def noisy(level: float, seed: int = 0):
    values = level + 0.02 * np.random.default_rng(seed).standard_normal(20)
    return list(values), [0.01] * 20


def test_verdicts_follow_size_and_p():
    table = rows(without=noisy(1.0), good=noisy(0.5, 1), bad=noisy(1.4, 2), same=noisy(1.0, 3))
    wide = [0.2, 1.9] * 10
    table["odd"] = [{"settled_error": e, "servo_activity": 0.01} for e in wide]
    tests = [against(table, arm, "without", "settled_error", (1, i))
             for i, arm in enumerate(("good", "bad", "same", "odd"))]  # fmt: skip
    correct_p_values(tests)
    assert [t["verdict"] for t in tests] == [HELPS, HARMS, EVEN, OPEN]
    assert all(t["p_holm"] >= t["p"] for t in tests)


def test_lost_runs_are_counted_and_not_averaged_away():
    table = rows(without=noisy(1.0), losing=noisy(0.2))
    for row in table["losing"][:8]:
        row["settled_error"] = float("nan")
    assert np.isnan(mean(table, "losing", "settled_error"))
    assert against(table, "losing", "without", "settled_error", (1,))["failed"] == 8


def test_the_rival_at_equal_activity_is_the_best_that_is_no_busier():
    table = rows(
        without=([1.0] * 8, [0.01] * 8), slow=([0.8] * 8, [0.012] * 8),
        busy=([0.1] * 8, [0.05] * 8), arm=([0.5] * 8, [0.02] * 8),
    )  # fmt: skip
    assert equal_activity_rival(table, "arm", ["slow", "busy"], "settled_error") == "slow"
    table["arm"] = [{"settled_error": 0.5, "servo_activity": 0.001}] * 8
    assert equal_activity_rival(table, "arm", ["slow", "busy"], "settled_error") == "without"
