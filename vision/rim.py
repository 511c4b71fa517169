"""The ball's edge to a hundredth of a pixel: a model of the rim, fitted to all its pixels.

Along the radius x (0 on the outline) the projected image is modelled as

    p(x) = [a0 + a1 n(x)] (1 - H) + [b0 + b1 x] H,   H = Phi(x / s),   n(x) = sqrt(2 |x| / R)

a sphere that turns away from the light as n does, a plate whose shade (the ball's own shadow) may
fall off beside it, and a blur s. Levels and slopes are taken in sectors, so light may differ all
round; s^2 may have a second harmonic, as motion gives it. What is left, times the edge's own
derivative, is each sector's shift d (Gauss-Newton), and the ellipse moves by what they agree on:

    d(t) = dR + du cos t + dv sin t + dc cos 2t + ds sin 2t

With known levels this is the maximum likelihood estimate; slopes keep a gradient beside the edge
from pulling at it, which is what biases a gradient's peak. Everything here is compiled, and in one
file because of it: numba's cache of `polish` would not notice a change of a helper in another.
"""

from __future__ import annotations

import math

import numba
import numpy as np

ARC_PX = 6.0  # a sector's length
# px of plain ball and plate beside the blur from which levels are taken; more where noise asks.
FLAT, FLAT_MOST, FLAT_BY_NOISE = 3.0, 7.0, 40.0
WIDE = 0.07  # of a turn, to both sides: what a slope is pooled over
ZONE = 2.2  # where the blur ends, in its standard deviations (a box ends at 1.73)
BLUR0 = 0.9  # px, first guess
SHADE_PX = 0.03
SMEAR_PX = 0.3
_z = np.arange(600) / 50.0 - 6.0
BELL_TABLE = np.exp(-0.5 * _z**2) / math.sqrt(2.0 * math.pi)
STEP_TABLE = np.array([0.5 + 0.5 * math.erf(z / math.sqrt(2.0)) for z in _z])
LUMA = np.array([0.114, 0.587, 0.299])


@numba.njit(cache=True)
def _solved(A, b):
    """x of A x = b and A^-1 by Gauss-Jordan; A symmetric positive definite."""
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


@numba.njit(cache=True, fastmath=True)
def _angle(x, y):
    """atan2(y, x) / 2 pi in 0..1 to 0.001: enough to tell the sector."""
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


@numba.njit(cache=True, fastmath=True)
def _gather(image, u, v, q, lo, hi, px):
    """Pixels between the radii R - lo and R + hi: rows (x, turn 0..1, -, b, g, r,
    cos, sin) into px; their count."""
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


@numba.njit(cache=True, fastmath=True)
def _colours(px, n, blur, flat, mean, noise):
    """Of the level zones: mean colours per side and sector into mean (2, k, 4: n, b, g, r), the
    covariance within sectors into noise (3, 3). Returns the share of pixels at the range's ends."""
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


@numba.njit(cache=True)
def _direction(mean, noise, radius, smeared, w):
    """The colour direction (3,) in which the edge is best located, into w; False where none is.

    Noise moves the centre by (sigma / A) sqrt(2 s / (sqrt(pi) R)) along a direction, light and
    shade by about SHADE_PX of their share of the contrast, colour that was stored coarsely
    (`smeared`) by SMEAR_PX of its share: w = (N + S)^-1 d makes their sum least.
    """
    k = mean.shape[1]
    d, S = np.zeros(3), np.zeros((3, 3))
    centre, count = np.zeros((2, 3)), np.zeros(2)
    for side in range(2):
        for i in range(k):
            if mean[side, i, 0] > 0.0:
                count[side] += 1.0
                centre[side] += mean[side, i, 1:]
        if count[side] < 3.0:
            return False
        centre[side] /= count[side]
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
    d[:] = centre[0] - centre[1]
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
    got, _ = _solved(S, d)
    power = got[0] * d[0] + got[1] * d[1] + got[2] * d[2]
    if not power > 0.0:
        return False
    w[:] = got / power
    return True


@numba.njit(cache=True, fastmath=True)
def _project(px, n, w):
    for m in range(n):
        px[m, 2] = w[0] * px[m, 3] + w[1] * px[m, 4] + w[2] * px[m, 5]


@numba.njit(cache=True, fastmath=True)
def _sums(px, n, blur, flat, bend, lean, inner, outer):
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


@numba.njit(cache=True)
def _levels(sums, floor, level, slope):
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


