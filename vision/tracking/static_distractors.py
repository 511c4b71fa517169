"""Which still things have the ball's colour and may be taken for it when it is gone?

While the ball is tracked, whatever else shows its colour is not the ball. A coarse map keeps the
share of the time in which each spot did so.
"""

from __future__ import annotations

import cv2
import numpy as np

from vision.detection.appearance import Appearance
from vision.detection.pixels import update_map

STEP = 4  # px, side of a map cell
MEMORY_S = 0.3  # time constant of the map
CELLS = 2400  # of the map that a frame refreshes, so that the cost does not grow with its size
LEAST = 110  # table value from which a spot shows the colour


class StaticDistractors:
    """Map (h / 4, w / 4) of an image of `shape` (h, w): the share of the time (0..1) in which each
    spot shows the ball's colour while the ball is elsewhere."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self._map = np.zeros((shape[0] // STEP, shape[1] // STEP), np.float32)
        self._rows = max(1, min(self._map.shape[0], CELLS // max(1, self._map.shape[1])))
        self._row = 0
        self._clock_s = 0.0
        self._refreshed_s = np.full(self._map.shape[0], -0.5 * MEMORY_S)

    def update(
        self,
        image: np.ndarray,
        appearance: Appearance,
        u_px: float,
        v_px: float,
        radius_px: float,
        dt_s: float,
    ) -> None:
        """Learn from an image (h, w, 3) uint8 BGR in which the ball is known to be at (u_px, v_px),
        with the radius `radius_px`.

        `dt_s`: the time since the last update. The surroundings of the ball, with its blur and
        shadow, are left as they were.
        """
        self._clock_s += max(dt_s, 0.0)
        gain = np.minimum(0.5, (self._clock_s - self._refreshed_s) / MEMORY_S)
        ball = u_px / STEP, v_px / STEP, 1.5 * radius_px / STEP + 2.0
        args = self._row, self._rows, STEP, gain, *ball, LEAST
        update_map(image, appearance.table, self._map, *args)
        last = self._row + self._rows
        self._refreshed_s[self._row : last] = self._clock_s
        self._refreshed_s[: max(0, last - len(gain))] = self._clock_s
        self._row = last % len(gain)

    def add(self, u_px: float, v_px: float, radius_px: float) -> None:
        """Mark the disc (px) as something that is known not to be the ball."""
        centre = (round(u_px / STEP), round(v_px / STEP))
        cv2.circle(self._map, centre, max(1, round(radius_px / STEP)), 1.0, -1)

    def at(self, u_px: float, v_px: float, radius_px: float) -> float:
        """Mean of the map (0..1) over the core (0.7 radii) of the disc (px)."""
        r = max(1, round(0.7 * radius_px / STEP))
        u, v = round(u_px / STEP), round(v_px / STEP)
        patch = self._map[max(0, v - r) : v + r + 1, max(0, u - r) : u + r + 1]
        return float(patch.mean()) if patch.size else 0.0
