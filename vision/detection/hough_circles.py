"""Where are circles of unknown colour? A Hough transform along the gradient.

The gradient of an edge points at its circle's centre, so every edge pixel votes for the place one
radius away along it, for bright and for dark discs apart: a ball is the one or the other all round,
chance alignments are not. Edges are taken from the colour channel that changes most.

Why not `cv2.HoughCircles`, which takes grey images: of 266 frames of the hard cases in
tests/benchmarks/vision_scripts.py, at 320 x 240 px, the ball is among the ten best circles in 258
with this transform, in 121 to 156 with HOUGH_GRADIENT, in 256 with HOUGH_GRADIENT_ALT. The last
fails on other frames: it misses coloured balls on transparent plates, where only the colour has
contrast (10 of 18 found, here 18), and finds white ones on pale plates (9 of 9, here 1). It takes
8 to 14 ms an image, this one 45 ms for 23 radii; the time is spent only until a ball is found.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from vision.compiled import kernel


@dataclass(frozen=True)
class Circle:
    """A circle in the image: centre and radius [px]; `score` is about the share of the
    circumference that voted for it."""

    u_px: float
    v_px: float
    radius_px: float
    score: float


@kernel
def _strongest(gx, gy):
    """Gradients (h, w) int16 of the channel that changes most, from those of all (h, w, 3)."""
    h, w, _ = gx.shape
    ox, oy = np.empty((h, w), np.int16), np.empty((h, w), np.int16)
    for i in range(h):
        for j in range(w):
            top = -1
            for c in range(3):
                size = abs(int(gx[i, j, c])) + abs(int(gy[i, j, c]))
                if size > top:
                    top = size
                    ox[i, j], oy[i, j] = gx[i, j, c], gy[i, j, c]
    return ox, oy


@kernel
def _vote(edges, gx, gy, radius, sign):
    """Accumulated votes (h, w) float32 for discs of this radius, brighter inside if sign > 0."""
    h, w = edges.shape
    out = np.zeros((h, w), np.float32)
    for i in range(h):
        for j in range(w):
            if edges[i, j]:
                x, y = float(gx[i, j]), float(gy[i, j])
                size = np.sqrt(x * x + y * y) + 1e-9
                u = round(j + sign * radius * x / size)
                v = round(i + sign * radius * y / size)
                if 0 <= u < w and 0 <= v < h:
                    out[v, u] += 1.0
    return out


def hough_circles(
    image: np.ndarray,
    radii_px: np.ndarray,
    *,
    noise: float,
    region: np.ndarray | None = None,
    at_most: int = 6,
) -> list[Circle]:
    """The best-supported circles in an image (h, w, 3) uint8 BGR, best first, not overlapping.

    Each of `radii_px` (n,) is tried; `noise` is the standard deviation of the pixel noise in grey
    levels, which sets what counts as an edge; only edges where `region` (h, w) uint8 is nonzero
    vote. At most `at_most` circles.
    """
    smooth = cv2.GaussianBlur(image, (3, 3), 0)
    gx, gy = _strongest(
        cv2.Sobel(smooth, cv2.CV_16S, 1, 0).reshape(image.shape),
        cv2.Sobel(smooth, cv2.CV_16S, 0, 1).reshape(image.shape),
    )
    # Sobel sums 8 weights: the blurred noise leaves it with about 3 sigma.
    high = max(40.0, 15.0 * noise)
    edges = cv2.Canny(gx, gy, 0.5 * high, high, L2gradient=True)
    if region is not None:
        edges = np.where(region > 0, edges, np.uint8(0))
    found: list[Circle] = []
    for radius in radii_px:
        size = 1 + 2 * max(1, round(0.1 * radius))
        for sign in (1.0, -1.0):
            votes = cv2.boxFilter(
                _vote(edges, gx, gy, float(radius), sign), -1, (size, size), normalize=False
            )
            found += _peaks(votes / (2 * np.pi * radius), float(radius))
    return _distinct(found, at_most)


def _peaks(support: np.ndarray, radius: float, least: float = 0.35) -> list[Circle]:
    """Up to three maxima of a support map (h, w) above `least`."""
    found = []
    support = support.copy()
    for _ in range(3):
        _, top, _, (u, v) = cv2.minMaxLoc(support)
        if top < least:
            break
        found.append(Circle(float(u), float(v), radius, float(top)))
        cv2.circle(support, (u, v), max(2, int(radius)), 0.0, -1)
    return found


def _distinct(found: list[Circle], at_most: int) -> list[Circle]:
    """The best circles whose centres do not lie in a better one.

    A short circumference is completed by chance more easily, hence the root of the radius.
    """
    kept: list[Circle] = []
    for c in sorted(found, key=lambda c: -c.score * np.sqrt(c.radius_px)):
        if all(
            np.hypot(c.u_px - k.u_px, c.v_px - k.v_px) > 0.7 * max(c.radius_px, k.radius_px)
            for k in kept
        ):
            kept.append(c)
        if len(kept) == at_most:
            break
    return kept
