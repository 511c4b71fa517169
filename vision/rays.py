"""Compiled kernels: where the ball ends along polar rays, and the robust ellipse through it.

Everything here works on the scalar image p = w . bgr, in which the ball is bright (+) and the plate
dark (-), whatever their colours; `w` is `Appearance.direction`.
"""

from __future__ import annotations

import numba
import numpy as np

STEP = 0.5  # sampling along a ray, px
OUTER_SHARE = 0.35
HALF = 6  # half width of the derivative kernel, samples
_sigma = 2.2  # samples, i.e. 1.1 px: about the edge blur of a focused lens, so near its optimum
_taps = np.arange(1, HALF + 1)
KERNEL = np.exp(-0.5 * (_taps / _sigma) ** 2) * _taps
KERNEL /= KERNEL.sum()


@numba.njit(cache=True, fastmath=True)
def _project(image, i0, i1, j0, j1, w):
    """p (i1 - i0, j1 - j0) float32 of a window: a third of the memory for the rays to read."""
    out = np.empty((i1 - i0, j1 - j0), np.float32)
    w0, w1, w2 = np.float32(w[0]), np.float32(w[1]), np.float32(w[2])
    for i in range(i0, i1):
        for j in range(j0, j1):
            out[i - i0, j - j0] = (
                w0 * np.float32(image[i, j, 0])
                + w1 * np.float32(image[i, j, 1])
                + w2 * np.float32(image[i, j, 2])
            )
    return out


@numba.njit(cache=True)
def _sample(p, x, y):
    """p at the sub-pixel place (x, y), bilinear; NaN outside."""
    if not (x >= 0.0 and y >= 0.0 and x < p.shape[1] - 1 and y < p.shape[0] - 1):
        return np.nan
    i, j = int(y), int(x)
    fy, fx = y - i, x - j
    top = p[i, j] + (p[i, j + 1] - p[i, j]) * fx
    low = p[i + 1, j] + (p[i + 1, j + 1] - p[i + 1, j]) * fx
    return top + (low - top) * fy


@numba.njit(cache=True)
def _steepest(profile, n, r_first, r_guess, kernel, signed):
    """(radius, strength, outer radius) of the strongest and the outermost fall of n samples.

    The place is the centroid of the derivative above half its peak: unbiased for a sharp edge and
    for the symmetric ramp of motion blur alike. The outermost one has a third of the strength of
    the strongest or more; often both are the same.
    """
    half = kernel.size
    edge = np.zeros(n)
    best, peak = -1, 0.0
    for k in range(half, n - half):
        d = 0.0
        for m in range(half):
            d += kernel[m] * (profile[k - 1 - m] - profile[k + 1 + m])
        if not signed:
            d = abs(d)
        edge[k] = d  # NaN where the ray leaves the image, and then never the best
        off = (r_first + k * STEP - r_guess) / (0.5 * r_guess)
        if d > peak * (1.0 + off * off):
            peak, best = d / (1.0 + off * off), k
    if best < 0:
        return np.nan, 0.0, np.nan
    place, hi = _centroid(edge, best, half, n - half)
    outer = place
    for k in range(n - half - 2, hi + 2, -1):
        if edge[k] > OUTER_SHARE * edge[best] and edge[k] >= edge[k - 1] and edge[k] > edge[k + 1]:
            outer, _ = _centroid(edge, k, hi + 1, n - half)
            break
    return r_first + place * STEP, edge[best], r_first + outer * STEP


@numba.njit(cache=True)
def _centroid(edge, peak, first, last):
    """Centroid (samples) of edge above half its value at `peak`, and where that stretch ends."""
    floor = 0.5 * edge[peak]
    lo, hi = peak, peak
    while lo > first and edge[lo - 1] > floor:
        lo -= 1
    while hi < last - 1 and edge[hi + 1] > floor:
        hi += 1
    total, moment = 0.0, 0.0
    for k in range(lo, hi + 1):
        total += edge[k] - floor
        moment += (edge[k] - floor) * k
    return (moment / total if total > 0.0 else float(peak)), hi


