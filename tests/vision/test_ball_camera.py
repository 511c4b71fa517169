"""From rendered frames to metres: exact, never locked on the wrong ball, silent when unsure."""

from dataclasses import replace

import numpy as np
import pytest

from tests.support.poses import tilt
from vision.ball_camera import BallCamera, ball_mask, radius_range
from vision.detection.appearance import Appearance
from vision.frames import Frame, Track
from vision.synthetic.synthetic import DeskBall, Renderer, Scene, virtual_view

RADIUS_M, SIDE_M = 0.019625, 0.275
MAX_TILT_RAD = 0.105
DECOY = DeskBall((0.19, 0.12), 0.0196, Scene().ball_bgr)
NEAR_DECOY = DeskBall((-0.17, 0.17), 0.0196, Scene().ball_bgr)


def circle(t):
    return 0.09 * np.array([np.cos(0.5 / 0.09 * t), np.sin(0.5 / 0.09 * t)])  # 0.5 m/s


def release(t):
    """Held over the corner for 0.3 s, then rolling to the middle at up to 0.4 m/s."""
    t = max(t - 0.3, 0.0)
    return np.array([-0.13, 0.13]) * np.cos(2.2 * t) * np.exp(-0.3 * t)


def swing(t):
    return 0.06 * np.sin(5.0 * t), 0.06 * np.sin(6.1 * t + 1.0)


def run(path, *, decoys=(), appearance=None, frames=100, **light):
    """(errors (n, 2) in m, normalised squared errors, states) over frames at 60 Hz."""
    scene = Scene(desk_balls=decoys)
    renderer = Renderer(scene, virtual_view(), np.random.default_rng(3))
    eye = BallCamera.over_plate(
        renderer.view, scene.layout, RADIUS_M, SIDE_M, MAX_TILT_RAD, appearance=appearance
    )
    errors, scores, states = [], [], []
    for k in range(frames):
        t = k / 60
        xy, ahead = path(t), path(t + 1e-4)
        image = renderer.render(
            tilt(*swing(t)), xy, velocity_m_s=(ahead - xy) / 1e-4, exposure_s=0.004, **light
        )
        hint = tilt(*(np.array(swing(t)) + 0.004 * np.sign(np.cos(5 * t))))  # play hides 0.23 deg
        seen, track, _ = eye.step(Frame(image, t, k), hint)
        states.append(track.state)
        if seen is not None:
            assert seen.exposed_s == t
            xx, cross, yy = seen.cov_m2
            error = np.array(seen.xy_m) - xy
            errors.append(error)
            scores.append(error @ np.linalg.solve([[xx, cross], [cross, yy]], error) / 2)
    return np.array(errors), np.array(scores), states


def every_way():
    """Path, decoys and colour in every combination; every pair of them is in one that is quick."""
    for i, path in enumerate((circle, release)):
        for j, decoys in enumerate(((), (DECOY,), (NEAR_DECOY,))):
            for k, colour in enumerate(("orange", None)):
                marks = pytest.mark.slow if (i + j + k) % 2 else ()
                yield pytest.param(path, decoys, colour, marks=marks)


@pytest.mark.parametrize(("path", "decoys", "colour"), [*every_way()])
def test_ball_is_seen_to_hundredths_of_a_millimetre(path, decoys, colour):
    appearance = None if colour is None else Appearance.of_colour(colour)
    errors, scores, states = run(path, decoys=decoys, appearance=appearance, frames=80)
    assert len(errors) > 50
    assert np.abs(errors).max() < 0.0003  # no wrong lock, no slip
    assert np.sqrt(np.mean(errors**2, axis=0)).max() < 0.00005
    assert np.median(scores) < 5  # the covariance is honest within a factor of two or so
    assert states.count("coast") + states.count("lost") <= 2


def test_dim_light_costs_little():
    errors, _, _ = run(circle, appearance=Appearance.of_colour("orange"), brightness=0.25)
    assert len(errors) > 90
    assert np.sqrt(np.mean(errors**2, axis=0)).max() < 0.0001


def test_a_decoy_on_the_desk_is_never_the_ball_when_there_is_none():
    scene = Scene(desk_balls=(NEAR_DECOY,))
    renderer = Renderer(scene, virtual_view(), np.random.default_rng(3))
    appearance = Appearance.of_colour("orange")
    eye = BallCamera.over_plate(
        renderer.view, scene.layout, RADIUS_M, SIDE_M, MAX_TILT_RAD, appearance=appearance
    )
    for k in range(40):
        rotation = tilt(*swing(k / 60))
        seen, _, _ = eye.step(Frame(renderer.render(rotation, None), k / 60, k), rotation)
        assert seen is None


