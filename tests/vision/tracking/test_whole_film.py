"""A film that can be read again: its ball, from its first frame to its last."""

import cv2
import numpy as np
import pytest

from tests.support.footage import Film, disc, exposed, rolling
from vision.detection.appearance import Appearance
from vision.frames import Frame
from vision.tracking.tracker import Tracker
from vision.tracking.whole_film import WholeFilm, survey

SMALL = {"size": (320, 240), "radius": 13.0, "seconds": 2.0}


def followed(film, **told):
    """(the film's tracks, error in px by frame: NaN where no place was measured, infinite where
    there is no ball)."""
    found = WholeFilm(lambda: film.frames, **told)
    off = []
    for frame, place in zip(film.frames, film.truth, strict=True):
        track = found.step(frame)
        away = np.inf if place is None else np.hypot(track.u_px - place[0], track.v_px - place[1])
        off.append(away if track.state == "track" else np.nan)
    return found, np.array(off)


@pytest.mark.parametrize("colour", [None, "green", "orange"])
def test_every_visible_frame_is_right_whatever_colour_is_named(colour):
    film = rolling("green", on="white", decoys=True, hidden=(0.8, 1.1), rest_s=0.3, **SMALL)
    appearance = Appearance.of_colour(colour) if colour else None
    found, off = followed(film, appearance=appearance)
    visible = np.array([place is not None for place in film.truth])
    assert np.isfinite(off[visible]).sum() >= visible.sum() - 2
    assert np.nanmax(off) < 1.0
    assert found.proven


def test_ball_of_the_film_is_followed_not_its_first_mover():
    film = rolling("blue", on="grey", rest_s=1.0, **SMALL)
    for k, frame in enumerate(film.frames[:20]):
        leaf = frame.image.astype(np.float32)
        disc(leaf, (20.0 + 8.0 * k, 30.0), 5.0, np.array((20.0, 200.0, 40.0)))
        film.frames[k] = Frame(leaf.astype(np.uint8), frame.t_s, frame.index)
    found, off = followed(film)
    assert np.nanmax(off) < 1.0
    assert np.isfinite(off).all()
    assert found.radius_px == pytest.approx(13.0, abs=0.5)


def test_ball_that_comes_late_is_tracked_back_to_where_it_came_from():
    film = rolling("orange", on="white", leaves_s=1.2, rest_s=0.0, **SMALL)
    film.frames.reverse()
    film.truth.reverse()
    film.frames = [Frame(f.image, k / 30, k) for k, f in enumerate(film.frames)]
    _, off = followed(film)
    visible = np.array([place is not None for place in film.truth])
    assert np.isfinite(off[visible]).mean() > 0.97
    assert not np.isinf(off).any()


def test_film_without_a_ball_has_none():
    film = rolling("orange", hidden=(0.0, 9.0), leaves_s=-99.0, **SMALL)
    found, off = followed(film)
    assert np.isnan(off).all()
    assert np.isnan(found.radius_px)
    assert not found.proven


@pytest.mark.parametrize("fps", [30.0, 100.0, 250.0])
@pytest.mark.parametrize("rest_s", [0.0, 9.0])
def test_live_lock_takes_as_long_at_any_frame_rate(fps, rest_s):
    film = rolling("green", on="white", fps=fps, rest_s=rest_s, **(SMALL | {"seconds": 0.75}))
    tracker = Tracker()
    first = next(f.t_s for f in film.frames if tracker.step(f).state == "track")
    assert 0.0 < first < 0.25
    assert not tracker.proven  # two looks do not show whether it travels
    *_, last = (tracker.step(f) for f in film.frames if f.t_s > first)
    assert last.state == "track"
    assert tracker.proven == (rest_s == 0.0)


def test_tracker_starts_where_it_is_told():
    film = rolling("orange", on="white", decoys=True, rest_s=9.0, **(SMALL | {"seconds": 0.2}))
    place = film.truth[0]
    assert place is not None
    tracker = Tracker(ball_at=(place[0] + 4.0, place[1] - 3.0))
    track = tracker.step(film.frames[0])
    assert np.hypot(track.u_px - place[0], track.v_px - place[1]) < 0.5
    assert tracker.start_at(film.frames[1], 5.0, 5.0) is None
    assert tracker.step(film.frames[1]).state == "track"


def test_a_mark_is_not_the_ball_of_a_film_in_which_something_rolls_that_no_circle_shows():
    film, rng = Film(), np.random.default_rng(1)
    for k in range(45):
        image = np.full((240, 320, 3), 150.0)
        disc(image, (60.0, 60.0), 12.0, np.array((90.0, 30.0, 60.0)))
        image[150:170, 100 + 3 * k : 120 + 3 * k] += 24.0
        film.add(
            np.clip(image + rng.normal(0.0, 1.0, image.shape), 0, 255).astype(np.uint8),
            k / 30,
            None,
        )
    assert not survey(lambda: film.frames).sightings
    still = [Frame(film.frames[0].image, k / 30, k) for k in range(45)]
    assert survey(lambda: still).sightings


@pytest.mark.parametrize("flat", [1.0, 0.8])
def test_a_printed_ring_is_no_ball_while_nothing_moves(flat):
    film, rng, tracker = Film(), np.random.default_rng(1), Tracker()
    image = np.full((240, 320, 3), 60.0, np.float32)
    cv2.ellipse(image, (100, 120), (16, round(16 * flat)), 20, 0, 360, (90, 110, 140), 5)
    for k in range(45):
        film.add(exposed(image, 2.0, rng), k / 30, None)
    assert not survey(lambda: film.frames).sightings
    assert {tracker.step(frame).state for frame in film.frames} == {"search"}
