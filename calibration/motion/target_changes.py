"""Where a controller worked in a log of commands and ball, and when it was given another target.

Nobody needs to have recorded the target: a controller answers its change at once, while the ball
still lies where it was. From tick to tick commands follow

    c_k = a_1 c_(k-1) + a_2 c_(k-2) + b_0 x_k + b_1 x_(k-1) + b_2 x_(k-2) + const

and what this misses, summed over 0.1 s, stands out where the target changed.
"""

from collections.abc import Iterator

import numpy as np

SHORTEST_S = 5.0  # of a stretch; chosen: a step and its settling
AT_REST_S = 0.25  # commands that stand still for longer: nobody controls; a ball unseen: not there
SUM_S = 0.1  # chosen: a controller's first answer
CHANGE_Z = 8.0  # robust deviations; chosen: noise of commands reaches 6
FLOOR = 0.1  # of the commands' deviation; chosen: commands without noise still meet limits
APART_S = 1.0  # two changes are further apart; chosen: the answer to one lasts as long
SETTLE_S = 1.0  # after the begin of a stretch: the filter's state at its begin is not known
ROUNDS = 8  # of reweighting; chosen: the coefficients move by less than 1 % in the last


def stretches(t_s: np.ndarray, ball_m: np.ndarray, command_rad: np.ndarray) -> list[slice]:
    """The rows in which the ball was seen and commands moved, as slices of SHORTEST_S and more.

    t_s (n,); ball_m (n, 2), NaN where no frame arrived; command_rad (n, 2).
    """
    seen = np.isfinite(ball_m).all(axis=1)
    moved = np.append([True], np.diff(command_rad, axis=0).any(axis=1))
    good = np.isfinite(command_rad).all(axis=1)
    for there in (np.asarray(seen), np.asarray(moved)):  # some time before, and some time after
        good &= _lately(t_s, there) & _lately(-t_s[::-1], there[::-1])[::-1]
    edges = np.flatnonzero(np.diff(np.concatenate([[0], good.astype(int), [0]])))
    found = [slice(int(i), int(j)) for i, j in edges.reshape(-1, 2)]
    return [s for s in found if t_s[s.stop - 1] - t_s[s.start] >= SHORTEST_S]


def _lately(t_s: np.ndarray, there: np.ndarray) -> np.ndarray:
    """Rows (n,) at which something was there within AT_REST_S before."""
    last = np.maximum.accumulate(np.where(there, t_s, -np.inf))
    return t_s - last <= AT_REST_S


def held(values: np.ndarray) -> np.ndarray:
    """values (n, 2) with what is no number replaced by the one before it, at the start by the
    first."""
    known = np.isfinite(values)
    first = np.argmax(known, axis=0)
    rows = np.where(known, np.arange(len(values))[:, None], first)
    return np.take_along_axis(values, np.maximum.accumulate(rows, axis=0), axis=0)


def recorded_changes(t_s: np.ndarray, targets: np.ndarray) -> list[int]:
    """Rows of a stretch, t_s (n,), at which a recorded target (n, 2) changed that had stood still
    for APART_S: one that glides in rounded numbers never does."""
    rows = np.flatnonzero((np.diff(targets, axis=0) != 0).any(axis=1)) + 1
    still_s = np.diff(t_s[rows], prepend=-np.inf)
    return [int(k) for k in rows[still_s >= APART_S]]


def told_changes(t_s: np.ndarray, ball_m: np.ndarray, command_rad: np.ndarray) -> list[int]:
    """Rows of a stretch at which its commands tell another target; ball_m (n, 2) is held."""
    dt = float(np.median(np.diff(t_s)))
    width = max(3, round(SUM_S / dt))
    both = [_unlikely(ball_m[:, a], command_rad[:, a], width) for a in range(2)]
    single, z = (np.max([axis[i] for axis in both], axis=0) for i in range(2))
    z[t_s - t_s[0] < SETTLE_S] = 0.0
    return list(_onsets(single, z, max(1, round(APART_S / dt)), width))


def _unlikely(ball: np.ndarray, told: np.ndarray, width: int) -> tuple[np.ndarray, np.ndarray]:
    """By how much each command (n,) differs from what the ball asks for, over the commands'
    deviation, and by how many robust deviations those of this and the next ticks do together."""
    n = len(told)
    past = [told[1 : n - 1], told[: n - 2], ball[2:], ball[1 : n - 1], ball[: n - 2]]
    X, y = np.column_stack([*past, np.ones(n - 2)]), told[2:]
    missed = y - y.mean()
    for _ in range(ROUNDS):
        weight = np.sqrt(np.minimum(1.0, 2.0 * _deviation(missed) / np.maximum(abs(missed), 1e-15)))
        found = np.linalg.lstsq(X * weight[:, None], y * weight, rcond=None)[0]
        missed = y - X @ found
    ahead = np.convolve(missed, np.ones(width), "full")[width - 1 :]  # of this row and later ones
    deviation = float(told.std()) + 1e-12
    z = abs(ahead) / max(_deviation(ahead), FLOOR * deviation)
    return np.append([0.0, 0.0], abs(missed) / deviation), np.append([0.0, 0.0], z)


def _deviation(values: np.ndarray) -> float:
    return float(1.4826 * np.median(abs(values - np.median(values)))) + 1e-12


def _onsets(single: np.ndarray, z: np.ndarray, apart: int, width: int) -> Iterator[int]:
    """The row with which each cluster of unlikely rows begins: the first that differs at least half
    as much as any about it."""
    last = -apart
    for k in np.flatnonzero(z > CHANGE_Z):
        if k - last >= apart:
            about = single[k : k + 2 * width]
            yield max(int(k + np.argmax(about >= 0.5 * about.max())), 1)
        last = k
