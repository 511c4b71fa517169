"""Still things of the ball's colour, remembered so that none is taken for the ball when it is gone.

While the ball is tracked, whatever else shows its colour is not the ball. A coarse map keeps how
much of the time each spot has done so.
"""

from __future__ import annotations

import cv2
import numpy as np

from vision.appearance import Appearance
from vision.pixels import remember

STEP = 4
MEMORY_S = 0.3
CELLS = 2400  # of the map that a frame refreshes, so that a large frame costs no more
LEAST = 110  # table value from which a spot shows the colour


class Imposters:
    """A map (h / 4, w / 4), 0..1: how reliably each spot shows the colour without the ball."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self._map = np.zeros((shape[0] // STEP, shape[1] // STEP), np.float32)
        self._rows = max(1, min(self._map.shape[0], CELLS // max(1, self._map.shape[1])))
        self._row = 0
        self._clock_s = 0.0
        self._refreshed_s = np.full(self._map.shape[0], -0.5 * MEMORY_S)

    def update(
        self,
        image: np.ndarray,
        looks: Appearance,
        u_px: float,
        v_px: float,
        radius_px: float,
        dt_s: float,
    ) -> None:
        """Learn from a frame in which the ball is known to be at (u_px, v_px)."""
        # The ball, its blur and its shadow say nothing about what lies under them.
        self._clock_s += max(dt_s, 0.0)
        gain = np.minimum(0.5, (self._clock_s - self._refreshed_s) / MEMORY_S)
        ball = u_px / STEP, v_px / STEP, 1.5 * radius_px / STEP + 2.0
        args = self._row, self._rows, STEP, gain, *ball, LEAST
        remember(image, looks.table, self._map, *args)
        last = self._row + self._rows
        self._refreshed_s[self._row : last] = self._clock_s
        self._refreshed_s[: max(0, last - len(gain))] = self._clock_s
        self._row = last % len(gain)

    def add(self, u_px: float, v_px: float, radius_px: float) -> None:
        """The spot holds something that is known not to be the ball."""
        centre = (round(u_px / STEP), round(v_px / STEP))
        cv2.circle(self._map, centre, max(1, round(radius_px / STEP)), 1.0, -1)

    def at(self, u_px: float, v_px: float, radius_px: float) -> float:
        """How much of the disc's core (0.7 radii) is known to be of something still, 0..1."""
        r = max(1, round(0.7 * radius_px / STEP))
        u, v = round(u_px / STEP), round(v_px / STEP)
        patch = self._map[max(0, v - r) : v + r + 1, max(0, u - r) : u + r + 1]
        return float(patch.mean()) if patch.size else 0.0
