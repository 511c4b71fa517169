"""One look at a ball's outline: rays from a guess, an edge on each, the ellipse through them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vision.consensus import shared_circle
from vision.ellipse import fit
from vision.rays import cast
from vision.tracing import ring_about, trace_rays

# Prior of the flattening, share of the radius: of a sphere (perspective, lens), which keeps an
# outline in its form where a hand or a thing of its colour hides part of it; and of a sphere
# blurred by its motion, which is believed only of a whole outline.
FLAT_STD, BLURRED_STD = 0.03, 0.12
ROUNDS = 8
# Shares of the radius: how far off the shared circle an edge may lie, how far short rays reach,
# and the prior of the flattening of an outline of which a part is not believed.
SLACKS, SHORT_REACH, ROUND_STD = (0.014, 0.024), 0.08, 0.01
AWAY = 0.06  # farther from the first outline than noise sets the shared circle


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
    shape = FLAT_STD, BLURRED_STD, ROUNDS
    place = float(u), float(v), float(radius)
    got, found = trace_rays(image, *place, reach, direction, _rays(radius), signed, *shape)
    return Outline(*got.tolist()) if found else None


def _rays(radius: float) -> int:
    """How many: one every two pixels of the outline, in eighths."""
    return 8 * min(max(int(2 * math.pi * radius / 2.0 / 8), 3), 9)


def freed(
    image: np.ndarray, direction: np.ndarray, signed: bool, line: Outline, reach: float
) -> Outline | None:
    """A rough outline anew, free of another edge beside it, or None where that is no better.

    The end of a ball's shadow may be a stronger edge than a dark ball's end in it. The ball is
    where most edges lie on one circle; rays too short to reach the shadow's end find the rest, and
    what of them leaves that circle is not believed.
    """
    for slack in SLACKS:
        again = _on_shared_circle(image, direction, signed, line, reach, slack * line.radius_px)
        if again is not None and again.share > 0.6 and again.residual_px < 0.7 * line.residual_px:
            return again
    return None


def _on_shared_circle(
    image: np.ndarray, direction: np.ndarray, signed: bool, line: Outline, reach: float,
    slack: float,
) -> Outline | None:  # fmt: skip
    """The outline through the edges within `slack` px of the circle that most of them share."""
    u, v, radius = line.u_px, line.v_px, line.radius_px
    for rays in (reach, SHORT_REACH):
        points, _, strength, inside = cast(
            image, u, v, radius, rays, direction, _rays(radius), signed
        )
        circle = shared_circle(points, radius, slack)
        if circle[3] == 0.0:
            return None
        u, v, radius = (float(c) for c in circle[:3])
        beyond = np.hypot(points[:, 0] - u, points[:, 1] - v) - radius
        away = math.hypot(u - line.u_px, v - line.v_px) > AWAY * radius
        arc = _is_arc(beyond > slack) or _is_arc(beyond < -slack)
        if rays == reach and not (arc or away):  # mere noise
            return None
    weight = (strength > 0.0).astype(float)
    u, v, radius, variance, rms, good = fit(points, weight, u, v, radius, slack, ROUND_STD, ROUNDS)
    octants = good[: len(good) // 8 * 8].reshape(8, -1).mean(1)
    wave = np.exp(2j * np.pi * np.arange(len(strength)) / len(strength))
    return Outline(
        float(u), float(v), float(radius), float(variance), float(rms), float(good.sum()),
        float(inside), float(2.0 * abs(strength @ wave) / max(strength.sum(), 1e-9)),
        float(np.mean(octants > 0.34)),
    )  # fmt: skip


def _is_arc(flags: np.ndarray) -> bool:
    """Whether an eighth of the turn or more is set without a gap: an edge, where noise is not."""
    twice = np.concatenate((flags, flags)).astype(np.int8)
    least = max(len(flags) // 8, 3)
    return bool((np.convolve(twice, np.ones(least, np.int8), "valid") == least).any())


def ring(
    image: np.ndarray, direction: np.ndarray, u: float, v: float, radius: float
) -> tuple[float, float, float, float] | None:
    """(u, v, radius, share of the rays) of the outer edge about an outline (px), None where none.

    A mirroring ball's inner outline is the picture of the plate in it, not its silhouette.
    """
    got = ring_about(image, float(u), float(v), float(radius), direction, 72, FLAT_STD, ROUNDS)
    return (float(got[0]), float(got[1]), float(got[2]), float(got[3])) if got[3] > 0.0 else None
