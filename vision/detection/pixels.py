"""Which colours, and which P(ball), do the pixels in and around a disc have? Compiled kernels.

`image` is (h, w, 3) uint8 BGR, `table` (32768,) uint8 the table of `Appearance`; places and radii
are in px. Large discs are sampled every few pixels, so that the cost stays bounded.
"""

from __future__ import annotations

import math

import numpy as np

from vision.compiled import kernel
from vision.detection.ellipse import solve_linear

LUMA = np.array([0.114, 0.587, 0.299])  # ITU-R BT.601, in BGR order


@kernel
def colour_moments(image, u, v, r_in, r_out):
    """Count, mean (3,) and covariance (3, 3) of the colours at distances r_in <= r < r_out from (u,
    v); all 0 where there are no pixels."""
    h, wd, _ = image.shape
    total, mean, cov = 0, np.zeros(3), np.zeros((3, 3))
    step = max(1, int(r_out / 12.0))
    for i in range(max(0, int(v - r_out)), min(h, int(v + r_out) + 2), step):
        for j in range(max(0, int(u - r_out)), min(wd, int(u + r_out) + 2), step):
            d = (i - v) ** 2 + (j - u) ** 2
            if r_in * r_in <= d < r_out * r_out:
                total += 1
                for c in range(3):
                    mean[c] += image[i, j, c]
                    for e in range(3):
                        cov[c, e] += float(image[i, j, c]) * image[i, j, e]
    if total:
        mean /= total
        for c in range(3):
            for e in range(3):
                cov[c, e] = cov[c, e] / total - mean[c] * mean[e]
    return total, mean, cov


@kernel
def fisher(image, u, v, r_ball, r_in, r_out, floor, smear):
    """Mean colours (3,) nearer than `r_ball` px and from `r_in` to `r_out`, direction (3,) and
    separation between them: Fisher's discriminant.

    direction = S^-1 d / (d' S^-1 d), d = ball - surround, S = scatter of both + `floor`^2 (grey
    levels); separation = sqrt(d' S^-1 d). Colour that is stored coarsely, as by JPEG, scatters by
    `smear` times its share of d, but for luma (ITU-R BT.601), which is stored in full.
    """
    n_ball, ball, ball_scatter = colour_moments(image, u, v, 0.0, r_ball)
    n_ring, ring, ring_scatter = colour_moments(image, u, v, r_in, r_out)
    if n_ball < 4 or n_ring < 4:
        return ball, ring, np.full(3, 1e-3), 0.0
    step = ball - ring
    scatter = 0.5 * (ball_scatter + ring_scatter)
    for c in range(3):
        scatter[c, c] += floor * floor
    if smear > 0.0:
        luma, length, chroma = 0.0, 0.0, 0.0
        for c in range(3):
            luma += LUMA[c] * step[c]
            length += LUMA[c] ** 2
        for c in range(3):
            chroma += (step[c] - luma) ** 2
        for c in range(3):
            for e in range(3):
                across = (1.0 if c == e else 0.0) - LUMA[c] * LUMA[e] / length
                scatter[c, e] += smear * smear * chroma * across
    whitened, _ = solve_linear(scatter, step)
    power = 0.0
    for c in range(3):
        power += step[c] * whitened[c]
    power = max(power, 1e-9)
    return ball, ring, whitened / power, math.sqrt(power)


