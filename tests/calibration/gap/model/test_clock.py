"""Stamps that jitter about an even clock are that clock's."""

import numpy as np
import pytest

from calibration.gap.model.clock import even_ticks

EVEN_s = 0.3 + 0.02 * np.arange(900)


@pytest.mark.parametrize("jitter_s", [0.0, 0.0008, 0.002])
def test_jitter_and_whole_milliseconds_leave_the_clock_and_what_is_missing_stays_missing(jitter_s):
    rng = np.random.default_rng(1)
    there = rng.random(900) > 0.02
    there[300:340] = False
    stamps = np.round(EVEN_s + rng.uniform(-jitter_s, jitter_s, 900), 3)[there]
    np.testing.assert_allclose(even_ticks(stamps), EVEN_s[there], rtol=0, atol=2e-4)


def test_ticks_that_are_not_even_are_left_alone():
    uneven = np.cumsum(np.random.default_rng(2).uniform(0.01, 0.03, 900))
    np.testing.assert_array_equal(even_ticks(uneven), uneven)
    for n in range(3):
        np.testing.assert_array_equal(even_ticks(EVEN_s[:n]), EVEN_s[:n])
