"""How far each sector of the rim lies off its model, and the ellipse's motion they agree on."""

from __future__ import annotations

import math

import numpy as np

from vision.compiled import fast_kernel, kernel
from vision.ellipse import solved
from vision.rim_pixels import ZONE

_z = np.arange(600) / 50.0 - 6.0
BELL_TABLE = np.exp(-0.5 * _z**2) / math.sqrt(2.0 * math.pi)
STEP_TABLE = np.array([0.5 + 0.5 * math.erf(z / math.sqrt(2.0)) for z in _z])


@fast_kernel
def shifts_of(px, n, blur, bend, a0, a1, b0, b1, lean, out):
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


@kernel
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


@kernel
def agreed(shifts, noise, rows, q, flat_std, good):
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
        move, cov = solved(N, b)
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


@kernel
def blurs(shifts, arc, blur, most):
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
    got, _ = solved(N, b)
    for i in range(k):
        t = 6.2831853 * (i + 0.5) / k
        s2 = got[0] + got[1] * math.cos(2.0 * t) + got[2] * math.sin(2.0 * t)
        blur[i] = min(max(math.sqrt(max(s2, 0.0)), 0.45), most)


@fast_kernel
def moved_off(px, n, move):
    """Take the ellipse's small motion off the pixels' x, in place."""
    for m in range(n):
        c, s = px[m, 6], px[m, 7]
        px[m, 0] -= (
            move[0] + move[1] * c + move[2] * s + move[3] * (c * c - s * s) + move[4] * 2.0 * c * s
        )
