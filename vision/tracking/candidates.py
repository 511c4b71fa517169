"""Discs that could be the ball, followed loosely until one is believed: motion settles doubts."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from vision.appearance import Appearance
from vision.detector import Detection, find, locate
from vision.gate import TELLING_FILL, believable, weight
from vision.imposters import Imposters
from vision.repeats import noise_level
from vision.votes import circles

AT_MOST = 8
KNOWN_STILL = 0.4
# Of a disc whose colour is all that speaks for it; a ball of 5 px on a plain plate has 15 and more.
LEAST_WEIGHT = 12.0


@dataclass(frozen=True)
class Candidate:
    """A disc seen in `hits` frames, missed in the last `misses`; `start` is where it was first."""

    seen: Detection
    start: tuple[float, float]
    hits: int = 1
    misses: int = 0
    span_px: float = 0.0

    @property
    def moved(self) -> bool:
        """Farther than a mark on the tilting plate can seem to."""
        return self.span_px > max(5.0, 0.5 * self.seen.radius_px)

    def again(self, seen: Detection) -> Candidate:
        """Seen once more."""
        span = math.hypot(seen.u_px - self.start[0], seen.v_px - self.start[1])
        return replace(
            self, seen=seen, hits=self.hits + 1, misses=0, span_px=max(span, self.span_px)
        )


def discs(
    image: np.ndarray,
    looks: Appearance,
    radius_px: tuple[float, float],
    mask: np.ndarray | None,
    imposters: Imposters | None,
) -> list[Detection]:
    """Every believable disc of the ball's colour that is not a known still thing."""
    found: list[Detection] = []
    # An assumed colour may be near the plate's: what stands out of it at some level counts.
    levels = (0.43,) if looks.learned else (0.43, 0.65, 0.85)
    blobs = [
        blob
        for least in levels
        for blob in find(image, looks, radius_px=radius_px, mask=mask, least=least)[:AT_MOST]
    ]
    for blob in blobs:
        guess = float(np.clip(blob.radius_px, *radius_px))
        disc = locate(image, looks, blob.u_px, blob.v_px, guess)
        if disc is None or not believable(disc, looks, radius_px, strict=True):
            continue
        u, v, r = disc.u_px, disc.v_px, disc.radius_px
        if not looks.learned and weight(looks.here(image, u, v, r)[1], r) < LEAST_WEIGHT:
            continue
        if imposters is not None and imposters.at(u, v, r) > KNOWN_STILL:
            continue
        if all(math.hypot(u - f.u_px, v - f.v_px) > r for f in found):
            found.append(disc)
    return found


def follow(known: list[Candidate], found: list[Detection]) -> list[Candidate]:
    """The candidates after another frame: nearest of like size continues, the rest is new.

    A candidate that was missed twice in a row is dropped.
    """
    free = list(found)
    after: list[Candidate] = []
    for c in known:
        near = [
            (math.hypot(d.u_px - c.seen.u_px, d.v_px - c.seen.v_px), i)
            for i, d in enumerate(free)
            if abs(math.log(d.radius_px / c.seen.radius_px)) < 0.25
        ]
        if near and min(near)[0] < 3.0 * c.seen.radius_px:
            after.append(c.again(free.pop(min(near)[1])))
        elif c.misses < 2:
            after.append(replace(c, misses=c.misses + 1))
    return after + [Candidate(d, (d.u_px, d.v_px)) for d in free]


def chosen(candidates: list[Candidate], *, at_once: bool) -> Candidate | None:
    """The one to believe, or None while it is not clear.

    A lone one after two frames, or `at_once` where its outline is complete; of several the only
    one that moves.
    """
    here = [c for c in candidates if c.misses == 0]
    moving = [c for c in here if c.moved and c.hits >= 3]
    if len(moving) == 1:
        return moving[0]
    if len(candidates) != 1 or not here:
        return None
    whole = here[0].seen.inliers > 0.85 and here[0].seen.coverage == 1.0
    return here[0] if here[0].hits >= 2 or (at_once and whole) else None


def rough_places(
    image: np.ndarray,
    looks: Appearance,
    origin: tuple[float, float],
    radius_px: float,
    limit_px: float,
) -> list[tuple[float, float]]:
    """Rough centres within `limit_px` of the origin, nearest first: patches of the ball's colour,
    and circles of its size where its colour tells little."""
    u, v = origin
    reach = limit_px + 1.6 * radius_px
    x0, y0 = max(0, int(u - reach)), max(0, int(v - reach))
    window = image[y0 : max(0, int(v + reach)) + 1, x0 : max(0, int(u + reach)) + 1]
    if min(window.shape[:2]) < radius_px:
        return []
    blobs = find(window, looks, radius_px=(radius_px / 1.3, radius_px * 1.3))[:4]
    places = [(b.u_px + x0, b.v_px + y0) for b in blobs]
    if looks.fill < TELLING_FILL:
        rings = circles(
            window, radius_px * np.array([0.93, 1.0, 1.07]), noise=noise_level(window), at_most=3
        )
        places += [(c.u_px + x0, c.v_px + y0) for c in rings]
    return sorted(places, key=lambda p: math.hypot(p[0] - u, p[1] - v))
