"""A ball of unknown colour, found by itself: the round thing that moves.

Still things of any colour are background. A hand moves but is not round; a mark on the tilting
plate is round but hardly moves; what is round, keeps its size and colour, and travels, is the ball.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from vision.appearance import Appearance
from vision.detector import Detection, locate
from vision.frames import Frame
from vision.gate import believable, weight
from vision.pixels import mean_between, moments, share
from vision.repeats import noise_level
from vision.unusual import surround
from vision.votes import Circle, circles

WORK_SIZE = 320  # px, longer side of the image that is searched for motion and circles
FORGET_S = 0.4
AT_MOST = 12
# Of the image's longer side: a mark at the edge of a plate tilted by 6 degrees shifts by 1 %.
TRAVEL = 0.03
LEAST_WEIGHT = 7.0
# A ball's outline is whole and sharp. Its shadow on a bright plate is round and moves as well,
# but its edge is soft here and hidden by the ball there.
LEAST_QUALITY = 0.83
# A disc smaller than this may be a highlight on a ball that hardly differs from the plate, if its
# edge is too soft to be fitted, or if it is white on something bright.
SMALL_PX, BRIGHT = 16.0, 235.0
DARK = 80.0  # brightest channel's mean below which a disc counts as badly lit


@dataclass(frozen=True, eq=False)
class Mover:
    """A round thing under observation: its looks when first seen, and where it was since."""

    looks: Appearance
    path: tuple[tuple[float, float, float], ...]  # u, v, radius in px
    quality: float
    misses: int = 0

    @property
    def last(self) -> tuple[float, float, float]:
        return self.path[-1]

    @property
    def weight(self) -> float:
        """How much it stands out."""
        return weight(self.looks.separation, self.last[2])

    def guess(self) -> tuple[float, float]:
        """Where it goes on to at the speed of the last step."""
        if len(self.path) < 2:
            return self.last[:2]
        (u0, v0, _), (u1, v1, _) = self.path[-2:]
        return 2 * u1 - u0, 2 * v1 - v0

    def convincing(self, least_px: float) -> bool:
        """Seen often, of one size, and travelling (over `least_px`) rather than jittering."""
        if len(self.path) < 6 or self.misses or self.quality < LEAST_QUALITY:
            return False
        path = np.array(self.path)
        radius = float(np.median(path[:, 2]))
        steps = np.hypot(*np.diff(path[:, :2], axis=0).T)
        span = float(np.hypot(*(path[:, :2] - path[0, :2]).T).max())
        travels = span > max(least_px, radius) and span > 0.4 * float(steps.sum())
        return travels and float(np.std(path[:, 2])) < 0.1 * radius


class Acquisition:
    """Watches frames until one ball is found; then says how it looks and where it is.

    `radius_px` (min, max) and `mask` (h, w) bound it, `colour` (an assumed appearance) narrows it.
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
        self._movers: list[Mover] = []

    def step(self, frame: Frame) -> tuple[Appearance, Detection] | None:
        """The ball's looks and place once it has been recognised, else None."""
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
            rings = circles(small, radii, noise=noise_level(small), region=region, at_most=10)
        places = [
            (scale * (c.u_px + 0.5) - 0.5, scale * (c.v_px + 0.5) - 0.5, scale * c.radius_px)
            for c in rings
        ]
        moved = [self._follow(m, image, places) for m in self._movers]
        self._movers = _distinct([m for m in moved if m is not None])
        self._start(image, places)
        return self._recognised(image)

    def _changed(self, small: np.ndarray, t_s: float) -> np.ndarray | None:
        """Mask (h, w) uint8 around what differs from the background; None where nothing does."""
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
        self, mover: Mover, image: np.ndarray, places: list[tuple[float, float, float]]
    ) -> Mover | None:
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
            found = locate(image, mover.looks, u, v, radius)
            if found is not None and believable(found, mover.looks, bounds, strict=True):
                step = (found.u_px, found.v_px, found.radius_px)
                quality = mover.quality + 0.3 * (found.inliers - mover.quality)
                return Mover(mover.looks, (*mover.path[-40:], step), quality)
        misses = mover.misses + 1
        return Mover(mover.looks, mover.path, mover.quality, misses) if misses < 4 else None

    def _start(self, image: np.ndarray, places: list[tuple[float, float, float]]) -> None:
        for u, v, r in places:
            if len(self._movers) >= AT_MOST or any(
                math.hypot(u - m.last[0], v - m.last[1]) < 0.7 * m.last[2] for m in self._movers
            ):
                continue
            looks = Appearance.sketch(image, u, v, r)
            bounds = (0.7 * r, 1.4 * r)
            found = locate(image, looks, u, v, r)
            if found is None or not believable(found, looks, bounds, strict=True):
                continue
            looks, found = _outermost(image, looks, found)
            if self._allowed(image, found):
                place = (found.u_px, found.v_px, found.radius_px)
                self._movers.append(Mover(looks, (place,), found.inliers))

    def _allowed(self, image: np.ndarray, found: Detection) -> bool:
        """Whether it is of the size and colour that were asked for."""
        if self._bounds and not self._bounds[0] <= found.radius_px <= self._bounds[1]:
            return False
        if not self._alone(found):
            return False
        if self._colour is None:
            return True
        u, v, r = found.u_px, found.v_px, 0.85 * found.radius_px
        if share(image, self._colour.table, u, v, 0.0, r) > 0.35:
            return True
        # In the dark noise hides a pixel's colour, not the disc's: ask its mean, brightened.
        mean = moments(image, u, v, 0.0, r)[1]
        if mean.max() > DARK:
            return False
        lit = np.clip(mean * (2.0 * DARK / max(float(mean.max()), 1.0)), 0, 255).astype(int) >> 3
        return bool(self._colour.table[lit[0] << 10 | lit[1] << 5 | lit[2]] > 255 * 0.35)

    def _alone(self, found: Detection) -> bool:
        """Whether still background lies about it: not a highlight on a ball, nor a knuckle."""
        u, v = ((x + 0.5) / self._scale - 0.5 for x in (found.u_px, found.v_px))
        r = found.radius_px / self._scale
        return mean_between(self._difference, u, v, 1.25 * r + 1.0, 1.7 * r + 1.5) < 255 * 0.65

    def _recognised(self, image: np.ndarray) -> tuple[Appearance, Detection] | None:
        least = TRAVEL * max(image.shape[:2])
        sure = [m for m in self._movers if m.convincing(least) and m.weight > LEAST_WEIGHT]
        for best in sorted(sure, key=lambda m: -m.weight * math.sqrt(len(m.path))):
            u, v, r = best.last
            looks = Appearance.learn(image, u, v, r)
            found = locate(image, looks, u, v, r)
            if found is not None and not (self._bounds is None and _glint(image, found)):
                return looks, _ringed(best, found, image)
        return None


