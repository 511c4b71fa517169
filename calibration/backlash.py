"""Where a joint with play leaves the plate: the friction operator of a slack joint."""

import numpy as np

from rig.compiled import compiled


@compiled
def _follow(theta, half, out):
    place = theta[0]
    for i in range(theta.shape[0]):
        place = min(max(place, theta[i] - half), theta[i] + half)
        out[i] = place


def behind_play(theta_rad: np.ndarray, play_rad: float) -> np.ndarray:
    """Angle (n,) of what follows `theta_rad` (n,) with a play of this full width and stays where it
    is while nothing pushes it."""
    out = np.empty(len(theta_rad))
    _follow(np.ascontiguousarray(theta_rad, float), 0.5 * max(play_rad, 0.0), out)
    return out