@kernel
def turn_steps(image, u, v, radius, floor):
    """Steps (8,) between just inside and just outside a disc (px), by eighths of its turn, sorted,
    in standard deviations of the colour channel that steps most; 0 where there are no pixels.

    The scatter is that within the eighths, and at least `floor` grey levels: a ball that is lit
    above and shaded below its plate's brightness differs from it all round, not in the mean.
    """
    h, wd, _ = image.shape
    gap, step = 0.5 + 0.04 * radius, max(1, int(radius / 12.0))
    count, mean = np.zeros((2, 8)), np.zeros((2, 8, 3))
    square, reach = np.zeros(3), 1.35 * radius + 1.0
    for i in range(max(0, int(v - reach)), min(h, int(v + reach) + 2), step):
        for j in range(max(0, int(u - reach)), min(wd, int(u + reach) + 2), step):
            d = math.sqrt((i - v) ** 2 + (j - u) ** 2)
            if d < 0.6 * radius or d >= reach or abs(d - radius) < gap:
                continue
            side = 1 if d > radius else 0
            part = int((math.atan2(i - v, j - u) / (2.0 * math.pi) + 1.0) * 8.0) % 8
            count[side, part] += 1.0
            for c in range(3):
                mean[side, part, c] += image[i, j, c]
                square[c] += float(image[i, j, c]) ** 2
    steps, total = np.zeros(8), max(count.sum(), 1.0)
    for c in range(3):
        within = square[c]
        for part in range(8):
            for side in range(2):
                within -= mean[side, part, c] ** 2 / max(count[side, part], 1.0)
        sigma = math.sqrt(max(within, 0.0) / total + floor * floor)
        for part in range(8):
            if count[0, part] > 0.0 and count[1, part] > 0.0:
                a, b = mean[0, part, c] / count[0, part], mean[1, part, c] / count[1, part]
                steps[part] = max(steps[part], abs(a - b) / sigma)
    return np.sort(steps)


@kernel
def relief(image, u, v, radius):
    """How much the brightness in a disc (px) varies as that of a solid does, share of its mean.

    Standard deviation of the least-squares fit a + b x + c y + d (x^2 + y^2) over the inner 0.8 of
    the disc, about its centre; the terms are orthogonal over a whole disc once their means are
    taken off. Noise and texture hardly enter; 0 where there are too few pixels.
    """
    h, wd, _ = image.shape
    reach, step = 0.8 * radius, max(1, int(radius / 10.0))
    n, sums, squares, products = 0, np.zeros(4), np.zeros(3), np.zeros(3)
    for i in range(max(0, int(v - reach)), min(h, int(v + reach) + 2), step):
        for j in range(max(0, int(u - reach)), min(wd, int(u + reach) + 2), step):
            x, y = j - u, i - v
            d = x * x + y * y
            if d > reach * reach:
                continue
            light = (float(image[i, j, 0]) + image[i, j, 1] + image[i, j, 2]) / 3.0
            n += 1
            sums[3] += light
            for k in range(3):
                term = x if k == 0 else y if k == 1 else d / radius
                sums[k] += term
                squares[k] += term * term
                products[k] += term * light
    if n < 8:
        return 0.0
    explained = 0.0
    for k in range(3):
        along = products[k] / n - sums[k] * sums[3] / (n * n)
        explained += along * along / max(squares[k] / n - (sums[k] / n) ** 2, 1e-9)
    return math.sqrt(explained) / max(sums[3] / n, 1.0)


@kernel
def unevenness(image, u, v, radius):
    """How much the brightness in a disc spreads about its median, share of that: 1.4826 times the
    median absolute deviation over the inner 0.8 of the disc, so that what covers less than half of
    it hardly enters; infinite where there are too few pixels."""
    h, wd, _ = image.shape
    reach, step = 0.8 * radius, max(1, int(radius / 10.0))
    light = np.empty((int(2.0 * reach / step) + 3) ** 2)
    n = 0
    for i in range(max(0, int(v - reach)), min(h, int(v + reach) + 2), step):
        for j in range(max(0, int(u - reach)), min(wd, int(u + reach) + 2), step):
            if (i - v) ** 2 + (j - u) ** 2 <= reach * reach:
                light[n] = (float(image[i, j, 0]) + image[i, j, 1] + image[i, j, 2]) / 3.0
                n += 1
    if n < 8:
        return np.inf
    middle = np.median(light[:n])
    return 1.4826 * np.median(np.abs(light[:n] - middle)) / max(middle, 1.0)