def _glint(image: np.ndarray, found: Detection) -> bool:
    """Whether it may be a highlight: see `SMALL_PX`."""
    place, r = (found.u_px, found.v_px), found.radius_px
    inside, beside = (
        moments(image, *place, 0.0, 0.7 * r)[1],
        moments(image, *place, 1.3 * r, 2 * r)[1],
    )
    white_on_bright = inside.min() > BRIGHT and beside.max() > 0.5 * BRIGHT
    return r < SMALL_PX and (not math.isfinite(found.blur_px) or bool(white_on_bright))


def _distinct(movers: list[Mover]) -> list[Mover]:
    """Of movers that ended on the same disc the one that was watched longest."""
    kept: list[Mover] = []
    for m in sorted(movers, key=lambda m: (m.misses, -len(m.path))):
        if all(math.hypot(m.last[0] - k.last[0], m.last[1] - k.last[1]) > k.last[2] for k in kept):
            kept.append(m)
    return kept


def _outermost(
    image: np.ndarray, looks: Appearance, found: Detection
) -> tuple[Appearance, Detection]:
    """The largest believable disc about the same centre: a ball's highlights are round as well."""
    inner = found
    for factor in (1.2, 1.4, 1.65, 2.0):
        radius = factor * inner.radius_px
        wider = Appearance.sketch(image, inner.u_px, inner.v_px, radius)
        disc = locate(image, wider, inner.u_px, inner.v_px, radius, reach=0.2)
        bounds = (max(1.1 * found.radius_px, 0.85 * radius), 1.15 * radius)
        if disc is None or not believable(disc, wider, bounds, strict=True):
            continue
        if math.hypot(disc.u_px - inner.u_px, disc.v_px - inner.v_px) < 0.2 * inner.radius_px:
            looks, found = wider, disc
    return looks, found


def _ringed(mover: Mover, found: Detection, image: np.ndarray) -> Detection:
    """The silhouette about what was watched, where it is but the inside of a mirroring ball."""
    whole = surround(image, mover.looks, found)
    return found if whole is None else whole
