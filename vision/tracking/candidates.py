"""Which of several discs of the ball's colour is the ball? They are followed until one is clear.

The discs of a frame are associated with those of the last by distance and size; of several, the
only one that moves is chosen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from vision.detection.appearance import Appearance
from vision.detection.blobs import find_blobs
from vision.detection.detector import Detection, locate_ball
from vision.detection.hough_circles import hough_circles
from vision.noise import noise_level
from vision.tracking.gate import TELLING_FILL, is_plausible, outline_significance
from vision.tracking.static_distractors import StaticDistractors

AT_MOST = 8  # patches of colour that are looked at more closely
DISTRACTOR_LIMIT = 0.4  # of `StaticDistractors.at`, above which a disc is a known still thing
# Of a disc that is known by its colour alone; a ball of 5 px on a plain plate has 15 and more.
LEAST_SIGNIFICANCE = 12.0


@dataclass(frozen=True)
class DiscCandidate:
    """A disc seen in `hits` frames and missed in the last `misses`.

    `seen` is its last detection, `start` (u, v) px its first place, `span_px` the farthest that it
    was from there.
    """

    seen: Detection
    start: tuple[float, float]
    hits: int = 1
    misses: int = 0
    span_px: float = 0.0

    @property
    def moved(self) -> bool:
        """Whether the disc moved farther than a mark on the tilting plate appears to: over 5 px and
        over half its radius."""
        return self.span_px > max(5.0, 0.5 * self.seen.radius_px)

    def again(self, seen: Detection) -> DiscCandidate:
        """The candidate after it was detected once more, as `seen`."""
        span = math.hypot(seen.u_px - self.start[0], seen.v_px - self.start[1])
        return replace(
            self, seen=seen, hits=self.hits + 1, misses=0, span_px=max(span, self.span_px)
        )


def find_discs(
    image: np.ndarray,
    appearance: Appearance,
    radius_px: tuple[float, float],
    mask: np.ndarray | None,
    distractors: StaticDistractors | None,
) -> list[Detection]:
    """Every plausible disc of the ball's colour that is not a known still thing.

    `image` (h, w, 3) uint8 BGR, `radius_px` (min, max), `mask` (h, w) uint8 nonzero where the ball
    can be.
    """
    found: list[Detection] = []
    # An assumed colour may be near the plate's: several levels of P(ball) are tried.
    levels = (0.43,) if appearance.learned else (0.43, 0.65, 0.85)
    blobs = [
        blob
        for least in levels
        for blob in find_blobs(image, appearance, radius_px, mask, least=least)[:AT_MOST]
    ]
    for blob in blobs:
        guess = float(np.clip(blob.radius_px, *radius_px))
        disc = locate_ball(image, appearance, blob.u_px, blob.v_px, guess)
        if disc is None or not is_plausible(disc, appearance, radius_px, strict=True):
            continue
        u, v, r = disc.u_px, disc.v_px, disc.radius_px
        if (
            not appearance.learned
            and outline_significance(appearance.here(image, u, v, r)[1], r) < LEAST_SIGNIFICANCE
        ):
            continue
        if distractors is not None and distractors.at(u, v, r) > DISTRACTOR_LIMIT:
            continue
        if all(math.hypot(u - f.u_px, v - f.v_px) > r for f in found):
            found.append(disc)
    return found


def associate(known: list[DiscCandidate], found: list[Detection]) -> list[DiscCandidate]:
    """The candidates after another frame, in which `found` were seen.

    Each continues with the nearest detection of its size (within three radii); detections that are
    left become new candidates. A candidate that is missed three times in a row is dropped.
    """
    free = list(found)
    after: list[DiscCandidate] = []
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
    return after + [DiscCandidate(d, (d.u_px, d.v_px)) for d in free]


def choose_candidate(candidates: list[DiscCandidate], *, at_once: bool) -> DiscCandidate | None:
    """The candidate to accept as the ball, or None while it is not clear which one is.

    It is the only one that moves or, where there is only one candidate, that one after two frames;
    with `at_once` already after one frame, where its outline is complete.
    """
    here = [c for c in candidates if c.misses == 0]
    moving = [c for c in here if c.moved and c.hits >= 3]
    if len(moving) == 1:
        return moving[0]
    if len(candidates) != 1 or not here:
        return None
    whole = here[0].seen.inliers > 0.85 and here[0].seen.coverage == 1.0
    return here[0] if here[0].hits >= 2 or (at_once and whole) else None


def rough_centres(
    image: np.ndarray,
    appearance: Appearance,
    origin: tuple[float, float],
    radius_px: float,
    limit_px: float,
) -> list[tuple[float, float]]:
    """Rough centres (u, v) px in an image (h, w, 3) uint8 BGR within about `limit_px` of `origin`
    (u, v), nearest first.

    Patches of the ball's colour, and circles of its size `radius_px` where its colour tells little.
    """
    u, v = origin
    reach = limit_px + 1.6 * radius_px
    x0, y0 = max(0, int(u - reach)), max(0, int(v - reach))
    window = image[y0 : max(0, int(v + reach)) + 1, x0 : max(0, int(u + reach)) + 1]
    if min(window.shape[:2]) < radius_px:
        return []
    blobs = find_blobs(window, appearance, (radius_px / 1.3, radius_px * 1.3))[:4]
    places = [(b.u_px + x0, b.v_px + y0) for b in blobs]
    if appearance.fill < TELLING_FILL:
        rings = hough_circles(
            window, radius_px * np.array([0.93, 1.0, 1.07]), noise=noise_level(window), at_most=3
        )
        places += [(c.u_px + x0, c.v_px + y0) for c in rings]
    return sorted(places, key=lambda p: math.hypot(p[0] - u, p[1] - v))
