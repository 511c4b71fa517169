"""The level plate from rendered frames: exact, and refused when something is off."""

from dataclasses import replace

import numpy as np
import pytest

from calibration.camera.plate import level_pose
from calibration.camera.sheet import CalibrationError
from vision.plate.markers import MarkerLayout, default_layout
from vision.synthetic.synthetic import Renderer, Scene, virtual_view
from vision.view import View

LEVEL = np.eye(3)
TILT = np.array([[0.99995, 0, 0.01], [0, 1, 0], [-0.01, 0, 0.99995]])
LAYOUT = default_layout(0.275)


def scene_frames(scene=None, count=4, ball=None, tilts=(LEVEL,)):
    renderer = Renderer(scene or Scene(), virtual_view(), np.random.default_rng(6))
    return [renderer.render(tilts[k % len(tilts)], ball) for k in range(count)]


def test_pose_is_exact_and_better_than_one_frame():
    truth = virtual_view()
    plate = level_pose(scene_frames(count=8), truth.camera, LAYOUT)
    error = plate.camera_from_plate - truth.camera_from_plate
    assert np.abs(error[:3, 3]).max() < 2e-4  # along the ray 0.75 m: the weak direction
    assert np.degrees(np.abs(error[:3, :3]).max()) < 0.015
    assert plate.residual_mm < 0.05
    assert plate.scatter_mm < 0.02
    assert plate.frames == 8
    assert 0 < np.sqrt(plate.covariance[0, 0]) < np.radians(0.01)
    assert np.allclose(
        plate.camera_from_plate[:3, :3] @ plate.camera_from_plate[:3, :3].T, np.eye(3)
    )


def test_a_ball_left_on_the_plate_does_not_matter():
    truth = virtual_view()
    plate = level_pose(scene_frames(ball=(-0.12, 0.0)), truth.camera, LAYOUT)
    assert np.abs(plate.camera_from_plate - truth.camera_from_plate)[:3, 3].max() < 3e-4
    assert plate.residual_mm < 0.1


def test_refuses_markers_that_are_not_where_the_layout_says():
    believed = LAYOUT.corners_m.copy()
    believed[3] += (0.0015, 0.0)
    believed[6] += (0.0, -0.0012)
    wrong = MarkerLayout(LAYOUT.ids, believed)
    with pytest.raises(CalibrationError, match=r"mm rms off the layout .* worst marker 3"):
        level_pose(scene_frames(), virtual_view().camera, wrong)


def test_refuses_a_moving_plate():
    frames = scene_frames(tilts=(LEVEL, TILT))
    with pytest.raises(CalibrationError, match="plate moved"):
        level_pose(frames, virtual_view().camera, LAYOUT)


def test_refuses_frames_without_markers_and_of_another_size():
    blank = [np.full((480, 640, 3), 128, np.uint8)] * 5
    with pytest.raises(CalibrationError, match="found in 0 of 5 frames"):
        level_pose(blank, virtual_view().camera, LAYOUT)
    small = [np.zeros((240, 320, 3), np.uint8)]
    with pytest.raises(CalibrationError, match="320x240"):
        level_pose(small, virtual_view().camera, LAYOUT)


def test_a_wrong_focal_length_shows_as_distance_not_as_residual():
    """Why the lens is calibrated apart: the level plate alone cannot tell."""
    view = virtual_view()
    matrix = view.camera.matrix.copy()
    matrix[[0, 1], [0, 1]] *= 1.02
    wrong = View(replace(view.camera, matrix=matrix), view.camera_from_plate)
    plate = level_pose(scene_frames(), wrong.camera, LAYOUT)
    assert plate.camera_from_plate[2, 3] == pytest.approx(0.75 * 1.02, rel=2e-3)
    assert plate.residual_mm < 0.1
