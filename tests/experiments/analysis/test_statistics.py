"""Intervals hold the truth as often as they say; verdicts follow the relevant size."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import ttest_ind

from experiments.analysis.statistics import (
    SUBSETS,
    holm,
    mean_difference,
    mean_interval,
    paired,
    wilson,
    within_run_interval,
)


def rng(seed=0):
    return np.random.default_rng(seed)


# Symmetric, skewed as a difference of two skewed arms is, and skewed by itself (skewness 1.4).
DRAWS = {
    "normal": (lambda r, n: r.normal(0.3, 1, n), 0.3),
    "two skewed arms": (lambda r, n: r.exponential(1, n) - r.exponential(0.7, n), 0.3),
    "gamma": (lambda r, n: r.gamma(2.0, 1.0, n), 2.0),
}


@pytest.mark.parametrize("name", DRAWS)
def test_the_paired_interval_holds_the_truth(name):
    draw, truth = DRAWS[name]
    r = rng(11)
    held = 0
    for _ in range(1000):
        d = draw(r, 24)
        result = paired(d, np.zeros(24), relevant=0.0, rng=r)
        held += result.low <= truth <= result.high
    assert 920 <= held <= 980, held


@pytest.mark.parametrize("name", DRAWS)
@pytest.mark.parametrize("n", [6, 24])
def test_the_mean_interval_holds_the_truth(name, n):
    draw, truth = DRAWS[name]
    r = rng(12)
    intervals = [mean_interval(draw(r, n)) for _ in range(2000)]
    held = np.mean([i.low <= truth <= i.high for i in intervals])
    assert (0.92 if n == 24 else 0.89) <= held <= 0.98, held


def test_exactly_enumerated_intervals_hold_the_truth_at_least_as_often_as_they_say():
    r = rng(13)
    held = 0
    for _ in range(1000):
        result = paired(r.normal(1, 1, 8), np.zeros(8), relevant=0.0, rng=r)
        held += result.low <= 1 <= result.high
    assert 935 <= held <= 980, held


@pytest.mark.parametrize("n", [7, 24])
def test_no_effect_is_called_one_in_one_of_twenty(n):
    r = rng(14)
    p = np.array(
        [paired(r.normal(size=n), r.normal(size=n), relevant=0.0, rng=r).p for _ in range(1000)]
    )
    assert 0.03 <= (p <= 0.05).mean() <= 0.07
    assert 0.42 <= (p <= 0.5).mean() <= 0.58


def brute_p(d):
    signs = 1 - 2 * ((np.arange(2 ** len(d))[:, None] >> np.arange(len(d))) & 1)
    sums = np.abs(signs @ d)
    return np.mean(sums >= np.abs(d.sum()) * (1 - 1e-12))


@given(st.lists(st.integers(-50, 50), min_size=1, max_size=9))
def test_the_exact_p_is_that_of_all_sign_patterns(d):
    result = paired(np.array(d), np.zeros(len(d)), relevant=0.0, rng=rng())
    assert result.p == pytest.approx(brute_p(np.array(d, float)))


@given(st.lists(st.floats(-5, 5), min_size=6, max_size=10), st.floats(-3, 3))
def test_the_interval_is_the_inverted_test(d, shift):
    """Effects inside have one-sided p above 2.5 %; the interval moves with the data."""
    d = np.array(d)
    result = paired(d, np.zeros(len(d)), relevant=0.0, rng=rng())
    assert result.low <= result.effect + 1e-9
    assert result.effect <= result.high + 1e-9
    moved = paired(d + shift, np.zeros(len(d)), relevant=0.0, rng=rng())
    np.testing.assert_allclose(
        [moved.low, moved.high], [result.low + shift, result.high + shift], atol=1e-9
    )
    for beyond in (result.low - 1e-6, result.high + 1e-6):
        assert brute_p(d - beyond) <= 0.05 + 1e-12
    width = result.high - result.low
    for inside in (result.low + 1e-6, result.high - 1e-6) if width > 1e-5 else ():
        assert brute_p(d - inside) > 0.05 - 1 / 2 ** len(d)


def test_swapping_the_arms_mirrors_the_result():
    a, b = rng(1).normal(1, 1, 9), rng(2).normal(0, 1, 9)
    one, other = paired(a, b, relevant=0.1, rng=rng()), paired(b, a, relevant=0.1, rng=rng())
    assert (one.effect, one.low, one.high) == pytest.approx(
        (-other.effect, -other.high, -other.low)
    )
    assert one.p == other.p


@pytest.mark.parametrize(
    ("shift", "holds"), [(2.0, True), (-2.0, False), (0.1, False), (0.5, None)]
)
def test_the_verdict_follows_the_relevant_size(shift, holds):
    d = shift + 0.2 * rng(3).normal(size=24)
    result = paired(d, np.zeros(24), relevant=0.5, rng=rng())
    assert result.holds is holds
    assert bool(result.reason) == (holds is None)


def test_few_pairs_decide_nothing():
    result = paired(np.arange(5) + 10.0, np.zeros(5), relevant=0.1, rng=rng())
    assert result.holds is None
    assert "fewer than 6" in result.reason
    assert result.p == pytest.approx(2 / 2**5)
    assert paired(np.arange(6) + 10.0, np.zeros(6), relevant=0.1, rng=rng()).holds is True
    empty = paired(np.array([]), np.array([]), relevant=0.1, rng=rng())
    assert empty.holds is None
    assert empty.n == 0


def test_four_pairs_cannot_fall_below_one_in_eight():
    assert paired(np.full(4, 9.0), np.zeros(4), relevant=0.0, rng=rng()).p == pytest.approx(0.125)


def test_nan_pairs_are_left_out_and_counted():
    a = np.append(np.arange(8) + 1.0, [np.nan, 3.0])
    result = paired(a, np.append(np.zeros(9), np.nan), relevant=0.1, rng=rng())
    assert (result.n, result.left_out) == (8, 2)


def test_equal_differences_are_their_own_interval():
    for n in (8, 24):
        result = paired(np.full(n, 0.3), np.zeros(n), relevant=0.1, rng=rng())
        assert (result.low, result.high) == pytest.approx((0.3, 0.3))
        assert result.holds is True
        none = paired(np.ones(n), np.ones(n), relevant=0.1, rng=rng())
        assert (none.effect, none.p, none.holds) == (0.0, 1.0, False)


def test_a_comparison_is_repeatable():
    a, b = rng(1).normal(1, 1, 24), rng(2).normal(0, 1, 24)
    first = paired(a, b, relevant=0.1, rng=rng(5))
    assert first == paired(a, b, relevant=0.1, rng=rng(5))
    assert first.p >= 2 / (SUBSETS + 1)


def test_bad_input_is_refused():
    with pytest.raises(ValueError, match="one shape"):
        paired(np.zeros(3), np.zeros(4), relevant=0.1, rng=rng())
    with pytest.raises(ValueError, match="relevant"):
        paired(np.zeros(8), np.zeros(8), relevant=-1, rng=rng())
    with pytest.raises(ValueError, match="within"):
        wilson(4, 3)
    with pytest.raises(ValueError, match="p-values"):
        holm(np.array([0.1, 1.5]))


def test_mean_interval_against_a_table():
    interval = mean_interval(np.array([1.0, 2.0, 3.0, 4.0, np.nan]))
    half = 3.182446 * np.std([1, 2, 3, 4], ddof=1) / 2
    assert (interval.value, interval.n) == (2.5, 4)
    assert (interval.low, interval.high) == pytest.approx((2.5 - half, 2.5 + half))
    assert np.isinf(mean_interval(np.array([1.0])).high)
    assert np.isnan(mean_interval(np.array([])).value)


def test_wilson_against_a_table():
    """Newcombe (Stat. Med. 17, 1998), table I: 81 of 263 and 15 of 148, 0 of 20."""
    for k, n, low, high in (
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
    ):
        interval = wilson(k, n)
        assert (interval.low, interval.high) == pytest.approx((low, high), abs=5e-5)
    assert wilson(20, 20).high == 1.0
    assert (wilson(0, 0).low, wilson(0, 0).high) == (0.0, 1.0)


def test_holm_against_a_worked_example():
    np.testing.assert_allclose(holm(np.array([0.01, 0.04, 0.03, 0.005])), [0.03, 0.06, 0.06, 0.02])
    np.testing.assert_allclose(holm(np.array([0.6, np.nan, 0.5])), [1.0, np.nan, 1.0])
    assert holm(np.array([])).shape == (0,)


@settings(max_examples=50)
@given(st.lists(st.floats(0, 1), min_size=1, max_size=12))
def test_holm_lies_between_p_and_bonferroni_and_keeps_the_order(p):
    p = np.array(p)
    adjusted = holm(p)
    assert (adjusted >= p).all()
    assert (adjusted <= np.minimum(1, p * len(p)) + 1e-12).all()
    assert (np.diff(adjusted[np.argsort(p, kind="stable")]) >= 0).all()


def cycling(r, seconds, amplitude, std, correlation_s, period_s=3.2):
    """Sine of random phase plus AR(1) on both axes, (n, 2) at 60 Hz; and its true spread."""
    from scipy.signal import lfilter

    n = round(seconds * 60)
    a = np.exp(-1 / 60 / correlation_s)
    kick = r.standard_normal((n, 2)) * np.sqrt(1 - a * a)
    kick[0] /= np.sqrt(1 - a * a)
    phase = 2 * np.pi * np.arange(n)[:, None] / 60 / period_s + r.uniform(0, 2 * np.pi, 2)
    xy = amplitude * np.sin(phase) + std * lfilter([1], [1, -a], kick, axis=0)
    return xy, np.sqrt(amplitude**2 + 2 * std**2)


@pytest.mark.parametrize("seconds", [12, 24, 45])
@pytest.mark.parametrize(("amplitude", "std"), [(5.0, 0.5), (5.0, 2.0), (0.0, 3.0)])
def test_intervals_within_one_run_hold_the_truth(seconds, amplitude, std):
    r = rng(21)
    mean, spread = [], []
    for _ in range(250):
        xy, true_spread = cycling(r, seconds, amplitude, std, 0.5)
        result = within_run_interval(xy, sample_s=1 / 60, period_s=3.2, rng=r)
        mean.append((result.mean_low_m <= 0) & (result.mean_high_m >= 0))
        spread.append(result.spread_low_m <= true_spread <= result.spread_high_m)
    # 500 and 250 intervals: 90 to 98 % with two standard errors of the count.
    assert 0.88 <= np.mean(mean) <= 0.99, np.mean(mean)
    assert 0.87 <= np.mean(spread) <= 0.995, np.mean(spread)


def test_a_run_shorter_than_two_blocks_has_no_interval():
    xy, _ = cycling(rng(), 5, 5.0, 0.5, 0.5)
    assert np.isnan(
        within_run_interval(xy, sample_s=1 / 60, period_s=3.2, rng=rng()).mean_low_m
    ).all()
    free = within_run_interval(xy, sample_s=1 / 60, rng=rng())
    assert free.blocks == pytest.approx(6)
    assert np.isfinite(free.mean_low_m).all()


def test_a_missing_axis_has_no_interval_and_does_not_harm_the_other():
    xy, _ = cycling(rng(), 20, 5.0, 0.5, 0.5)
    xy[:, 1] = np.nan
    result = within_run_interval(xy, sample_s=1 / 60, period_s=3.2, rng=rng())
    assert result.mean_low_m[0] < 0 < result.mean_high_m[0]
    assert np.isnan(result.mean_low_m[1])
    assert result.spread_low_m < 5 / np.sqrt(2) + 0.1 < result.spread_high_m + 0.3


@pytest.mark.parametrize("sizes", [(2, 2), (3, 8), (24, 5)])
def test_the_difference_of_means_is_welchs(sizes: tuple[int, int]):
    rng = np.random.default_rng(sum(sizes))
    first, second = rng.normal(1.0, 0.2, sizes[0]), rng.normal(1.5, 0.9, sizes[1])
    expected = ttest_ind(second, first, equal_var=False).confidence_interval()
    found = mean_difference(np.append(first, np.nan), second)
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high))
    assert (found.value, found.n) == (pytest.approx(second.mean() - first.mean()), min(sizes))
    assert np.isinf(mean_difference(first[:1], second).high)
    assert mean_difference(np.ones(3), np.full(2, 2.0)).low == pytest.approx(1.0)