class Says:
    """A tracker that says what it is told."""

    def __init__(self, track):
        self.track = track

    def step(self, frame):
        return self.track


def camera_that_hears(track, view, layout):
    return BallCamera(view, layout, Says(track), RADIUS_M, plate_side_m=SIDE_M)  # type: ignore[arg-type]


def test_no_observation_without_a_measurement_or_off_the_plate():
    scene = Scene()
    renderer = Renderer(scene, virtual_view(), np.random.default_rng(0))
    frame = Frame(renderer.render(np.eye(3), None), 0.0, 0)
    for state in ("search", "coast", "lost"):
        track = Track(state) if state != "coast" else Track("coast", 300.0, 240.0, 5.0, 30.0)
        eye = camera_that_hears(track, renderer.view, scene.layout)
        assert eye.step(frame, np.eye(3))[0] is None
    off = Track("track", 590.0, 240.0, 0.02, 28.0)
    assert camera_that_hears(off, renderer.view, scene.layout).step(frame, np.eye(3))[0] is None
    on = Track("track", 330.0, 250.0, 0.02, 29.0)
    seen, track, view = camera_that_hears(on, renderer.view, scene.layout).step(frame, np.eye(3))
    assert seen is not None
    assert track is on
    assert view.pose_cov is not None


def test_hidden_markers_fall_back_on_the_encoders_with_an_honest_covariance():
    scene = Scene()
    renderer = Renderer(scene, virtual_view(), np.random.default_rng(0))
    u, v, radius = renderer.view.tilted(tilt(0.05, 0.0)).silhouette_from_ball((0.08, 0.0), RADIUS_M)
    eye = camera_that_hears(Track("track", u, v, 0.02, radius), renderer.view, scene.layout)
    blind = Frame(np.full((480, 640, 3), 90, np.uint8), 0.0, 0)
    seen, _, _ = eye.step(blind, tilt(0.047, 0.002))
    assert seen is not None
    assert not eye.pose.accepted
    std = np.sqrt([seen.cov_m2[0], seen.cov_m2[2]])
    assert np.all(std > 1e-4)
    assert np.all(np.abs(np.array(seen.xy_m) - (0.08, 0.0)) < 4 * std)


def test_finds_the_plate_again_after_the_camera_was_knocked():
    scene = Scene()
    renderer = Renderer(scene, virtual_view(), np.random.default_rng(0))
    knocked = renderer.view.camera_from_plate.copy()
    knocked[:3, 3] += (0.012, -0.006, 0.0)
    moved = Renderer(
        scene, replace(renderer.view, camera_from_plate=knocked), np.random.default_rng(0)
    )
    u, v, radius = moved.view.silhouette_from_ball((0.03, 0.04), RADIUS_M)
    eye = camera_that_hears(Track("track", u, v, 0.02, radius), renderer.view, scene.layout)
    frame = Frame(moved.render(np.eye(3), (0.03, 0.04)), 0.0, 0)
    assert np.isnan(eye.drift_m)
    seen = [eye.step(frame, np.eye(3))[0] for _ in range(5)]
    assert abs(eye.drift_m - np.hypot(0.012, 0.006)) < 2e-4
    assert eye.pose.accepted
    last = seen[-1]
    assert last is not None
    assert np.abs(np.array(last.xy_m) - (0.03, 0.04)).max() < 5e-5


def test_geometry_bounds_the_ball():
    view = virtual_view()
    low, high = radius_range(view, RADIUS_M, SIDE_M, MAX_TILT_RAD)
    mask = ball_mask(view, RADIUS_M, SIDE_M, MAX_TILT_RAD)
    rng = np.random.default_rng(1)
    for _ in range(50):
        eye = view.tilted(tilt(*rng.uniform(-0.07, 0.07, 2)))
        xy = rng.uniform(-0.1375, 0.1375, 2)
        assert low < eye.silhouette_from_ball(xy, RADIUS_M)[2] < high
        for u, v in np.rint(eye.outline_from_ball(xy, RADIUS_M)).astype(int):
            assert not (0 <= u < 640 and 0 <= v < 480) or mask[v, u] == 255
    assert mask[240, 5] == 0
    assert mask[240, 635] == 0
