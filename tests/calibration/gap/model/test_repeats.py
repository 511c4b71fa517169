"""Places that a tracker repeats are found, readings of a ball at rest are not."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration.gap.model.repeats import repeats
from tests.calibration.gap.model.test_outliers import NOISE_m, rolling


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from([25.0, 60.0, 200.0]), st.integers(5, 40))
def test_places_that_are_told_again_are_found_and_nothing_else(seed, rate_hz, frames):
    _, ball = rolling(seed, rate_hz)
    assert not repeats(ball).any()
    odd, rng = np.zeros(len(ball), bool), np.random.default_rng(seed)
    for i in rng.choice(np.arange(5, len(ball) - 100, 60), 3, replace=False):
        ball[i + 1 : i + frames] = ball[i]
        odd[i : i + frames] = True
    for lost in (slice(-frames, None), slice(-2 * frames - 1, -frames - 1)):
        ball[lost] = 0.0  # a place that is told for "none"
        odd[lost] = True
    np.testing.assert_array_equal(repeats(ball), odd)


def test_a_place_at_the_end_of_the_picture_is_none():
    _, ball = rolling(4)
    ends = np.quantile(ball, [0.1, 0.9], axis=0)
    cut = np.clip(ball, *ends)
    beyond = (ball < ends[0]) | (ball > ends[1])
    found = repeats(cut)
    assert not found[~beyond.any(axis=1)].any()
    assert found[beyond.any(axis=1)].mean() > 0.9


@pytest.mark.parametrize("step_m", [2e-5, 1e-4, 3e-4, 0.001, 0.005])
@pytest.mark.parametrize("seed", range(5))
def test_a_ball_at_rest_is_read_however_coarse_the_camera(step_m, seed):
    """In whole pixels, and these turned and stretched as by a camera that looks from aside."""
    t, far = rolling(seed)
    ball = 0.05 * far
    rest = (t > 8.0) & (t < 16.0)
    ball[rest] = ball[rest][0]
    pixels = np.round((ball + np.random.default_rng(seed).normal(0.0, NOISE_m, far.shape)) / step_m)
    assert not repeats(pixels * step_m).any()
    u, v = pixels.T
    aside = np.column_stack([u + 0.3 * v, 0.8 * v]) * step_m
    assert not repeats(aside / (1.0 + 0.01 * aside[:, :1])).any()


def test_a_ball_without_noise_may_rest_along_one_axis_or_both():
    """A step along x, then one along y, as a simulator without noise records them."""
    t = np.arange(0.0, 12.0, 0.02)
    ball = np.column_stack([0.1 * (1.0 - np.cos(np.clip(t - b, 0.0, np.pi))) for b in (1.0, 6.0)])
    assert not repeats(ball).any()
    assert not repeats(np.round(ball, 7)).any()
    lost = (t > 2.0) & (t < 3.0)
    ball[lost] = ball[lost][0]
    assert repeats(ball)[lost].all()


def test_few_places_are_left_alone():
    assert not repeats(np.zeros((400, 2))).any()
    for n in range(7):
        assert not repeats(np.zeros((n, 2))).any()
