"""Streaks, and polished balls that mirror the plate, against the ray tracer's truth."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))

from vision_scenes import SHADED, Studio  # pyright: ignore[reportMissingImports]

from vision.appearance import Appearance
from vision.detector import locate
from vision.unusual import locate_streak, surround


@pytest.mark.parametrize("plate", ["pale", "textured"])
def test_polished_ball_is_its_silhouette_and_not_the_picture_in_it(plate):
    shot = Studio(replace(SHADED, ball="steel", plate=plate)).shot((0.05, 0.06))
    u, v, r = shot.u_px, shot.v_px, shot.radius_px
    looks = Appearance.sketch(shot.image, u, v, 0.8 * r)
    inner = locate(shot.image, looks, u, v, 0.8 * r)
    assert inner is not None
    assert inner.radius_px < 0.9 * r  # the picture of the room, some px beside the ball's centre
    whole = surround(shot.image, looks, inner)
    assert whole is not None
    assert whole.radius_px == pytest.approx(r, rel=0.03)
    assert np.hypot(whole.u_px - u, whole.v_px - v) < 3.0 * whole.sigma_px < 4.5


def test_nothing_surrounds_a_painted_ball():
    shot = Studio(SHADED).shot((0.02, -0.03))
    looks = Appearance.learn(shot.image, shot.u_px, shot.v_px, shot.radius_px)
    found = locate(shot.image, looks, shot.u_px, shot.v_px, shot.radius_px)
    assert found is not None
    assert surround(shot.image, looks, found) is None


def test_middle_of_a_streak_is_found():
    studio = Studio(SHADED)
    still = studio.shot((0.0, 0.0))
    looks = Appearance.learn(still.image, still.u_px, still.v_px, still.radius_px)
    studio.look = replace(SHADED, exposure_s=0.0333)
    shot = studio.shot((0.01, 0.02), (0.6, 0.5))  # 39 px
    found = locate_streak(shot.image, looks, shot.u_px + 4.0, shot.v_px - 3.0, shot.radius_px)
    assert found is not None
    assert np.hypot(found.u_px - shot.u_px, found.v_px - shot.v_px) < 4.0 * found.sigma_px < 12.0


def test_small_ball_has_no_smaller_image():
    image = np.zeros((60, 60, 3), np.uint8)
    assert locate_streak(image, Appearance.of_colour("orange"), 30.0, 30.0, 10.0) is None
