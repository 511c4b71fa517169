"""What do the sectors of the rim say? Their brightness levels, blur, and the ellipse's motion.

The steps of one Gauss-Newton turn of `rim.fit_rim`, compiled, in the order in which it calls them.
The symbols (x, n, p, H, a0, a1, b0, b1, s) are those of `rim`. `px` (m, 8) are the pixels of
`rim_pixels.gather_pixels`, `n` their count, k the number of sectors.
"""

from __future__ import annotations

import math

import numpy as np

from vision.compiled import fast_kernel, kernel
from vision.detection.ellipse import solve_linear
from vision.detection.rim_pixels import ZONE

_z = np.arange(600) / 50.0 - 6.0
BELL_TABLE = np.exp(-0.5 * _z**2) / math.sqrt(2.0 * math.pi)
STEP_TABLE = np.array([0.5 + 0.5 * math.erf(z / math.sqrt(2.0)) for z in _z])
WIDE = 0.07  # of a turn, to both sides: what a slope is pooled over


@fast_kernel
def level_sums(px, n, blur, flat, bend, lean, inner, outer):
    """Write sums over the level zones beside the blur, per sector, into `inner` (k, 6) and `outer`
    (k, 6).

    A row holds: count, mean f, mean p, and Sff, Sfp, Spp about the means; f is n(x) inside and x
    [px] outside. `blur` (k,) [px]; `flat`: the zones' width [px]; `bend`: 2 / R [1/px]; `lean`
    (k,): the lamp's gradient (`lamp_gradients`), which is subtracted from p inside.
    """
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
def sector_levels(sums, floor, level, slope):
    """Fit level at the edge and slope per sector into `level`, `slope` (k,) from `sums` (k, 6).

    Returns the noise variance of p, at least `floor`; NaN without samples. Slopes are pooled over
    7 % of the turn to both sides and shrunk towards a mean over a sixth to both sides; levels are
    pooled over two sectors to both sides, from which a sector departs only as far as its scatter
    exceeds the noise (James-Stein shrinkage).
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
def lamp_gradients(a0, radius, lean):
    """Write the gradient along x [per px] of the lamp's light into `lean` (k,): the light falls as
    1 - x / R, with R = `radius` [px].

    `a0` (k,) are the levels inside. The darkest sector's level is taken as light from all round,
    which does not fall off; only what exceeds it comes from the lamp.
    """
    dark = a0[0]
    for i in range(1, a0.size):
        if abs(a0[i]) < abs(dark):  # no light at all is p = 0
            dark = a0[i]
    for i in range(a0.size):
        lean[i] = (a0[i] - dark) / radius


@fast_kernel
def sector_shifts(px, n, blur, bend, a0, a1, b0, b1, lean, out):
    """Sums over the edge zone per sector, into out (k, 4).

    0 derivative times residual, 1 squared derivative (their ratio is the shift in px), 2 first
    moment of the blur, 3 squared contrast summed over the pixels. `a0, a1, b0, b1, lean` (k,) as in
    `rim`, interpolated between sectors.
    """
    k = blur.size
    out[:] = 0.0
    for m in range(n):
        x = px[m, 0]
        turn = px[m, 1] * k - 0.5
        low = int(math.floor(turn))
        part = turn - low
        i, o = low % k, (low + 1) % k
        sector = min(int(px[m, 1] * k), k - 1)
        s = blur[sector]
        if abs(x) > ZONE * s + 0.4:
            continue
        keep = 1.0 - part
        inner, outer = keep * a0[i] + part * a0[o], keep * b0[i] + part * b0[o]
        bright, fall = keep * a1[i] + part * a1[o], keep * b1[i] + part * b1[o]
        at = (x / s + 6.0) * 50.0
        cell = min(max(int(at), 0), 598)
        over = at - cell
        H = STEP_TABLE[cell] + over * (STEP_TABLE[cell + 1] - STEP_TABLE[cell])
        g = (BELL_TABLE[cell] + over * (BELL_TABLE[cell + 1] - BELL_TABLE[cell])) / s
        out_x = x * H + s * s * g  # max(x, 0), blurred
        in_n = math.sqrt(bend * max(out_x - x, 0.0))
        inner += (keep * lean[i] + part * lean[o]) * (x - out_x)
        A = inner - outer
        model = inner + bright * in_n * (1.0 - H) - A * H + fall * out_x
        e = px[m, 2] - model
        row = out[sector]
        row[0] += A * g * e
        row[1] += A * A * g * g
        sharp = outer + fall * x if x > 0.0 else inner + bright * math.sqrt(-bend * x)
        row[2] += x * (px[m, 2] - sharp) * A
        row[3] += A * A
    return


@kernel
def _lack(rest, power, good, noise_px2):
    """Power (px^2 per component) of the third and fourth harmonics in the sectors' residuals `rest`
    (k,) px beyond what their scatter gives each component, `noise_px2`.

    Light, shadows and marks that the model lacks shift sectors smoothly round the turn. Their first
    harmonic goes into the centre and cannot be seen; the first two that the ellipse does not follow
    tell how large it is. `power` (k,): roots of the sectors' weights.
    """
    k = rest.size
    total, waves = 0.0, 0.0
    for i in range(k):
        if good[i]:
            total += power[i] ** 2
    for m in range(3, 5):
        c, s = 0.0, 0.0
        for i in range(k):
            if good[i]:
                t = m * 2.0 * math.pi * (i + 0.5) / k
                c += power[i] ** 2 * rest[i] * math.cos(t)
                s += power[i] ** 2 * rest[i] * math.sin(t)
        waves += c * c + s * s
    return max(0.0, waves / max(total, 1e-9) ** 2 - noise_px2)


@kernel
def ellipse_step(shifts, noise, rows, q, flat_std, good):
    """Robust weighted least squares (Tukey's biweight) of the ellipse's motion to the shifts.

    `shifts` (k, 4) of `sector_shifts`, `noise` variance of p, `rows` (k, 5) the motion's effect on
    each sector's shift, `q` (3,) R and flattening (px), `flat_std` its prior (share of R). Returns
    the motion (5,) px (dR, du, dv, dc, ds), the centre's variance per axis (px^2, from the noise,
    scaled up where the sectors scatter more; infinite where none shows an edge), and `_lack`; fills
    `good` (k,) with the sectors used.
    """
    k = shifts.shape[0]
    d, power, left = np.zeros(k), np.zeros(k), np.zeros(k)
    for i in range(k):
        if shifts[i, 1] > 0.0:
            d[i] = shifts[i, 0] / shifts[i, 1]
            power[i] = shifts[i, 1] / noise
    typical = np.median(power)
    move, cov = np.zeros(5), np.zeros((5, 5))
    if not typical > 0.0:
        return move, np.inf, np.inf
    for i in range(k):
        # No sector counts for more than four times the usual: models err more than noise there.
        power[i] = math.sqrt(min(power[i], 4.0 * typical)) if power[i] > 0.1 * typical else 0.0
        left[i] = d[i] * power[i]
    prior = 1.0 / (flat_std * q[0]) ** 2
    cut = np.inf
    for turn in range(3):
        N, b = np.zeros((5, 5)), np.zeros(5)
        for i in range(k):
            z = left[i] / cut
            good[i] = power[i] > 0.0 and abs(z) < 1.0
            if good[i]:
                weight = (power[i] * (1.0 - z * z)) ** 2
                for m in range(5):
                    part = weight * rows[i, m]
                    b[m] += part * d[i]
                    for o in range(m + 1):
                        N[m, o] += part * rows[i, o]
        for m in range(5):
            N[m, m] += 1e-9 + (prior if m > 2 else 0.0)
            for o in range(m):
                N[o, m] = N[m, o]
        b[3] -= prior * q[1]
        b[4] -= prior * q[2]
        move, cov = solve_linear(N, b)
        for i in range(k):
            fitted = 0.0
            for m in range(5):
                fitted += rows[i, m] * move[m]
            left[i] = (d[i] - fitted) * power[i]
        if turn < 2:
            cut = 4.685 * max(1.0, 1.4826 * np.median(np.abs(left)))
    chi, count = 0.0, -5.0
    for i in range(k):
        if good[i]:
            chi += left[i] ** 2
            count += 1.0
        left[i] /= max(power[i], 1e-9)
    variance = 0.5 * (cov[1, 1] + cov[2, 2]) * max(1.0, chi / max(count, 1.0))
    return move, variance, _lack(left, power, good, variance)


@kernel
def update_blurs(shifts, rows, blur, most):
    """Update `blur` (k,) px in place: s^2 = 2 M / (A arc), as a mean and a second harmonic.

    M is the moment in `shifts`, A the contrast, `rows` (k, 5) as in `ellipse_step`, arc a
    sector's length (px); 0.45 <= s <= `most`.
    """
    k = blur.size
    N, b, row = np.zeros((3, 3)), np.zeros(3), np.ones(3)
    for i in range(k):
        row[1], row[2] = rows[i, 3], rows[i, 4]
        width = 2.0 * (ZONE * blur[i] + 0.4)  # of the zone, px: shifts[3] = A^2 arc width
        weight = shifts[i, 3] / width
        for m in range(3):
            b[m] += row[m] * 2.0 * shifts[i, 2]
            for o in range(3):
                N[m, o] += weight * row[m] * row[o]
    if not N[0, 0] > 0.0:
        return
    for m in range(3):
        N[m, m] *= 1.001
    got, _ = solve_linear(N, b)
    for i in range(k):
        s2 = got[0] + got[1] * rows[i, 3] + got[2] * rows[i, 4]
        blur[i] = min(max(math.sqrt(max(s2, 0.0)), 0.45), most)


@fast_kernel
def shift_pixels(px, n, move):
    """Subtract the ellipse's small motion `move` (5,) [px] (dR, du, dv, dc, ds) from the x of the
    first n pixels, in place."""
    for m in range(n):
        c, s = px[m, 6], px[m, 7]
        px[m, 0] -= (
            move[0] + move[1] * c + move[2] * s + move[3] * (c * c - s * s) + move[4] * 2.0 * c * s
        )
