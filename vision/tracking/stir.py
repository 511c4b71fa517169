"""Does anything stir beside a thing at rest? Then the thing may be a mark, and the ball what stirs.

A ball that no circle shows, white on a pale plate or polished, still changes the image where it
rolls. What changed within the last `SPAN_S` is taken in compact patches, as a ball leaves: a hand
reaches in over the image's border, other light changes all of it.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from vision.noise import noise_level

SPAN_S = 0.3  # a ball that starts on a slope of 1 degree rolls 5 mm in it
SIDE_PX = 200  # chosen: of the longer side of the images compared, in which a small ball is 3 px
SIGMAS, LEAST_STEP = 6.0, 12.0  # of a change: standard deviations of the noise, grey levels
LEAST_PX = 6  # area of a patch: a small ball moved by its radius; packing noise changes 1 to 4
LARGEST_SHARE = 0.5  # of the shorter side: what a rolling ball's patch spans at most


class Stir:
    """Remembers small images of the last `SPAN_S` and where they differ."""

    def __init__(self) -> None:
        self._seen: list[tuple[float, np.ndarray]] = []
        self._changed = np.zeros((1, 1), np.uint8)
        self._patches = np.zeros((0, 2))
        self._step = 1

    def add(self, t_s: float, image: np.ndarray) -> None:
        """Look at an image (h, w, 3) uint8 BGR at a time."""
        self._step = max(1, round(max(image.shape[:2]) / SIDE_PX))
        size = max(1, image.shape[1] // self._step), max(1, image.shape[0] // self._step)
        small = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))
        small = np.asarray(cv2.GaussianBlur(small, (3, 3), 0))
        self._seen = [x for x in self._seen if 0.0 <= t_s - x[0] <= SPAN_S]
        self._seen.append((t_s, small))
        change = cv2.absdiff(self._seen[0][1], small).max(2)
        least = max(LEAST_STEP, SIGMAS * noise_level(small))
        self._changed = (change > least).astype(np.uint8)
        self._patches = _compact(self._changed)

    def elsewhere(self, place: tuple[float, float], radius_px: float) -> bool:
        """Whether something stirs farther than two radii from a place (u, v) px, and nothing does
        within one and a half."""
        (u, v), r = ((x + 0.5) / self._step - 0.5 for x in place), radius_px / self._step
        if not any(math.dist((u, v), patch) > 2.0 * r for patch in self._patches):
            return False
        reach = 1.5 * r + 1.0
        x, y = max(0, round(u - reach)), max(0, round(v - reach))
        near = self._changed[y : round(v + reach) + 1, x : round(u + reach) + 1]
        return int(near.sum()) < LEAST_PX


def _compact(changed: np.ndarray) -> np.ndarray:
    """Middles (n, 2) px of the compact patches of a map (h, w) uint8 of what changed."""
    n, _, stats, middles = cv2.connectedComponentsWithStats(changed, connectivity=8)
    h, w = changed.shape
    x, y, wide, high, area = (np.asarray(stats)[1:n].astype(int)).T
    inside = (x > 0) & (y > 0) & (x + wide < w) & (y + high < h)
    compact = np.maximum(wide, high) < LARGEST_SHARE * min(h, w)
    return np.asarray(middles)[1:n][inside & compact & (area >= LEAST_PX)]