@numba.njit(cache=True)
def cast(image, u, v, radius, reach, w, n_rays, signed, kernel):
    """Edge points, outermost edge points (n_rays, 2) px (NaN: none), strength (n_rays,), and how
    many rays lay inside the image.

    Rays run from (1 - reach) to (1 + reach) times `radius` about (u, v).
    """
    points, outer = np.full((n_rays, 2), np.nan), np.full((n_rays, 2), np.nan)
    strength = np.zeros(n_rays)
    half = kernel.size
    r_first = max(0.0, radius * (1.0 - reach) - half * STEP)
    n = int((radius * (1.0 + reach) - r_first) / STEP) + half + 1
    profile = np.empty(n)
    far = int(r_first + n * STEP) + 2
    i0, i1 = max(0, int(v) - far), min(image.shape[0], int(v) + far + 1)
    j0, j1 = max(0, int(u) - far), min(image.shape[1], int(u) + far + 1)
    inside = 0
    if i1 - i0 < 3 or j1 - j0 < 3:
        return points, outer, strength, inside
    p = _project(image, i0, i1, j0, j1, w)
    x0, y0 = u - j0, v - i0
    for i in range(n_rays):
        angle = 2.0 * np.pi * i / n_rays
        c, s = np.cos(angle), np.sin(angle)
        for k in range(n):
            r = r_first + k * STEP
            profile[k] = _sample(p, x0 + r * c, y0 + r * s)
        if not np.isnan(_sample(p, x0 + radius * c, y0 + radius * s)):
            inside += 1
        r, strength[i], far_r = _steepest(profile, n, r_first, radius, kernel, signed)
        points[i, 0], points[i, 1] = u + r * c, v + r * s
        outer[i, 0], outer[i, 1] = u + far_r * c, v + far_r * s
    return points, outer, strength, inside


@numba.njit(cache=True)
def _solve(A, b):
    """x of A x = b by Gauss-Jordan elimination, and A^-1; A symmetric positive definite."""
    n = A.shape[0]
    M = np.zeros((n, 2 * n + 1))
    M[:, :n] = A
    M[:, n] = b
    for i in range(n):
        M[i, n + 1 + i] = 1.0
    for i in range(n):
        M[i] /= M[i, i]
        for k in range(n):
            if k != i:
                M[k] -= M[k, i] * M[i]
    return M[:, n].copy(), M[:, n + 1 :].copy()


@numba.njit(cache=True)
def _scale(residual, used, floor):
    """Robust standard deviation of the residuals: 1.4826 median |r| over the used points."""
    values = np.abs(residual[used])
    return max(floor, 1.4826 * np.median(values)) if values.size else floor


@numba.njit(cache=True)
def _normal(points, weight, used, q, u, v, scale):
    """A (5, 5) and b (5,) of the weighted least squares about (u, v), and residuals (n,) px.

    Tukey's weights of the residuals against the ellipse q: 0 beyond 4.685 `scale`.
    """
    A, b = np.zeros((5, 5)), np.zeros(5)
    residual = np.zeros(points.shape[0])
    row = np.zeros(5)
    cut = 4.685 * scale
    for i in range(points.shape[0]):
        if not used[i]:
            continue
        du, dv = points[i, 0] - u, points[i, 1] - v
        r = np.sqrt(du * du + dv * dv) + 1e-12
        c, s = du / r, dv / r
        row[0], row[1], row[2], row[3], row[4] = 1.0, c, s, c * c - s * s, 2.0 * c * s
        e = r - (q[0] + q[3] * row[3] + q[4] * row[4])
        residual[i] = e
        if abs(e) < cut:
            t = weight[i] * (1.0 - (e / cut) ** 2) ** 2
            for m in range(5):
                b[m] += t * row[m] * r
                for o in range(5):
                    A[m, o] += t * row[m] * row[o]
    return A, b, residual


