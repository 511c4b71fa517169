"""One look at a ball's outline: rays from a guess, an edge on each, the ellipse through them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vision.rays import KERNEL, ring_about, trace_rays

# Prior of the flattening, share of the radius: of a sphere (perspective, lens), which keeps an
# outline in its form where a hand or a thing of its colour hides part of it; and of a sphere
# blurred by its motion, which is believed only of a whole outline.
FLAT_STD, BLURRED_STD = 0.03, 0.12
ROUNDS = 8


class Outline(NamedTuple):
    """The ellipse: centre and mean radius in px, variance of the centre per axis from the residuals
    alone, their rms, how many rays lie on it and how many lay in the image, the relative first
    harmonic of the edge's strength round it, and the share of the full turn that is covered, by
    eighths with at least one in three rays on the ellipse."""

    u_px: float
    v_px: float
    radius_px: float
    variance_px2: float
    residual_px: float
    good: float
    inside: float
    lopsided: float
    coverage: float

    @property
    def share(self) -> float:
        """Of the rays in the image, how many lie on the ellipse."""
        return self.good / max(self.inside, 1.0)


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
    n_rays = 8 * min(max(int(2 * math.pi * radius / 2.0 / 8), 3), 9)
    shape = FLAT_STD, BLURRED_STD, ROUNDS
    got, found = trace_rays(
        image, float(u), float(v), float(radius), reach, direction, n_rays, signed, KERNEL, *shape
    )
    return Outline(*got.tolist()) if found else None


def ring(
    image: np.ndarray, direction: np.ndarray, u: float, v: float, radius: float
) -> tuple[float, float, float, float] | None:
    """(u, v, radius, share of the rays) of the outer edge about an outline (px), None where none.

    A mirroring ball's inner outline is the picture of the plate in it, not its silhouette.
    """
    got = ring_about(
        image, float(u), float(v), float(radius), direction, 72, KERNEL, FLAT_STD, ROUNDS
    )
    return (float(got[0]), float(got[1]), float(got[2]), float(got[3])) if got[3] > 0.0 else None
