"""Streaks, and polished balls that mirror the plate, against the ray tracer's truth."""

from dataclasses import replace

import numpy as np
import pytest

from tests.benchmarks.vision.scenes import SHADED, Studio
from vision.detection.appearance import Appearance
from vision.detection.detector import locate_ball
from vision.detection.streaks_and_mirrors import locate_streak, mirror_silhouette


@pytest.mark.parametrize("plate", ["pale", "textured"])
def test_polished_ball_is_its_silhouette_and_not_the_picture_in_it(plate):
    shot = Studio(replace(SHADED, ball="steel", plate=plate)).shot((0.05, 0.06))
    u, v, r = shot.u_px, shot.v_px, shot.radius_px
    appearance = Appearance.sketch(shot.image, u, v, 0.8 * r)
    inner = locate_ball(shot.image, appearance, u, v, 0.8 * r)
    assert inner is not None
    assert inner.radius_px < 0.9 * r  # the picture of the room, some px beside the ball's centre
    whole = mirror_silhouette(shot.image, appearance, inner)
    assert whole is not None
    assert whole.radius_px == pytest.approx(r, rel=0.03)
    assert np.hypot(whole.u_px - u, whole.v_px - v) < 3.0 * whole.sigma_px < 4.5


def test_nothing_surrounds_a_painted_ball():
    shot = Studio(SHADED).shot((0.02, -0.03))
    appearance = Appearance.learn(shot.image, shot.u_px, shot.v_px, shot.radius_px)
    found = locate_ball(shot.image, appearance, shot.u_px, shot.v_px, shot.radius_px)
    assert found is not None
    assert mirror_silhouette(shot.image, appearance, found) is None


def test_middle_of_a_streak_is_found():
    studio = Studio(SHADED)
    still = studio.shot((0.0, 0.0))
    appearance = Appearance.learn(still.image, still.u_px, still.v_px, still.radius_px)
    studio.look = replace(SHADED, exposure_s=0.0333)
    shot = studio.shot((0.01, 0.02), (0.6, 0.5))  # 39 px
    found = locate_streak(shot.image, appearance, shot.u_px + 4.0, shot.v_px - 3.0, shot.radius_px)
    assert found is not None
    assert np.hypot(found.u_px - shot.u_px, found.v_px - shot.v_px) < 4.0 * found.sigma_px < 12.0


def test_small_ball_has_no_smaller_image():
    image = np.zeros((60, 60, 3), np.uint8)
    assert locate_streak(image, Appearance.of_colour("orange"), 30.0, 30.0, 10.0) is None
