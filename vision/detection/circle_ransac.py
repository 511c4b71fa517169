"""Which circle do most edge points lie on, where points of another edge are among them?

RANSAC (Fischler and Bolles, Comm. ACM 24, 1981) with regular triples in place of random ones: the
points go once round a turn, so triples a fixed stride apart contain one within a free arc, and the
result is the same at every call.
"""

from __future__ import annotations

import math

import numpy as np

from vision.compiled import fast_kernel, kernel

ARCS = 3  # strides of n / 3, n / 5 and n / 7 points: the shortest triple spans 2 / 7 of the turn
LEAST_SHARE = 0.45  # of the points; chosen below a half, since another edge may hide that much


@kernel
def _through(points, i, j, k):
    """(u, v, radius) of the circle through three points; radius infinite where they are in line."""
    ax, ay = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
    bx, by = points[k, 0] - points[i, 0], points[k, 1] - points[i, 1]
    cross = 2.0 * (ax * by - ay * bx)
    if not abs(cross) > 1e-6:
        return 0.0, 0.0, np.inf
    a2, b2 = ax * ax + ay * ay, bx * bx + by * by
    u, v = (by * a2 - ay * b2) / cross, (ax * b2 - bx * a2) / cross
    return points[i, 0] + u, points[i, 1] + v, math.sqrt(u * u + v * v)


@fast_kernel
def _count_on(x, y, u, v, least, most):
    """How many places (x, y) (n,) have a squared distance from (u, v) between `least` and `most`;
    all in px."""
    on = 0
    for m in range(x.size):
        d = (x[m] - u) ** 2 + (y[m] - v) ** 2
        on += least < d < most
    return on


@kernel
def consensus_circle(points, radius, slack_px):
    """The circle that most points lie on within `slack_px`, (4,): u, v, radius [px], share of the
    points on it (RANSAC with regular triples).

    `points` (n, 2) [px] go once round a turn; NaN counts as off. Circles whose radius differs by
    more than a third from `radius` are passed over. Share 0: no circle held `LEAST_SHARE` of the
    points.
    """
    n = points.shape[0]
    best, most = np.zeros(4), LEAST_SHARE * n - 0.5
    x, y = np.empty(n), np.empty(n)
    for i in range(n):
        there = np.isfinite(points[i, 0])
        x[i], y[i] = (points[i, 0], points[i, 1]) if there else (1e9, 1e9)  # on no circle
    for arc in range(ARCS):
        stride = n // (3 + 2 * arc)
        for i in range(n):
            u, v, r = _through(points, i, (i + stride) % n, (i + 2 * stride) % n)
            if not 0.67 * radius < r < 1.33 * radius:
                continue
            least = max(r - slack_px, 0.0) ** 2
            on = _count_on(x, y, u, v, least, (r + slack_px) ** 2)
            if on > most:
                most = float(on)
                best[0], best[1], best[2], best[3] = u, v, r, on / n
    return best
