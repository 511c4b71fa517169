"""Which pixels lie about the ball's rim, and which colour direction shows the rim best?

Compiled parts of `rim.fit_rim`. Pixels are rows (8,) of a float32 array `px`: 0 x = distance from
the outline (px, positive outside), 1 turn (angle / 2 pi, 0..1), 2 p = w . bgr (`project_colours`),
3-5 b, g, r (0..255), 6-7 cos, sin of the angle.
"""

from __future__ import annotations

import math

import numpy as np

from vision.compiled import fast_kernel, kernel
from vision.detection.ellipse import solve_linear

ZONE = 2.2  # where the blur ends, in its standard deviations (a box ends at 1.73)
BLUR0 = 0.9  # px, first guess
# How far light and shade, and coarsely stored colour, move the edge: px per share of the contrast.
SHADE_PX, SMEAR_PX = 0.03, 0.3
LUMA = np.array([0.114, 0.587, 0.299])  # ITU-R BT.601, in BGR order


@fast_kernel
def _angle(x, y):
    """atan2(y, x) / 2 pi in 0..1, accurate to 0.001, which suffices to tell the sector."""
    ax, ay = abs(x), abs(y)
    t = min(ax, ay) / (max(ax, ay) + 1e-12)
    a = t * (0.97239411 - 0.19194795 * t * t)
    if ay > ax:
        a = 1.5707963 - a
    if x < 0.0:
        a = 3.1415927 - a
    if y < 0.0:
        a = 6.2831853 - a
    return a * 0.15915494


@fast_kernel
def gather_pixels(image, u, v, q, lo, hi, px):
    """Write the pixels between the radii R - lo and R + hi (px) about (u, v) into `px`.

    `q` (3,) is R and the flattening (cos 2t, sin 2t) in px. Column 2 is left as it was. Returns
    their count; pixels beyond the array's length are left out.
    """
    R = q[0]
    bend = abs(q[1]) + abs(q[2])
    r_out, r_in = R + hi + bend, max(R - lo - bend, 0.0)
    h, wd = image.shape[0], image.shape[1]
    n = 0
    for i in range(max(0, int(math.ceil(v - r_out))), min(h, int(v + r_out) + 1)):
        dv = i - v
        reach = math.sqrt(max(r_out * r_out - dv * dv, 0.0))
        skip = math.sqrt(max(r_in * r_in - dv * dv, 0.0))
        j = max(0, int(math.ceil(u - reach)))
        last = min(wd - 1, int(math.floor(u + reach)))
        while j <= last:
            du = j - u
            if -skip < du < skip:
                j = max(j + 1, int(math.ceil(u + skip)))
                continue
            r = math.sqrt(du * du + dv * dv) + 1e-9
            c, s = du / r, dv / r
            px[n, 0] = r - R - q[1] * (c * c - s * s) - q[2] * 2.0 * c * s
            px[n, 1] = _angle(du, dv)
            px[n, 3] = image[i, j, 0]
            px[n, 4] = image[i, j, 1]
            px[n, 5] = image[i, j, 2]
            px[n, 6], px[n, 7] = c, s
            n += 1
            j += 1
            if n == px.shape[0]:
                return n
    return n


