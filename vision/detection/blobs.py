"""Where in an image are patches of the ball's colour? Robust and coarse: centres to some pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from vision.detection.appearance import Appearance
from vision.detection.pixels import probability_map


@dataclass(frozen=True)
class Blob:
    """A patch of the ball's colour: its centroid, and the radius of the disc that has its area
    [px].

    `score` (0..1): its area over that of the disc through the longer side of its bounding box.
    """

    u_px: float
    v_px: float
    radius_px: float
    score: float


def find_blobs(
    image: np.ndarray,
    appearance: Appearance,
    radius_px: tuple[float, float],
    mask: np.ndarray | None = None,
    *,
    least: float = 0.43,
) -> list[Blob]:
    """Patches of the ball's colour in an image (h, w, 3) uint8 BGR, most disc-like first.

    `radius_px` bounds the radius (min, max); patches from half to twice that are kept, since hands
    hide a part and motion lengthens. `mask` (h, w) uint8 is nonzero where the ball can be. A pixel
    counts from P(ball) = `least` on.
    """
    step = int(np.clip(radius_px[0] / 4.0, 1, 4))
    likely = probability_map(image, appearance.table, step)
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
