"""One look at a ball's outline: rays from a guess, an edge on each, the ellipse through them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vision.rays import KERNEL, cast, fit

# Prior of the flattening, share of the radius: of a sphere (perspective, lens), which keeps an
# outline in its form where a hand or a thing of its colour hides part of it; and of a sphere
# blurred by its motion, which is believed only of a whole outline.
FLAT_STD, BLURRED_STD = 0.03, 0.12
ROUNDS = 8


class Outline(NamedTuple):
    """The ellipse: centre and mean radius in px, variance of the centre per axis from the residuals
    alone, their rms, which rays lie on it (n,), how many rays lay in the image, and the relative
    first harmonic of the edge's strength round it."""

    u_px: float
    v_px: float
    radius_px: float
    variance_px2: float
    residual_px: float
    good: np.ndarray
    inside: int
    lopsided: float

    @property
    def share(self) -> float:
        """Of the rays in the image, how many lie on the ellipse."""
        return float(self.good.sum()) / max(self.inside, 1)

    @property
    def coverage(self) -> float:
        """Share of the full turn, by eighths with at least one in three rays on the ellipse."""
        octants = self.good[: len(self.good) // 8 * 8].reshape(8, -1).mean(1) > 0.34
        return float(octants.mean())


def trace(
    image: np.ndarray,
    direction: np.ndarray,
    signed: bool,
    u: float,
    v: float,
    radius: float,
    reach: float,
) -> Outline | None:
    """The outline about a guess (px) in an image (h, w, 3) uint8 along `direction` (3,).

    Rays run from (1 - reach) to (1 + reach) radii; `signed` edges fall outwards along the
    direction. None where the fit has run away or rests on too few edges.
    """
    n_rays = 8 * int(np.clip(2 * math.pi * radius / 2.0 / 8, 3, 9))
    points, outer, strength, inside = cast(
        image, u, v, radius, reach, direction, n_rays, signed, KERNEL
    )
    typical = float(np.median(strength))
    if typical <= 0.0:
        return None
    weight = np.clip((strength / typical - 0.15) / 0.35, 0.0, 1.0)
    u2, v2, radius2, variance, residual, good = _best_fit(
        points, outer, weight, (u, v, radius), inside
    )
    limit = (1.0 + reach) * radius
    # Comparisons that are false for NaN refuse it too.
    if not (math.hypot(u2 - u, v2 - v) < limit and 0.3 * radius < radius2 < 2.0 * radius):
        return None
    if good.sum() < 10 or not math.isfinite(variance):
        return None
    # Rays closer than a pixel's diagonal or so share their pixels, and so their noise.
    variance *= max(1.0, 2.2 * n_rays / (2 * math.pi * radius2))
    turn = np.exp(2j * math.pi * np.arange(n_rays) / n_rays)
    lopsided = 2.0 * abs(complex(turn @ strength)) / max(float(strength.sum()), 1e-9)
    return Outline(u2, v2, radius2, variance, residual, good, inside, float(lopsided))


def _best_fit(
    points: np.ndarray,
    outer: np.ndarray,
    weight: np.ndarray,
    guess: tuple[float, float, float],
    inside: int,
):
    """(u, v, radius, variance, rms, good (n,)) of a ball, a mirroring ball or a blurred one."""
    u, v, radius = guess
    best = fit(points, weight, u, v, radius, 0.15 * radius, FLAT_STD, ROUNDS)
    if np.count_nonzero(np.abs(outer - points).max(1) > 0.03 * radius) > 0.2 * inside:
        # Two edges on many rays: a mirroring ball's rim reflects the plate. The outer one is its.
        rim = fit(outer, weight, u, v, 1.1 * radius, 0.15 * radius, FLAT_STD, ROUNDS)
        if rim[5].sum() >= 0.8 * inside and rim[4] < 0.03 * radius and rim[2] > 1.03 * best[2]:
            best = rim
    if best[5].sum() < 0.9 * inside or best[4] > 0.03 * radius:
        blurred = fit(points, weight, u, v, radius, 0.3 * radius, BLURRED_STD, ROUNDS)
        if blurred[5].sum() >= 0.9 * inside:
            best = blurred
    return best
