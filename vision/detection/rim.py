"""Where is the ball's outline, to a hundredth of a pixel? A model fitted to all pixels of the rim.

Along the radius x (px, 0 on the outline) the projected image is modelled as

    p(x) = [a0 + a1 n(x)] (1 - H) + [b0 + b1 x] H,   H = Phi(x / s),   n(x) = sqrt(2 |x| / R)

a sphere that turns away from the light as n does, a plate whose brightness (the ball's own shadow)
may fall off beside it, and a blur s. R is the mean radius. Levels and slopes are fitted per sector
of the turn, so the light may differ all round; s^2 may have a second harmonic, as motion gives it.
The residual times the edge's own derivative gives each sector's shift d (Gauss-Newton), and a
robust fit of the ellipse's motion to the shifts moves the ellipse:

    d(t) = dR + du cos t + dv sin t + dc cos 2t + ds sin 2t

With known levels this is the maximum likelihood estimate; the slopes remove the bias that a
brightness gradient beside the edge gives to the place of the steepest gradient. `rim_pixels` takes
the pixels out of the image, `rim_sectors` fits levels, shifts and blur.

`fit_rim` returns an array (15,): 0 u, 1 v, 2 radius (px), 3 variance of the centre per axis from
the sectors' scatter (px^2, infinite where the fit failed), 4 power of what the model lacks (px^2
per component, `rim_sectors._lack`), 5 share of sectors used, 6 mean blur (px), 7 share of clipped
pixels, 8 whether the blur reached its limit, 9-11 and 12-14 mean BGR inside and outside.
"""

from __future__ import annotations

import math

import numpy as np

from vision.compiled import kernel
from vision.detection.rim_pixels import (
    BLUR0,
    ZONE,
    best_direction,
    gather_pixels,
    project_colours,
    zone_colours,
)
from vision.detection.rim_sectors import (
    ellipse_step,
    lamp_gradients,
    level_sums,
    sector_levels,
    sector_shifts,
    shift_pixels,
    update_blurs,
)

ARC_PX = 6.0  # a sector's length
ROUNDS = 4  # Gauss-Newton steps at most
# px of plain ball and plate beside the blur from which levels are taken; more where noise asks.
FLAT, FLAT_MOST, FLAT_BY_NOISE = 3.0, 7.0, 40.0


