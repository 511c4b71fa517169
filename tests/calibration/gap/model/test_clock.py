"""Stamps that jitter about the clock of the servos are that clock's."""

import numpy as np
import pytest

from calibration.gap.model.clock import even_ticks

EVEN_s = 0.3 + 0.02 * np.arange(900)


@pytest.mark.parametrize("jitter_s", [0.0, 0.0008, 0.003])
@pytest.mark.parametrize("period_s", [0.02, 0.01, 0.06])
def test_jitter_and_whole_milliseconds_leave_the_clock_and_what_is_missing(jitter_s, period_s):
    rng = np.random.default_rng(1)
    there = rng.random(900) > 0.02
    there[300:340] = False
    stamps = np.round(EVEN_s + rng.uniform(0.0, jitter_s, 900), 3)[there]
    np.testing.assert_allclose(even_ticks(stamps, period_s), EVEN_s[there], rtol=0, atol=1e-9)


def test_another_clock_and_uneven_ticks_are_left_alone():
    uneven = np.cumsum(np.random.default_rng(2).uniform(0.01, 0.03, 900))
    for t_s in (uneven, EVEN_s * 1.05, EVEN_s + 0.007):
        np.testing.assert_array_equal(even_ticks(t_s, 0.02), t_s)
    still = np.zeros(9)  # a clock that stands
    np.testing.assert_array_equal(even_ticks(still, 0.02), still)
    for n in range(3):
        np.testing.assert_array_equal(even_ticks(EVEN_s[:n], 0.02), EVEN_s[:n])
