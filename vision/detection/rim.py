"""The ball's edge to a hundredth of a pixel: a model of the rim, fitted to all its pixels.

Along the radius x (0 on the outline) the projected image is modelled as

    p(x) = [a0 + a1 n(x)] (1 - H) + [b0 + b1 x] H,   H = Phi(x / s),   n(x) = sqrt(2 |x| / R)

a sphere that turns away from the light as n does, a plate whose shade (the ball's own shadow) may
fall off beside it, and a blur s. Levels and slopes are taken in sectors, so light may differ all
round; s^2 may have a second harmonic, as motion gives it. What is left, times the edge's own
derivative, is each sector's shift d (Gauss-Newton), and the ellipse moves by what they agree on:

    d(t) = dR + du cos t + dv sin t + dc cos 2t + ds sin 2t

With known levels this is the maximum likelihood estimate; slopes keep a gradient beside the edge
from pulling at it, which is what biases a gradient's peak. The steps are compiled: `rim_pixels`,
`rim_levels` and `rim_shift`, in the order in which a turn takes them.
"""

from __future__ import annotations

import math

import numpy as np

from vision.compiled import kernel
from vision.rim_levels import lamp_falls, levels, sums_of_levels
from vision.rim_pixels import BLUR0, ZONE, best_direction, colours, gather, project
from vision.rim_shift import agreed, blurs, moved_off, shifts_of

ARC_PX = 6.0  # a sector's length
# px of plain ball and plate beside the blur from which levels are taken; more where noise asks.
FLAT, FLAT_MOST, FLAT_BY_NOISE = 3.0, 7.0, 40.0


@kernel
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
            n = gather(image, u, v, q, min(held, 0.7 * q[0]), held, px)
            if turn > 0:
                project(px, n, w)
        bend = 2.0 / q[0]
        if turn == 0 or (turn == 1 and step > 0.1):
            out[8] = colours(px, n, blur, flat, mean, colour)
            if not best_direction(mean, colour, radius, smeared, w):
                return out
            floor = 0.1 * (w[0] ** 2 + w[1] ** 2 + w[2] ** 2)
            project(px, n, w)
        sums_of_levels(px, n, blur, flat, bend, lean, inner, outer)
        noise = 0.5 * (levels(inner, floor, a0, a1) + levels(outer, floor, b0, b1))
        if not noise > 0.0:
            return out
        # In p the contrast is 1: the noisier, the more pixels must speak for the levels.
        flat = min(FLAT + FLAT_BY_NOISE * math.sqrt(noise), FLAT_MOST)
        shifts_of(px, n, blur, bend, a0, a1, b0, b1, lean, shifts)
        lamp_falls(a0, q[0], lean)
        move, variance, out[4], out[7] = agreed(shifts, noise, rows, q, flat_std, good)
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
            moved_off(px, n, move)
        wide = blur.mean()
        blurs(shifts, 2.0 * math.pi * q[0] / k, blur, most)
        if turn > 0 and step < 0.03 and abs(blur.mean() - wide) < 0.15 * wide:
            break
    out[0], out[1], out[2], out[3], out[5], out[6] = u, v, q[0], variance, good.mean(), blur.mean()
    out[9] = 1.0 if blur.max() >= most else 0.0
    for c in range(3):
        out[10 + c] = _mean_of(mean, 0, c)
        out[13 + c] = _mean_of(mean, 1, c)
    return out


@kernel
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
