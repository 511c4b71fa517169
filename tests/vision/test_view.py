"""Laws of the view: round trips, an independent outline, OpenCV's own projection, covariances."""

from math import radians, sin

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.poses import tilt
from vision.view import Camera, View

RADIUS_M = 0.019625
LENSES = {"ideal": (0, 0, 0, 0, 0), "mild": (-0.12, 0.05, 4e-4, -3e-4, 0.01)}


def camera(lens="ideal"):
    matrix = np.array([[1095.0, 0, 322.0], [0, 1093.0, 238.0], [0, 0, 1]])
    return Camera(matrix, np.array(LENSES[lens], float), 640, 480)


def view(lens="ideal", s_x=0.0, s_y=0.0):
    pose = np.eye(4)
    pose[:3, :3] = np.diag([1.0, -1.0, -1.0]) @ cv2.Rodrigues(np.array([0.02, -0.03, 0.015]))[0]
    pose[:3, 3] = 0.003, -0.002, 0.75
    return View(camera(lens), pose).tilted(tilt(s_x, s_y))


places = st.floats(-0.135, 0.135)
tilts = st.floats(-sin(radians(6)), sin(radians(6)))
lenses = st.sampled_from(sorted(LENSES))


@given(places, places, tilts, tilts, lenses)
def test_ball_comes_back_from_its_silhouette(x, y, s_x, s_y, lens):
    eye = view(lens, s_x, s_y)
    u, v, _ = eye.silhouette_from_ball((x, y), RADIUS_M)
    xy, _ = eye.ball_from_silhouette((u, v), RADIUS_M, 0.05)
    assert np.abs(xy - (x, y)).max() < (1e-12 if lens == "ideal" else 1e-7)


@given(places, places, st.floats(-0.02, 0.05), tilts, tilts, lenses)
def test_plate_points_come_back_from_pixels(x, y, height, s_x, s_y, lens):
    eye = view(lens, s_x, s_y)
    uv = eye.pixel_from_plate(np.array([[x, y, height]]))
    assert np.abs(eye.plate_from_pixel(uv, height) - (x, y)).max() < 1e-9


@settings(max_examples=25)
@given(places, places, tilts, tilts)
def test_outline_is_where_rays_graze_the_sphere(x, y, s_x, s_y):
    """Independent of the closed form: the extremes over all points of the sphere's surface."""
    eye = view("ideal", s_x, s_y)
    C = np.array([x, y, RADIUS_M])
    eye_plate = -eye.camera_from_plate[:3, :3].T @ eye.camera_from_plate[:3, 3]
    towards = eye_plate - C
    away = np.linalg.norm(towards)
    e3 = towards / away
    e1 = np.cross(e3, [1.0, 0, 0])
    e1 /= np.linalg.norm(e1)
    e2 = np.cross(e3, e1)
    t = np.linspace(0, 2 * np.pi, 400, endpoint=False)[:, None]
    ring = RADIUS_M * np.sqrt(1 - (RADIUS_M / away) ** 2)  # tangent points: a circle, not the
    rim = C + RADIUS_M**2 / away * e3 + ring * (np.cos(t) * e1 + np.sin(t) * e2)  # equator
    uv = eye.pixel_from_plate(rim)
    conic = np.column_stack((uv**2, uv[:, :1] * uv[:, 1:], uv)) / [1e5, 1e5, 1e5, 1e2, 1e2]
    A, B, H, D, E = np.linalg.lstsq(conic, np.ones(len(uv)), rcond=None)[0] / [
        1e5,
        1e5,
        1e5,
        1e2,
        1e2,
    ]
    centre = np.linalg.solve([[2 * A, H], [H, 2 * B]], [-D, -E])
    area = 0.5 * abs(np.sum(uv[:, 0] * np.roll(uv[:, 1], -1) - uv[:, 1] * np.roll(uv[:, 0], -1)))
    u, v, radius = eye.silhouette_from_ball((x, y), RADIUS_M)
    assert np.abs(centre - (u, v)).max() < 1e-5
    assert abs(np.sqrt(area / np.pi) - radius) < 3e-3  # 400-gon against circle: 1.2e-3
    outline = eye.outline_from_ball((x, y), RADIUS_M)
    value = A * outline[:, 0] ** 2 + B * outline[:, 1] ** 2 + H * outline[:, 0] * outline[:, 1]
    assert np.abs(value + outline @ [D, E] - 1).max() < 1e-6