@kernel
def fit_rim(image, u, v, radius, guess_px, flat_std, smeared):
    """Refine an outline from a guess (u, v, radius) [px] within about a pixel of it, by
    Gauss-Newton steps on the module's model; returns (15,), listed in the module's docstring.

    `image` (h, w, 3) uint8 BGR; `guess_px`: the first blur [px]; `flat_std`: prior standard
    deviation of the flattening (share of the radius); `smeared`: colour differences are stored
    coarsely.
    """
    out = np.zeros(15)
    out[0], out[1], out[2], out[3] = u, v, radius, np.inf
    k = 8 * max(1, min(6, int(round(2.0 * math.pi * radius / ARC_PX / 8.0))))
    q = np.array([radius, 0.0, 0.0])
    most = 0.12 * radius + 0.6
    blur = np.full(k, min(max(guess_px, 0.45), most))
    px = np.empty((0, 8), np.float32)
    inner, outer, shifts = np.empty((k, 6)), np.empty((k, 6)), np.empty((k, 4))
    a0, a1, b0, b1, lean = np.empty(k), np.empty(k), np.empty(k), np.empty(k), np.zeros(k)
    good, rows, variance = np.zeros(k, np.bool_), _harmonics(k), np.inf
    mean, colour, w = np.empty((2, k, 4)), np.empty((3, 3)), np.zeros(3)
    floor, flat, n, held, step, bend = 0.0, FLAT, 0, -1.0, 1.0, 2.0 / radius
    for turn in range(ROUNDS):
        far = ZONE * blur.max() + 0.4 + flat
        if far > held:
            held = far + 0.7
            px, n = _pixels_within(image, u, v, q, held, px)
            if turn > 0:
                project_colours(px, n, w)
        bend = 2.0 / q[0]
        if turn == 0 or (turn == 1 and step > 0.1):
            out[7] = zone_colours(px, n, blur, flat, mean, colour)
            if not best_direction(mean, colour, radius, smeared, w):
                return out
            floor = 0.1 * (w[0] ** 2 + w[1] ** 2 + w[2] ** 2)
            project_colours(px, n, w)
        level_sums(px, n, blur, flat, bend, lean, inner, outer)
        noise = 0.5 * (sector_levels(inner, floor, a0, a1) + sector_levels(outer, floor, b0, b1))
        if not noise > 0.0:
            return out
        # In p the contrast is 1: the noisier the image, the more pixels the levels need.
        flat = min(FLAT + FLAT_BY_NOISE * math.sqrt(noise), FLAT_MOST)
        sector_shifts(px, n, blur, bend, a0, a1, b0, b1, lean, shifts)
        lamp_gradients(a0, q[0], lean)
        move, variance, out[4] = ellipse_step(shifts, noise, rows, q, flat_std, good)
        step = math.sqrt(move[1] ** 2 + move[2] ** 2)
        if not (step < 0.3 * radius + 1.0 and 0.6 * radius < q[0] + move[0] < 1.5 * radius):
            return out
        u, v = u + move[1], v + move[2]
        q[0], q[1], q[2] = q[0] + move[0], q[1] + move[3], q[2] + move[4]
        if step + abs(move[0]) > 0.4:
            held = -1.0
        else:
            shift_pixels(px, n, move)
        wide = blur.mean()
        update_blurs(shifts, rows, blur, most)
        if turn > 0 and step < 0.03 and abs(blur.mean() - wide) < 0.15 * wide:
            break
    out[0], out[1], out[2], out[3], out[5], out[6] = u, v, q[0], variance, good.mean(), blur.mean()
    out[8] = 1.0 if blur.max() >= most else 0.0
    _mean_colours(mean, out)
    return out


@kernel
def _harmonics(k):
    """Rows (k, 5) of 1, cos t, sin t, cos 2t, sin 2t at the sectors' middles t."""
    rows = np.ones((k, 5))
    for i in range(k):
        t = 2.0 * math.pi * (i + 0.5) / k
        rows[i, 1], rows[i, 2] = math.cos(t), math.sin(t)
        rows[i, 3], rows[i, 4] = math.cos(2.0 * t), math.sin(2.0 * t)
    return rows


@kernel
def _pixels_within(image, u, v, q, held, px):
    """The pixels up to `held` px beside the outline, in `px` or a larger array, and their count."""
    room = int(13.0 * (q[0] + 2.0) * (held + abs(q[1]) + abs(q[2]))) + 200
    if room > px.shape[0]:  # small enough for the heap: fresh pages cost more than the work
        px = np.empty((room, 8), np.float32)
    return px, gather_pixels(image, u, v, q, min(held, 0.7 * q[0]), held, px)


@kernel
def _mean_colours(mean, out):
    """Mean BGR over the sectors of either side, into out[9:12] (inside) and out[12:15]."""
    for side in range(2):
        for c in range(3):
            total, count = 0.0, 1e-9
            for i in range(mean.shape[1]):
                if mean[side, i, 0] > 0.0:
                    total += mean[side, i, 1 + c]
                    count += 1.0
            out[9 + 3 * side + c] = total / count


def colour_is_smeared(image: np.ndarray, u_px: float, v_px: float, radius_px: float) -> bool:
    """Whether colour differences blur the edge of the disc over 1.2 times as much as brightness
    does, as in images (h, w, 3) uint8 that went through chroma subsampling (4:2:0 and the like).
    Place and radius in px."""
    blurs = []
    for smeared in (False, True):
        place = float(u_px), float(v_px), float(radius_px)
        rim = fit_rim(image, *place, BLUR0, 0.03, smeared)
        blurs.append(float(rim[6]) if np.isfinite(rim[3]) else 0.0)
    return blurs[1] > 0.0 and blurs[0] > 1.2 * blurs[1]
