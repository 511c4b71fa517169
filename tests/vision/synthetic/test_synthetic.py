"""The rendered picture lies where the view says, to a hundredth of a pixel, and repeats."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from tests.support.poses import tilt
from vision.synthetic.synthetic import DeskBall, Renderer, Scene, virtual_camera, virtual_view

QUIET = Scene(noise_dn=0.0, shadow=0.0)
LEVEL = np.eye(3)


def renderer(scene=QUIET, seed=4, distorted=True):
    return Renderer(scene, virtual_view(virtual_camera(distorted=distorted)), rng(seed))


def rng(seed):
    return np.random.default_rng(seed)


@pytest.fixture(scope="module")
def black_and_pale():
    return tuple(
        renderer(replace(QUIET, plate_bgr=c, desk_bgr=c)) for c in ((0, 0, 0), (215, 215, 215))
    )


def coverage(pair, rotation, xy, **motion):
    """The ball's share of each pixel: what hides the difference of two backgrounds."""
    seen = [r.render(rotation, xy, **motion).astype(float) for r in pair]
    empty = [r.render(rotation, None).astype(float) for r in pair]
    behind = (empty[1] - empty[0]).mean(2)
    return 1 - (seen[1] - seen[0]).mean(2) / np.where(behind < 60, np.inf, behind)


@pytest.mark.parametrize("xy", [(0.0, 0.0), (-0.083, 0.071), (0.0613, -0.0907)])
def test_ball_covers_exactly_its_silhouette(black_and_pale, xy):
    rotation = tilt(0.06, -0.05)
    share = coverage(black_and_pale, rotation, xy)
    u, v, radius = black_and_pale[0].view.tilted(rotation).silhouette_from_ball(xy, 0.019625)
    v0, u0 = round(v) - 40, round(u) - 40
    share = share[v0 : v0 + 81, u0 : u0 + 81]
    rows, columns = np.mgrid[: share.shape[0], : share.shape[1]]
    mass = share.sum()
    assert abs((share * columns).sum() / mass + u0 - u) < 0.01
    assert abs((share * rows).sum() / mass + v0 - v) < 0.01
    assert abs(np.sqrt(mass / np.pi) - radius) < 0.01


def test_edge_lies_on_the_outline_all_around(black_and_pale):
    share = coverage(black_and_pale, tilt(-0.04, 0.07), (0.05, 0.06)).astype(np.float32)
    view = black_and_pale[0].view.tilted(tilt(-0.04, 0.07))
    outline = view.outline_from_ball((0.05, 0.06), 0.019625, np.linspace(0, 2 * np.pi, 90))
    outline = outline.astype(np.float32)
    found = cv2.remap(share, outline[:, 0], outline[:, 1], cv2.INTER_CUBIC).reshape(-1)
    # slope 0.75 a pixel at the middle of the edge: 0.01 px is 0.0075
    assert abs(found.mean() - 0.5) < 0.0075
    assert np.abs(found - 0.5).max() < 0.03  # a single pixel's rounding and cubic interpolation


def test_streak_is_centred_on_mid_exposure(black_and_pale):
    u, v, radius = black_and_pale[0].view.silhouette_from_ball((0.02, 0.03), 0.019625)
    v0, u0 = round(v) - 50, round(u) - 50
    rows, columns = np.mgrid[:101, :101]
    widths = []
    for velocity in ((0.0, 0.0), (0.4, -0.3)):
        share = coverage(
            black_and_pale, LEVEL, (0.02, 0.03), velocity_m_s=velocity, exposure_s=0.008
        )[v0 : v0 + 101, u0 : u0 + 101]
        share /= share.sum()
        assert abs((share * columns).sum() + u0 - u) < 0.015
        assert abs((share * rows).sum() + v0 - v) < 0.015
        widths.append((share * (columns + u0 - u) ** 2).sum())
    path_px = 0.4 * 0.008 * radius / 0.019625
    assert widths[1] - widths[0] == pytest.approx(path_px**2 / 12, rel=0.05)


def test_plate_edge_lies_where_the_view_says(black_and_pale):
    rotation = tilt(0.05, 0.04)
    image = (
        renderer(replace(QUIET, plate_bgr=(200, 200, 200), desk_bgr=(0, 0, 0)))
        .render(rotation, None)[..., 1]
        .astype(np.float32)
    )
    view = black_and_pale[0].view.tilted(rotation)
    for axis in (0, 1):
        for sign in (-1, 1):
            along = np.linspace(-0.09, 0.09, 40)
            ends = []
            for inset in np.linspace(-0.004, 0.004, 81):
                points = np.zeros((40, 3))
                points[:, axis], points[:, 1 - axis] = sign * (0.1375 - inset), along
                uv = view.pixel_from_plate(points).astype(np.float32)
                ends.append(cv2.remap(image, uv[:, 0], uv[:, 1], cv2.INTER_LINEAR).mean())
            bevel = np.interp(0.0, np.linspace(-0.004, 0.004, 81), ends)
            assert bevel == pytest.approx(0.5 * 0.86 * 200, abs=6)  # 6 DN are 0.04 px


def test_same_generator_same_frames_and_noise_of_the_asked_size():
    frames = []
    for _ in range(2):
        r = renderer(Scene(noise_dn=3.0), seed=9)
        frames.append([r.render(LEVEL, (0.01, 0)), r.render(LEVEL, (0.01, 0))])
    assert np.array_equal(frames[0], frames[1])
    difference = frames[0][0].astype(float) - frames[0][1]
    assert np.std(difference) == pytest.approx(3.0 * np.sqrt(2), rel=0.03)
    assert abs(difference.mean()) < 0.02


def test_view_holds_the_whole_ball_over_the_corner_of_the_tilted_plate():
    for s_x, s_y in ((0.0, 0.0), (0.06, -0.06), (0.087, 0), (0, -0.087)):
        uv = virtual_view().tilted(tilt(s_x, s_y)).outline_from_ball((-0.13, 0.13), 0.019625)
        assert uv.min() > 2
        assert uv[:, 0].max() < 637


def test_brightness_scales_and_desk_balls_stay():
    scene = replace(QUIET, desk_balls=(DeskBall((0.2, 0.05), 0.0196, (36, 118, 238)),))
    r = renderer(scene)
    normal, dark = (r.render(LEVEL, None, brightness=b).astype(float) for b in (1.0, 0.25))
    assert np.abs(dark - normal / 4).max() <= 1
    changed = np.abs(normal - renderer().render(LEVEL, None)).max(2) > 20
    rows, columns = np.nonzero(changed)
    assert columns.min() > 520
    assert 1500 < len(rows) < 5000
    moved = r.render(tilt(0.05, 0), None)
    assert np.array_equal(moved[changed], normal[changed].astype(np.uint8))
