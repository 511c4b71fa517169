"""Where is the disc near a guess, to a hundredth of a pixel, and how certain is that?

`locate_ball` casts rays from the guess, takes the edge on each and fits an ellipse robustly
(`outline`); then once more from there, a ray for every pixel of the turn. Pure functions; whether a
result is accepted is decided by `vision.tracking.gate`. Rough guesses come from `blobs` and
`hough_circles`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vision.detection.appearance import SIGNED_ABOVE, Appearance
from vision.detection.outline import (
    LONG_REACH,
    Outline,
    retrace_on_consensus,
    trace_outline,
)
from vision.detection.pixels import mean_probability

# Deviations of the outline from an ellipse (blur, a shadow's edge) are common to some nine rays.
RAYS_SHARE = 9.0
UNSEEN_PX = 2.0  # that the centre may be off by, per share of the turn that shows no edge
# Power of the first harmonic of an outline's deviations from an ellipse, which no residual shows,
# over that of the third and fourth; fitted on images of two renderers that share no code, of other
# seeds than those of the table (tests/benchmarks/vision/locating.py).
LACK_SHARE = 1.5
# How far light from one side moves an outline, per `tilt` of it, and how far that may be off [px]:
# 0.02 to 0.1 in ten of those scenes.
TILT_PX, TILT_DOUBT_PX = 0.05, 0.012
# Dense rays search to both sides: a share of the radius, but no less than an edge is wide, which
# cuts the bias of a radius of 5 px from 0.16 to 0.02 px.
DENSE_REACH, LEAST_REACH_PX = 0.2, 2.5
# Below it a disc is little more than its edges: centres of radii of 2.5 and 3 px are off by 0.1 to
# 0.17 px, and no residual shows it (test_small_balls).
TINY_PX, TINY_DOUBT_PX = 3.7, 0.15
UNSIGNED_REACH = 0.25
ROUGH_SHARE = 0.01  # of the radius: residual of an outline beside which another edge may run
MAJORITY = 0.75  # share of the rays on their shared circle from which it outweighs an ellipse
WHOLE = 0.85  # share of the rays from which an outline counts as free all round
# Casts at most; the share of the radius that is no move; and that a blurred outline may still sway.
SETTLE_ROUNDS, SETTLED, RESTLESS = 7, 0.03, 0.1
# Residual, share of the radius, at which a mere guess is given up after two casts: 1.6 times what
# the gate lets pass. Of 3263 guesses in 79 images this spares two in five casts; 14 of 701 that
# would have passed are lost.
HOPELESS = 0.08
REACH = 0.6  # rays search from (1 - REACH) to (1 + REACH) radii


@dataclass(frozen=True)
class Detection:
    """A located disc with what is needed to judge it.

    `u_px, v_px, radius_px` centre and mean radius of the outline; `sigma_px` standard deviation of
    the centre per axis; `inliers` share of the rays in the image whose edge lies
    on the ellipse; `coverage` share of the full turn so covered, by eighths with at least one in
    three rays good; `framed` share of the turn that lies in the image; `contrast` 1 where ball and
    plate differ as in the appearance, negative where the sign is wrong; `residual_px` rms of the
    inliers; `fill` and `spill` the mean P(ball) of the colours inside and just outside; `inside_px`
    the radius of the picture in a mirroring ball, 0 where there is none; `flattening` as of
    `Outline`.
    """

    u_px: float
    v_px: float
    radius_px: float
    sigma_px: float
    inliers: float
    coverage: float
    contrast: float
    residual_px: float
    fill: float
    spill: float
    inside_px: float = 0.0
    framed: float = 1.0
    flattening: float = 0.0


def locate_ball(
    image: np.ndarray,
    appearance: Appearance,
    u_px: float,
    v_px: float,
    radius_px: float,
    *,
    reach: float = REACH,
    polish: bool = True,
) -> Detection | None:
    """The disc near a guess (px), or None where too few edges lie on any ellipse.

    `image` (h, w, 3) uint8 BGR; rays search from (1 - reach) to (1 + reach) times `radius_px`. A
    first outline is traced along the appearance's direction in colour space. Where it is not whole
    and smooth, it is traced again along the direction measured at the spot. Then it is traced by
    dense rays; where that fails, or without `polish`, the outline stays. None also for a guess that
    is no number.
    """
    if not math.isfinite(u_px + v_px + radius_px):
        return None
    direction, signed, table = appearance.direction, appearance.signed, appearance.table
    if not appearance.learned:
        direction = appearance.here(image, u_px, v_px, radius_px)[0]
    # Edges of either sign are found inside a mirroring ball too: look for its rim alone.
    reach = reach if signed else min(reach, UNSIGNED_REACH)
    worst = math.inf if polish else HOPELESS
    line = _settled(image, direction, signed, (u_px, v_px, radius_px), reach, worst)
    if line is None:
        return None
    contrast = shared = None
    if signed and line.residual_px > max(0.2, ROUGH_SHARE * line.radius_px):
        shared = retrace_on_consensus(image, direction, signed, line)
        line = shared or line
    if not _plain(line):
        last, contrast = _refined(image, appearance, line, direction, signed)
        # Longer rays may meet again what the majority left out.
        majority = shared is not None and shared.share > MAJORITY
        line = line if majority and last.residual_px > line.residual_px else last
    local, separation, here = appearance.here(
        image, line.u_px, line.v_px, line.radius_px, fine=True
    )
    contrast = here if contrast is None else contrast
    clear = line.share > WHOLE and line.coverage == 1.0 and separation > SIGNED_ABOVE
    fine = _dense(image, local, line) if polish and clear else None
    u, v, radius, sigma = _centre(line, fine)
    return Detection(
        u_px=u,
        v_px=v,
        radius_px=radius,
        sigma_px=sigma,
        inliers=line.share,
        coverage=line.coverage,
        contrast=contrast if appearance.learned and signed else 1.0,
        residual_px=line.residual_px,
        fill=mean_probability(image, table, u, v, 0.0, 0.85 * radius),
        spill=mean_probability(image, table, u, v, 1.2 * radius + 1.0, 1.6 * radius + 2.0),
        framed=line.framed,
        flattening=line.flattening,
    )


def _dense(image: np.ndarray, direction: np.ndarray, line: Outline) -> Outline | None:
    """The outline traced again by dense rays, or None where they found another one."""
    u, v, radius = line.u_px, line.v_px, line.radius_px
    near = max(DENSE_REACH, LEAST_REACH_PX / radius)
    fine = trace_outline(image, direction, True, u, v, radius, near, dense=True)
    return fine if fine is not None and _agrees(fine, line) else None


def _centre(line: Outline, fine: Outline | None) -> tuple[float, float, float, float]:
    """Centre, radius and standard deviation of the centre per axis [px], from the dense outline
    where there is one."""
    if fine is None:
        u, v, radius, variance = line.u_px, line.v_px, line.radius_px, _line_variance(line)
    else:
        u, v = fine.u_px + TILT_PX * fine.tilt_u, fine.v_px + TILT_PX * fine.tilt_v
        radius, variance = fine.radius_px, _dense_variance(fine)
    doubt = TINY_DOUBT_PX if radius < TINY_PX else 0.0
    return u, v, radius, math.hypot(math.sqrt(variance), doubt)


def _plain(line: Outline) -> bool:
    """Whether the outline is seen all round and is smooth."""
    smooth = line.residual_px < max(0.25, 0.02 * line.radius_px)
    return line.share > WHOLE and line.coverage == 1.0 and smooth


def _agrees(fine: Outline, line: Outline) -> bool:
    """Whether dense rays found the outline that sparse ones traced."""
    moved, radius = math.hypot(fine.u_px - line.u_px, fine.v_px - line.v_px), line.radius_px
    near = moved < 0.3 + 0.04 * radius and abs(fine.radius_px - radius) < 0.4 + 0.06 * radius
    return near and fine.share > 0.7


def _dense_variance(fine: Outline) -> float:
    """Variance (px^2) of a densely traced outline's centre per axis: scatter, what shifts the edges
    smoothly round the turn beyond that, and light from one side."""
    lack = max(0.0, fine.lack_px2 - fine.variance_px2)
    tilt = TILT_DOUBT_PX * math.hypot(fine.tilt_u, fine.tilt_v)
    return fine.variance_px2 + LACK_SHARE * lack + tilt**2


def _line_variance(line: Outline) -> float:
    """Variance (px^2) of a traced outline's centre per axis, from the residuals (which neighbouring
    rays share) and the arc that is not seen."""
    unseen = 1.0 - min(line.share, 1.0)
    return RAYS_SHARE * line.variance_px2 + (UNSEEN_PX * unseen) ** 2


def _settled(
    image: np.ndarray,
    direction: np.ndarray,
    signed: bool,
    guess: tuple[float, float, float],
    reach: float,
    worst: float,
) -> Outline | None:
    """The outline about a guess, traced again from its own result until that stays or its residual
    exceeds `worst` (share of the radius) twice in a row.

    Rays from a guess near the ball's edge meet other edges too, and an ellipse through them all
    lies somewhere between: only an outline that is found again from its own centre is accepted.
    """
    line, moved, radius, rough = None, math.inf, guess[2], False
    for _ in range(SETTLE_ROUNDS):
        line = trace_outline(image, direction, signed, *guess, reach)
        if line is None or (rough and line.residual_px > worst * line.radius_px):
            return None
        rough = line.residual_px > worst * line.radius_px
        u, v, radius = guess
        guess = line.u_px, line.v_px, line.radius_px
        moved = math.hypot(guess[0] - u, guess[1] - v) + abs(guess[2] - radius)
        # A whole smooth outline is accepted at once where it lay well within the rays' reach.
        if moved < SETTLED * radius or (_plain(line) and moved < 0.4 * reach * radius):
            return line
    return line if moved < RESTLESS * radius else None


def _refined(
    image: np.ndarray, appearance: Appearance, first: Outline, direction: np.ndarray, signed: bool
) -> tuple[Outline, float]:
    """The outline along the colour direction measured at the spot, and the contrast there.

    Where that direction shows no outline, the first one stays.
    """
    line, last, contrast = first, None, 1.0
    for _ in range(3):
        u, v, radius = line.u_px, line.v_px, line.radius_px
        local, separation, contrast = appearance.here(image, u, v, radius)
        signs = separation > SIGNED_ABOVE
        last = trace_outline(
            image, local, signs, u, v, radius, LONG_REACH if signs else UNSIGNED_REACH
        )
        if last is None or math.hypot(last.u_px - u, last.v_px - v) < 0.03 * radius:
            break
        # The colours were measured at the wrong place: once more.
        line = last
    if first.share < WHOLE:
        # Something lies in front or beside, and may have been measured as the plate.
        u, v, radius = first.u_px, first.v_px, first.radius_px
        known = trace_outline(
            image, direction, signed, u, v, radius, LONG_REACH if signed else UNSIGNED_REACH
        )
        if last is None or (known is not None and known.variance_px2 < last.variance_px2):
            last = known
    return (first if last is None else last), contrast
