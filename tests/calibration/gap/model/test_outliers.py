"""Places of the ball that cannot be: found, and no others."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration.gap.model.outliers import outliers

NOISE_m = 0.0003


def rolling(seed: int, rate_hz: float = 60.0, seconds: float = 30.0):
    """Times and places of a ball whose acceleration jumps by up to 2 m/s2 every second."""
    rng = np.random.default_rng(seed)
    fine = np.arange(0.0, seconds, 1e-3)
    pull = rng.uniform(-1.0, 1.0, (int(seconds) + 1, 2))[fine.astype(int)]
    place = np.cumsum(np.cumsum(pull, axis=0), axis=0) * 1e-6
    place -= np.linspace(0.0, 1.0, len(fine))[:, None] * place[-1]
    rows = np.unique((np.arange(0.0, seconds, 1.0 / rate_hz) * 1e3).astype(int))
    rows = rows[rng.random(len(rows)) > 0.08]  # frames are lost
    return fine[rows], place[rows] + rng.normal(0.0, NOISE_m, (len(rows), 2))


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from([25.0, 60.0, 200.0]), st.integers(1, 3))
def test_stays_elsewhere_are_found_and_nothing_else(seed, rate_hz, frames):
    t, ball = rolling(seed, rate_hz)
    assert not outliers(t, ball, NOISE_m).any()
    first = np.random.default_rng(seed).choice(np.arange(10, len(t) - 10, 12), 5, replace=False)
    odd, lone = np.zeros(len(t), bool), np.zeros(len(t), bool)
    for i in first:
        odd[i : i + frames] = True
        ball[i : i + frames] += (0.04, -0.03)
        # Beside lost frames less is known.
        lone[i : i + frames] = np.diff(t[i - 2 : i + frames + 2]).max() < 1.5 / rate_hz
    found = outliers(t, ball, NOISE_m)
    assert not (found & ~odd).any()
    assert found[lone].all()


@pytest.mark.parametrize("speed_m_s", [0.3, 1.0])
def test_a_ball_that_bounces_or_is_struck_is_no_outlier(speed_m_s):
    t, ball = rolling(3)
    for turn_s in (4.013, 9.2, 15.5):
        ball[:, 0] += speed_m_s * np.abs(t - turn_s) * (np.abs(t - turn_s) < 0.5)
    ball[:, 1] += speed_m_s * np.clip(t - 20.01, 0.0, None)
    assert not outliers(t, ball, NOISE_m)[np.abs(t - 15.0) < 14.0].any()


def test_few_frames_and_frames_at_one_time_are_left_alone():
    for n in range(7):
        assert not outliers(np.arange(n) / 60.0, np.zeros((n, 2)), 0.0).any()
    assert not outliers(np.zeros(20), np.zeros((20, 2)), NOISE_m).any()
