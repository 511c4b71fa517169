"""Intervals: against closed forms, and that they hold the truth as often as they say."""

import numpy as np
import pytest
from scipy.stats import ttest_1samp

from calibration.statistics import (
    clustered_covariance,
    jackknife_std,
    mean_with_half_width,
    student_quantile,
)


def test_the_mean_has_students_interval():
    values = np.array([1.0, 1.2, 0.7, 1.1, 0.9])
    mean, half = mean_with_half_width(values)
    low, high = ttest_1samp(values, 0.0).confidence_interval(0.95)
    assert (mean - half, mean + half) == pytest.approx((low, high))
    with pytest.raises(ValueError, match="at least 2"):
        mean_with_half_width([1.0])


def test_less_than_one_degree_of_freedom_counts_as_one():
    assert student_quantile(-3) == student_quantile(1) == pytest.approx(12.706, abs=1e-3)


def test_the_jackknife_of_a_mean_is_its_standard_error():
    values = np.random.default_rng(0).normal(size=(12, 2))
    left_out = np.array([np.delete(values, i, axis=0).mean(axis=0) for i in range(12)])
    assert jackknife_std(left_out) == pytest.approx(values.std(axis=0, ddof=1) / 12**0.5)


def test_clustered_intervals_hold_the_truth_where_clusters_share_an_error():
    """20 clusters of 10 rows with one common error each: white residuals would be 3 times too
    narrow; 95 % of 400 intervals should hold the slope, give or take 2 %."""
    rng, held = np.random.default_rng(1), 0
    clusters = np.repeat(np.arange(20), 10)
    for _ in range(400):
        x = np.column_stack((np.ones(200), rng.normal(size=20)[clusters]))
        y = x @ (0.5, 2.0) + rng.normal(size=20)[clusters] + 0.1 * rng.normal(size=200)
        found = np.linalg.lstsq(x, y)[0]
        std = clustered_covariance(x, y - x @ found, clusters)[1, 1] ** 0.5
        held += abs(found[1] - 2.0) <= student_quantile(18) * std
    assert 0.90 <= held / 400 <= 0.98
