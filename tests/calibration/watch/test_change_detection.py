"""The chart over runs: its threshold, its false alarms, what it tells of a change."""

import numpy as np
import pytest

from calibration.watch.change_detection import (
    alarm_threshold,
    alarms,
    average_run_length,
    smallest_seen,
    strongest,
)


def test_the_threshold_is_that_of_the_average_run_length():
    for parameters in (1, 5, 17):
        h = alarm_threshold(parameters, 100)
        assert average_run_length(h) == pytest.approx(100 * parameters, rel=1e-6)
    assert alarm_threshold(17, 100) > alarm_threshold(5, 100) > alarm_threshold(5, 50)


@pytest.mark.parametrize(("parameters", "one_in"), [(0, 100), (3, 5)])
def test_no_threshold_for_nothing(parameters: int, one_in: float):
    with pytest.raises(ValueError, match="at least"):
        alarm_threshold(parameters, one_in)


def test_run_length_of_the_known_chart_is_the_formulas():
    """The formula of Siegmund and Venkatraman against 400 runs of the chart it was derived for:
    normal deviates of mean 0 known, z_k = sum/sqrt(n - k)."""
    rng, h, lengths = np.random.default_rng(1), alarm_threshold(1, 50), []
    for _ in range(400):
        sums, n = np.zeros(0), 0
        while True:
            n += 1
            sums = np.append(sums, 0.0) + rng.standard_normal()
            if np.max(np.abs(sums) / np.sqrt(np.arange(n, 0, -1))) > h:
                break
        lengths.append(n)
    mean, error = float(np.mean(lengths)), float(np.std(lengths)) / 20
    # Asymptotic: 61 at 50 (2000 runs), 337 at 300, 1065 at 1000; never too short.
    assert 50.0 - 3 * error < mean < 61.0 + 3 * error


@pytest.mark.parametrize("accepted", [1, 5])
def test_healthy_runs_raise_few_alarms(accepted: int):
    """With the spread that the prior expects, and four times the variance."""
    rng, p, h = np.random.default_rng(accepted), 10, alarm_threshold(10)
    runs = false = 0
    for table in range(20):
        x = (1.45 + 1.45 * (table % 2)) * rng.standard_normal((accepted + 20, p))
        for n in range(accepted + 1, len(x) + 1):
            runs += 1
            if alarms(strongest(x[:n], np.ones((n, p)), accepted), h):
                false += 1
                break
    assert runs > 300
    assert false <= runs / 100 + 3 * (runs / 100) ** 0.5


def test_a_step_is_told_with_its_run_and_size():
    rng, held = np.random.default_rng(3), 0
    for _ in range(100):
        x = rng.standard_normal((24, 3))
        x[14:, 1] += 6.0
        found = strongest(x, np.ones_like(x), 4)
        first = alarms(found, alarm_threshold(3))[0]
        assert first.parameter == 1
        assert first.earliest <= 14 <= first.latest
        held += first.low <= 6.0 <= first.high
    assert held >= 88  # of 100 intervals of 95 %; 1 in 1000 sets of such intervals holds fewer


def test_one_failed_fit_is_no_alarm_but_two_that_agree_are():
    x = np.random.default_rng(4).standard_normal((20, 2))
    x[12, 0] += 40.0
    h = alarm_threshold(2)
    for n in range(5, 21):
        assert not alarms(strongest(x[:n], np.ones((n, 2)), 4), h)
    x[12, 0] -= 40.0
    x[18:, 0] += 15.0
    (only,) = alarms(strongest(x, np.ones_like(x), 4), h)
    assert (only.parameter, only.since) == (0, 18)


def test_runs_that_tell_nothing_are_passed_over():
    x, s = np.random.default_rng(5).standard_normal((12, 2)), np.ones((12, 2))
    x[6:, 0] += 20.0
    x[7, 0] = s[7, 0] = np.nan
    x[:, 1] = s[:, 1] = np.nan
    found = strongest(x, s, 3)
    assert found[1] is None
    assert found[0] is not None
    assert found[0].since == 6
    assert np.isnan(smallest_seen(x, s, 3.0)[1])


def test_a_noisy_run_weighs_less():
    x, s = np.random.default_rng(6).standard_normal((15, 1)), np.ones((15, 1))
    x[13:], s[13:] = 8.0, 8.0  # as far as their own deviations reach
    (found,) = strongest(x, s, 5)
    assert found is not None
    assert abs(found.z) < alarm_threshold(1)


def test_what_would_be_seen_is_seen_in_half_of_the_cases():
    rng, h, seen = np.random.default_rng(7), alarm_threshold(1), 0
    for _ in range(200):
        x = 1.45 * rng.standard_normal((15, 1))
        size = smallest_seen(x[:10], np.ones((10, 1)), h)[0]
        x[10:] += size
        seen += bool(alarms(strongest(x, np.ones_like(x), 10), h))
    assert 40 < seen < 160


def test_bad_arrays_are_refused():
    with pytest.raises(ValueError, match="0 accepted"):
        strongest(np.zeros((3, 1)), np.ones((3, 1)), 0)
