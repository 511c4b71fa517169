"""The detector against exact discs: right to hundredths of a pixel, and honest about it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.footage import BGR, disc, exposed, plate, still_disc
from vision.detection.appearance import NAMED, Appearance, parse_colour
from vision.detection.blobs import find_blobs
from vision.detection.detector import locate_ball
from vision.tracking.gate import is_plausible


def errors_and_scores(radius, *, noise, shade, count=24):
    """Errors (n, 2) px of located discs and the same over the sigma that was claimed."""
    rng = np.random.default_rng(5)
    errors, scores, appearance = [], [], None
    for k in range(count):
        u, v = rng.uniform(75, 85, 2)
        image = still_disc(radius, (u, v), noise=noise, shade=shade, seed=k)
        appearance = appearance or Appearance.learn(image, u, v, radius)
        off = rng.uniform(-0.2, 0.2, 2) * radius
        found = locate_ball(image, appearance, u + off[0], v + off[1], 1.05 * radius)
        assert found is not None
        assert is_plausible(found, appearance, (0.8 * radius, 1.25 * radius), strict=True)
        error = np.array([found.u_px - u, found.v_px - v])
        errors.append(error)
        scores.append(error / found.sigma_px)
    return np.array(errors), np.array(scores)


@pytest.mark.parametrize("radius", [6, 12, 30, 55])
def test_clean_disc_is_located_to_hundredths_of_a_pixel(radius):
    errors, _ = errors_and_scores(radius, noise=0.0, shade=0.0)
    assert np.sqrt(np.mean(errors**2, axis=0)).max() < 0.01


@pytest.mark.parametrize("radius", [10, 20, 40])
@pytest.mark.parametrize("noise", [2.0, 6.0])
@pytest.mark.parametrize("shade", [0.0, 0.4])
def test_sigma_is_honest(radius, noise, shade):
    errors, scores = errors_and_scores(radius, noise=noise, shade=shade)
    assert np.sqrt(np.mean(errors**2, axis=0)).max() < 0.05
    assert 0.7 < np.sqrt(np.mean(scores**2)) < 1.4


def test_no_bias_towards_any_part_of_the_pixel():
    appearance, errors = None, []
    for k, part in enumerate(np.linspace(0, 1, 21)):
        image = still_disc(15, (80 + part, 80 + part), noise=0.0, shade=0.0, seed=k)
        appearance = appearance or Appearance.learn(image, 80, 80, 15)
        found = locate_ball(image, appearance, 80, 80, 15)
        assert found is not None
        errors.append(found.u_px - 80 - part)
    assert np.abs(errors).max() < 0.006


@settings(max_examples=25)
@given(u=st.floats(60, 100), v=st.floats(60, 100), radius=st.floats(8, 40))
def test_mirrored_image_gives_the_mirrored_place(u, v, radius):
    image = still_disc(radius, (u, v), noise=1.0, shade=0.3, seed=3)
    appearance = Appearance.learn(image, u, v, radius)
    found = locate_ball(image, appearance, u, v, radius)
    mirrored = locate_ball(np.ascontiguousarray(image[:, ::-1]), appearance, 159 - u, v, radius)
    assert found is not None
    assert mirrored is not None
    assert abs(found.u_px - (159 - mirrored.u_px)) < 0.02
    assert abs(found.v_px - mirrored.v_px) < 0.02


@pytest.mark.parametrize("hidden", ["left", "top"])
def test_ball_half_behind_a_stick_keeps_its_place(hidden):
    image = np.full((160, 160, 3), (150.0, 165.0, 175.0), np.float32)
    disc(image, (80.3, 79.6), 25, np.array((30.0, 120.0, 190.0)))
    whole = exposed(image, 2.0, np.random.default_rng(1))
    if hidden == "left":
        image[:, 40:62] = 40
    else:
        image[40:66, :] = 40
    appearance = Appearance.learn(whole, 80.3, 79.6, 25)
    found = locate_ball(exposed(image, 2.0, np.random.default_rng(2)), appearance, 83, 82, 25)
    assert found is not None
    assert is_plausible(found, appearance, (20, 31))
    error = np.hypot(found.u_px - 80.3, found.v_px - 79.6)
    assert error < 0.3
    assert error < 4 * found.sigma_px
    assert found.coverage < 1.0


def test_streak_is_located_at_its_middle():
    rng = np.random.default_rng(0)
    places = [(80.0 + d, 80.0) for d in np.linspace(-9, 9, 37)]
    images = []
    for place in places:
        image = np.full((160, 160, 3), (150.0, 165.0, 175.0), np.float32)
        disc(image, place, 18, np.array((30.0, 120.0, 190.0)))
        images.append(image)
    still = exposed(images[18], 2.0, rng)
    appearance = Appearance.learn(still, 80, 80, 18)
    found = locate_ball(exposed(np.mean(images, axis=0), 2.0, rng), appearance, 84, 82, 18)
    assert found is not None
    assert is_plausible(found, appearance, (14, 23))
    assert np.hypot(found.u_px - 80, found.v_px - 80) < 0.4


@pytest.mark.parametrize("what", ["plate", "square", "inverse", "small"])
def test_what_is_not_the_ball_is_not_believed(what):
    ball = still_disc(20, (80, 80), noise=2.0, shade=0.2, seed=1)
    appearance = Appearance.learn(ball, 80, 80, 20)
    image = np.full((160, 160, 3), (150.0, 165.0, 175.0), np.float32)
    if what == "square":
        image[60:100, 50:110] = (30, 120, 190)
    elif what == "inverse":
        image[:] = (30, 120, 190)
        disc(image, (80, 80), 20, np.array((150.0, 165.0, 175.0)))
    elif what == "small":
        disc(image, (80, 80), 12, np.array((30.0, 120.0, 190.0)))
    found = locate_ball(exposed(image, 2.0, np.random.default_rng(4)), appearance, 82, 79, 20)
    assert not is_plausible(found, appearance, (16, 25))


@pytest.mark.parametrize("at", [(-30.0, 50.0), (2.0, 2.0), (640.0, 90.0), (80.0, 1e4)])
def test_guesses_at_and_beyond_the_border_are_harmless(at):
    image = still_disc(20, (80, 80), noise=2.0, shade=0.2, seed=1)
    appearance = Appearance.learn(image, 80, 80, 20)
    assert not is_plausible(
        locate_ball(image, appearance, *at, 20), appearance, (16, 25), strict=True
    )


@pytest.mark.parametrize("colour", ["orange", "white", "black", "green", "red", "blue", "yellow"])
@pytest.mark.parametrize("on", ["wood", "white", "dark"])
def test_named_ball_is_found_first(colour, on):
    if (colour, on) in {("white", "white"), ("black", "dark")}:
        pytest.skip("the ball has its plate's colour")
    image = plate(on, (320, 240), np.random.default_rng(2))
    disc(image, (190.0, 130.0), 14, np.array(BGR[colour], float), shade=0.25)
    appearance = Appearance.of_colour(colour)
    seen = exposed(image, 2.0, np.random.default_rng(3))
    found = [
        blob
        for least in (0.43, 0.65, 0.85)
        for blob in find_blobs(seen, appearance, (8, 25), least=least)
    ]
    assert any(np.hypot(b.u_px - 190, b.v_px - 130) < 4 for b in found)
    fits = [locate_ball(seen, appearance, b.u_px, b.v_px, b.radius_px) for b in found]
    right = [f for f in fits if is_plausible(f, appearance, (8, 25), strict=True)]
    assert right
    assert all(f is not None and np.hypot(f.u_px - 190, f.v_px - 130) < 0.5 for f in right)


def test_mask_hides_what_lies_outside():
    image = still_disc(15, (40, 80), noise=2.0, shade=0.0, seed=1)
    appearance = Appearance.learn(image, 40, 80, 15)
    mask = np.zeros(image.shape[:2], np.uint8)
    mask[:, 80:] = 255
    assert find_blobs(image, appearance, (10, 20))
    assert not find_blobs(image, appearance, (10, 20), mask=mask)


def test_learned_looks_know_their_ball():
    image = still_disc(20, (80, 80), noise=2.0, shade=0.2, seed=1)
    appearance = Appearance.learn(image, 80, 80, 20)
    assert appearance.fill > 0.9
    assert appearance.signed
    _, _, contrast = appearance.here(image, 80, 80, 20)
    assert contrast == pytest.approx(1.0, abs=1e-6)


def test_colours_are_parsed_or_refused():
    assert list(parse_colour("#ff8000")) == [0, 128, 255]
    assert list(parse_colour(" Orange ")) == list(parse_colour(NAMED["orange"]))
    for bad in ("octarine", "#12345", "#12345g", ""):
        with pytest.raises(ValueError, match="use #rrggbb or one of"):
            parse_colour(bad)
