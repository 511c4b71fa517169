"""Round things in one image, whatever they are."""

import cv2
import numpy as np
import pytest

from tests.support.footage import disc, exposed
from vision.detection.appearance import NOISE_FLOOR, Appearance
from vision.detection.hough_circles import circles_of_any_size
from vision.detection.pixels import turn_steps, unevenness
from vision.tracking.sightings import FAINT, LEAST_STEP, bounds_of, round_things, sight
from vision.tracking.things import EVEN, PATTERN


def seen(image):
    """(places (n, 2), radii (n,)) of the round things in an image."""
    found = round_things(image, bounds_of(image, None), at_most=3)
    return np.array([s.place for s in found]), np.array([s.seen.radius_px for s in found])


def test_ball_brighter_on_one_side_and_darker_on_the_other_than_its_plate():
    """Its brightness is the plate's in the mean: only its colour is another all round."""
    rng = np.random.default_rng(1)
    grain = cv2.GaussianBlur(12 * rng.normal(size=(240, 320, 1)), (9, 9), 2.0)
    image = np.full((240, 320, 3), (70.0, 100.0, 130.0)) + 3.0 * grain[:, :, None]
    image = image.astype(np.float32)
    disc(image, (170.0, 120.0), 26.0, np.array((25.0, 85.0, 160.0)), shade=0.5)
    circles = circles_of_any_size(exposed(image, 2.0, rng), (3.5, 100.0), at_most=3)
    support = [c.score for c in circles if np.hypot(c.u_px - 170.0, c.v_px - 120.0) < 5.0]
    assert max(support, default=0.0) > 1.0


@pytest.mark.parametrize(("v", "sighted"), [(34.0, True), (4.0, False)])
def test_ball_of_which_the_border_cuts_a_little_is_seen_one_that_is_halved_is_not(v, sighted):
    image = np.full((240, 320, 3), 200.0, np.float32)
    disc(image, (170.0, v), 40.0, np.array((30.0, 110.0, 220.0)))
    places, radii = seen(exposed(image, 2.0, np.random.default_rng(1)))
    hits = [
        np.hypot(*(p - (170.0, v))) < 1.0 and abs(r - 40) < 1
        for p, r in zip(places, radii, strict=True)
    ]
    assert any(hits) == sighted


def test_a_shaded_ball_is_likelier_than_a_flat_mark_of_its_contrast():
    image = np.full((240, 320, 3), 200.0, np.float32)
    disc(image, (100.0, 120.0), 20.0, np.array((60.0, 90.0, 120.0)), shade=0.4)
    disc(image, (220.0, 120.0), 20.0, np.array((60.0, 90.0, 120.0)), shade=0.0)
    image = exposed(image, 2.0, np.random.default_rng(1))
    ball, mark = sorted(round_things(image, bounds_of(image, None)), key=lambda s: s.place)
    assert ball.likely > 1.5 * mark.likely


def test_a_ball_as_bright_as_its_plate_steps_along_its_turn_a_printed_ring_does_not():
    image = np.full((240, 320, 3), 200.0, np.float32)
    disc(image, (90.0, 120.0), 30.0, np.full(3, 200.0), shade=0.5)
    cv2.circle(image, (230, 120), 30, (60.0, 60.0, 60.0), 2, cv2.LINE_AA)
    image = exposed(image, 2.0, np.random.default_rng(1))
    ball, ring = (turn_steps(image, u, 120.0, 30.0, NOISE_FLOOR) for u in (90.0, 230.0))
    assert Appearance.sketch(image, 90.0, 120.0, 30.0).separation < LEAST_STEP
    assert ball[2] > LEAST_STEP > 3.0 * ring[3]


def test_a_ball_within_a_printed_ring_is_seen_and_not_the_ring():
    image = np.full((240, 320, 3), 180.0, np.float32)
    cv2.circle(image, (160, 120), 50, (60.0, 60.0, 60.0), 2, cv2.LINE_AA)
    disc(image, (156.0, 117.0), 36.0, np.array((70.0, 100.0, 130.0)), shade=0.3)
    places, radii = seen(exposed(image, 2.0, np.random.default_rng(1)))
    near = np.hypot(*(places - (156.0, 117.0)).T) < 10.0
    assert radii[near] == pytest.approx([36.0], abs=1.0)


