"""The grid on the plate, and the places from which a page looks at the table."""

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

from experiments.dashboard.server.controls import Controls
from experiments.dashboard.view.backlash_gauges import PLACES
from experiments.dashboard.view.grid import (
    COARSE_M,
    FINE_M,
    axis_letters,
    below_numbers,
    grid_lines,
    grid_numbers,
)
from experiments.dashboard.view.pose import TOOTH_M
from experiments.dashboard.view.view_points import (
    FIELD_OF_VIEW_RAD,
    NARROW,
    VIEW_POINTS,
    add_view_points,
    field_of_view_rad,
    view_point,
)

SIDE_M = 0.275


@pytest.mark.parametrize("step_m", [FINE_M, COARSE_M])
def test_every_line_is_a_whole_multiple_of_the_step_from_edge_to_edge(step_m):
    lines = grid_lines(SIDE_M, step_m)
    assert lines.shape == (2 * (2 * int(SIDE_M / 2 / step_m) + 1), 2, 3)
    assert np.abs(lines[..., :2]).max() == pytest.approx(SIDE_M / 2)
    upright = lines[lines[:, 0, 0] == lines[:, 1, 0]]
    multiples = upright[:, 0, 0] / step_m
    assert multiples == pytest.approx(np.round(multiples), abs=1e-4)
    assert len(upright) == len(lines) // 2
    assert (0.0, 0.0) in {tuple(x) for x in upright[:, :, 0]}


def test_numbers_stand_beside_the_plate_where_their_lines_end():
    numbers = grid_numbers(SIDE_M)
    near = {text: place[0] for text, place in numbers if place[1] < -SIDE_M / 2}
    left = {text: place[1] for text, place in numbers if place[0] < -SIDE_M / 2}
    assert near == left == {text: pytest.approx(float(text) / 100) for text in near}
    assert list(near) == ["-10", "-5", "0", "5", "10"]


def test_no_gauge_stands_between_the_camera_and_a_number():
    """Labels are as large on a phone, where the table is small: whole sides of it apart."""
    for gauge in PLACES.values():
        for _, place in grid_numbers(SIDE_M):
            assert np.linalg.norm(np.subtract(gauge, place)) > SIDE_M / 2


PHONE_PX = (390, 370)  # of the 3-D view, above the panel
LABEL_PX, LETTER_PX = (92, 24), 12  # of a label's two lines, and of an axis's name


def on_phone(place) -> np.ndarray:
    """Pixel of a place in the view of the whole table on a phone."""
    position, at = map(np.array, view_point("Whole table", SIDE_M))
    ahead = (at - position) / np.linalg.norm(at - position)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    seen = np.array([right, np.cross(ahead, right), ahead]) @ (np.array(place) - position)
    wide, high = PHONE_PX
    focal_px = high / 2 / np.tan(field_of_view_rad(wide / high) / 2)
    return np.array(PHONE_PX) / 2 + focal_px * seen[:2] / seen[2]


def test_the_labels_of_the_gauges_are_whole_on_a_phone_and_hide_no_axis():
    for (kind, _), place in PLACES.items():
        off_m = (2.2 if kind == "joint" else -2.2) * TOOTH_M
        end = np.add(place, [0.0, 0.0, off_m])
        low = on_phone(end) - [LABEL_PX[0] / 2, LABEL_PX[1] if kind == "joint" else 0]
        high = low + LABEL_PX
        assert (low > 0).all()
        assert (high < PHONE_PX).all()
        for _, letter in axis_letters(SIDE_M):
            at = on_phone(letter)
            inside = (at > low - LETTER_PX / 2) & (at < high + LETTER_PX / 2)
            assert not inside.all(), (kind, place, at, low)


def test_the_models_distance_hides_no_number_on_a_phone():
    top = on_phone(below_numbers(SIDE_M))
    assert top[1] + LABEL_PX[1] < PHONE_PX[1]
    for text, place in [*grid_numbers(SIDE_M), *axis_letters(SIDE_M)]:
        apart = np.abs(on_phone(place) - top - (0.0, LABEL_PX[1] / 2))
        assert (apart > (np.array(LABEL_PX) + LETTER_PX) / 2).any(), text


def test_a_page_moves_its_own_view_alone_and_may_without_the_controls():
    pressed = {}

    def handle(name, **looks):
        return SimpleNamespace(on_click=lambda act: pressed.update({name: act}))

    def page():
        return SimpleNamespace(atomic=nullcontext, camera=SimpleNamespace())

    gui = SimpleNamespace(
        add_folder=lambda *a, **k: nullcontext(), add_button=handle, add_command=handle
    )
    controls, pages = Controls(lambda *what: None, print), {1: page(), 2: page()}
    add_view_points(SimpleNamespace(gui=gui), controls, pages, SIDE_M)  # pyright: ignore
    assert set(pressed) == set(VIEW_POINTS)
    pressed["From above"](SimpleNamespace(client_id=2))
    pressed["From above"](SimpleNamespace(client_id=3))  # has gone
    controls.queue.close()
    assert pages[2].camera.position == pytest.approx(VIEW_POINTS["From above"][0])
    assert pages[2].camera.look_at == VIEW_POINTS["From above"][1]
    assert not vars(pages[1].camera)
    for position, at in VIEW_POINTS.values():
        assert np.linalg.norm(np.subtract(position, at)) > 0.2
        assert position[2] > at[2]  # never from below


def test_a_larger_plate_is_seen_at_the_same_size_and_a_smaller_one_is_not_come_nearer():
    for name, (position, at) in VIEW_POINTS.items():
        there, same = view_point(name, 1.5 * SIDE_M)
        assert same == at
        assert np.subtract(there, at) == pytest.approx(1.5 * np.subtract(position, at))
        assert view_point(name, 0.5 * SIDE_M)[0] == pytest.approx(position)


@pytest.mark.parametrize("aspect", [0.2, 0.4, NARROW, 1.0, 2.5])
def test_a_narrow_view_sees_as_much_from_side_to_side(aspect: float):
    across = np.tan(field_of_view_rad(aspect) / 2) * aspect
    assert across == pytest.approx(np.tan(FIELD_OF_VIEW_RAD / 2) * max(NARROW, aspect))
    if aspect >= NARROW:
        assert field_of_view_rad(aspect) == pytest.approx(FIELD_OF_VIEW_RAD)