@numba.njit(cache=True)
def fit(points, weight, u, v, radius, scale, flat_std, rounds):
    """Robust ellipse r(a) = R + x cos a + y sin a + c cos 2a + s sin 2a through edge points.

    A centred ellipse (and a streak, the disc swept along a line) has even harmonics only, so the
    first harmonic is the centre's error; it is moved away and the angles are taken anew. c and s
    are held near 0 with `flat_std` (share of R), which matters when an arc is hidden. `scale` (px)
    is how far off the guess (u, v, radius) may be: the weights start there and narrow. Returns
    (u, v, R, variance per axis, rms of the inliers, inlier flags).
    """
    used = np.isfinite(points[:, 0]) & (weight > 0.0)
    q = np.zeros(5)  # in the first round the model is the guess, a circle
    q[0] = radius
    inverse = np.zeros((5, 5))
    for _ in range(rounds):
        A, b, _r = _normal(points, weight, used, q, u, v, scale)
        noise = max(scale, 0.02) ** 2
        A[0, 0] += noise / (0.3 * radius) ** 2
        b[0] += noise / (0.3 * radius) ** 2 * radius
        A[1, 1] += 1e-9
        A[2, 2] += 1e-9
        A[3, 3] += noise / (flat_std * radius) ** 2
        A[4, 4] += noise / (flat_std * radius) ** 2
        q, inverse = _solve(A, b)
        u, v = u + q[1], v + q[2]
        fresh = _after(points, used, q, u, v)
        last = scale
        scale = max(_scale(fresh, used, 0.02), 0.25 * scale)
        if scale > 0.9 * last and abs(q[1]) + abs(q[2]) < 0.01:
            break
    residual = _after(points, used, q, u, v)
    good = used & (np.abs(residual) < 3.0 * scale)
    count = good.sum()
    if count <= 5:
        return u, v, q[0], np.inf, np.inf, good
    total = np.sum(residual[good] ** 2)
    variance = total / (count - 5) * 0.5 * (inverse[1, 1] + inverse[2, 2])
    return u, v, q[0], variance, np.sqrt(total / count), good


@numba.njit(cache=True)
def _after(points, used, q, u, v):
    """Residuals (n,) px of the points against the ellipse q about its own centre (u, v)."""
    out = np.zeros(points.shape[0])
    for i in range(points.shape[0]):
        if used[i]:
            du, dv = points[i, 0] - u, points[i, 1] - v
            r = np.sqrt(du * du + dv * dv) + 1e-12
            c, s = du / r, dv / r
            out[i] = r - (q[0] + q[3] * (c * c - s * s) + q[4] * 2.0 * c * s)
    return out


@numba.njit(cache=True)
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


@numba.njit(cache=True)
def trace_rays(
    image, u, v, radius, reach, w, n_rays, signed, kernel, flat_std, blurred_std, rounds
):
    """Edges along rays about a guess and the ellipse through them (`cast`, `fit`).

    Returns an array: 0 u, 1 v, 2 radius, 3 variance per axis, 4 rms of the inliers, 5 how many, 6
    rays inside the image, 7 first harmonic of the edge's strength over its mean, 8 coverage by
    eighths with at least one in three rays good; and whether an ellipse was found.
    """
    out = np.zeros(9)
    points, outer, strength, inside = cast(image, u, v, radius, reach, w, n_rays, signed, kernel)
    typical = np.median(strength)
    if not typical > 0.0:
        return out, False
    weight = np.minimum(np.maximum((strength / typical - 0.15) / 0.35, 0.0), 1.0)
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
        covered += good[i * per : (i + 1) * per].mean() > 0.34
    out[0], out[1], out[2], out[3], out[4] = u2, v2, radius2, variance, residual
    out[5], out[6], out[8] = count, inside, covered / 8.0
    out[7] = 2.0 * np.sqrt(c * c + s * s) / total
    return out, True


@numba.njit(cache=True)
def _beyond(points, u, v, radius, used):
    """Mark as used the points (n, 2) clearly outside the circle, and not NaN."""
    for i in range(points.shape[0]):
        r = np.sqrt((points[i, 0] - u) ** 2 + (points[i, 1] - v) ** 2)
        used[i] = 1.0 if r > 1.05 * radius else 0.0


@numba.njit(cache=True)
def ring_about(image, u, v, radius, w, n_rays, kernel, flat_std, rounds):
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
        points, outer, _strength, inside = cast(
            image, u2, v2, radius2, reach, w, n_rays, False, kernel
        )
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
