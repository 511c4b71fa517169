"""Where does the ball end along rays from a guess? Compiled.

Everything here works on the scalar image p = w . bgr, in which the ball is bright (+) and the plate
dark (-), whatever their colours; `w` (3,) is `Appearance.direction`. The edge is the centroid of
the derivative of a Gaussian (sigma 1.1 px) of the profile along the ray.
"""

from __future__ import annotations

import numpy as np

from vision.compiled import fast_kernel, kernel

STEP = 0.5  # sampling along a ray, px
OUTER_SHARE = 0.35  # of the strongest edge's strength, from which another one farther out counts
HALF = 6  # half width of the derivative kernel, samples
_sigma = 2.2  # samples, i.e. 1.1 px: about the edge blur of a focused lens, so near its optimum
_taps = np.arange(1, HALF + 1)
KERNEL = np.exp(-0.5 * (_taps / _sigma) ** 2) * _taps
KERNEL /= KERNEL.sum()


@fast_kernel
def _project(image, i0, i1, j0, j1, w):
    """p (i1 - i0, j1 - j0) float32 of a window of the image (h, w, 3) uint8."""
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


@kernel
def _holds(p, x, y):
    """Whether the place (x, y) px lies in p (h, w)."""
    return x >= 0.0 and y >= 0.0 and x < p.shape[1] - 1 and y < p.shape[0] - 1


@kernel
def _sample(p, x, y):
    """p at the sub-pixel place (x, y) px in it, bilinear."""
    i, j = int(y), int(x)
    fy, fx = y - i, x - j
    top = p[i, j] + (p[i, j + 1] - p[i, j]) * fx
    low = p[i + 1, j] + (p[i + 1, j + 1] - p[i + 1, j]) * fx
    return top + (low - top) * fy


@kernel
def _steepest(profile, n, r_first, far, edge, signed):
    """(radius, strength, outer radius) of the strongest and the outermost fall of n samples (px).

    `far` (n,): what divides the strength at each sample; `edge` (n,) is room to work in. The place
    is the centroid of the derivative above half its peak: unbiased for a sharp edge and for the
    symmetric ramp of motion blur alike. The outermost fall has at least `OUTER_SHARE` of the
    strongest one's strength; often both are the same.
    """
    half = HALF
    best, peak = -1, 0.0
    fall = edge[half : n - half]
    fall[:] = 0.0
    for m in range(half):  # tap by tap, on slices: these loops run in vector registers
        near, away, tap = profile[half - 1 - m :], profile[half + 1 + m :], KERNEL[m]
        for k in range(n - 2 * half):
            fall[k] += tap * (near[k] - away[k])
    for k in range(half, n - half):
        if not signed:
            edge[k] = abs(edge[k])
        if edge[k] > peak * far[k]:  # NaN where the ray leaves the image, and then never the best
            peak, best = edge[k] / far[k], k
    if best < 0:
        return np.nan, 0.0, np.nan
    place, hi = _centroid(edge, best, half, n - half)
    outer = place
    for k in range(n - half - 2, hi + 2, -1):
        if edge[k] > OUTER_SHARE * edge[best] and edge[k] >= edge[k - 1] and edge[k] > edge[k + 1]:
            outer, _ = _centroid(edge, k, hi + 1, n - half)
            break
    return r_first + place * STEP, edge[best], r_first + outer * STEP


@kernel
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


@kernel
def cast_rays(image, u, v, radius, reach, w, n_rays, signed):
    """Edge points along `n_rays` rays about (u, v) px in an image (h, w, 3) uint8.

    Rays run from (1 - reach) to (1 + reach) times `radius` px; `w` (3,): direction in colour space
    in which edges are taken (p = w . bgr); `signed` takes falls of p only, else edges of either
    sign. Returns the strongest and the outermost edge of each ray (n_rays, 2) px (NaN: none), the
    strength (n_rays,), and how many rays lay inside the image.
    """
    points, outer = np.full((n_rays, 2), np.nan), np.full((n_rays, 2), np.nan)
    strength = np.zeros(n_rays)
    half = HALF
    r_first = max(0.0, radius * (1.0 - reach) - half * STEP)
    n = int((radius * (1.0 + reach) - r_first) / STEP) + half + 1
    profile, edge, far = np.empty(n), np.zeros(n), np.empty(n)
    for k in range(n):
        far[k] = 1.0 + ((r_first + k * STEP - radius) / (0.5 * radius)) ** 2
    room = int(r_first + n * STEP) + 2
    i0, i1 = max(0, int(v) - room), min(image.shape[0], int(v) + room + 1)
    j0, j1 = max(0, int(u) - room), min(image.shape[1], int(u) + room + 1)
    inside = 0
    if i1 - i0 < 3 or j1 - j0 < 3:
        return points, outer, strength, inside
    p = _project(image, i0, i1, j0, j1, w)
    x0, y0 = u - j0, v - i0
    for i in range(n_rays):
        angle = 2.0 * np.pi * i / n_rays
        c, s = np.cos(angle), np.sin(angle)
        last = r_first + (n - 1) * STEP
        whole = _holds(p, x0 + r_first * c, y0 + r_first * s) and _holds(
            p, x0 + last * c, y0 + last * s
        )
        for k in range(n):
            x, y = x0 + (r_first + k * STEP) * c, y0 + (r_first + k * STEP) * s
            profile[k] = _sample(p, x, y) if whole or _holds(p, x, y) else np.nan
        inside += whole or _holds(p, x0 + radius * c, y0 + radius * s)
        r, strength[i], far_r = _steepest(profile, n, r_first, far, edge, signed)
        points[i, 0], points[i, 1] = u + r * c, v + r * s
        outer[i, 0], outer[i, 1] = u + far_r * c, v + far_r * s
    return points, outer, strength, inside
