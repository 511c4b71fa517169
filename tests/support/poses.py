"""Poses of the plate by geometry alone, for tests of what looks at it."""

import numpy as np


def tilt(s_x: float, s_y: float) -> np.ndarray:
    """Rotation (3, 3) by the least angle that takes the z axis to (s_x, s_y, sqrt(1 - ...))."""
    c = np.sqrt(1 - s_x**2 - s_y**2)
    return np.array(
        [
            [1 - s_x**2 / (1 + c), -s_x * s_y / (1 + c), s_x],
            [-s_x * s_y / (1 + c), 1 - s_y**2 / (1 + c), s_y],
            [-s_x, -s_y, c],
        ]
    )
