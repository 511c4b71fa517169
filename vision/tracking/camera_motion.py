"""How did the camera move since the first image? Travel is told from a zoom and a hand that shakes.

Between two images the corners of a small one are followed (Lucas and Kanade, IJCAI 1981), and a
similarity (turn, zoom, shift) that most of them share is fitted by RANSAC (Fischler and Bolles,
Comm. ACM 24, 1981). It counts as the camera's, or the plate's where that fills the image, where
next to no corner stays: what is about a hand or a ball that moves does.
"""

from __future__ import annotations

import cv2
import numpy as np

SIDE_PX = 320  # chosen: of the longer side of the images compared, in which corners are distinct
CELL_PX = 80  # chosen: side of a cell of the image, each of which has corners of its own
CORNERS, QUALITY, APART_PX = 12, 0.05, 6.0  # chosen: of `cv2.goodFeaturesToTrack` in a cell
BACK_PX, INLIER_PX = 0.3, 1.0  # from where a corner is followed back to; from the common motion
# Chosen: corners that move as one, their share, the share of either side that they span, and the
# share that may stay, as those in the middle of a zoom do.
LEAST, MOST_SHARE, SPAN, STAYS_SHARE = 10, 0.5, 0.33, 0.2
STILL_PX = 0.3  # a corner that moves less stays
# In hours of a camera that moves, errors of a zoom add up: beyond this one it begins anew.
FARTHEST_ZOOM = 4.0


class CameraMotion:
    """Adds up the camera's motion from image to image; images have one size."""

    def __init__(self) -> None:
        self._last: np.ndarray | None = None
        self._scale = 1.0
        self._to_first = np.eye(3)

    def add(self, image: np.ndarray) -> None:
        """Take the next image (h, w, 3) uint8 BGR."""
        h, w = image.shape[:2]
        self._scale = max(h, w) / SIDE_PX
        size = max(1, round(w / self._scale)), max(1, round(h / self._scale))
        small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        grey = np.asarray(cv2.cvtColor(small, cv2.COLOR_BGR2GRAY))
        if self._last is not None and self._last.shape == grey.shape:
            self._to_first = self._to_first @ _motion(grey, self._last)
            zoom = float(np.hypot(*self._to_first[:2, 0]))
            if not 1.0 / FARTHEST_ZOOM < zoom < FARTHEST_ZOOM:
                self._to_first = np.eye(3)
        self._last = grey

    def home(self, place: tuple[float, float]) -> tuple[float, float]:
        """Where a place (u, v) px of the last image would be in the first one [px]."""
        u, v = ((x + 0.5) / self._scale - 0.5 for x in place)
        x, y, _ = self._to_first @ (u, v, 1.0)
        return (x + 0.5) * self._scale - 0.5, (y + 0.5) * self._scale - 0.5


def _corners(grey: np.ndarray) -> np.ndarray:
    """Corners (n, 1, 2) float32 px of a grey image (h, w), from all over it: what has the strongest
    ones, as a hand or a striped ball may, has but its share."""
    found = [np.zeros((0, 1, 2), np.float32)]
    for y in range(0, grey.shape[0], CELL_PX):
        for x in range(0, grey.shape[1], CELL_PX):
            cell = np.ascontiguousarray(grey[y : y + CELL_PX, x : x + CELL_PX])
            corners = cv2.goodFeaturesToTrack(cell, CORNERS, QUALITY, APART_PX)
            if corners is not None:
                found.append(np.asarray(corners) + np.array((x, y), np.float32))
    return np.concatenate(found)


def _motion(now: np.ndarray, before: np.ndarray) -> np.ndarray:
    """The similarity (3, 3) from places in a grey image (h, w) to those in the one before; the
    identity where corners do not move as one, or do not move."""
    still = np.eye(3)
    corners = _corners(now)
    if len(corners) < LEAST:
        return still
    there, _, _ = cv2.calcOpticalFlowPyrLK(now, before, corners, np.empty_like(corners))
    back, _, _ = cv2.calcOpticalFlowPyrLK(before, now, there, np.empty_like(corners))
    a, b, again = (np.asarray(x).reshape(-1, 2) for x in (corners, there, back))
    found = np.hypot(*(again - a).T) < BACK_PX
    a, b = a[found], b[found]
    if len(a) < LEAST or np.mean(np.hypot(*(b - a).T) < STILL_PX) > STAYS_SHARE:
        return still
    fitted, inliers = cv2.estimateAffinePartial2D(a, b, ransacReprojThreshold=INLIER_PX)
    if fitted is None:
        return still
    shared = np.asarray(inliers).ravel() > 0
    spread = np.ptp(a[shared], 0) > SPAN * np.array(now.shape[::-1])
    if shared.sum() < LEAST or shared.mean() < MOST_SHARE or not spread.all():
        return still
    return np.vstack((fitted, (0.0, 0.0, 1.0)))
