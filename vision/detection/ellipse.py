"""Which ellipse lies through edge points, some of which are outliers? Compiled."""

from __future__ import annotations

import numpy as np

from vision.compiled import kernel

ROUNDS = 8  # of a robust fit, at most
LEAST_PX = 0.02  # scale of the residuals


@kernel
def solve_linear(A, b):
    """Solve A x = b by Gauss-Jordan elimination without pivoting, for a symmetric positive definite
    A (n, n) and b (n,); returns x (n,) and A^-1 (n, n)."""
    # Loops, not slices: these compile in a tenth of the time.
    n = A.shape[0]
    M = np.zeros((n, 2 * n + 1))
    for i in range(n):
        for m in range(n):
            M[i, m] = A[i, m]
        M[i, n] = b[i]
        M[i, n + 1 + i] = 1.0
    for i in range(n):
        pivot = M[i, i]
        for m in range(2 * n + 1):
            M[i, m] /= pivot
        for k in range(n):
            factor = M[k, i]
            if k != i:
                for m in range(2 * n + 1):
                    M[k, m] -= factor * M[i, m]
    x, inverse = np.empty(n), np.empty((n, n))
    for i in range(n):
        x[i] = M[i, n]
        for m in range(n):
            inverse[i, m] = M[i, n + 1 + m]
    return x, inverse


@kernel
def _scale(residual, used):
    """Robust standard deviation of the residuals: 1.4826 median |r| over the used points."""
    values = np.abs(residual[used])
    return max(LEAST_PX, 1.4826 * np.median(values)) if values.size else LEAST_PX


@kernel
def _measure(points, used, q, u, v, polar):
    """Write of every used point r, cos a, sin a, cos 2a, sin 2a about (u, v) px and its residual
    [px] against the ellipse q about its own centre into `polar` (n, 6)."""
    for i in range(points.shape[0]):
        if used[i]:
            du, dv = points[i, 0] - u, points[i, 1] - v
            r = np.sqrt(du * du + dv * dv) + 1e-12
            c, s = du / r, dv / r
            c2, s2 = c * c - s * s, 2.0 * c * s
            polar[i, 0], polar[i, 1], polar[i, 2], polar[i, 3], polar[i, 4] = r, c, s, c2, s2
            polar[i, 5] = r - (q[0] + q[3] * c2 + q[4] * s2)


@kernel
def _normal(polar, weight, used, scale):
    """A (5, 5) and b (5,) of the weighted least squares for `polar` (n, 6), under Tukey's weights
    of the residuals: 0 beyond 4.685 `scale` [px]."""
    A, b = np.zeros((5, 5)), np.zeros(5)
    cut = 4.685 * scale
    for i in range(polar.shape[0]):
        e = polar[i, 5]
        if not used[i] or abs(e) >= cut:
            continue
        t = weight[i] * (1.0 - (e / cut) ** 2) ** 2
        r = polar[i, 0]
        polar[i, 0] = 1.0  # the row of the radius while the sums are taken
        for m in range(5):
            part = t * polar[i, m]
            b[m] += part * r
            for o in range(m + 1):
                A[m, o] += part * polar[i, o]
        polar[i, 0] = r
    for m in range(5):
        for o in range(m):
            A[o, m] = A[m, o]
    return A, b


@kernel
def fit_ellipse(points, weight, u, v, radius, scale, flat_std):
    """Robust ellipse r(a) = R + x cos a + y sin a + c cos 2a + s sin 2a through points (n, 2) px.

    A centred ellipse (and a streak, the disc swept along a line) has even harmonics only, so the
    first harmonic is the centre's error; it is moved away and the angles are taken anew. c and s
    are held near 0 with `flat_std` (share of R), which matters when an arc is hidden. `scale` (px)
    is how far off the guess (u, v, radius) may be: Tukey's weights start there and narrow over at
    most `ROUNDS` rounds; `weight` (n,) multiplies them, 0 leaves a point out. Returns u, v, R (px),
    variance of the centre per axis (px^2; infinite below six inliers), rms of the inliers (px),
    inlier flags (n,) and the flattening (share of R).
    """
    used = np.zeros(points.shape[0], np.bool_)
    for i in range(points.shape[0]):
        used[i] = np.isfinite(points[i, 0]) and weight[i] > 0.0
    q = np.zeros(5)  # in the first round the model is the guess, a circle
    q[0] = radius
    inverse, polar = np.zeros((5, 5)), np.zeros((points.shape[0], 6))
    _measure(points, used, q, u, v, polar)
    for _ in range(ROUNDS):
        A, b = _normal(polar, weight, used, scale)
        noise = max(scale, LEAST_PX) ** 2
        A[0, 0] += noise / (0.3 * radius) ** 2
        b[0] += noise / (0.3 * radius) ** 2 * radius
        A[1, 1] += 1e-9
        A[2, 2] += 1e-9
        A[3, 3] += noise / (flat_std * radius) ** 2
        A[4, 4] += noise / (flat_std * radius) ** 2
        q, inverse = solve_linear(A, b)
        u, v = u + q[1], v + q[2]
        _measure(points, used, q, u, v, polar)
        last = scale
        scale = max(_scale(polar[:, 5], used), 0.25 * scale)
        if scale > 0.9 * last and abs(q[1]) + abs(q[2]) < 0.01:
            break
    good = np.zeros(points.shape[0], np.bool_)
    count, total = 0, 0.0
    for i in range(points.shape[0]):
        good[i] = used[i] and abs(polar[i, 5]) < 3.0 * scale
        if good[i]:
            count += 1
            total += polar[i, 5] ** 2
    flattening = np.sqrt(q[3] ** 2 + q[4] ** 2) / q[0]
    if count <= 5:
        return u, v, q[0], np.inf, np.inf, good, flattening
    variance = total / (count - 5) * 0.5 * (inverse[1, 1] + inverse[2, 2])
    return u, v, q[0], variance, np.sqrt(total / count), good, flattening
