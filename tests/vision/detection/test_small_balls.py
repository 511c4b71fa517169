"""Discs of a few pixels: sigma is no smaller than the error, and the radius is not biased."""

from math import nan

import numpy as np
import pytest

from vision.detection.appearance import Appearance
from vision.detection.detector import locate_ball

FINE = 8  # samples of a pixel's side
ORANGE, PLATE = np.array([40.0, 120.0, 220.0]), 200.0


def disc(radius_px: float, u: float, v: float, side: int, rng) -> np.ndarray:
    """A clean disc by area sampling, with noise of 2 grey levels."""
    y, x = (np.indices((side * FINE, side * FINE)) + 0.5) / FINE - 0.5
    inside = np.hypot(x - u, y - v) < radius_px
    share = inside.reshape(side, FINE, side, FINE).mean((1, 3))[..., None]
    image = ORANGE * share + PLATE * (1.0 - share) + rng.normal(0.0, 2.0, (side, side, 3))
    return np.clip(image, 0.0, 255.0).astype(np.uint8)


@pytest.mark.parametrize(
    ("radius_px", "bias_px"), [(2.5, 0.8), (3.0, 0.5), (4.0, 0.1), (5.0, 0.1), (7.0, 0.05)]
)
def test_small_discs_are_as_near_as_sigma_says(radius_px: float, bias_px: float):
    rng, side = np.random.default_rng(7), int(4 * radius_px + 60)
    over, radii = [], []
    for _ in range(12):
        u, v = side / 2 + rng.uniform(-0.5, 0.5, 2)
        image = disc(radius_px, u, v, side, rng)
        appearance = Appearance.learn(image, u, v, radius_px)
        found = locate_ball(image, appearance, u + 0.3, v - 0.3, radius_px)
        assert found is not None
        over += [(found.u_px - u) / found.sigma_px, (found.v_px - v) / found.sigma_px]
        radii.append(found.radius_px)
    assert np.sqrt(np.mean(np.square(over))) < 1.5
    assert abs(np.mean(radii) - radius_px) < bias_px


@pytest.mark.parametrize("guess", [(nan, 30.0, 5.0), (30.0, nan, 5.0), (30.0, 30.0, nan)])
def test_a_guess_that_is_no_number_finds_nothing(guess):
    rng = np.random.default_rng(1)
    image = disc(5.0, 30.0, 30.0, 60, rng)
    appearance = Appearance.learn(image, 30.0, 30.0, 5.0)
    assert locate_ball(image, appearance, *guess) is None