@numba.njit(cache=True, fastmath=True)
def _shifts(px, n, blur, bend, a0, a1, b0, b1, lean, out):
    """Per sector into out (k, 6): sum of derivative times residual, of its square, the moment of
    the blur, the squared contrast that it was seen with, and the first two inside x = 0 alone."""
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
        if x < 0.0:
            row[4] += A * g * e
            row[5] += A * A * g * g
        sharp = outer + fall * x if x > 0.0 else inner + bright * math.sqrt(-bend * x)
        row[2] += x * (px[m, 2] - sharp) * A
        row[3] += A * A
    return


@numba.njit(cache=True)
def _lit(a0, radius, lean):
    """Fall per px of the lamp's light along x: its share of the rim's level turns away as 1 - x/R.

    What the darkest sector shows comes from all round and does not fall off.
    """
    dark = a0[0]
    for i in range(1, a0.size):
        if abs(a0[i]) < abs(dark):  # no light at all is p = 0
            dark = a0[i]
    for i in range(a0.size):
        lean[i] = (a0[i] - dark) / radius


@numba.njit(cache=True)
def _halves_apart(shifts, power, good, rows, cov):
    """Mean square per axis (px^2) of how far the centre seen in the inner halves of the edge lies
    from that seen in the outer halves: what the model lacks moves the two differently."""
    b = np.zeros(5)
    for i in range(shifts.shape[0]):
        s0, s1 = shifts[i, 4], shifts[i, 5]
        o0, o1 = shifts[i, 0] - s0, shifts[i, 1] - s1
        if good[i] and s1 > 0.1 * shifts[i, 1] and o1 > 0.1 * shifts[i, 1]:
            weight = power[i] ** 2 * (s0 / s1 - o0 / o1)
            for m in range(5):
                b[m] += weight * rows[i, m]
    du, dv = 0.0, 0.0
    for m in range(5):
        du += cov[1, m] * b[m]
        dv += cov[2, m] * b[m]
    return 0.5 * (du * du + dv * dv)