def test_distorted_outline_centre_is_that_of_a_fitted_circle():
    eye = view("mild", 0.05, -0.06)
    uv = eye.outline_from_ball((-0.12, 0.11), RADIUS_M, np.linspace(0, 2 * np.pi, 720)[:-1])
    (u, v, radius) = (*uv.mean(0), 30.0)
    for _ in range(20):  # geometric circle fit
        away = uv - (u, v)
        r = np.hypot(*away.T)
        step = np.linalg.lstsq(
            np.column_stack((away / r[:, None], np.ones(len(r)))), r - radius, rcond=None
        )[0]
        u, v, radius = np.array((u, v, radius)) + step
    assert np.allclose(eye.silhouette_from_ball((-0.12, 0.11), RADIUS_M), (u, v, radius), atol=3e-3)


def test_projection_agrees_with_opencv():
    eye = view("mild", 0.03, 0.05)
    points = np.random.default_rng(1).uniform(-0.14, 0.14, (50, 3))
    R, t = eye.camera_from_plate[:3, :3], eye.camera_from_plate[:3, 3]
    theirs, _ = cv2.projectPoints(
        points, cv2.Rodrigues(R)[0], t, eye.camera.matrix, eye.camera.distortion
    )
    assert np.abs(np.asarray(theirs).reshape(-1, 2) - eye.pixel_from_plate(points)).max() < 1e-9


def test_centre_of_the_outline_is_not_the_image_of_the_centre():
    eye = view()
    u, v, _ = eye.silhouette_from_ball((-0.13, 0.13), RADIUS_M)
    plain = eye.pixel_from_plate(np.array([[-0.13, 0.13, RADIUS_M]]))[0]
    assert 0.1 < np.hypot(u - plain[0], v - plain[1]) < 0.4


@pytest.mark.parametrize("lens", sorted(LENSES))
def test_covariance_is_the_spread_of_many_noisy_pixels_and_poses(lens):
    rng = np.random.default_rng(3)
    A = rng.normal(size=(6, 6))
    cov = A @ A.T
    scale = np.array([2e-4] * 3 + [1e-4] * 3) / np.sqrt(np.diag(cov))
    cov *= np.outer(scale, scale)
    eye = view(lens, -0.04, 0.06)
    eye = View(eye.camera, eye.camera_from_plate, cov)
    u, v, _ = eye.silhouette_from_ball((-0.1, 0.07), RADIUS_M)
    _, predicted = eye.ball_from_silhouette((u, v), RADIUS_M, 0.2)
    seen = []
    for uv, moved in zip(
        rng.normal((u, v), 0.2, (4000, 2)),
        rng.multivariate_normal(np.zeros(6), cov, 4000),
        strict=True,
    ):
        pose = eye.camera_from_plate.copy()
        pose[:3, :3] = cv2.Rodrigues(moved[:3])[0] @ pose[:3, :3]
        pose[:3, 3] += moved[3:]
        seen.append(View(eye.camera, pose).ball_from_silhouette(uv, RADIUS_M)[0])
    ratio = np.linalg.eigvals(np.linalg.solve(predicted, np.cov(np.array(seen).T)))
    assert np.all((ratio > 0.9) & (ratio < 1.1))


def test_refuses_rays_that_miss_the_plate():
    pose = np.eye(4)
    pose[:3, 3] = 0, 0, -0.7
    with pytest.raises(ValueError, match="check the plate pose"):
        View(camera(), pose).ball_from_silhouette((320, 240), RADIUS_M)
    with pytest.raises(ValueError, match="check the plate pose"):
        View(camera(), pose).plate_from_pixel(np.array([[320.0, 240.0]]))
    with pytest.raises(ValueError, match="in front of the camera"):
        View(camera(), pose).silhouette_from_ball((0, 0), RADIUS_M)
    with pytest.raises(ValueError, match="focal"):
        Camera(np.zeros((3, 3)), np.zeros(5), 640, 480)
