"""What changes beside a thing at rest, and along with one that moves."""

import numpy as np
import pytest

from tests.support.footage import disc
from vision.frames import Frame
from vision.tracking.stir import Stir
from vision.tracking.tracker import Tracker

FPS = 30.0
MARK = (60.0, 60.0, 12.0)


def table(u: float) -> np.ndarray:
    """A grey table (240, 320, 3) with a dark round mark, and a faint square at `u` px."""
    rng = np.random.default_rng(round(u))
    image = np.full((240, 320, 3), 150.0)
    disc(image, MARK[:2], MARK[2], np.array((90.0, 30.0, 60.0)))
    image[150:170, int(u) : int(u) + 20] += 24.0
    return np.clip(image + rng.normal(0.0, 1.0, image.shape), 0, 255).astype(np.uint8)


def test_still_image_does_not_stir():
    stir = Stir()
    for k in range(8):
        stir.add(k / FPS, table(100.0))
    assert not stir.elsewhere(MARK[:2], MARK[2])


def test_faint_thing_that_moves_stirs_beside_the_mark_and_not_beside_itself():
    stir = Stir()
    for k in range(8):
        stir.add(k / FPS, table(100.0 + 3 * k))
    assert stir.elsewhere(MARK[:2], MARK[2])
    assert not stir.elsewhere((120.0, 160.0), 15.0)


@pytest.mark.parametrize("change", ["light", "hand"])
def test_other_light_and_what_reaches_in_over_the_border_do_not_stir(change):
    stir = Stir()
    for k in range(8):
        image = table(100.0)
        if change == "light":
            image = np.clip(1.03**k * image.astype(float), 0, 255).astype(np.uint8)
        else:
            image[100:140, : 20 * k] = (90, 120, 190)
        stir.add(k / FPS, image)
    assert not stir.elsewhere((260.0, 60.0), 12.0)


@pytest.mark.parametrize("shade", [0.0, 0.3])
def test_mark_is_left_once_something_rolls_that_no_circle_shows_but_no_solid_is(shade):
    tracker, states = Tracker(), []
    for k in range(60):
        image = table(100.0 + max(0, k - 20) * 3.0).astype(float)
        disc(image, MARK[:2], MARK[2], np.array((90.0, 30.0, 60.0)), shade=shade)
        states.append(tracker.step(Frame(image.astype(np.uint8), k / FPS, k)).state)
    assert "track" in states[:20]
    assert ("track" in states[45:]) == (shade > 0.0)


def test_a_ball_rolls_alone_with_its_shadow_and_a_fingertip_does_not():
    rolling, reaching = Stir(), Stir()
    for k in range(8):
        tip, ball = 60.0 + 8.0 * k, table(0.0).astype(float)
        hand = ball.copy()
        disc(ball, (tip + 10.0, 128.0), 12.0, np.array((60.0, 60.0, 60.0)))
        for image in (ball, hand):
            disc(image, (tip, 120.0), 12.0, np.array((90.0, 120.0, 190.0)))
        hand[108:132, : round(tip)] = hand[90:160, : max(0, round(tip) - 30)] = (90, 120, 190)
        rolling.add(k / FPS, ball.astype(np.uint8))
        reaching.add(k / FPS, hand.astype(np.uint8))
    way = [(60.0 + 8.0 * k, 120.0) for k in range(8)]
    assert not rolling.joined(way, 12.0, still=True)
    assert not rolling.joined([way[0], way[-1]], 12.0, still=True)  # seen at few looks
    assert reaching.joined(way, 12.0, still=True)
    assert reaching.joined(way, 12.0, still=False)


def test_nothing_came_to_where_the_image_did_not_change():
    stir = Stir()
    for k in range(8):
        stir.add(k / FPS, table(100.0 + 3 * k))
    assert stir.is_calm(MARK[:2], MARK[2], 90.0, 0.0)
    assert not stir.is_calm((120.0, 160.0), 15.0, 90.0, 0.0)  # here it did
    assert not stir.is_calm(MARK[:2], MARK[2], 12.0, 0.0)  # too faint to be sure
    assert not stir.is_calm(MARK[:2], MARK[2], 90.0, -1.0)  # not remembered


def test_nothing_came_to_where_the_image_is_as_it_was_a_second_ago():
    """Two marks that are seen by turns, at looks far apart, are no ball that goes to and fro."""
    stir = Stir()
    for k in range(12):
        stir.add(0.1 * k, table(100.0 + (60.0 if k > 3 else 0.0)))
    assert stir.is_calm(MARK[:2], MARK[2], 90.0, 0.2)
    assert not stir.is_calm((170.0, 160.0), 15.0, 90.0, 0.2)  # long ago, but since then
    assert stir.is_calm((170.0, 160.0), 15.0, 90.0, 0.4)


def test_nothing_came_to_a_mark_that_sways_with_its_plate():
    stir = Stir()
    for k in range(6):
        stir.add(0.1 * k, np.roll(table(100.0), k // 3, axis=1))
    assert stir.is_calm(MARK[:2], MARK[2], 90.0, 0.0)


def test_what_changes_on_all_sides_may_be_the_light():
    stir = Stir()
    for k in range(8):
        stir.add(k / FPS, np.clip(1.05**k * table(100.0).astype(float), 0, 255).astype(np.uint8))
    assert stir.joined([MARK[:2]], MARK[2], still=True)
    assert not stir.joined([MARK[:2]], MARK[2], still=False)
