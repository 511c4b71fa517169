"""Where is a ball whose strongest outline is not its own?

Two kinds: a ball smeared to a streak by its motion, and a polished one, in which the strongest
outline is that of the room's image.
"""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np

from vision.detection.appearance import Appearance
from vision.detection.detector import REACH, WHOLE, Detection, locate_ball
from vision.detection.outline import trace_outer_ring

# Of a streak: the ball's radius in the smaller image, and the share of the radius by which light
# from one side moves the middle between ramps that wide.
STREAK_RADIUS_PX, STREAK_SHARE = 8.0, 0.02
RING_SHARE = 0.03  # of the radius: sigma of a mirroring ball's rim, whose two sides are alike


def locate_streak(
    image: np.ndarray, appearance: Appearance, u_px: float, v_px: float, radius_px: float
) -> Detection | None:
    """The disc near a guess [px], for a ball that moved by up to its diameter while exposed; None
    where the ball is too small for it or its outline is not whole.

    `image` (h, w, 3) uint8 BGR. Half-way up its ramps a streak shorter than the ball is as round as
    the ball, and its middle is the place at mid exposure; in an image some radii / 8 times smaller
    the ramps are edges again, and `locate_ball` finds them.
    """
    step = int(radius_px / STREAK_RADIUS_PX)
    found = None
    if step >= 2:
        found = locate_shrunk(image, appearance, u_px, v_px, radius_px, step)
    if found is None or found.inliers < WHOLE or found.coverage < 1.0:
        return None
    return replace(found, sigma_px=math.hypot(found.sigma_px, STREAK_SHARE * radius_px))


def locate_shrunk(
    image: np.ndarray,
    appearance: Appearance,
    u_px: float,
    v_px: float,
    radius_px: float,
    step: int,
    *,
    polish: bool = True,
) -> Detection | None:
    """`locate_ball` in an image `step` times smaller, for a large or a soft disc; all in px of the
    whole image."""
    if step < 2:
        return locate_ball(image, appearance, u_px, v_px, radius_px, polish=polish)
    reach = (1.0 + REACH) * radius_px + 4 * step
    x0, y0 = max(0, int(u_px - reach)), max(0, int(v_px - reach))
    window = image[y0 : max(0, int(v_px + reach)), x0 : max(0, int(u_px + reach))]
    h, w = window.shape[0] // step, window.shape[1] // step
    if min(h, w) < radius_px / step:
        return None
    small = np.asarray(
        cv2.resize(window[: h * step, : w * step], (w, h), interpolation=cv2.INTER_AREA)
    )
    at = ((u_px - x0 + 0.5) / step - 0.5, (v_px - y0 + 0.5) / step - 0.5)
    found = locate_ball(small, appearance, *at, radius_px / step, polish=polish)
    if found is None:
        return None
    return replace(
        found,
        u_px=step * (found.u_px + 0.5) - 0.5 + x0,
        v_px=step * (found.v_px + 0.5) - 0.5 + y0,
        radius_px=step * found.radius_px,
        sigma_px=step * found.sigma_px,
        residual_px=step * found.residual_px,
    )


def mirror_silhouette(
    image: np.ndarray, appearance: Appearance, found: Detection
) -> Detection | None:
    """The silhouette of a mirroring ball about the inner outline `found`.

    Polished balls mirror the plate in a ring about the image of the room; the ring's outer edge is
    the silhouette. None where no outer edge is consistent round most of the turn.
    """
    inner = float(found.u_px), float(found.v_px), float(found.radius_px)
    u, v, radius, share = trace_outer_ring(image, *inner, appearance.direction).tolist()
    if share == 0.0:
        return None
    sigma = math.hypot(found.sigma_px, RING_SHARE * radius)
    return replace(
        found,
        u_px=u,
        v_px=v,
        radius_px=radius,
        sigma_px=sigma,
        inliers=share,
        inside_px=found.radius_px,
    )