@numba.njit(cache=True)
def _agreed(shifts, noise, rows, q, flat_std, good):
    """The ellipse's motion (5,) that the sectors agree on (Tukey's weights), the centre's variance
    per axis, the rms of the residuals over what the noise explains, and `_halves_apart`; `good`
    (k,) is filled.

    `rows` (k, 5) are the motion's effects on each sector's shift.
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
        return move, np.inf, np.inf, np.inf
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
        move, cov = _solved(N, b)
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
    apart = _halves_apart(shifts, power, good, rows, cov)
    return move, 0.5 * (cov[1, 1] + cov[2, 2]), math.sqrt(chi / max(count, 1.0)), apart


@numba.njit(cache=True)
def _blurs(shifts, arc, blur, most):
    """New blur per sector: s^2 = 2 M / (A arc) as a mean and, where it shows, a second harmonic."""
    k = blur.size
    N, b = np.zeros((3, 3)), np.zeros(3)
    row = np.empty(3)
    contrast = 0.0
    for i in range(k):
        contrast += shifts[i, 3] / k
    for i in range(k):
        t = 6.2831853 * (i + 0.5) / k
        row[0], row[1], row[2] = 1.0, math.cos(2.0 * t), math.sin(2.0 * t)
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
    got, _ = _solved(N, b)
    for i in range(k):
        t = 6.2831853 * (i + 0.5) / k
        s2 = got[0] + got[1] * math.cos(2.0 * t) + got[2] * math.sin(2.0 * t)
        blur[i] = min(max(math.sqrt(max(s2, 0.0)), 0.45), most)


@numba.njit(cache=True, fastmath=True)
def _moved(px, n, move):
    """Take the ellipse's small motion off the pixels' x, in place."""
    for m in range(n):
        c, s = px[m, 6], px[m, 7]
        px[m, 0] -= (
            move[0] + move[1] * c + move[2] * s + move[3] * (c * c - s * s) + move[4] * 2.0 * c * s
        )


@numba.njit(cache=True)
def polish(image, u, v, radius, guess_px, flat_std, smeared, rounds):
    """The outline refined from a guess (u, v, radius) within about a pixel of it.

    `image` (h, w, 3) uint8; `guess_px` the blur to start with; `smeared` colour differences are
    stored coarsely. Returns an array: 0 u, 1 v, 2 radius, 3 variance of the centre per axis from
    noise alone (infinite: failed), 4 what is left over that noise, 5 share of good sectors, 6 mean
    blur, 7 how far apart the halves of the edge see the centre (`_halves_apart`, px^2), 8 share of
    clipped pixels, 9 whether the blur was too wide to be trusted, 10-12 and 13-15 mean BGR inside
    and outside.
    """
    out = np.zeros(16)
    out[0], out[1], out[2], out[3] = u, v, radius, np.inf
    k = 8 * max(1, min(6, int(round(2.0 * math.pi * radius / ARC_PX / 8.0))))
    q = np.array([radius, 0.0, 0.0])
    most = 0.12 * radius + 0.6
    blur = np.full(k, min(max(guess_px, 0.45), most))
    px = np.empty((0, 8), np.float32)
    inner, outer, shifts = np.empty((k, 6)), np.empty((k, 6)), np.empty((k, 6))
    a0, a1, b0, b1 = np.empty(k), np.empty(k), np.empty(k), np.empty(k)
    lean = np.zeros(k)
    good, rows, variance = np.zeros(k, np.bool_), np.ones((k, 5)), np.inf
    for i in range(k):
        t = 2.0 * math.pi * (i + 0.5) / k
        rows[i, 1], rows[i, 2] = math.cos(t), math.sin(t)
        rows[i, 3], rows[i, 4] = math.cos(2.0 * t), math.sin(2.0 * t)
    mean, colour, w = np.empty((2, k, 4)), np.empty((3, 3)), np.zeros(3)
    floor, flat, n, held, step, bend = 0.0, FLAT, 0, -1.0, 1.0, 2.0 / radius
    for turn in range(rounds):
        far = ZONE * blur.max() + 0.4 + flat
        if far > held:
            held = far + 0.7
            room = int(13.0 * (q[0] + 2.0) * (held + abs(q[1]) + abs(q[2]))) + 200
            if room > px.shape[0]:  # small enough for the heap: fresh pages cost more than the work
                px = np.empty((room, 8), np.float32)
            n = _gather(image, u, v, q, min(held, 0.7 * q[0]), held, px)
            if turn > 0:
                _project(px, n, w)
        bend = 2.0 / q[0]
        if turn == 0 or (turn == 1 and step > 0.1):
            out[8] = _colours(px, n, blur, flat, mean, colour)
            if not _direction(mean, colour, radius, smeared, w):
                return out
            floor = 0.1 * (w[0] ** 2 + w[1] ** 2 + w[2] ** 2)
            _project(px, n, w)
        _sums(px, n, blur, flat, bend, lean, inner, outer)
        noise = 0.5 * (_levels(inner, floor, a0, a1) + _levels(outer, floor, b0, b1))
        if not noise > 0.0:
            return out
        # In p the contrast is 1: the noisier, the more pixels must speak for the levels.
        flat = min(FLAT + FLAT_BY_NOISE * math.sqrt(noise), FLAT_MOST)
        _shifts(px, n, blur, bend, a0, a1, b0, b1, lean, shifts)
        _lit(a0, q[0], lean)
        move, variance, out[4], out[7] = _agreed(shifts, noise, rows, q, flat_std, good)
        step = math.sqrt(move[1] ** 2 + move[2] ** 2)
        if not (step < 0.3 * radius + 1.0 and 0.6 * radius < q[0] + move[0] < 1.5 * radius):
            return out
        u, v = u + move[1], v + move[2]
        q[0] += move[0]
        q[1] += move[3]
        q[2] += move[4]
        if step + abs(move[0]) > 0.4:
            held = -1.0
        else:
            _moved(px, n, move)
        wide = blur.mean()
        _blurs(shifts, 2.0 * math.pi * q[0] / k, blur, most)
        if turn > 0 and step < 0.03 and abs(blur.mean() - wide) < 0.15 * wide:
            break
    out[0], out[1], out[2], out[3], out[5], out[6] = u, v, q[0], variance, good.mean(), blur.mean()
    out[9] = 1.0 if blur.max() >= most else 0.0
    for c in range(3):
        out[10 + c] = _mean_of(mean, 0, c)
        out[13 + c] = _mean_of(mean, 1, c)
    return out


@numba.njit(cache=True)
def _mean_of(mean, side, c):
    """Mean over the sectors of one side's channel c."""
    total, count = 0.0, 1e-9
    for i in range(mean.shape[1]):
        if mean[side, i, 0] > 0.0:
            total += mean[side, i, 1 + c]
            count += 1.0
    return total / count


def colour_is_smeared(image: np.ndarray, u_px: float, v_px: float, radius_px: float) -> bool:
    """Whether colour differences blur the edge more than brightness does (4:2:0 and the like)."""
    blurs = []
    for smeared in (False, True):
        place = float(u_px), float(v_px), float(radius_px)
        got = polish(image, *place, BLUR0, 0.03, smeared, 4)
        blurs.append(float(got[6]) if np.isfinite(got[3]) else 0.0)
    return blurs[1] > 0.0 and blurs[0] > 1.2 * blurs[1]
