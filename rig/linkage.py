"""Servo angles to the plate's pose: Eq. 14 and the rotation that vision needs."""

from math import sin, sqrt

import numpy as np


def tilt_sines(theta_rad: tuple[float, float], ratio: float) -> tuple[float, float]:
    """sin(phi_x), sin(phi_y) of Eq. 14 from the servo angles; `ratio` = 2 R_d/L."""
    return ratio * sin(theta_rad[0]), ratio * sin(theta_rad[1])


def plate_rotation(sines: tuple[float, float]) -> np.ndarray:
    """World from plate (3, 3): the shortest turn that lowers the +x and +y sides by these sines.

    Columns are the plate's axes; the third row is (-sin phi_x, -sin phi_y, c).
    """
    s_x, s_y = sines
    c = sqrt(1.0 - s_x * s_x - s_y * s_y)
    cross = -s_x * s_y / (1.0 + c)
    return np.array(
        [
            [1.0 - s_x * s_x / (1.0 + c), cross, s_x],
            [cross, 1.0 - s_y * s_y / (1.0 + c), s_y],
            [-s_x, -s_y, c],
        ]
    )
