"""Compiled: edges along rays and their ellipse, of a ball, a blurred or a mirroring one."""

from __future__ import annotations

import numpy as np

from vision.compiled import kernel
from vision.ellipse import fit
from vision.rays import cast


@kernel
def _best_fit(points, outer, weight, u, v, radius, inside, flat_std, blurred_std, rounds):
    """`fit` of a ball, of a mirroring ball, or of a blurred one."""
    best = fit(points, weight, u, v, radius, 0.15 * radius, flat_std, rounds)
    double = 0
    for i in range(points.shape[0]):
        apart = max(abs(outer[i, 0] - points[i, 0]), abs(outer[i, 1] - points[i, 1]))
        double += apart > 0.03 * radius
    if double > 0.2 * inside:
        # Two edges on many rays: a mirroring ball's rim reflects the plate. The outer one is its.
        rim = fit(outer, weight, u, v, 1.1 * radius, 0.15 * radius, flat_std, rounds)
        if rim[5].sum() >= 0.8 * inside and rim[4] < 0.03 * radius and rim[2] > 1.03 * best[2]:
            best = rim
    if best[5].sum() < 0.9 * inside or best[4] > 0.03 * radius:
        blurred = fit(points, weight, u, v, radius, 0.3 * radius, blurred_std, rounds)
        if blurred[5].sum() >= 0.9 * inside:
            best = blurred
    return best


@kernel
def trace_rays(image, u, v, radius, reach, w, n_rays, signed, flat_std, blurred_std, rounds):
    """Edges along rays about a guess and the ellipse through them (`cast`, `fit`).

    Returns an array: 0 u, 1 v, 2 radius, 3 variance per axis, 4 rms of the inliers, 5 how many, 6
    rays inside the image, 7 first harmonic of the edge's strength over its mean, 8 coverage by
    eighths with at least one in three rays good; and whether an ellipse was found.
    """
    out = np.zeros(9)
    points, outer, strength, inside = cast(image, u, v, radius, reach, w, n_rays, signed)
    typical = np.median(strength)
    if not typical > 0.0:
        return out, False
    weight = np.empty(n_rays)
    for i in range(n_rays):
        weight[i] = min(max((strength[i] / typical - 0.15) / 0.35, 0.0), 1.0)
    u2, v2, radius2, variance, residual, good = _best_fit(
        points, outer, weight, u, v, radius, inside, flat_std, blurred_std, rounds
    )
    limit = (1.0 + reach) * radius
    off = np.sqrt((u2 - u) ** 2 + (v2 - v) ** 2)
    # Comparisons that are false for NaN refuse it too.
    if not (off < limit and 0.3 * radius < radius2 < 2.0 * radius):
        return out, False
    count = good.sum()
    if count < 10 or not np.isfinite(variance):
        return out, False
    # Rays closer than a pixel's diagonal or so share their pixels, and so their noise.
    variance *= max(1.0, 2.2 * n_rays / (2.0 * np.pi * radius2))
    c, s, total = 0.0, 0.0, 1e-9
    for i in range(n_rays):
        c += strength[i] * np.cos(2.0 * np.pi * i / n_rays)
        s += strength[i] * np.sin(2.0 * np.pi * i / n_rays)
        total += strength[i]
    per, covered = n_rays // 8, 0
    for i in range(8):
        on = 0
        for k in range(i * per, (i + 1) * per):
            on += good[k]
        covered += on > 0.34 * per
    out[0], out[1], out[2], out[3], out[4] = u2, v2, radius2, variance, residual
    out[5], out[6], out[8] = count, inside, covered / 8.0
    out[7] = 2.0 * np.sqrt(c * c + s * s) / total
    return out, True


@kernel
def _beyond(points, u, v, radius, used):
    """Mark as used the points (n, 2) clearly outside the circle, and not NaN."""
    for i in range(points.shape[0]):
        r = np.sqrt((points[i, 0] - u) ** 2 + (points[i, 1] - v) ** 2)
        used[i] = 1.0 if r > 1.05 * radius else 0.0


@kernel
def ring_about(image, u, v, radius, w, n_rays, flat_std, rounds):
    """(u, v, radius, share of the rays on it) of a ball of which the circle given is but a part.

    A mirroring ball shows the plate's picture about that of the room: a ring whose outer edge is
    the ball's. It surrounds the inner outline, need not be concentric with it, and is weaker where
    the ball's own shadow lies; so the outermost edges of either sign are asked, and an ellipse is
    taken on which rays from its own centre meet edges in most directions. Share 0: none.
    """
    out = np.zeros(4)
    u2, v2, radius2 = u, v, 1.25 * radius
    for turn in range(3):
        reach = 0.22 if turn == 0 else 0.12
        points, outer, _strength, inside = cast(image, u2, v2, radius2, reach, w, n_rays, False)
        both = np.concatenate((points, outer))
        weight = np.zeros(2 * n_rays)
        _beyond(both, u, v, radius, weight)
        if weight.sum() < 0.5 * n_rays:
            return out
        scale = (0.08 if turn == 0 else 0.04) * radius
        got = fit(both, weight, u2, v2, radius2, scale, flat_std, rounds)
        u2, v2, radius2 = got[0], got[1], got[2]
        off = np.sqrt((u2 - u) ** 2 + (v2 - v) ** 2)
        if not (1.08 * radius < radius2 < 1.6 * radius and off < radius2 - 0.95 * radius):
            return out
        on, per = 0, n_rays // 8
        covered = np.zeros(8)
        for i in range(n_rays):
            if got[5][i] or got[5][n_rays + i]:
                on += 1
                covered[min(i // per, 7)] += 1.0 / per
        if got[4] > 0.03 * radius2 or on < 0.5 * inside or (covered > 0.34).sum() < 5:
            return out
        out[0], out[1], out[2], out[3] = u2, v2, radius2, on / inside
    return out
