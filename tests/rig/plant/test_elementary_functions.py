"""Own sine, cosine and exponential: as exact as the library's, the same alone and in a vector."""

from math import cos, exp, pi, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig.compiled import compiled
from rig.plant.elementary_functions import cosine, decaying, fma, sine, sine_cosine

ULP = 2.3e-16


@compiled
def in_a_row(x, out):
    """All functions of all x: a loop that the compiler may turn into vector instructions."""
    for i in range(x.shape[0]):
        out[0, i], out[1, i] = sine_cosine(x[i])
        out[2, i] = decaying(abs(x[i]))


def several(x: np.ndarray) -> np.ndarray:
    out = np.empty((3, len(x)))
    in_a_row(x, out)
    return out


@given(st.floats(-1e5, 1e5))
def test_sine_and_cosine_are_within_an_ulp_of_one(x):
    assert sine(x) == pytest.approx(sin(x), abs=ULP, rel=2 * ULP)
    assert cosine(x) == pytest.approx(cos(x), abs=ULP, rel=2 * ULP)


@given(st.floats(0, 700))
def test_decay_is_exact_to_two_ulp_relative(x):
    assert decaying(x) == pytest.approx(exp(-x), rel=2 * ULP, abs=0)


def test_dense_points_of_every_range_agree_with_numpy():
    rng = np.random.default_rng(0)
    for scale in (1e-8, 0.7, pi / 4, pi / 2, 10.0, 700.0, 1e5):
        x = np.concatenate([rng.uniform(-scale, scale, 20000), [-scale, scale, 0.0]])
        s, c, e = several(x)
        assert np.abs(s - np.sin(x)).max() < ULP
        assert np.abs(c - np.cos(x)).max() < ULP
        small = np.abs(x) < 700
        want = np.exp(-np.abs(x[small]))
        assert (np.abs(e[small] - want) / want).max() < 2 * ULP


def test_near_multiples_of_half_pi_the_answer_keeps_its_relative_accuracy():
    x = np.arange(1, 200) * (pi / 2)
    s, c, _ = several(x)
    small = np.where(np.arange(1, 200) % 2 == 0, s, c)
    truth = np.where(np.arange(1, 200) % 2 == 0, np.sin(x), np.cos(x))
    np.testing.assert_allclose(small, truth, rtol=0, atol=ULP)


def test_one_and_many_give_the_same_bits():
    x = np.random.default_rng(1).uniform(-30, 30, 1003)
    s, c, e = several(x)
    for i in range(0, 1003, 7):
        assert (sine(x[i]), cosine(x[i])) == (s[i], c[i])
        assert decaying(abs(x[i])) == e[i]


def test_fixed_points_and_ends():
    assert sine(0.0) == 0.0
    assert cosine(0.0) == decaying(0.0) == 1.0
    assert 0.0 <= decaying(1e9) < 1e-300
    assert np.isnan(sine(float("nan")))
    assert np.isnan(cosine(float("inf")))


def test_multiply_and_add_rounds_once():
    a = 1.0 + 2.0**-30
    assert fma_of(a, a, -1.0) == 2.0**-29 + 2.0**-60
    assert a * a - 1.0 != 2.0**-29 + 2.0**-60


@compiled
def fma_of(a, b, c):
    return fma(a, b, c)
