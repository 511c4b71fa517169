"""Where are circles of unknown colour? A Hough transform along the gradient, at several scales.

The gradient of an edge points at its circle's centre, so every edge pixel votes for the place one
radius away along it, for bright and for dark discs apart: a ball is the one or the other all round,
chance alignments are not. Edges are taken from the colour channel that changes most. One octave of
radii is looked for in an image; larger circles are found as small ones in a smaller image
(`circles_of_any_size`), so that the cost does not grow with the radius.

Why not `cv2.HoughCircles`, which takes grey images: of 266 frames of the hard cases in
tests/benchmarks/vision/scripts.py, at 320 x 240 px, the ball is among the ten best circles in 258
with this transform, in 121 to 156 with HOUGH_GRADIENT, in 256 with HOUGH_GRADIENT_ALT. The last
fails on other frames: it misses coloured balls on transparent plates, where only the colour has
contrast (10 of 18 found, here 18), and finds white ones on pale plates (9 of 9, here 1).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from vision.compiled import kernel
from vision.noise import noise_level

SMALLEST_PX = 3.8  # radius below which a circle has too few edge pixels to be told from chance
OCTAVE = SMALLEST_PX * np.geomspace(1.0, 2.0, 6)[:5]
MOST_PIXELS = 2.1e6  # of an image that is searched; a larger one is halved first, to save time
LEAST_SUPPORT = 0.35  # share of the circumference, chosen below a half: a hand may hide that much


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
def _votes(edges, gx, gy, radii):
    """Votes (2 n, h, w) uint8 for discs of the n radii: brighter inside, then darker inside."""
    h, w = edges.shape
    n = radii.size
    out = np.zeros((2 * n, h, w), np.uint8)
    for i in range(h):
        for j in range(w):
            if not edges[i, j]:
                continue
            x, y = float(gx[i, j]), float(gy[i, j])
            size = math.sqrt(x * x + y * y) + 1e-9
            for k in range(2 * n):
                far = radii[k] if k < n else -radii[k - n]
                u, v = int(j + far * x / size + 0.5), int(i + far * y / size + 0.5)
                if 0 <= u < w and 0 <= v < h and out[k, v, u] < 255:
                    out[k, v, u] += 1
    return out


def hough_circles(
    image: np.ndarray, radii_px: np.ndarray, *, noise: float, at_most: int = 6
) -> list[Circle]:
    """The best-supported circles in an image (h, w, 3) uint8 BGR, best first, not overlapping.

    Each of `radii_px` (n,) is tried; `noise` is the standard deviation of the pixel noise in grey
    levels, which sets what counts as an edge. At most `at_most` circles.
    """
    smooth = cv2.GaussianBlur(image, (3, 3), 0)
    gx, gy = _strongest(
        cv2.Sobel(smooth, cv2.CV_16S, 1, 0).reshape(image.shape),
        cv2.Sobel(smooth, cv2.CV_16S, 0, 1).reshape(image.shape),
    )
    # Sobel sums 8 weights: the blurred noise leaves it with about 3 sigma.
    high = max(40.0, 15.0 * noise)
    edges = cv2.Canny(gx, gy, 0.5 * high, high, L2gradient=True)
    radii = np.asarray(radii_px, float)
    found: list[Circle] = []
    for k, votes in enumerate(_votes(edges, gx, gy, radii)):
        radius = float(radii[k % len(radii)])
        size = 1 + 2 * max(1, round(0.1 * radius))
        box = cv2.boxFilter(votes, cv2.CV_16U, (size, size), normalize=False)
        found += _peaks(np.asarray(box), radius)
    return _distinct(found, at_most)


def circles_of_any_size(
    image: np.ndarray,
    bounds_px: tuple[float, float],
    *,
    at_most: int = 10,
    due: Callable[[int], bool] = lambda pixels: True,
) -> list[Circle]:
    """Circles with radii within `bounds_px` in an image (h, w, 3) uint8 BGR: the `at_most` best of
    every octave of radii, none in a better one.

    `due` says of an image's number of pixels whether it is looked at this time.
    """
    found: list[Circle] = []
    scale, small = 1.0, image
    while SMALLEST_PX * scale <= bounds_px[1] and min(small.shape[:2]) > 2.5 * SMALLEST_PX:
        pixels = small.shape[0] * small.shape[1]
        if 2.0 * SMALLEST_PX * scale >= bounds_px[0] and pixels < MOST_PIXELS and due(pixels):
            # Video stores colour at half the resolution.
            for view in (small, _opponents(small)) if scale > 1.0 else (small,):
                rings = hough_circles(view, OCTAVE, noise=noise_level(view), at_most=at_most)
                found += [
                    Circle(
                        scale * (c.u_px + 0.5) - 0.5,
                        scale * (c.v_px + 0.5) - 0.5,
                        scale * c.radius_px,
                        c.score,
                    )
                    for c in rings
                ]
        scale *= 2.0
        half = (max(1, small.shape[1] // 2), max(1, small.shape[0] // 2))
        small = np.asarray(cv2.resize(small, half, interpolation=cv2.INTER_AREA))
    return found


def _opponents(image: np.ndarray) -> np.ndarray:
    """Differences of the channels (h, w, 3) uint8, 128 for none. Shading turns a coloured ball from
    brighter to darker than its plate round the turn; these keep their sign."""
    halves = np.array(((0.5, -0.5, 0.0), (0.0, 0.5, -0.5), (-0.5, 0.0, 0.5)))
    return np.asarray(cv2.transform(image, np.hstack((halves, np.full((3, 1), 128.0)))))


def _peaks(support: np.ndarray, radius: float) -> list[Circle]:
    """Up to three maxima of a map of votes (h, w) above `LEAST_SUPPORT` of the circumference."""
    found = []
    turn = 2.0 * math.pi * radius
    for _ in range(3):
        _, top, _, (u, v) = cv2.minMaxLoc(support)
        if top < LEAST_SUPPORT * turn:
            break
        found.append(Circle(float(u), float(v), radius, top / turn))
        cv2.circle(support, (u, v), max(2, int(radius)), 0.0, -1)
    return found


def _distinct(found: list[Circle], at_most: int) -> list[Circle]:
    """The best circles whose centres do not lie in a better one.

    A short circumference is completed by chance more easily, hence the root of the radius.
    """
    kept: list[Circle] = []
    for c in sorted(found, key=lambda c: -c.score * math.sqrt(c.radius_px)):
        if all(
            math.hypot(c.u_px - k.u_px, c.v_px - k.v_px) > 0.7 * max(c.radius_px, k.radius_px)
            for k in kept
        ):
            kept.append(c)
        if len(kept) == at_most:
            break
    return kept
