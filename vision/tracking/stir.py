"""What changes in the image, beside a thing at rest and along with one that moves?

A ball that no circle shows, white on a pale plate or polished, still changes the image where it
rolls: a thing that rests meanwhile may be a mark. What changed within the last `SPAN_S` is taken in
compact patches, as a ball leaves: a hand reaches in over the image's border, other light changes
all of it. A ball rolls alone, but for its shadow: where more changes along with a round thing, as
at a fingertip, a knuckle or a highlight, it is a part of something larger.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from vision.noise import noise_level

SPAN_S = 0.3  # a ball that starts on a slope of 1 degree rolls 5 mm in it
MEMORY_S = 2.0  # as long as things are remembered, which are asked where they came from
SIDE_PX = 200  # chosen: of the longer side of the images compared, in which a small ball is 3 px
SIGMAS, LEAST_STEP = 6.0, 12.0  # of a change: standard deviations of the noise, grey levels
LEAST_PX = 6  # area of a patch: a small ball moved by its radius; packing noise changes 1 to 4
LARGEST_SHARE = 0.5  # of the shorter side: what a rolling ball's patch spans at most
# Discs' areas that change beside a ball which moves alone: its shadow, where that is and was. Under
# a lamp `a` above the plate it covers 1/sin a discs; 30 degrees, chosen: lower ones light no table.
SHADOWS = 2.0 / 0.5
PLAIN = 2.0  # of the least change: contrast of a disc of which the small image's blur leaves enough
SOFT_RADII, SOFT_PX = 0.25, 1.5  # about a disc, still its own: a rough radius; the small image
SUB_PX = 16  # parts of a pixel to which a way is drawn


class Stir:
    """Remembers small images of the last `MEMORY_S`; where those of the last `SPAN_S` differ."""

    def __init__(self) -> None:
        self._seen: list[tuple[float, np.ndarray]] = []
        self._changed = np.zeros((1, 1), np.uint8)
        self._patches, self._labels = np.zeros((0, 2)), np.zeros((1, 1), np.int32)
        self._step, self._least = 1, LEAST_STEP

    def add(self, t_s: float, image: np.ndarray) -> None:
        """Look at an image (h, w, 3) uint8 BGR at a time."""
        self._step = max(1, round(max(image.shape[:2]) / SIDE_PX))
        size = max(1, image.shape[1] // self._step), max(1, image.shape[0] // self._step)
        small = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))
        small = np.asarray(cv2.GaussianBlur(small, (3, 3), 0))
        self._seen = [
            x for x in self._seen if 0.0 <= t_s - x[0] <= MEMORY_S and x[1].shape == small.shape
        ]
        self._seen.append((t_s, small))
        before = next(image for seen_s, image in self._seen if t_s - seen_s <= SPAN_S)
        self._least = max(LEAST_STEP, SIGMAS * noise_level(small))
        self._changed = (cv2.absdiff(before, small).max(2) > self._least).astype(np.uint8)
        self._patches, self._labels = _compact(self._changed)

    def elsewhere(self, place: tuple[float, float], radius_px: float) -> bool:
        """Whether something stirs farther than two radii from a place (u, v) px, and nothing does
        within one and a half."""
        (u, v), r = self._small(place), radius_px / self._step
        if not any(math.dist((u, v), patch) > 2.0 * r for patch in self._patches):
            return False
        near = self._near(self._changed, place, 1.5 * radius_px + self._step)
        return int(near.sum()) < LEAST_PX

    def is_calm(
        self, place: tuple[float, float], radius_px: float, contrast: float, since_s: float
    ) -> bool:
        """Whether nothing came to a place (u, v) px since a time: a disc of that radius and
        contrast [grey levels] would have changed it. Not where the time is not remembered."""
        then = [image for seen_s, image in self._seen[:-1] if seen_s <= since_s]
        if not then or contrast <= PLAIN * self._least:
            return False
        core = 0.5 * radius_px  # where a mark that sways with its plate looks as before
        old, new = (self._near(x, place, core) for x in (then[-1], self._seen[-1][1]))
        return not np.abs(old.astype(int) - new).max(2).mean() > self._least

    def _near(self, small: np.ndarray, place: tuple[float, float], reach_px: float) -> np.ndarray:
        """What a small image shows in a square about a place (u, v) px."""
        (u, v), reach = self._small(place), reach_px / self._step
        x, y = max(0, round(u - reach)), max(0, round(v - reach))
        return small[y : max(0, round(v + reach)) + 1, x : max(0, round(u + reach)) + 1]

    def joined(self, way: list[tuple[float, float]], radius_px: float, *, still: bool) -> bool:
        """Whether what changed at a thing is part of something larger; `way`: places (u, v) px that
        it went by within the last `SPAN_S`; without `still`, what reaches all sides of the image is
        nothing larger, but the camera or the light that changes."""
        r = radius_px / self._step
        disc = self._swept(way, r)
        own = self._swept(way, (1.0 + SOFT_RADII) * r + SOFT_PX)
        c = np.isin(self._labels, np.setdiff1d(self._labels[disc], (0,)))
        if int((c & ~own).sum()) <= max(SHADOWS * math.pi * r**2, LEAST_PX):
            return False
        return still or not all(side.any() for side in (c[0], c[-1], c[:, 0], c[:, -1]))

    def _swept(self, way: list[tuple[float, float]], radius: float) -> np.ndarray:
        """Where a disc of this radius (px of the small image) went along a way, (h, w) bool."""
        places = np.array([self._small(place) for place in (way[0], *way)])
        line = np.rint(SUB_PX * places).astype(np.int32)
        swept = np.zeros(self._changed.shape, np.uint8)
        wide = max(1, round(2.0 * radius))
        cv2.polylines(swept, [line], False, 1, wide, cv2.LINE_8, SUB_PX.bit_length() - 1)
        return swept > 0

    def _small(self, place: tuple[float, float]) -> tuple[float, float]:
        """A place (u, v) px in the small image."""
        u, v = ((x + 0.5) / self._step - 0.5 for x in place)
        return u, v


def _compact(changed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Middles (n, 2) px of the compact patches of a map (h, w) uint8 of what changed, and the map's
    connected parts (h, w), numbered from 1."""
    n, labels, stats, middles = cv2.connectedComponentsWithStats(changed, connectivity=8)
    h, w = changed.shape
    x, y, wide, high, area = (np.asarray(stats)[1:n].astype(int)).T
    inside = (x > 0) & (y > 0) & (x + wide < w) & (y + high < h)
    compact = np.maximum(wide, high) < LARGEST_SHARE * min(h, w)
    return np.asarray(middles)[1:n][inside & compact & (area >= LEAST_PX)], np.asarray(labels)
