"""How a ball that rolls without slip lies after its path."""

import numpy as np


def attitude(path_m: np.ndarray, radius_m: float) -> np.ndarray:
    """Attitude (n, 3, 3) of a ball that rolled along path (n, 2), from the identity on."""
    found = np.empty((len(path_m), 3, 3))
    rotation = np.eye(3)
    steps = np.diff(path_m, axis=0, prepend=path_m[:1])
    for i, (dx, dy) in enumerate(steps):
        angle = np.hypot(dx, dy) / radius_m
        if angle > 0.0:
            axis = np.array([-dy, dx, 0.0]) / np.hypot(dx, dy)
            cross = np.array([[0, 0, axis[1]], [0, 0, -axis[0]], [-axis[1], axis[0], 0]])
            rotation = (np.eye(3) + np.sin(angle) * cross
                        + (1 - np.cos(angle)) * cross @ cross) @ rotation  # fmt: skip
        found[i] = rotation
    return found
