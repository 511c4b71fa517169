"""Still things of the ball's colour, remembered so that none is taken for the ball when it is gone.

While the ball is tracked, whatever else shows its colour is not the ball. A coarse map keeps how
much of the time each spot has done so.
"""

from __future__ import annotations

import cv2
import numpy as np

from vision.appearance import Appearance
from vision.pixels import lookup

STEP = 4
MEMORY_S = 0.3


class Imposters:
    """A map (h / 4, w / 4), 0..1: how reliably each spot shows the colour without the ball."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self._map = np.zeros((shape[0] // STEP, shape[1] // STEP), np.float32)

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
        seen = (lookup(image, looks.table, STEP) > 110).astype(np.float32)
        weight = np.full(seen.shape, min(0.5, max(dt_s, 0.0) / MEMORY_S), np.float32)
        centre = (round(u_px / STEP), round(v_px / STEP))
        # The ball, its blur and its shadow say nothing about what lies under them.
        cv2.circle(weight, centre, int(1.5 * radius_px / STEP) + 2, 0.0, -1)
        self._map += weight * (seen - self._map)

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