@fast_kernel
def zone_colours(px, n, blur, flat, mean, noise):
    """Compute the mean colours of the level zones beside the blur, and the noise within them, from
    the first n pixels of `px`.

    Writes `mean` (2, k, 4): side (0 inside), sector, (count, b, g, r), and `noise` (3, 3), the
    covariance of bgr within sectors. `blur` (k,) and the zones' width `flat` in px. Returns the
    share of pixels that are clipped at either end of the range.
    """
    k = blur.size
    mean[:] = 0.0
    noise[:] = 0.0
    clipped, seen = 0, 1
    for m in range(n):
        x = px[m, 0]
        sector = min(int(px[m, 1] * k), k - 1)
        far = abs(x) - ZONE * blur[sector] - 0.4
        if far < 0.0 or far > flat:
            continue
        row = mean[0 if x < 0.0 else 1, sector]
        row[0] += 1.0
        seen += 1
        top = max(px[m, 3], px[m, 4], px[m, 5])
        if top > 253.0 or min(px[m, 3], px[m, 4], px[m, 5]) < 2.0:
            clipped += 1
        for c in range(3):
            row[1 + c] += px[m, 3 + c]
            for e in range(c + 1):
                noise[c, e] += px[m, 3 + c] * px[m, 3 + e]
    total = 0.0
    for side in range(2):
        for i in range(k):
            row = mean[side, i]
            if row[0] > 0.0:
                total += row[0] - 1.0
                for c in range(3):
                    row[1 + c] /= row[0]
                for c in range(3):
                    for e in range(c + 1):
                        noise[c, e] -= row[0] * row[1 + c] * row[1 + e]
    for c in range(3):
        for e in range(c + 1):
            noise[c, e] /= max(total, 1.0)
            noise[e, c] = noise[c, e]
    return clipped / seen


@kernel
def best_direction(mean, noise, radius, smeared, w):
    """Write the colour direction (3,) in which the edge is located best into w.

    `mean` and `noise` are those of `zone_colours`; `radius` in px. Noise moves the centre by
    (sigma / A) sqrt(2 s / (sqrt(pi) R)) along a direction, light and shade by about SHADE_PX of
    their share of the contrast, colour that was stored coarsely (`smeared`) by SMEAR_PX of its
    share: w = (N + S)^-1 d minimises their sum, with d the mean colour inside minus outside;
    scaled so that w . d = 1. Returns False where fewer than three sectors show a side or the
    contrast is nil.
    """
    k = mean.shape[1]
    d, S = np.zeros(3), np.zeros((3, 3))
    centre, count = np.zeros((2, 3)), np.zeros(2)
    for side in range(2):
        for i in range(k):
            if mean[side, i, 0] > 0.0:
                count[side] += 1.0
                for c in range(3):
                    centre[side, c] += mean[side, i, 1 + c]
        if count[side] < 3.0:
            return False
        for c in range(3):
            centre[side, c] /= count[side]
        for i in range(k):
            if mean[side, i, 0] > 0.0:
                for c in range(3):
                    for e in range(3):
                        S[c, e] += (
                            (mean[side, i, 1 + c] - centre[side, c])
                            * (mean[side, i, 1 + e] - centre[side, e])
                            * 0.5
                            / count[side]
                        )
    for c in range(3):
        d[c] = centre[0, c] - centre[1, c]
    # Luma alone is stored in full: the colour without luma is smeared, whatever its direction.
    luma = LUMA[0] * d[0] + LUMA[1] * d[1] + LUMA[2] * d[2]
    length = LUMA[0] ** 2 + LUMA[1] ** 2 + LUMA[2] ** 2
    chroma = 0.0
    for c in range(3):
        chroma += (d[c] - luma) ** 2
    weight = math.sqrt(math.pi) * radius / (2.0 * BLUR0)
    for c in range(3):
        for e in range(3):
            S[c, e] = noise[c, e] + weight * SHADE_PX**2 * S[c, e]
            if smeared:
                across = (1.0 if c == e else 0.0) - LUMA[c] * LUMA[e] / length
                S[c, e] += weight * SMEAR_PX**2 * chroma * across
        S[c, c] += 0.3
    got, _ = solve_linear(S, d)
    power = got[0] * d[0] + got[1] * d[1] + got[2] * d[2]
    if not power > 0.0:
        return False
    for c in range(3):
        w[c] = got[c] / power
    return True


@fast_kernel
def project_colours(px, n, w):
    """Write p = w . bgr of the first n pixels of `px` into column 2; `w` (3,)."""
    for m in range(n):
        px[m, 2] = w[0] * px[m, 3] + w[1] * px[m, 4] + w[2] * px[m, 5]
