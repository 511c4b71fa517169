"""Which thing is the ball, if its colour is not known? The round thing that moves.

Still things of any colour are background. A hand moves but is not round; a mark on the tilting
plate is round but hardly moves; what is round, keeps its size and colour, and travels, is the ball.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from vision.detection.appearance import Appearance
from vision.detection.detector import Detection, locate_ball
from vision.detection.hough_circles import Circle, hough_circles
from vision.detection.pixels import colour_moments, mean_between, mean_probability
from vision.detection.streaks_and_mirrors import mirror_silhouette
from vision.frames import Frame
from vision.noise import noise_level
from vision.tracking.gate import is_plausible, outline_significance

WORK_SIZE = 320  # px, longer side of the image that is searched for motion and circles
FORGET_S = 0.4  # time constant of the background
AT_MOST = 12  # discs watched at a time
# Of the image's longer side: a mark at the edge of a plate tilted by 6 degrees shifts by 1 %.
TRAVEL = 0.03
LEAST_SIGNIFICANCE = 7.0
# A ball's outline is whole and sharp. Its shadow on a bright plate is round and moves as well,
# but its edge is soft here and hidden by the ball there.
LEAST_QUALITY = 0.83
# A disc smaller than this may be a highlight on a ball that hardly differs from the plate, if its
# edge is too soft to be fitted, or if it is white on something bright.
SMALL_PX, BRIGHT = 16.0, 235.0
DARK = 80.0  # brightest channel's mean below which a disc counts as badly lit


@dataclass(frozen=True, eq=False)
class MovingDisc:
    """A round thing that is watched: its appearance when first seen, and its places since.

    `path`: (u, v, radius) [px] by frame, at most the last 41; `quality` (0..1): the smoothed share
    of its outline that was seen; `misses`: the number of last frames in which it was not found.
    """

    appearance: Appearance
    path: tuple[tuple[float, float, float], ...]
    quality: float
    misses: int = 0

    @property
    def last(self) -> tuple[float, float, float]:
        """(u, v, radius) [px] where the disc was seen last."""
        return self.path[-1]

    @property
    def significance(self) -> float:
        """Significance of the disc's outline [1], see `gate.outline_significance`."""
        return outline_significance(self.appearance.separation, self.last[2])

    def guess(self) -> tuple[float, float]:
        """(u, v) [px] in the next frame, at the speed of the last step."""
        if len(self.path) < 2:
            return self.last[:2]
        (u0, v0, _), (u1, v1, _) = self.path[-2:]
        return 2 * u1 - u0, 2 * v1 - v0

    def convincing(self, least_px: float) -> bool:
        """Whether the disc was seen in six frames or more, has one size, and travelled over
        `least_px`.

        Travelling: its span exceeds 40 % of its path's length, which jitter does not reach.
        """
        if len(self.path) < 6 or self.misses or self.quality < LEAST_QUALITY:
            return False
        path = np.array(self.path)
        radius = float(np.median(path[:, 2]))
        steps = np.hypot(*np.diff(path[:, :2], axis=0).T)
        span = float(np.hypot(*(path[:, :2] - path[0, :2]).T).max())
        travels = span > max(least_px, radius) and span > 0.4 * float(steps.sum())
        return travels and float(np.std(path[:, 2])) < 0.1 * radius


