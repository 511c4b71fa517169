"""Stamps of other clocks: never after the arrival, free of the way's jitter."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vision.sources.clock import WINDOW_S, ForeignClock, own_clock

WALL = 1.7e9  # seconds since 1970 at the monotonic clock's zero


@given(st.floats(1.0, 1e6), st.floats(0.0, 1.9))
def test_our_own_clocks_are_recognised(taken_s, delay_s):
    arrived_s = taken_s + delay_s
    assert own_clock(taken_s, arrived_s, WALL) == pytest.approx(taken_s, abs=1e-9)
    assert own_clock(taken_s + WALL, arrived_s, WALL) == pytest.approx(taken_s, abs=1e-6)


@pytest.mark.parametrize("stamp_s", [0.0, 90.0, 100.1, WALL, WALL + 90, WALL + 101, 1e18])
def test_a_stamp_of_no_clock_of_ours_is_told(stamp_s):
    assert own_clock(stamp_s, 100.0, WALL) is None


@given(
    st.floats(-1e9, 1e9),
    st.lists(st.floats(0.0, 0.2), min_size=3, max_size=60),
    st.integers(0, 59),
)
def test_jitter_of_the_way_does_not_reach_the_times(zero_s, delays, fastest):
    """Once a frame has come by the shortest way, the others are dated as if they had too."""
    fastest %= len(delays)
    delays[fastest] = 0.0
    clock = ForeignClock()
    for k, delay_s in enumerate(delays):
        taken_s = 50.0 + 0.25 * k
        mapped_s = clock.to_rig(taken_s - zero_s, taken_s + delay_s)
        assert mapped_s <= taken_s + delay_s
        if k >= fastest:
            assert mapped_s == pytest.approx(taken_s, abs=1e-5)


def test_a_drifting_clock_is_followed():
    clock, rng = ForeignClock(), np.random.default_rng(0)
    errors = []
    for taken_s in np.arange(0.0, 10 * WINDOW_S, 0.1):
        mapped_s = clock.to_rig(taken_s * (1 + 50e-6) + 7.0, taken_s + rng.exponential(0.005))
        errors.append(mapped_s - taken_s)
    assert np.abs(errors[600:]).max() < 0.003  # 50 ppm of it over the window: 1.5 ms


def test_a_clock_set_back_starts_anew():
    clock = ForeignClock()
    clock.to_rig(1000.0, 10.0)
    assert clock.to_rig(5.0, 11.0) == 11.0
    assert clock.to_rig(5.5, 11.6) == pytest.approx(11.5)
