"""A flat round mark at rest is not held for the ball while other things stir."""

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


def test_mark_is_left_once_something_rolls_that_no_circle_shows():
    tracker, states = Tracker(), []
    for k in range(60):
        u = 100.0 + max(0, k - 20) * 3.0
        states.append(tracker.step(Frame(table(u), k / FPS, k)).state)
    assert "track" in states[:20]
    assert "track" not in states[45:]
