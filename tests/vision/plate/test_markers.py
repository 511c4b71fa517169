"""The plate's pose from its markers: exact, honest about its error, refused when wrong."""

import cv2
import numpy as np
import pytest

from tests.support.poses import tilt
from vision.plate.edges import cut_edges
from vision.plate.markers import MarkerLayout, default_layout, detect, find_pose, track_pose
from vision.synthetic.synthetic import Renderer, Scene, virtual_view

RADIUS_M = 0.019625
CORNER = (-0.13, 0.13)


@pytest.fixture(scope="module")
def renderer():
    return Renderer(Scene(), virtual_view(), np.random.default_rng(5))


def cases(renderer, count=25, ball=None, guess_error=0.01, **light):
    """Rendered frames at random tilts: (truth, fit) pairs."""
    rng = np.random.default_rng(11)
    layout = renderer.scene.layout
    for _ in range(count):
        s = rng.uniform(-0.06, 0.06, 2)
        truth = renderer.view.tilted(tilt(*s))
        guess = renderer.view.tilted(tilt(*(s + rng.uniform(-1, 1, 2) * guess_error)))
        image = renderer.render(tilt(*s), ball, **light)
        yield truth, track_pose(image, layout, guess)


def tilt_error_deg(a, b):
    turn = a.camera_from_plate[:3, :3].T @ b.camera_from_plate[:3, :3]
    return np.degrees(np.hypot(turn[0, 2], turn[1, 2]))


