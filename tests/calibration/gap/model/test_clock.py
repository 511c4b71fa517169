"""Stamps that jitter about the servos' clock are that clock's; rows date the frames in them."""

import numpy as np
import pytest

from calibration.gap.model.clock import dated_to_s, even_ticks
from rig.log import Log

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


def test_frames_are_dated_to_a_row_unless_each_tells_when_it_was_exposed():
    t_s = 0.02 * np.arange(50)
    ball = {"ball_x_m": np.sin(t_s), "ball_y_m": np.cos(t_s)}
    exposed = {"ball_exposed_s": t_s - 0.013}
    assert dated_to_s(Log.from_columns({"t_s": t_s, **ball})) == pytest.approx(0.02)
    assert dated_to_s(Log.from_columns({"t_s": t_s, **ball, **exposed})) == 0.0
    exposed["ball_exposed_s"][7] = np.nan
    assert dated_to_s(Log.from_columns({"t_s": t_s, **ball, **exposed})) == pytest.approx(0.02)
    assert dated_to_s(Log.from_columns({"t_s": t_s})) == 0.0
