"""Exposures that tell a place again to the last digit, as of a tracker that lost the ball.

Where a camera's readings are coarse, in whole pixels or millimetres, a ball at rest is told at one
place for long, and a ball that moves slowly comes back to places that it had: of those that are
told FEWEST times in a row or less, more than COMING_BACK are told again at another time. Elsewhere
noise makes each reading a new one, and more of one place in a row are no readings.
"""

import numpy as np

# Chosen: with readings a noise's deviation apart, of which COMING_BACK come back at least, a ball
# at rest is told so often in a row once in 2000 frames.
FEWEST = 4
COMING_BACK = 0.01  # share; chosen: of readings a tenth of the noise apart it is less by far


def repeats(ball_m: np.ndarray) -> np.ndarray:
    """True (n,) for the exposures whose places ball_m (n, 2) [m], in their order, are no readings
    by the module's rule: the first of a place, which the ball may have left, too."""
    if not len(ball_m):
        return np.zeros(0, bool)
    new = np.concatenate([[True], (ball_m[1:] != ball_m[:-1]).any(axis=1)])
    begin = np.flatnonzero(new)
    told = np.diff(np.append(begin, len(ball_m)))  # times in a row
    places = ball_m[begin][told <= FEWEST]
    again = len(places) - len(np.unique(places, axis=0))
    if again > COMING_BACK * len(places) or not len(places):
        return np.zeros(len(ball_m), bool)
    return np.repeat(told > FEWEST, told)
