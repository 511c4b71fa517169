"""What is drawn shows the state, and sheets keep every image in its place."""

import numpy as np
import pytest

from vision.frames import Track
from vision.overlay import COLOURS, MEANINGS, contact_sheet, draw_track, legend

GREY = np.full((120, 160, 3), 90, np.uint8)


@pytest.mark.parametrize("state", ["track", "coast"])
def test_outline_is_drawn_in_the_colour_of_the_state(state):
    out = draw_track(GREY, Track(state, 80.0, 70.0, 0.05, 20.0), [(60.0, 70.0), (80.0, 70.0)])
    assert tuple(out[70, 100]) == COLOURS[state]
    assert tuple(out[50, 80]) == COLOURS[state]
    assert out[70, 70, 0] > 200 > 100 > out[70, 70, 2]  # the trail, in cyan


@pytest.mark.parametrize("state", ["search", "lost"])
def test_without_a_ball_nothing_is_drawn_on_the_plate(state):
    out = draw_track(GREY, Track(state), [(float("nan"), float("nan"))])
    assert np.array_equal(out[22:], GREY[22:])
    assert not np.array_equal(out[:20], GREY[:20])  # but the state is written


def test_drawing_leaves_the_frame_alone():
    before = GREY.copy()
    draw_track(GREY, Track("track", 80.0, 70.0, 0.05, 20.0), [])
    assert np.array_equal(GREY, before)


def test_sheet_places_images_by_rows():
    images = [np.full((4, 6, 3), k, np.uint8) for k in range(1, 6)]
    sheet = contact_sheet(images, 3)
    assert sheet.shape == (8, 18, 3)
    assert [int(sheet[r * 4, c * 6, 0]) for r in range(2) for c in range(3)] == [1, 2, 3, 4, 5, 0]


@pytest.mark.parametrize(("images", "columns"), [([], 2), ([GREY], 0), ([GREY, GREY[:50]], 2)])
def test_impossible_sheets_are_refused(images, columns):
    with pytest.raises(ValueError, match="contact sheet"):
        contact_sheet(images, columns)


@pytest.mark.parametrize("width", [240, 640, 1600])
def test_a_legend_shows_every_colour_inside_its_width(width: int):
    strip = legend("a film: 24 of 600 frames", width)
    assert strip.shape[1] == width
    for _, colour in MEANINGS:
        assert (strip == colour).all(axis=2).sum() > 30, colour
    assert not strip[:, -2:].any()  # nothing is cut off
    assert {colour for _, colour in MEANINGS} >= set(COLOURS.values())
