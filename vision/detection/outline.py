"""Which ellipse do the edges along rays from a guess lie on?

Rays are cast from the guess (`rays`), an edge is taken on each, and an ellipse is fitted robustly
(`ellipse`). Variants: an edge of something else beside the ball (`retrace_on_consensus`), and the
outer edge of a mirroring ball (`trace_outer_ring`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vision.compiled import kernel
from vision.detection.circle_ransac import consensus_circle
from vision.detection.ellipse import fit_ellipse
from vision.detection.rays import cast_rays

# Prior of the flattening, share of the radius: of a sphere (perspective, lens), which keeps an
# outline in its form where a hand or a thing of its colour hides part of it; and of a sphere
# blurred by its motion, which is believed only of a whole outline.
FLAT_STD, BLURRED_STD = 0.03, 0.12
LONG_REACH = 0.35  # share of the radius that rays from a rough outline search to both sides
OUTER_RAYS = 72
# Shares of the radius: how far off the shared circle an edge may lie, how far short rays reach,
# and the prior of the flattening of an outline of which a part is not believed.
SLACKS, SHORT_REACH, ROUND_STD = (0.014, 0.024), 0.08, 0.01
AWAY = 0.06  # farther from the first outline than noise sets the shared circle


class Outline(NamedTuple):
    """An ellipse through edge points.

    `u_px, v_px, radius_px` centre and mean radius; `variance_px2` of the centre per axis, from the
    residuals alone; `residual_px` rms of the inliers; `good` rays on the ellipse and `inside` rays
    in the image (counts); `coverage` share of the turn that is covered: eighths with at least one
    in three rays on the ellipse; `framed` share of the turn that lies in the image: eighths with at
    least half their rays; `flattening` half the difference of the half axes, share of the
    radius; `lack_px2` power of the third and fourth harmonics of the residuals, per component: what
    light, shadows and marks move smoothly round the turn, whose first harmonic no residual shows;
    `tilt_u`, `tilt_v` first harmonic of the edges' steepness over the square of its mean: of light
    from one side.
    """

    u_px: float
    v_px: float
    radius_px: float
    variance_px2: float
    residual_px: float
    good: float
    inside: float
    coverage: float
    framed: float
    flattening: float
    lack_px2: float
    tilt_u: float
    tilt_v: float

    @property
    def share(self) -> float:
        """Share (0..1) of the rays in the image that lie on the ellipse."""
        return self.good / max(self.inside, 1.0)


@kernel
def rays_of(radius, dense=False):
    """Number of rays: one every two pixels of the outline [px], a multiple of 8 from 24 to 72; with
    `dense` one every pixel, from 24 to 480."""
    if dense:
        return 8 * min(max(int(2.0 * np.pi * radius / 8.0 + 0.5), 3), 60)
    return 8 * min(max(int(np.pi * radius / 8.0), 3), 9)


@kernel
def _best_fit(points, outer, weight, u, v, radius, inside):
    """`fit_ellipse` of a ball, of a mirroring ball, or of a blurred one, whichever holds."""
    best = fit_ellipse(points, weight, u, v, radius, 0.15 * radius, FLAT_STD)
    double = 0
    for i in range(points.shape[0]):
        apart = max(abs(outer[i, 0] - points[i, 0]), abs(outer[i, 1] - points[i, 1]))
        double += apart > 0.03 * radius
    if double > 0.2 * inside:
        # Two edges on many rays: a mirroring ball reflects the plate; its outline is the outer one.
        rim = fit_ellipse(outer, weight, u, v, 1.1 * radius, 0.15 * radius, FLAT_STD)
        if rim[5].sum() >= 0.8 * inside and rim[4] < 0.03 * radius and rim[2] > 1.03 * best[2]:
            best = rim
    if best[5].sum() < 0.9 * inside or best[4] > 0.03 * radius:
        blurred = fit_ellipse(points, weight, u, v, radius, 0.3 * radius, BLURRED_STD)
        if blurred[5].sum() >= 0.9 * inside:
            best = blurred
    return best


@kernel
def _framed(image, u, v, radius, per):
    """Share of the turn, by eighths of `per` rays, in which half the circle (px) or more lies in
    the image (h, w, 3)."""
    h, w = image.shape[0], image.shape[1]
    framed = 0
    for i in range(8):
        there = 0
        for k in range(i * per, (i + 1) * per):
            x = u + radius * np.cos(0.25 * np.pi * k / per)
            y = v + radius * np.sin(0.25 * np.pi * k / per)
            there += 0.0 <= x <= w - 1.0 and 0.0 <= y <= h - 1.0
        framed += 2 * there >= per
    return framed / 8.0


@kernel
def trace_rays(image, u, v, radius, reach, w, signed, dense):
    """Edges along rays about a guess and the ellipse through them (`cast_rays`, `fit_ellipse`).

    `image`, `u`, `v`, `radius`, `reach`, `signed` and `dense` as in `trace_outline`; `w` (3,):
    colour direction. Returns the fields of `Outline` in their order, (13,), and whether an ellipse
    was found.
    """
    out, n_rays = np.zeros(13), rays_of(radius, dense)
    points, outer, strength, inside = cast_rays(image, u, v, radius, reach, w, n_rays, signed)
    typical = np.median(strength)
    if not typical > 0.0:
        return out, False
    weight = np.empty(n_rays)
    for i in range(n_rays):
        weight[i] = min(max((strength[i] / typical - 0.15) / 0.35, 0.0), 1.0)
    u2, v2, radius2, variance, residual, good, flat = _best_fit(
        points, outer, weight, u, v, radius, inside
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
    out = _described(image, points, u2, v2, radius2, variance, residual, good, inside, flat)
    out[11], out[12] = _harmonic(strength / strength.mean() ** 2, 1)
    return out, True


@kernel
def _harmonic(values, m):
    """Amplitudes of cos mt and sin mt in values (n,) round the turn."""
    c, s, n = 0.0, 0.0, values.size
    for i in range(n):
        c += 2.0 / n * values[i] * np.cos(2.0 * np.pi * m * i / n)
        s += 2.0 / n * values[i] * np.sin(2.0 * np.pi * m * i / n)
    return c, s


@kernel
def _described(image, points, u, v, radius, variance, residual, good, inside, flattening):
    """The fields of `Outline` in their order, (13,), of an ellipse on the rays `good` (n,), whose
    edges are `points` (n, 2); the last two are left 0."""
    per, covered = good.size // 8, 0
    for i in range(8):
        on = 0
        for k in range(i * per, (i + 1) * per):
            on += good[k]
        covered += on > 0.34 * per
    out = np.zeros(13)
    out[0], out[1], out[2], out[3], out[4] = u, v, radius, variance, residual
    out[5], out[6], out[7] = good.sum(), inside, covered / 8.0
    out[8], out[9] = _framed(image, u, v, radius, per), flattening
    off = np.zeros(good.size)
    for i in range(good.size):
        if good[i]:
            off[i] = np.sqrt((points[i, 0] - u) ** 2 + (points[i, 1] - v) ** 2) - radius
    for m in range(3, 5):
        c, s = _harmonic(off, m)
        out[10] += 0.25 * (c * c + s * s)
    return out


@kernel
def _beyond(points, u, v, radius, used):
    """Mark as used the points (n, 2) clearly outside the circle, and not NaN."""
    for i in range(points.shape[0]):
        r = np.sqrt((points[i, 0] - u) ** 2 + (points[i, 1] - v) ** 2)
        used[i] = 1.0 if r > 1.05 * radius else 0.0


@kernel
def trace_outer_ring(image, u, v, radius, w):
    """(u, v, radius, share of the rays on it) of a mirroring ball about its inner circle (px), in
    an image (h, w, 3) uint8 BGR along the colour direction `w` (3,).

    A mirroring ball shows the plate in a ring about the image of the room; the ring's outer edge is
    the ball's outline. It surrounds the inner circle, need not be concentric with it, and is weaker
    where the ball's own shadow lies. So edges of either sign are taken, and an ellipse counts on
    which rays from its own centre meet edges in most directions. Share 0: none.
    """
    out, n_rays = np.zeros(4), OUTER_RAYS
    u2, v2, radius2 = u, v, 1.25 * radius
    for turn in range(3):
        reach = 0.22 if turn == 0 else 0.12
        points, outer, _strength, inside = cast_rays(
            image, u2, v2, radius2, reach, w, n_rays, False
        )
        both = np.concatenate((points, outer))
        weight = np.zeros(2 * n_rays)
        _beyond(both, u, v, radius, weight)
        if weight.sum() < 0.5 * n_rays:
            return out
        scale = (0.08 if turn == 0 else 0.04) * radius
        got = fit_ellipse(both, weight, u2, v2, radius2, scale, FLAT_STD)
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


def trace_outline(
    image: np.ndarray,
    direction: np.ndarray,
    signed: bool,
    u: float,
    v: float,
    radius: float,
    reach: float,
    *,
    dense: bool = False,
) -> Outline | None:
    """The outline about a guess (px) in an image (h, w, 3) uint8 BGR.

    `direction` (3,) is the colour direction along which edges are taken; with `signed` they must
    fall outwards along it. Rays run from (1 - reach) to (1 + reach) radii, with `dense` one for
    every pixel of the turn. None where the fit left the rays' reach or rests on fewer than ten
    edges.
    """
    place = float(u), float(v), float(radius)
    values, found = trace_rays(image, *place, reach, direction, signed, dense)
    return Outline(*values.tolist()) if found else None


def retrace_on_consensus(
    image: np.ndarray, direction: np.ndarray, signed: bool, line: Outline
) -> Outline | None:
    """Trace a rough outline again around its majority circle; None where that is no better.

    The end of a ball's shadow may be a stronger edge than a dark ball's own outline. Most edges lie
    on the ball's circle (`consensus_circle`); short rays from there do not reach the shadow's end,
    and points farther than the slack from the circle are dropped. Better is: over 60 % of the rays
    on it, and under 70 % of the residual of `line`.
    """
    place = line.u_px, line.v_px, line.radius_px
    first = cast_rays(image, *place, LONG_REACH, direction, rays_of(line.radius_px), signed)[0]
    for slack in SLACKS:
        slack_px = slack * line.radius_px
        values, found = _trace_shared(image, *place, first, direction, signed, slack_px)
        again = Outline(*values.tolist()) if found else line
        if again.share > 0.6 and again.residual_px < 0.7 * line.residual_px:
            return again
    return None


@kernel
def _trace_shared(image, u, v, radius, first, w, signed, slack):
    """The fields of `Outline`, (13,), through the edges within `slack` px of the circle that most
    of them share, and whether there is such an outline that differs from the circle (u, v, radius).

    `first` (n, 2) are the edges that long rays met; short rays from their shared circle follow.
    """
    out = np.zeros(13)
    shared = consensus_circle(first, radius, slack)
    if shared[3] == 0.0:
        return out, False
    away = np.sqrt((shared[0] - u) ** 2 + (shared[1] - v) ** 2) > AWAY * radius
    outside, inside = _longest_arc(first, shared, slack)
    if not away and max(outside, inside) < max(first.shape[0] // 8, 3):  # mere noise
        return out, False
    n_rays = rays_of(shared[2])
    points, _, strength, seen = cast_rays(
        image, shared[0], shared[1], shared[2], SHORT_REACH, w, n_rays, signed
    )
    shared = consensus_circle(points, shared[2], slack)
    if shared[3] == 0.0:
        return out, False
    weight = np.empty(n_rays)
    for i in range(n_rays):
        weight[i] = 1.0 if strength[i] > 0.0 else 0.0
    u, v, radius, variance, rms, good, flat = fit_ellipse(
        points, weight, shared[0], shared[1], shared[2], slack, ROUND_STD
    )
    return _described(image, points, u, v, radius, variance, rms, good, seen, flat), True


@kernel
def _longest_arc(points, circle, slack):
    """The most consecutive points (n, 2) px once round that lie farther than `slack` px outside the
    circle (u, v, radius), and inside it: many in a row are another edge, not noise."""
    n = points.shape[0]
    longest, run = np.zeros(2, np.int64), np.zeros(2, np.int64)
    for i in range(2 * n):
        du, dv = points[i % n, 0] - circle[0], points[i % n, 1] - circle[1]
        off = np.sqrt(du * du + dv * dv) - circle[2]
        run[0] = run[0] + 1 if off > slack else 0
        run[1] = run[1] + 1 if off < -slack else 0
        for k in range(2):
            longest[k] = max(longest[k], run[k])
    return longest[0], longest[1]