@kernel
def company(image, u, v, r_in, r_out, surround, direction):
    """Share (0..1) of the pixels at distances r_in <= r < r_out px from (u, v) that look more like
    the disc than like its `surround` (3,), along `direction` (3,) of `fisher`: what half of the
    eighths of the turn have at least. A shadow, or a thing beside the disc, fills fewer.
    """
    h, wd, _ = image.shape
    total, alike = np.zeros(8), np.zeros(8)
    step = max(1, int(r_out / 20.0))
    for i in range(max(0, int(v - r_out)), min(h, int(v + r_out) + 2), step):
        for j in range(max(0, int(u - r_out)), min(wd, int(u + r_out) + 2), step):
            d = (i - v) ** 2 + (j - u) ** 2
            if r_in * r_in <= d < r_out * r_out:
                share = 0.0
                for c in range(3):
                    share += (image[i, j, c] - surround[c]) * direction[c]
                part = int((math.atan2(i - v, j - u) / (2.0 * math.pi) + 1.0) * 8.0) % 8
                total[part] += 1.0
                alike[part] += share > 0.5
    return np.sort(alike / np.maximum(total, 1.0))[4]


@kernel
def _entry(image, i, j):
    """Where a pixel's colour stands in the table."""
    b, g, r = image[i, j, 0] >> 3, image[i, j, 1] >> 3, image[i, j, 2] >> 3
    return (int(b) << 10) | (int(g) << 5) | int(r)


@kernel
def mean_probability(image, table, u, v, r_in, r_out):
    """Mean P(ball) (0..1) of the pixels at distances r_in <= r < r_out from (u, v); 0 where there
    are none."""
    h, wd, _ = image.shape
    total, hits = 0, 0.0
    step = max(1, int(r_out / 10.0))
    for i in range(max(0, int(v - r_out)), min(h, int(v + r_out) + 2), step):
        for j in range(max(0, int(u - r_out)), min(wd, int(u + r_out) + 2), step):
            d = (i - v) ** 2 + (j - u) ** 2
            if r_in * r_in <= d < r_out * r_out:
                total += 1
                hits += table[_entry(image, i, j)]
    return hits / total / 255.0 if total else 0.0


@kernel
def adapted_table(table, image, u, v, radius, rate):
    """The table (32768,) with the colours of the disc raised and those of its surround lowered.

    Each sampled pixel moves its colour's entry by `rate` (0..1) towards 255 or 0; the disc comes
    last, so that a thing of the ball's colour beside it does not remove that colour.
    """
    out = table.copy()
    h, wd, _ = image.shape
    step = max(1, int(radius / 8.0))
    reach = 2.0 * radius + 2.0
    for disc in (False, True):
        for i in range(max(0, int(v - reach)), min(h, int(v + reach) + 2), step):
            for j in range(max(0, int(u - reach)), min(wd, int(u + reach) + 2), step):
                d = math.sqrt((i - v) ** 2 + (j - u) ** 2)
                if d > 0.85 * radius if disc else not 1.25 * radius + 1.0 < d < reach:
                    continue
                c = _entry(image, i, j)
                aim = 255.0 if disc else 0.0
                out[c] = np.uint8(out[c] + rate * (aim - out[c]))
    return out


@kernel
def probability_map(image, table, step):
    """255 P(ball) of every `step`-th pixel, (h // step, w // step) uint8."""
    h, wd = image.shape[0] // step, image.shape[1] // step
    out = np.empty((h, wd), np.uint8)
    for i in range(h):
        for j in range(wd):
            out[i, j] = table[_entry(image, i * step, j * step)]
    return out


@kernel
def update_map(image, table, known, row, rows, step, gain, u, v, radius, least):
    """Update `rows` rows of the map `known` (h / step, w / step) float32 in place, from `row` on.

    Each cell moves by its row's `gain` towards 1 where its pixel's table value exceeds `least`,
    else towards 0; rows wrap round at the end. Cells within `radius` of (u, v) stay; these three
    are in cells.
    """
    h, w = known.shape
    for m in range(rows):
        i = (row + m) % h
        share = gain[i]
        for j in range(w):
            if (i - v) ** 2 + (j - u) ** 2 <= radius * radius:
                continue
            seen = 1.0 if table[_entry(image, i * step, j * step)] > least else 0.0
            known[i, j] += share * (seen - known[i, j])
