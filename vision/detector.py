"""Find one ball in an image, and locate it to a hundredth of a pixel. Pure functions.

`find` asks each pixel's colour whether it is the ball's and groups the answers: robust, coarse.
`locate` casts rays from a guess, takes the sub-pixel edge on each and fits an ellipse robustly:
exact, local. Nothing here decides whether to believe a result; `vision.gate` does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from vision.appearance import SIGNED_ABOVE, Appearance
from vision.rays import KERNEL, cast, fit, lookup, share

__all__ = ["Appearance", "Blob", "Detection", "find", "locate"]

# Prior of the flattening, share of the radius: of a sphere (perspective, lens), which keeps an
# outline in its form where a hand or a thing of its colour hides part of it; and of a sphere
# blurred by its motion, which is believed only of a whole outline.
FLAT_STD, BLURRED_STD = 0.03, 0.12
# What the outline deviates from an ellipse in a common way (blur, a shadow's edge) does not average
# out over the rays; this share of the residual is added to the centre's sigma.
OUTLINE_SHARE = 0.05
# Light from one side makes one edge stronger and lays a shadow at the other; the centre then leans
# by about this much (px) per relative first harmonic of the edge's strength.
LIGHT_SHARE_PX = 0.06
UNSIGNED_REACH = 0.25
REACH = 0.6  # rays search from (1 - REACH) to (1 + REACH) radii


@dataclass(frozen=True)
class Blob:
    """A patch of the ball's colour: centre and radius of the disc of its area, px; 0 <= score <= 1.

    The score is how well a disc would fill the patch's bounding box.
    """

    u_px: float
    v_px: float
    radius_px: float
    score: float


@dataclass(frozen=True)
class Detection:
    """A located disc with what is needed to judge it.

    `sigma_px` std of the centre per axis; `inliers` share of the rays in the image whose edge lies
    on the ellipse; `coverage` share of the full turn so covered, by eighths with at least one in
    three rays good; `contrast` 1 where ball and plate differ as in the appearance, negative where
    the sign is wrong; `residual_px` rms of the inliers; `fill` and `spill` the mean P(ball) of the
    colours inside and just outside.
    """

    u_px: float
    v_px: float
    radius_px: float
    sigma_px: float
    inliers: float
    coverage: float
    contrast: float
    residual_px: float
    fill: float
    spill: float


def find(
    image: np.ndarray,
    appearance: Appearance,
    *,
    radius_px: tuple[float, float],
    mask: np.ndarray | None = None,
    least: float = 0.43,
) -> list[Blob]:
    """Patches of the ball's colour in an image (h, w, 3) uint8 BGR, most disc-like first.

    `radius_px` bounds the radius (min, max); patches down to half and up to twice that stay in,
    since hands hide and streaks lengthen. `mask` (h, w) uint8: nonzero where the ball can be.
    `least` is the P(ball) from which a pixel counts.
    """
    step = int(np.clip(radius_px[0] / 4.0, 1, 4))
    likely = lookup(image, appearance.table, step)
    if mask is not None:
        h, w = likely.shape
        likely = np.where(mask[::step, ::step][:h, :w] > 0, likely, np.uint8(0))
    size = 2 * int(np.clip(0.12 * radius_px[0] / step, 1, 5)) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    binary = (cv2.medianBlur(likely, 3) > 255 * least).astype(np.uint8)
    # Closing bridges a stick or a highlight across the ball.
    binary = cv2.morphologyEx(binary, cv2.MORPH_CLOSE, disc)
    _, labels, stats, centres = cv2.connectedComponentsWithStats(binary, connectivity=4)
    blobs: list[Blob] = []
    for k in range(1, len(stats)):
        blobs += _blobs_of(labels, k, stats[k], centres[k], step, radius_px)
    return sorted(blobs, key=lambda b: -b.score)


def _blobs_of(
    labels: np.ndarray,
    k: int,
    stats: np.ndarray,
    centre: np.ndarray,
    step: int,
    bounds: tuple[float, float],
) -> list[Blob]:
    """The blobs that component k offers: itself, and the thickest spot of an overlong one."""
    x, y, w, h, area = (int(s) for s in stats[:5])
    radius = step * math.sqrt(area / math.pi)
    if radius < 0.5 * bounds[0]:
        return []
    score = area / (math.pi / 4 * max(w, h) ** 2)
    u, v = step * float(centre[0]), step * float(centre[1])
    found = [Blob(u, v, radius, min(score, 1.0))] if radius < 2.0 * bounds[1] else []
    if score < 0.75 or radius > bounds[1]:
        patch = np.pad((labels[y : y + h, x : x + w] == k).astype(np.uint8), 1)
        depth = cv2.distanceTransform(patch, cv2.DIST_L2, 3)
        _, deepest, _, place = cv2.minMaxLoc(depth)
        if 0.5 * bounds[0] < step * deepest < 2.0 * bounds[1]:
            u, v = step * (x + place[0] - 1), step * (y + place[1] - 1)
            found.append(Blob(float(u), float(v), step * deepest, min(score, 1.0) * 0.9))
    return found


def locate(
    image: np.ndarray,
    appearance: Appearance,
    u_px: float,
    v_px: float,
    radius_px: float,
    *,
    reach: float = REACH,
) -> Detection | None:
    """The disc near a guess, or None where too few edges lie on any ellipse.

    Two passes: the first with the appearance's direction, about the guess; the second with the
    direction measured at the spot, about the first's centre. Sigma from the residuals:
    C = s^2 (A' W A + P)^-1 of the ellipse's five parameters, and a share of s for what is common.
    """
    direction, signed = appearance.direction, appearance.signed
    if not appearance.learned:
        direction = appearance.here(image, u_px, v_px, radius_px)[0]
    # Edges of either sign are found inside a mirroring ball too: look for its rim alone.
    reach = reach if signed else min(reach, UNSIGNED_REACH)
    first = _pass(image, direction, signed, u_px, v_px, radius_px, reach)
    if first is None:
        return None
    u, v, radius = first[:3]
    local, separation, contrast = appearance.here(image, u, v, radius)
    signed = separation > SIGNED_ABOVE
    last = _pass(image, local, signed, u, v, radius, 0.35 if signed else UNSIGNED_REACH)
    if last is None:
        return None
    u, v, radius, variance, residual, good, inside, lopsided = last
    octants = good[: len(good) // 8 * 8].reshape(8, -1).mean(1) > 0.34
    return Detection(
        u_px=u,
        v_px=v,
        radius_px=radius,
        sigma_px=math.hypot(
            math.sqrt(variance), OUTLINE_SHARE * residual, LIGHT_SHARE_PX * lopsided
        ),
        inliers=float(good.sum()) / max(inside, 1),
        coverage=float(octants.mean()),
        contrast=contrast if appearance.learned and appearance.signed else 1.0,
        residual_px=residual,
        fill=share(image, appearance.table, u, v, 0.0, 0.85 * radius),
        spill=share(image, appearance.table, u, v, 1.2 * radius + 1.0, 1.6 * radius + 2.0),
    )


def _pass(
    image: np.ndarray,
    direction: np.ndarray,
    signed: bool,
    u: float,
    v: float,
    radius: float,
    reach: float,
) -> tuple[float, float, float, float, float, np.ndarray, int, float] | None:
    """Rays and fit about (u, v); None where the fit has run away or rests on too few edges."""
    n_rays = 8 * int(np.clip(2 * math.pi * radius / 2.0 / 8, 3, 9))
    points, outer, strength, inside = cast(
        image, u, v, radius, reach, direction, n_rays, signed, KERNEL
    )
    typical = float(np.median(strength))
    if typical <= 0.0:
        return None
    weight = np.clip((strength / typical - 0.15) / 0.35, 0.0, 1.0)
    result = fit(points, weight, u, v, radius, 0.15 * radius, FLAT_STD, 8)
    if np.count_nonzero(np.abs(outer - points).max(1) > 0.03 * radius) > 0.2 * inside:
        # Two edges on many rays: a mirroring ball's rim reflects the plate. The outer one is
        # the ball's.
        rim = fit(outer, weight, u, v, 1.1 * radius, 0.15 * radius, FLAT_STD, 8)
        if rim[5].sum() >= 0.8 * inside and rim[4] < 0.03 * radius and rim[2] > 1.03 * result[2]:
            result = rim
    if result[5].sum() < 0.9 * inside or result[4] > 0.03 * radius:
        blurred = fit(points, weight, u, v, radius, 0.3 * radius, BLURRED_STD, 8)
        if blurred[5].sum() >= 0.9 * inside:
            result = blurred
    u2, v2, radius2, variance, residual, good = result
    limit = (1.0 + reach) * radius
    # Comparisons that are false for NaN refuse it too.
    if not (math.hypot(u2 - u, v2 - v) < limit and 0.3 * radius < radius2 < 2.0 * radius):
        return None
    if good.sum() < 10 or not math.isfinite(variance):
        return None
    # Rays closer than a pixel's diagonal or so share their pixels, and so their noise.
    variance *= max(1.0, 2.2 * n_rays / (2 * math.pi * radius2))
    turn = np.exp(2j * math.pi * np.arange(n_rays) / n_rays)
    lopsided = 2.0 * abs(complex(turn @ strength)) / max(float(strength.sum()), 1e-9)
    return u2, v2, radius2, variance, residual, good, inside, float(lopsided)