def corner_errors(truth, fit, layout):
    points = np.column_stack(
        (layout.corners_m.reshape(-1, 2), np.zeros(layout.corners_m.size // 2))
    )
    return fit.view.pixel_from_plate(points) - truth.pixel_from_plate(points)


@pytest.mark.parametrize(
    ("ball", "light", "limit_deg"),
    [
        (None, {}, 0.02),
        (CORNER, {}, 0.025),
        ((0.12, 0.0), {}, 0.025),
        (None, {"brightness": 0.25}, 0.05),
    ],
)
def test_pose_is_exact_to_hundredths_of_a_degree_and_of_a_pixel(renderer, ball, light, limit_deg):
    pairs = list(cases(renderer, ball=ball, **light))
    assert all(fit.accepted for _, fit in pairs)
    errors = [tilt_error_deg(truth, fit.view) for truth, fit in pairs]
    assert np.sqrt(np.mean(np.square(errors))) < limit_deg
    px = np.array([corner_errors(t, f, renderer.scene.layout) for t, f in pairs])
    assert np.abs(px.mean(axis=0)).max() < 0.02  # bias of any corner
    if ball is not None:
        assert np.mean([fit.n_corners for _, fit in pairs]) < 31


def test_stated_covariance_is_the_true_spread(renderer):
    scores = []
    for truth, fit in cases(renderer, 60):
        a, b = truth.camera_from_plate, fit.view.camera_from_plate
        turn = np.asarray(cv2.Rodrigues(a[:3, :3] @ b[:3, :3].T)[0]).ravel()
        error = np.concatenate((turn, a[:3, 3] - b[:3, 3]))
        assert fit.view.pose_cov is not None
        scores.append(error @ np.linalg.solve(fit.view.pose_cov, error) / 6)
    assert 0.6 < np.mean(scores) < 1.6


def test_a_level_guess_reaches_a_plate_at_five_degrees(renderer):
    for s in ((0.087, 0.0), (0.06, -0.06), (0.0, -0.087)):
        image = renderer.render(tilt(*s), (0.02, 0.01))
        fit = track_pose(image, renderer.scene.layout, renderer.view)
        assert fit.accepted
        assert tilt_error_deg(fit.view, renderer.view.tilted(tilt(*s))) < 0.05


def test_refuses_what_is_not_there_and_returns_the_guess(renderer):
    layout, guess = renderer.scene.layout, renderer.view
    noise = np.random.default_rng(2).integers(0, 255, (480, 640, 3)).astype(np.uint8)
    plain = np.full((480, 640, 3), 128, np.uint8)
    shifted = np.roll(renderer.render(np.eye(3), None), 25, axis=1)
    hand = renderer.render(np.eye(3), None)
    hand[:, :480] = 140
    for image in (noise, plain, shifted, hand):
        fit = track_pose(image, layout, guess)
        assert not fit.accepted
        assert fit.n_corners == 0
        assert fit.view is guess


def test_never_accepts_a_wrong_pose_from_a_wrong_guess(renderer):
    rng = np.random.default_rng(8)
    image = renderer.render(np.eye(3), (0.05, 0.05))
    for _ in range(60):
        pose = renderer.view.camera_from_plate.copy()
        pose[:3, :3] = np.asarray(cv2.Rodrigues(rng.normal(0, 0.06, 3))[0]) @ pose[:3, :3]
        pose[:3, 3] += rng.normal(0, 0.012, 3)
        guess = type(renderer.view)(renderer.view.camera, pose)
        fit = track_pose(image, renderer.scene.layout, guess)
        if fit.accepted:
            assert tilt_error_deg(fit.view, renderer.view) < 0.1
            assert np.abs(corner_errors(renderer.view, fit, renderer.scene.layout)).max() < 0.1


@pytest.mark.parametrize("distance_m", [0.72, 0.85, 1.0])
def test_finds_the_plate_without_a_guess(renderer, distance_m):
    pose = virtual_view().camera_from_plate.copy()
    pose[2, 3] = distance_m
    view = type(renderer.view)(renderer.view.camera, pose)
    drawn = Renderer(Scene(), view, np.random.default_rng(1))
    fit = find_pose(drawn.render(tilt(0.05, -0.04), CORNER), drawn.scene.layout, view.camera)
    assert fit is not None
    assert tilt_error_deg(fit.view, view.tilted(tilt(0.05, -0.04))) < 0.06
    assert find_pose(np.full((480, 640, 3), 99, np.uint8), drawn.scene.layout, view.camera) is None


def test_detects_every_marker_and_only_those_of_the_layout(renderer):
    layout = renderer.scene.layout
    image = renderer.render(tilt(0.03, 0.03), None)
    found = detect(image, layout)
    assert sorted(found.ids) == list(range(8))
    rows = [int(np.flatnonzero(layout.ids == i)[0]) for i in found.ids]
    points = np.column_stack((layout.corners_m[rows].reshape(-1, 2), np.zeros(32)))
    truth = renderer.view.tilted(tilt(0.03, 0.03)).pixel_from_plate(points)
    assert np.abs(found.corners_px.reshape(-1, 2) - truth).max() < 0.5
    half = MarkerLayout(layout.ids[:4], layout.corners_m[:4])
    assert sorted(detect(image, half).ids) == [0, 1, 2, 3]


def test_layout_leaves_the_middle_free_and_rejects_nonsense():
    layout = default_layout(0.275)
    assert np.abs(layout.corners_m).max() < 0.1375 - 0.0049
    assert np.abs(layout.corners_m).max(axis=2).min() > 0.1
    with pytest.raises(ValueError, match="no room"):
        default_layout(0.08)
    with pytest.raises(ValueError, match="must differ"):
        MarkerLayout(np.array([1, 1]), np.zeros((2, 4, 2)))
    with pytest.raises(ValueError, match="no marker dictionary"):
        MarkerLayout(np.array([1]), np.zeros((1, 4, 2)), "DICT_9X9")


@pytest.mark.parametrize("length", [0.0, np.nan, np.inf])
def test_an_edge_without_a_direction_is_not_seen(renderer, length):
    """The compiled cuts read beyond the image along a direction that is no number."""
    points, along = np.array([[0.0, 0.0], [0.02, 0.0]]), np.array([[1.0, 0.0], [length, 0.0]])
    image = renderer.render(np.eye(3), None)
    with np.errstate(invalid="ignore", divide="ignore"):
        offset, contrast, jacobian = cut_edges(
            image, points, along, virtual_view(), 6, 3, (0.0, 0.0, 0.0)
        )
    assert (offset[1], contrast[1]) == (0.0, 0.0)
    assert (jacobian[1] == 0.0).all()
