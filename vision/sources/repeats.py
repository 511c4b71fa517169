"""Which frames of a container show the same exposure again?

A container may claim more frames than there were exposures (a 250 fps file of a 10 fps webcam).
Repeats carry no new light but a later time stamp, which would turn a moving ball into a stuttering
one. They are not quite equal: codecs go on refining a picture that they were shown before.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import islice, pairwise

import cv2
import numpy as np

from vision.noise import noise_level

# A new exposure differs from the last by 1.13 sigma of sensor noise on average (mean of
# |N(0, 2 sigma^2)|). A re-encoded repeat stays an order of magnitude below that, or below one grey
# level in a twentieth of the pixels, which no sensor does.
REPEAT_SHARE, REPEAT_LEVEL = 0.08, 0.05
# Mean change of an 8x8 block by which a codec refines the same picture at most: a rounding step or
# two, and a share of the noise that it had smoothed away. Something that moves changes a block by
# a multiple (`STRONG`) of that.
LOCAL_LEVEL, LOCAL_SHARE, STRONG = 2.0, 8.0, 3.0
# How many strong changes settle whether a container has repeats, and where to stop looking.
ENOUGH, AT_MOST = 24, 1500
LONG_RUN = 6


def local_change(image: np.ndarray, other: np.ndarray) -> float:
    """The largest mean change of an 8x8 block between `image` and `other` (h, w, 3) uint8, of one
    size, in grey levels (0..255).
    """
    h, w = image.shape[:2]
    blocks = (max(1, w // 8), max(1, h // 8))
    change = cv2.resize(cv2.absdiff(image, other), blocks, interpolation=cv2.INTER_AREA)
    return float(change.max())


def has_repeats(images: Iterable[np.ndarray]) -> bool | None:
    """Whether a container's images (h, w, 3) hold repeats as a rule, as far as motion tells.

    What moves changes in every exposure; between repeats it stands still, so that strong changes
    come alone. None where too little moves to tell.
    """
    runs: list[int] = []
    limit, run = math.nan, 0
    for last, image in pairwise(islice(images, AT_MOST)):
        if image.shape != last.shape:
            break
        if math.isnan(limit):
            limit = STRONG * (LOCAL_LEVEL + LOCAL_SHARE * noise_level(last))
        if local_change(image, last) > limit:
            run += 1
        elif run:
            runs.append(run)
            run = 0
        if sum(runs) + run >= ENOUGH:
            break
    runs.append(run)
    strong = sum(runs)
    if strong < LONG_RUN:
        return None
    return sum(r for r in runs if r >= LONG_RUN) <= 0.8 * strong


class RepeatFilter:
    """Tells a repeat from a new exposure, one frame after the other.

    `repeats` says whether the container is known to hold them (`has_repeats`). Where it is not, a
    single one is told by the motion that it interrupts, and what stands still is a still scene.
    """

    def __init__(self, *, repeats: bool | None = None) -> None:
        self._repeats = repeats
        self._last: np.ndarray | None = None
        self._kept: np.ndarray | None = None
        self._noise = 0.0
        self._moved = False

    def is_repeat(self, image: np.ndarray) -> bool:
        """Whether the (h, w, 3) image shows the same exposure as its predecessor.

        The mean change is judged against the noise of the picture itself; the largest local change
        since the last kept frame saves a small ball that creeps over a large still plate.
        """
        last, kept = self._last, self._kept
        self._last = image
        if last is None or kept is None or last.shape != image.shape:
            self._kept, self._noise = image, noise_level(image)
            return False
        limit = LOCAL_LEVEL + LOCAL_SHARE * self._noise
        mean_change = float(np.mean(cv2.mean(cv2.absdiff(image, last))[:3]))
        still = mean_change <= max(REPEAT_LEVEL, REPEAT_SHARE * self._noise)
        # A coarse codec refines the ball's edge by more than that, if it is given the time.
        still = still and local_change(image, kept) <= limit * (STRONG if self._repeats else 1.0)
        if still and (self._moved or self._repeats is not False):
            self._moved = False
            return True
        self._moved = not still and local_change(image, last) > STRONG * limit
        self._kept = image
        self._noise += 0.05 * (noise_level(image) - self._noise)
        return False
