"""Outlines against closed forms: their harmonics, the steepness of their edges, their rays."""

import numpy as np
import pytest

from vision.detection.outline import Outline, rays_of, trace_outline

AT, RADIUS, SIDE = (80.3, 75.6), 30.0, 160
DIRECTION = np.array([0.0, 0.0, 1.0])
CONTRAST = 100.0


def disc(
    bumps_px: float = 0.0,
    m: int = 3,
    light: float = 0.0,
    towards: float = 0.0,
    contrast: float = CONTRAST,
) -> np.ndarray:
    """A soft disc of radius RADIUS + bumps_px cos(m t), whose contrast is `contrast` (1 + light
    cos(t - towards)) at its rim; t: the angle about its centre [rad]."""
    v, u = np.mgrid[:SIDE, :SIDE].astype(float)
    du, dv = u - AT[0], v - AT[1]
    r, t = np.hypot(du, dv), np.arctan2(dv, du)
    inside = np.clip(RADIUS + bumps_px * np.cos(m * t) - r + 0.5, 0.0, 1.0)
    lit = 1.0 + light * r / RADIUS * np.cos(t - towards)
    red = 60.0 + contrast * lit * inside
    image = np.full((SIDE, SIDE, 3), 60.0)
    image[..., 2] = red
    return np.round(image).astype(np.uint8)


def traced(image: np.ndarray, *, dense: bool = True) -> Outline:
    line = trace_outline(image, DIRECTION, True, *AT, RADIUS, 0.2, dense=dense)
    assert line is not None
    return line


@pytest.mark.parametrize("dense", [True, False])
def test_a_clean_disc_lacks_nothing(dense: bool):
    line = traced(disc(), dense=dense)
    assert (line.u_px, line.v_px, line.radius_px) == pytest.approx((*AT, RADIUS), abs=0.02)
    assert line.lack_px2 < 0.01**2
    assert (line.share, line.coverage, line.framed) == (1.0, 1.0, 1.0)
    assert np.hypot(line.tilt_u, line.tilt_v) * CONTRAST < 0.02


@pytest.mark.parametrize("m", [3, 4])
@pytest.mark.parametrize("bumps_px", [0.2, 0.4])
def test_the_lack_is_the_power_of_the_third_and_fourth_harmonics(bumps_px: float, m: int):
    """Per component of each: a^2/4 of a cos(m t), which moves no centre."""
    line = traced(disc(bumps_px, m))
    assert line.lack_px2 == pytest.approx(bumps_px**2 / 4.0, rel=0.15)
    assert (line.u_px, line.v_px) == pytest.approx(AT, abs=0.03)


@pytest.mark.parametrize("m", [6, 9])
def test_higher_harmonics_are_scatter_and_no_lack(m: int):
    line = traced(disc(0.3, m))
    assert line.lack_px2 < 0.02**2
    assert line.residual_px == pytest.approx(0.3 / np.sqrt(2.0), rel=0.15)


@pytest.mark.parametrize("towards", [0.0, 0.5 * np.pi, np.pi, 4.0])
def test_the_tilt_points_at_the_light_and_is_its_share_of_the_steepness(towards: float):
    """Steepness s (1 + b cos(t - t0)) has the first harmonic b s, b/s over its square."""

    def tilt(light: float, contrast: float) -> np.ndarray:
        line = traced(disc(light=light, towards=towards, contrast=contrast))
        return np.array((line.tilt_u, line.tilt_v))

    at = tilt(0.3, 100.0)
    assert at / np.hypot(*at) == pytest.approx((np.cos(towards), np.sin(towards)), abs=0.1)
    assert tilt(0.15, 100.0) == pytest.approx(0.5 * at, abs=0.05 * np.hypot(*at))
    assert tilt(0.3, 50.0) == pytest.approx(2.0 * at, abs=0.2 * np.hypot(*at))


@pytest.mark.parametrize("dense", [True, False])
def test_rays_come_in_whole_eighths_and_no_more_than_pixels_tell(dense: bool):
    radii = np.geomspace(2.0, 200.0, 60)
    counts = np.array([rays_of(r, dense) for r in radii])
    assert (counts % 8 == 0).all()
    assert (np.diff(counts) >= 0).all()
    assert (counts[0], counts[-1]) == ((24, 480) if dense else (24, 72))
    between = (counts > 24) & (counts < counts[-1])
    pixels = 2.0 * np.pi * radii / (1.0 if dense else 2.0)
    assert (np.abs(counts - pixels)[between] <= 8).all()
