"""A knocked camera is noticed by its fixed markers, a pushed marker or a hand is not one."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from calibration.camera.camera_shift import ShiftMonitor, camera_shift, fixed_markers, plate_moved
from calibration.camera.plate import level_pose
from vision.ball_camera import BallCamera
from vision.frames import Frame
from vision.plate.markers import FoundMarkers, default_layout
from vision.synthetic.synthetic import Renderer, Scene, virtual_view
from vision.tracking.tracker import Tracker
from vision.view import View

LAYOUT, MM_PER_PX = default_layout(0.275), 0.69
PLACES = {46: (-0.18, 0.08), 47: (0.18, 0.08), 48: (-0.18, -0.08), 49: (0.18, -0.08)}
FIXED_SIDE_M = 0.024


def moved_view(shift_m=(0.0, 0.0, 0.0), turn_deg=0.0) -> View:
    """The view after somebody pushed the camera."""
    view = virtual_view()
    push = np.eye(4)
    push[:3, :3] = np.asarray(cv2.Rodrigues(np.radians([turn_deg, 0.0, 0.0]))[0])
    push[:3, 3] = shift_m
    return replace(view, camera_from_plate=push @ view.camera_from_plate)


def with_fixed(image: np.ndarray, view: View, places=PLACES) -> np.ndarray:
    """Paste markers on white paper that lie beside the level plate, at its height."""
    book = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    out = image.copy()
    for number, (x, y) in places.items():
        print_ = np.pad(cv2.aruco.generateImageMarker(book, number, 48), 24, constant_values=255)
        half = FIXED_SIDE_M / 2 * 96 / 48
        square = [
            (x - half, y + half),
            (x + half, y + half),
            (x + half, y - half),
            (x - half, y - half),
        ]
        corners = view.pixel_from_plate(np.column_stack((square, np.zeros(4))))
        texels = 96 * np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32) - 0.5
        warp = cv2.getPerspectiveTransform(texels, corners.astype(np.float32))
        size = (image.shape[1], image.shape[0])
        drawn = cv2.warpPerspective(print_, warp, size, flags=cv2.INTER_LINEAR)
        cover = cv2.warpPerspective(np.full_like(print_, 255), warp, size)
        out[cover > 127] = cv2.GaussianBlur(drawn, (0, 0), 0.5)[cover > 127, None]
    return out


def frames(view: View, count: int = 1, seed: int = 0, places=PLACES) -> list[np.ndarray]:
    made = Renderer(Scene(), view, np.random.default_rng(seed))
    return [with_fixed(made.render(np.eye(3), None), view, places) for _ in range(count)]


@pytest.fixture(scope="module")
def fixed():
    found = fixed_markers(frames(virtual_view(), 4), LAYOUT, MM_PER_PX)
    assert found is not None
    return found


@pytest.mark.slow
def test_fixed_markers_are_found_beside_the_plate_and_do_not_disturb_it(fixed):
    assert fixed.ids == [46, 47, 48, 49]
    truth = virtual_view()
    pose = level_pose(frames(truth, 4), truth.camera, LAYOUT)
    assert np.abs(pose.camera_from_plate - truth.camera_from_plate)[:3, 3].max() < 3e-4


def test_a_plate_alone_has_none():
    assert fixed_markers(frames(virtual_view(), 3, places={}), LAYOUT, MM_PER_PX) is None


def said_after(fixed, images) -> list[str]:
    watch = ShiftMonitor(fixed, every_s=1.0)
    return [said for k, image in enumerate(images) if (said := watch.check(image, float(k)))]


@pytest.mark.parametrize(
    ("shift_m", "turn_deg"), [((0.003, 0.0, 0.0), 0.0), ((0, 0.002, 0), 0), ((0, 0, 0), 0.3)]
)
def test_a_knocked_camera_is_said_once(fixed, shift_m, turn_deg):
    before, after = frames(virtual_view(), 3, 1), frames(moved_view(shift_m, turn_deg), 6, 2)
    said = said_after(fixed, [*before, *after])
    assert len(said) == 1
    assert said[0].startswith("moved camera: of 4 fixed markers 4 lie")
    assert "rig calibrate table" in said[0]


def test_a_camera_that_stayed_is_not_accused(fixed):
    assert not said_after(fixed, frames(virtual_view(), 6, 3))


def test_one_pushed_marker_is_no_knock(fixed):
    pushed = {**PLACES, 46: (-0.20, 0.06)}
    assert not said_after(fixed, frames(virtual_view(), 5, 4, pushed))


def test_a_hand_over_them_is_no_knock(fixed):
    assert not said_after(fixed, frames(virtual_view(), 5, 5, {}))


def test_a_glimpse_is_not_enough(fixed):
    still, odd = frames(virtual_view(), 1, 6)[0], frames(moved_view((0.004, 0, 0)), 1, 6)[0]
    assert not said_after(fixed, [still, odd, odd, still, odd, odd, still])


def test_the_shift_is_a_pure_judgement(fixed):
    ids, corners = np.array(fixed.ids), np.array(fixed.corners_px)
    assert camera_shift(FoundMarkers(ids, corners), fixed) is None
    assert camera_shift(FoundMarkers(ids[:0], corners[:0]), fixed) is None
    found = camera_shift(FoundMarkers(ids, corners + np.array((4.0, 3.0))), fixed)
    assert found is not None
    assert found.moved_px == pytest.approx(5.0)
    assert found.moved_mm == pytest.approx(5.0 * MM_PER_PX)
    assert camera_shift(FoundMarkers(ids, corners + 0.5), fixed) is None


@pytest.mark.slow
def test_without_fixed_markers_the_plates_centre_tells():
    view = virtual_view()
    camera = BallCamera(view, LAYOUT, Tracker(), 0.02)
    watch, said = ShiftMonitor(None), []
    for k, image in enumerate(frames(moved_view((0.004, 0.0, 0.0)), 4, 7, {})):
        camera.step(Frame(image, float(k), k), np.eye(3))
        said.append(watch.check(image, float(k), camera.drift_m))
    assert [bool(text) for text in said] == [False, False, True, False]
    assert "plate's centre lies 4." in str(said[2]) or "3.9" in str(said[2])


def test_a_plates_centre_that_is_not_seen_or_hardly_moves_says_nothing():
    assert plate_moved(float("nan")) is None
    assert plate_moved(0.0005) is None
    assert plate_moved(0.004) is not None
