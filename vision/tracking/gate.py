"""Is a located disc plausibly the ball? Tests of outline, size, colour, contrast and place.

A wrong position that passes as good is worse than a lost ball, so the tests are strict where no
prediction supports the place.
"""

from __future__ import annotations

import math

import numpy as np

from vision.detection.appearance import Appearance
from vision.detection.detector import Detection
from vision.tracking.kinematics import ImageMotion

# Below this mean P(ball) of its own pixels the colour table says nothing about a ball.
TELLING_FILL = 0.35
# Of the turn: what the image's border may cut from a ball that is met for the first time.
LEAST_FRAMED = 0.6


def outline_significance(separation: float, radius_px: float) -> float:
    """Significance [1] of a disc's outline: `separation` from its surround (in sigmas) times
    sqrt(`radius_px`).

    The signal-to-noise ratio of an outline grows with the root of its length. Tips of sticks,
    specks and flecks of shadow are short outlines of little contrast.
    """
    return separation * math.sqrt(radius_px)


def _clear(found: Detection) -> bool:
    """Whether the outline is whole and sharp, and nothing of the ball's colour lies beside it."""
    sharp = found.residual_px < max(0.25, 0.02 * found.radius_px)
    return found.inliers > 0.85 and found.coverage == 1.0 and sharp and found.spill < 0.15


def is_inside(found: Detection, mask: np.ndarray | None) -> bool:
    """Whether a disc's centre is where the ball can be: `mask` (h, w) is not 0 there, or None."""
    if mask is None:
        return True
    h, w = mask.shape[:2]
    i, j = round(found.v_px), round(found.u_px)
    return 0 <= i < h and 0 <= j < w and bool(mask[i, j])


def is_apart(seen: Detection, motion: ImageMotion, radius_px: float) -> bool:
    """Whether a disc is another than the one that is tracked, of radius `radius_px`."""
    u, v = motion.place
    return math.hypot(seen.u_px - u, seen.v_px - v) > 1.5 * radius_px


def is_plausible(
    found: Detection | None,
    appearance: Appearance,
    radius_px: tuple[float, float],
    *,
    strict: bool = False,
    familiar: bool = False,
) -> bool:
    """Whether the disc has the ball's outline, size and colour; False for None.

    `radius_px` (min, max) bounds the ball's radius here. `strict` is for a first lock and for a
    ball found again, where no prediction supports the place: nearly the whole outline that lies in
    the image must be seen.
    `familiar` says that place and size are as predicted: a clear outline may then have changed its
    colour, as it does under lamps and windows.
    """
    if found is None or not radius_px[0] <= found.radius_px <= radius_px[1]:
        return False
    telling = appearance.fill >= TELLING_FILL
    known = 0.25 if familiar and _clear(found) else 0.65 if strict else 0.5
    if telling and found.fill < known * appearance.fill:
        return False
    least = max(found.framed - 0.13, LEAST_FRAMED) if strict else 0.5
    if found.contrast < 0.25 or found.coverage < least:
        return False
    rough_px = max(0.25, 0.05 * found.radius_px) if strict else max(0.4, 0.07 * found.radius_px)
    if found.inliers >= (0.75 if strict else 0.55) and found.residual_px <= rough_px:
        return True
    # Motion blur roughens the outline in proportion to the ball; colour then speaks for the rest.
    coloured = telling and found.fill > 0.8 * appearance.fill and found.spill < 0.15
    whole = found.inliers >= 0.9 and found.coverage == 1.0
    return coloured and whole and found.residual_px <= 0.15 * found.radius_px
