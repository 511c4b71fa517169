"""Frames in which the ball is told to be where it cannot be, as a tracker's wild detections.

With p the cubic through the two exposures before and the two behind a stay of at most
LONGEST_FRAMES, and l, r the straight lines through either two, a stay is an outlier where each of
its places is farther than SIGMAS s w + A h^2/8 from p, l and r on one axis, w the root of the sum
of the squares of their weights and 1. A ball that rolls is on the cubic, but for a change of its
acceleration by A within the gap h that it spans; one that bounces or is struck is on one of the
lines. s is 1.4826 times the median of the distance from p over w (Hampel, J. Am. Stat. Assoc. 69,
1974), at least the camera's noise.
"""

import numpy as np

LONGEST_FRAMES = 3  # chosen: longer stays are hands, or another thing that is tracked
SIGMAS = 8.0  # chosen: of normal noise, no frame in the life of a table
ACCELERATION_M_S2 = 3.0  # A: of a plate that turns by 0.4 rad at once


def outliers(t_s: np.ndarray, ball_m: np.ndarray, noise_m: float) -> np.ndarray:
    """True (n,) for the exposures at t_s (n,) [s], increasing, whose places ball_m (n, 2) [m] are
    outliers by the module's rule; `noise_m`: the camera's [m]."""
    found = np.zeros(len(t_s), bool)
    for frames in range(LONGEST_FRAMES, 0, -1):  # a part of a stay may look like a shorter one
        left = np.flatnonzero(~found)
        found[left[_stays(t_s[left], ball_m[left], noise_m, frames)]] = True
    return found


def _stays(t: np.ndarray, ball: np.ndarray, noise_m: float, frames: int) -> np.ndarray:
    """The exposures (k,) of stays of so many frames that are outliers."""
    n = len(t) - frames - 3
    if n < 1:
        return np.zeros(0, int)
    first = np.arange(2, 2 + n)
    around = [first - 2, first - 1, first + frames, first + frames + 1]
    odd = np.ones((n, 2), bool)
    turned = ACCELERATION_M_S2 / 8.0 * (t[around[2]] - t[around[1]])[:, None] ** 2
    for j in range(frames):
        off, wide = _off(t, ball, first + j, around)
        noise = np.maximum(1.4826 * np.median(off / wide, axis=0), noise_m)
        odd &= off > SIGMAS * noise * wide + turned
        for pair in (around[:2], around[2:]):
            off, wide = _off(t, ball, first + j, pair)
            odd &= off > SIGMAS * noise * wide + turned
    begun = first[odd.any(axis=1)]
    return np.unique(begun[:, None] + np.arange(frames))


def _off(
    t: np.ndarray, ball: np.ndarray, at: np.ndarray, rows: list[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Distances (n, 2) of the places at rows `at` (n,) from Lagrange's polynomials through those at
    `rows` (k arrays (n,)), and the deviations (n, 1) of these under noise of 1."""
    through, squares = np.zeros((len(at), 2)), np.ones(len(at))
    with np.errstate(divide="ignore", invalid="ignore"):  # two exposures at one time tell nothing
        for i, own in enumerate(rows):
            weight = np.ones(len(at))
            for k, other in enumerate(rows):
                if k != i:
                    weight *= (t[at] - t[other]) / (t[own] - t[other])
            through += weight[:, None] * ball[own]
            squares += weight**2
    return np.abs(ball[at] - through), np.sqrt(squares)[:, None]
