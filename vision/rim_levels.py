"""How bright ball and plate are on the two sides of the rim, all round: levels and slopes."""

from __future__ import annotations

import math

import numpy as np

from vision.compiled import fast_kernel, kernel
from vision.rim_pixels import ZONE

WIDE = 0.07  # of a turn, to both sides: what a slope is pooled over


@fast_kernel
def sums_of_levels(px, n, blur, flat, bend, lean, inner, outer):
    """Of the level zones: per sector n, mean f, mean p, Sff, Sfp, Spp about the means, into
    inner (k, 6), where f is n(x), and outer (k, 6), where it is x."""
    k = blur.size
    inner[:] = 0.0
    outer[:] = 0.0
    for m in range(n):
        x = px[m, 0]
        sector = min(int(px[m, 1] * k), k - 1)
        far = abs(x) - ZONE * blur[sector] - 0.4
        if far < 0.0 or far > flat:
            continue
        f, p, row = x, px[m, 2], outer[sector]
        if x < 0.0:
            f, p, row = math.sqrt(-bend * x), p - lean[sector] * x, inner[sector]
        row[0] += 1.0
        row[1] += f
        row[2] += p
        row[3] += f * f
        row[4] += f * p
        row[5] += p * p
    for out in (inner, outer):
        for i in range(k):
            row = out[i]
            if row[0] > 0.0:
                row[1] /= row[0]
                row[2] /= row[0]
                row[3] -= row[0] * row[1] * row[1]
                row[4] -= row[0] * row[1] * row[2]
                row[5] -= row[0] * row[2] * row[2]


@kernel
def levels(sums, floor, level, slope):
    """Level at the edge and slope per sector; returns the noise variance, NaN without samples.

    Slopes are pooled over an eighth of the turn to both sides; levels over two sectors to both
    sides, from which a sector departs only as far as its scatter exceeds the noise (Stein).
    """
    k = sums.shape[0]
    wide = max(1, int(k * WIDE))
    spread, free = 0.0, 0.0
    strength, calm = np.empty(k), np.empty(k)
    most = max(wide, k // 6)
    for i in range(k):
        ff, fp = 1e-9, 0.0
        for d in range(-wide, wide + 1):
            ff += sums[(i + d) % k, 3]
            fp += sums[(i + d) % k, 4]
        slope[i], strength[i] = fp / ff, ff
        for d in range(wide + 1, most + 1):
            ff += sums[(i + d) % k, 3] + sums[(i - d) % k, 3]
            fp += sums[(i + d) % k, 4] + sums[(i - d) % k, 4]
        calm[i] = fp / ff
    left = np.full(k, np.nan)
    for i in range(k):
        if sums[i, 0] >= 4.0:
            rest = sums[i, 5] - 2.0 * slope[i] * sums[i, 4] + slope[i] ** 2 * sums[i, 3]
            left[i] = rest / (sums[i, 0] - 1.0)
    seen = left[np.isfinite(left)]
    noise = max(np.median(seen), floor) if seen.size else np.nan
    part = wide / most  # of the calm slope's noise is the near one's own
    steep, apart, chance = 1e-12, 1e-12, 0.0
    for i in range(k):
        steep += calm[i] ** 2
        apart += (slope[i] - calm[i]) ** 2
        chance += noise / strength[i]
    keep = max(0.0, 1.0 - chance * (1.0 - part) / apart)
    calmer = max(0.0, 1.0 - chance * part / steep)
    for i in range(k):
        slope[i] = calmer * calm[i] + keep * (slope[i] - calm[i])
        level[i] = sums[i, 2] - slope[i] * sums[i, 1]
    smooth = np.zeros(k)
    for i in range(k):
        total, count = 0.0, 1e-9
        for d in range(-2, 3):
            m = (i + d) % k
            total += sums[m, 0] * level[m]
            count += sums[m, 0]
        smooth[i] = total / count
        if sums[i, 0] >= 4.0:
            spread += (level[i] - smooth[i]) ** 2
            free += 0.8 * noise / sums[i, 0]
    keep = max(0.0, 1.0 - free / spread) if spread > 0.0 else 0.0
    for i in range(k):
        trust = keep if sums[i, 0] >= 4.0 else 0.0
        level[i] = smooth[i] + trust * (level[i] - smooth[i])
    return noise


@kernel
def lamp_falls(a0, radius, lean):
    """Fall per px of the lamp's light along x: its share of the rim's level turns away as 1 - x/R.

    What the darkest sector shows comes from all round and does not fall off.
    """
    dark = a0[0]
    for i in range(1, a0.size):
        if abs(a0[i]) < abs(dark):  # no light at all is p = 0
            dark = a0[i]
    for i in range(a0.size):
        lean[i] = (a0[i] - dark) / radius
