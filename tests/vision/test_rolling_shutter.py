"""A ball that rolls past a camera which exposes row after row is where it was, when it was."""

from dataclasses import replace

import numpy as np
import pytest

from tests.support.rolling_shutter import rolling_picture
from vision.ball_camera import BallCamera
from vision.frames import Frame
from vision.synthetic.synthetic import Renderer, Scene, virtual_view
from vision.tracking.tracker import Tracker

READOUT_S = 0.016
FRAME_S = 1 / 60


def errors_mm(readout_s: float, velocity: tuple[float, float], told_s: float) -> np.ndarray:
    """Distance [mm] (n,) of what is seen from where the ball was at the moment it is dated."""
    scene, level = Scene(), virtual_view()
    renderer = Renderer(scene, level, np.random.default_rng(5))
    way = np.array(velocity)
    start = -0.09 * way / np.linalg.norm(way)

    def motion(t_s: float):
        return np.eye(3), start + way * t_s, way

    view = replace(level, camera=replace(level.camera, readout_s=told_s))
    u, v, radius = view.silhouette_from_ball(start, scene.ball_radius_m)
    tracker = Tracker(ball_at=(u, v, radius))
    camera = BallCamera(view, scene.layout, tracker, scene.ball_radius_m)
    found = []
    for k in range(int(0.18 / np.linalg.norm(way) / FRAME_S)):
        t_s = k * FRAME_S
        u, v, radius = level.silhouette_from_ball(motion(t_s)[1], scene.ball_radius_m)
        near = v - radius - 30, v + radius + 30
        image = rolling_picture(renderer, motion, t_s, readout_s, band_px=4, rows=near)
        seen, _, _ = camera.step(Frame(image, t_s, k), np.eye(3))
        if seen is not None:
            found.append(1e3 * np.linalg.norm(seen.xy_m - (start + way * seen.exposed_s)))
    assert len(found) >= 8
    return np.array(found)


@pytest.mark.parametrize("velocity", [(0.5, 0.0), (0.0, 0.5), (0.35, -0.35)])
def test_half_a_metre_a_second_is_seen_within_a_fifth_of_a_millimetre(velocity):
    assert np.quantile(errors_mm(READOUT_S, velocity, READOUT_S), 0.95) < 0.2


def test_what_is_not_told_is_millimetres():
    assert errors_mm(READOUT_S, (0.0, 0.5), 0.0).max() > 2.0


def test_a_global_shutter_has_no_rows():
    assert virtual_view().camera.row_s(0.0) == 0.0
    camera = replace(virtual_view().camera, readout_s=READOUT_S)
    assert camera.row_s(-0.5) == -READOUT_S / 2
    assert camera.row_s(camera.height_px - 0.5) == pytest.approx(READOUT_S / 2)
