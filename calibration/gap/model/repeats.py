"""Exposures that tell a place again to the last digit, as of a tracker that lost the ball.

Where a camera's readings are coarse, in whole pixels or millimetres, a ball at rest is told at one
place for long, and a ball that moves slowly comes back to places that it had: of those that are
told FEWEST times in a row or less, more than COMING_BACK are told again at another time. Elsewhere
noise makes each reading a new one, and more of one place in a row are no readings: unless a ball
without noise, as a simulator tells it, comes to rest there and leaves by less than STARTS of the
usual way from a place to the next.
"""

import numpy as np

# Chosen: with readings a noise's deviation apart, of which COMING_BACK come back at least, a ball
# at rest is told so often in a row once in 2000 frames.
FEWEST = 4
COMING_BACK = 0.01  # share; chosen: of readings a tenth of the noise apart it is less by far

STARTS = 0.1  # share; chosen: of a ball that starts at 0.5 m/s2 and usually rolls at 50 mm/s


def repeats(ball_m: np.ndarray) -> np.ndarray:
    """True (n,) for the exposures whose places ball_m (n, 2) [m], in their order, are no readings
    by the module's rule, of both axes or of one, as where a picture ends: the first of a place,
    which the ball may have left, too."""
    sides = ball_m, ball_m[:, :1], ball_m[:, 1:]
    return np.logical_or.reduce([_told_again(places_m) for places_m in sides])


def _told_again(places_m: np.ndarray) -> np.ndarray:
    """`repeats` of places (n, k)."""
    n = len(places_m)
    new = np.concatenate([np.ones(min(n, 1), bool), (places_m[1:] != places_m[:-1]).any(axis=1)])
    begin = np.flatnonzero(new)
    told = np.diff(np.append(begin, n))  # times in a row
    seldom = places_m[begin][told <= FEWEST]
    again = len(seldom) - len(np.unique(seldom, axis=0))
    if len(begin) < 2 or not len(seldom) or again > COMING_BACK * len(seldom):
        return np.zeros(n, bool)
    ways = np.linalg.norm(np.diff(places_m[begin], axis=0), axis=1)
    ends = np.maximum(np.append(0.0, ways), np.append(ways, 0.0))  # the longer of to and from each
    return np.repeat((told > FEWEST) & (ends > STARTS * np.median(ways)), told)