class Acquisition:
    """Watches frames until one ball is found; then gives its appearance and place.

    `radius_px` (min, max) bounds its radius, `mask` (h, w) uint8 is nonzero where it can be,
    `colour` is an assumed appearance that it must have.
    """

    def __init__(
        self,
        radius_px: tuple[float, float] | None = None,
        mask: np.ndarray | None = None,
        *,
        colour: Appearance | None = None,
    ) -> None:
        self._bounds = radius_px
        self._colour = colour
        self._mask = mask
        self._background: np.ndarray | None = None
        self._difference = np.zeros((1, 1), np.uint8)  # 255 where the small image has changed
        self._scale = 1.0
        self._t_s = 0.0
        self._movers: list[MovingDisc] = []

    def step(self, frame: Frame) -> tuple[Appearance, Detection] | None:
        """The ball's appearance and detection in this frame, once it has been recognised, else
        None; frames come in order of time."""
        image = frame.image
        scale = self._scale = max(1.0, max(image.shape[:2]) / WORK_SIZE)
        size = (round(image.shape[1] / scale), round(image.shape[0] / scale))
        small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        region = self._changed(small, frame.t_s)
        rings: list[Circle] = []
        if region is not None:
            lo, hi = self._bounds or (3.0 * scale, 0.22 * min(image.shape[:2]))
            steps = max(2, math.ceil(math.log(hi / lo) / 0.13))
            radii = np.geomspace(lo, hi, steps) / scale
            rings = hough_circles(small, radii, noise=noise_level(small), region=region, at_most=10)
        places = [
            (scale * (c.u_px + 0.5) - 0.5, scale * (c.v_px + 0.5) - 0.5, scale * c.radius_px)
            for c in rings
        ]
        moved = [self._follow(m, image, places) for m in self._movers]
        self._movers = _distinct([m for m in moved if m is not None])
        self._start(image, places)
        return self._recognised(image)

    def _changed(self, small: np.ndarray, t_s: float) -> np.ndarray | None:
        """Mask (h, w) uint8 around what differs from the background; None where nothing does.

        The background is a running mean with time constant `FORGET_S`.
        """
        now = small.astype(np.float32)
        if self._background is None:
            self._background, self._t_s = now, t_s
            return None
        difference = np.abs(now - self._background).max(2)
        gain = 1.0 - math.exp(-max(t_s - self._t_s, 1e-3) / FORGET_S)
        self._background += gain * (now - self._background)
        self._t_s = t_s
        binary = (difference > max(10.0, 5.0 * noise_level(small))).astype(np.uint8)
        self._difference = 255 * binary
        _, _, stats, _ = cv2.connectedComponentsWithStats(binary, connectivity=8)
        region = np.zeros(binary.shape, np.uint8)
        for x, y, w, h, area in stats[1:].reshape(-1, 5):
            # A slow ball changes at its front and back only: take in what lies between.
            grow = max(4, int(max(w, h)))
            if area >= 3:
                top, left = max(0, y - grow), max(0, x - grow)
                region[top : y + h + grow, left : x + w + grow] = 255
        if self._mask is not None:
            size = (small.shape[1], small.shape[0])
            allowed = np.asarray(cv2.resize(self._mask, size, interpolation=cv2.INTER_NEAREST))
            region[allowed == 0] = 0
        return region if region.any() else None

    def _follow(
        self, mover: MovingDisc, image: np.ndarray, places: list[tuple[float, float, float]]
    ) -> MovingDisc | None:
        """The mover in the next image, by its outline near the guess or a circle of its size."""
        radius = mover.last[2]
        near = [
            (math.hypot(u - mover.last[0], v - mover.last[1]), u, v)
            for u, v, r in places
            if abs(math.log(r / radius)) < 0.4
        ]
        guesses = [mover.guess(), mover.last[:2]]
        guesses += [(u, v) for d, u, v in sorted(near)[:1] if d < 4.0 * radius]
        bounds = (0.8 * radius, 1.25 * radius)
        for u, v in guesses:
            found = locate_ball(image, mover.appearance, u, v, radius)
            if found is not None and is_plausible(found, mover.appearance, bounds, strict=True):
                step = (found.u_px, found.v_px, found.radius_px)
                quality = mover.quality + 0.3 * (found.inliers - mover.quality)
                return MovingDisc(mover.appearance, (*mover.path[-40:], step), quality)
        missed = replace(mover, misses=mover.misses + 1)
        return missed if missed.misses < 4 else None

    def _start(self, image: np.ndarray, places: list[tuple[float, float, float]]) -> None:
        for u, v, r in places:
            if len(self._movers) >= AT_MOST or any(
                math.hypot(u - m.last[0], v - m.last[1]) < 0.7 * m.last[2] for m in self._movers
            ):
                continue
            appearance = Appearance.sketch(image, u, v, r)
            bounds = (0.7 * r, 1.4 * r)
            found = locate_ball(image, appearance, u, v, r)
            if found is None or not is_plausible(found, appearance, bounds, strict=True):
                continue
            appearance, found = _outermost(image, appearance, found)
            if self._allowed(image, found):
                place = (found.u_px, found.v_px, found.radius_px)
                self._movers.append(MovingDisc(appearance, (place,), found.inliers))

    def _allowed(self, image: np.ndarray, found: Detection) -> bool:
        """Whether it has the size and colour that were asked for, and stands alone."""
        if self._bounds and not self._bounds[0] <= found.radius_px <= self._bounds[1]:
            return False
        if not self._alone(found):
            return False
        if self._colour is None:
            return True
        u, v, r = found.u_px, found.v_px, 0.85 * found.radius_px
        if mean_probability(image, self._colour.table, u, v, 0.0, r) > 0.35:
            return True
        # In the dark noise hides a pixel's colour, not the disc's: judge its mean, brightened.
        mean = colour_moments(image, u, v, 0.0, r)[1]
        if mean.max() > DARK:
            return False
        lit = np.clip(mean * (2.0 * DARK / max(float(mean.max()), 1.0)), 0, 255).astype(int) >> 3
        return bool(self._colour.table[lit[0] << 10 | lit[1] << 5 | lit[2]] > 255 * 0.35)

    def _alone(self, found: Detection) -> bool:
        """Whether still background surrounds it, unlike a highlight on a ball, or a knuckle."""
        u, v = ((x + 0.5) / self._scale - 0.5 for x in (found.u_px, found.v_px))
        r = found.radius_px / self._scale
        return mean_between(self._difference, u, v, 1.25 * r + 1.0, 1.7 * r + 1.5) < 255 * 0.65

    def _recognised(self, image: np.ndarray) -> tuple[Appearance, Detection] | None:
        least = TRAVEL * max(image.shape[:2])
        sure = [
            m for m in self._movers if m.convincing(least) and m.significance > LEAST_SIGNIFICANCE
        ]
        for best in sorted(sure, key=lambda m: -m.significance * math.sqrt(len(m.path))):
            u, v, r = best.last
            appearance = Appearance.learn(image, u, v, r)
            found = locate_ball(image, appearance, u, v, r)
            if found is not None and not (self._bounds is None and _glint(image, found)):
                return appearance, _ringed(best, found, image)
        return None


