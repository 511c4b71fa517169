"""The circle that most edge points share: what an outline is where another edge runs beside it."""

from __future__ import annotations

import math

import numpy as np

from vision.compiled import kernel

ARCS = 3  # a third and less of the turn apart: an arc that is free over two of these will do
LEAST_SHARE = 0.45


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


@kernel
def shared_circle(points, radius, slack_px):
    """(u, v, radius, share) of the circle that most of the points (n, 2) lie on within `slack_px`.

    The points go once round; NaN ones count as off. Circles through three of them, up to two
    thirds of the turn apart, are asked, if their radius is within a third of `radius`. Share 0:
    none held `LEAST_SHARE` of the points.
    """
    n = points.shape[0]
    best, most = np.zeros(4), LEAST_SHARE * n - 0.5
    for arc in range(ARCS):
        stride = n // (3 + 2 * arc)
        for i in range(n):
            u, v, r = _through(points, i, (i + stride) % n, (i + 2 * stride) % n)
            if not 0.67 * radius < r < 1.33 * radius:
                continue
            on = 0
            for m in range(n):
                du, dv = points[m, 0] - u, points[m, 1] - v
                on += abs(math.sqrt(du * du + dv * dv) - r) < slack_px
            if on > most:
                most = float(on)
                best[0], best[1], best[2], best[3] = u, v, r, on / n
    return best