def test_a_coin_seen_aslant_is_flattened_and_a_ball_is_not():
    image = np.full((240, 320, 3), 60.0, np.float32)
    disc(image, (90.0, 120.0), 14.0, np.array((40.0, 130.0, 220.0)), shade=0.4)
    cv2.ellipse(image, (230, 120), (17, 12), 0, 0, 360, (150.0, 200.0, 200.0), -1, cv2.LINE_AA)
    image = exposed(image, 2.0, np.random.default_rng(1))
    ball, coin = sorted(round_things(image, bounds_of(image, None)), key=lambda s: s.place)
    assert ball.round > 0.9
    assert coin.seen.flattening == pytest.approx(0.17, abs=0.03)
    assert coin.round < FAINT


def test_a_cell_of_a_marker_has_company_of_its_colour_a_ball_has_none():
    image = np.full((240, 320, 3), 200.0, np.float32)
    disc(image, (230.0, 120.0), 6.0, np.array((30.0, 110.0, 220.0)))
    image[90:150, 50:110] = 20.0
    around = ((72, 108), (84, 106), (96, 110), (70, 122), (98, 124), (74, 134), (86, 136))
    for u, v in ((84, 120), *around):
        image[v - 4 : v + 4, u - 4 : u + 4] = 230.0
    image = np.asarray(cv2.GaussianBlur(image, (0, 0), 1.5))
    image = exposed(image, 2.0, np.random.default_rng(1))
    bounds = bounds_of(image, None)
    cell, ball = sight(image, 83.5, 119.5, 4.5, bounds), sight(image, 230.0, 120.0, 6.0, bounds)
    assert cell is not None
    assert ball is not None
    assert cell.company > PATTERN
    assert ball.company < 0.01


def test_a_shadow_on_one_side_is_no_company():
    image = np.full((240, 320, 3), 200.0, np.float32)
    for place, level in (((150.0, 112.0), 60.0), ((130.0, 100.0), 30.0)):
        disc(image, place, 14.0, np.full(3, level))
    image = exposed(image, 2.0, np.random.default_rng(1))
    ball = sight(image, 130.0, 100.0, 14.0, bounds_of(image, None))
    assert ball is not None
    assert ball.company < 0.01


@pytest.mark.parametrize("radius", [8.0, 18.0, 40.0])
def test_a_shadow_that_its_ball_covers_in_part_is_even_and_a_black_ball_is_not(radius):
    """The ball, white on a pale plate, hides a third of the shadow."""
    image = np.full((240, 320, 3), 200.0, np.float32)
    disc(image, (90.0, 120.0 + 1.1 * radius), radius, np.full(3, 135.0))
    disc(image, (90.0, 120.0), radius, np.full(3, 200.0), shade=0.3)
    disc(image, (230.0, 120.0), radius, np.full(3, 60.0), shade=0.3)
    image = exposed(image, 2.0, np.random.default_rng(1))
    assert unevenness(image, 90.0, 120.0 + 1.1 * radius, radius) < EVEN
    assert unevenness(image, 230.0, 120.0, radius) > 1.5 * EVEN
    assert unevenness(image, -50.0, 120.0, radius) == np.inf


@pytest.mark.parametrize("radius", [8.0, 20.0, 60.0])
def test_a_matt_ball_under_an_even_sky_is_less_even_than_a_shadow(radius: float):
    y, x = np.mgrid[: 4 * radius, : 4 * radius] + 0.5 - 2.0 * radius
    inside = (x**2 + y**2) / radius**2
    up = np.sqrt(np.clip(1.0 - inside, 0.0, 1.0))  # n_z
    grey = np.where(inside < 1.0, 120.0 * 0.5 * (1.0 + up), 220.0)
    image = np.repeat(grey[:, :, None], 3, axis=2).round().astype(np.uint8)
    middle = 2.0 * radius - 0.5
    found = unevenness(image, middle, middle, radius)
    assert found == pytest.approx(0.08, abs=0.005)
    assert found > 1.5 * EVEN