def _glint(image: np.ndarray, found: Detection) -> bool:
    """Whether it may be a highlight: see `SMALL_PX`."""
    place, r = (found.u_px, found.v_px), found.radius_px
    inside, beside = (
        colour_moments(image, *place, 0.0, 0.7 * r)[1],
        colour_moments(image, *place, 1.3 * r, 2 * r)[1],
    )
    white_on_bright = inside.min() > BRIGHT and beside.max() > 0.5 * BRIGHT
    return r < SMALL_PX and (not math.isfinite(found.blur_px) or bool(white_on_bright))


def _distinct(movers: list[MovingDisc]) -> list[MovingDisc]:
    """One mover per disc: of those that ended on the same, the one that was watched longest."""
    distinct: list[MovingDisc] = []
    for m in sorted(movers, key=lambda m: (m.misses, -len(m.path))):
        u, v, _ = m.last
        if all(math.hypot(u - d.last[0], v - d.last[1]) > d.last[2] for d in distinct):
            distinct.append(m)
    return distinct


def _outermost(
    image: np.ndarray, appearance: Appearance, found: Detection
) -> tuple[Appearance, Detection]:
    """The largest plausible disc about the same centre: a ball's highlights are round as well."""
    inner = found
    for factor in (1.2, 1.4, 1.65, 2.0):
        radius = factor * inner.radius_px
        wider = Appearance.sketch(image, inner.u_px, inner.v_px, radius)
        disc = locate_ball(image, wider, inner.u_px, inner.v_px, radius, reach=0.2)
        bounds = (max(1.1 * found.radius_px, 0.85 * radius), 1.15 * radius)
        if disc is None or not is_plausible(disc, wider, bounds, strict=True):
            continue
        if math.hypot(disc.u_px - inner.u_px, disc.v_px - inner.v_px) < 0.2 * inner.radius_px:
            appearance, found = wider, disc
    return appearance, found


def _ringed(mover: MovingDisc, found: Detection, image: np.ndarray) -> Detection:
    """The silhouette about `found` where that is the inner outline of a mirroring ball."""
    silhouette = mirror_silhouette(image, mover.appearance, found)
    return found if silhouette is None else silhouette
