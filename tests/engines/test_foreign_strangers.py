"""The foreign table's effects that are in no catalogue, against closed forms."""

import numpy as np
import pytest

from experiments.benchmark.engines.foreign.plant import G
from experiments.benchmark.engines.foreign.truth import STRANGERS, strange
from tests.support.foreign.runs import bang, nothing_odd, quiet, seen

FACTOR = 0.6
COUNT = 2 * np.pi / 4096
RNG = np.random.default_rng


def test_a_dent_pulls_most_at_its_width():
    odd = nothing_odd()._replace(dent=0.05, dent_at=np.array([0.02, 0.01]), dent_width=0.015)
    t, xy = seen(quiet(odd=odd, seconds=0.1, ball=(0.035, 0.01, 0, 0, 0)))
    np.testing.assert_allclose(xy[:, 0], 0.035 - 0.025 * t**2, atol=1e-7)
    _, still = seen(quiet(odd=odd, ball=(0.02, 0.01, 0, 0, 0)))
    np.testing.assert_allclose(still - [0.02, 0.01], 0, atol=1e-12)


def test_a_rhythm_and_a_bump_are_their_integrals():
    w = 2 * np.pi * 1.3
    odd = nothing_odd()._replace(shake=np.array([0.1, 0.0]), shake_hz=1.3, shake_phase=0.0)
    t, xy = seen(quiet(odd=odd, ball=(0, 0, 0, 0, 0)))
    np.testing.assert_allclose(xy[:, 0], 0.1 / w * (t - np.sin(w * t) / w), atol=1e-6)
    odd = nothing_odd()._replace(bump=np.array([0.0, 0.01]), bump_from=0.3, bump_to=0.6)
    t, xy = seen(quiet(odd=odd, ball=(0, 0, 0, 0, 0)))
    in_it, after = np.clip(t - 0.3, 0, 0.3), np.maximum(t - 0.6, 0)
    expected = FACTOR * G * 0.01 * (in_it**2 / 2 + 0.3 * after)
    np.testing.assert_allclose(xy[:, 1], expected, atol=1e-5)


def test_an_unbalanced_ball_rocks_about_its_heavy_side():
    """Small angles about the lowest point: omega^2 = k g e / r^2 (e well below r)."""
    e, r = 1e-3, 0.019625
    odd = nothing_odd()._replace(heavy=e * np.array([np.sin(0.05), 0, -np.cos(0.05)]))
    t, xy = seen(quiet(odd=odd, seconds=3.0, ball=(0, 0, 0, 0, 0)))
    w = np.sqrt(FACTOR * G * e) / r
    np.testing.assert_allclose(xy[:, 0], 0.05 * r * (1 - np.cos(w * t)), atol=0.02 * 0.05 * r)


def test_a_cable_balances_the_motor_where_its_pull_equals_the_volts():
    odd = nothing_odd()._replace(cable=np.array([2.0, 0.0]), cable_from=np.array([-0.05, 0.0]))
    log = quiet(odd=odd, seconds=3.0, way=(-1, -1), pilot=bang(0.5))
    assert log["theta_x_rad"][-1] == pytest.approx(-0.05 - 0.25, abs=COUNT)
    assert log["theta_y_rad"][-1] < -2
    assert quiet(odd=odd, way=(1, 1), pilot=bang(0.5))["theta_x_rad"][-1] > 0.7


def test_a_draught_pushes_a_ball_at_rest_by_its_size_and_one_with_the_wind_less():
    odd = nothing_odd()._replace(draught=0.05, draught_at=0.03)
    t, xy = seen(quiet(odd=odd, seconds=0.1, ball=(0, 0.03, 0, 0, 0)))
    np.testing.assert_allclose(xy[:, 0], 0.025 * t**2, rtol=0.01, atol=1e-7)
    _, far = seen(quiet(odd=odd, ball=(0, -0.09, 0, 0, 0)))
    assert np.abs(far[:, 0]).max() < 1e-5
    t, fast = seen(quiet(odd=odd, seconds=0.1, ball=(0, 0.03, 0.5, 0, 0)))
    pushed = fast[-1, 0] - 0.5 * t[-1]
    assert pushed == pytest.approx(0.025 * t[-1] ** 2 * (0.5**2 + 0.5**2), rel=0.02)


@pytest.mark.parametrize("name", STRANGERS)
def test_every_stranger_is_drawn_and_has_its_size(name: str):
    one = strange((name, STRANGERS[name][1]), RNG(3), 30.0)._asdict()
    other = strange((name, 2 * STRANGERS[name][1]), RNG(3), 30.0)._asdict()
    grown = [f for f in one if not np.array_equal(one[f], other[f])]
    assert len(grown) == 1
    np.testing.assert_allclose(other[grown[0]], 2 * np.asarray(one[grown[0]]))
