"""Which values of the ball's columns mean `no ball`: -1, 0, 9999, the panel's end, a corner."""

from collections import Counter
from itertools import pairwise

import numpy as np

MIN_ROWS = 3  # a lost ball is lost for longer than a moment, or again and again
LONG_ROWS = 10
FAR = 8.0  # of the 99 % quantile of the steps between rows: no ball moves so between two rows
NEAR = 2.0  # so far a ball may move: between NEAR and FAR it cannot be told
LONGER = 3.0  # times the longest stay anywhere else: no ball rests so much better in one place


def absent_codes(columns: list[np.ndarray]) -> tuple[tuple[float, ...], bool]:
    """The value of each coordinate ((n,) each, 1 or 2) that means `no ball`, and if that is sure.

    Such a value is repeated exactly in all coordinates at once, and the ball jumps to it and from
    it; or it is a whole number, and stays far longer than any other place. Empty where there is
    none. Not sure: the jumps are no larger than a fast ball's.
    """
    points = np.column_stack(columns)
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < 10:
        return (), True
    edges = np.flatnonzero(np.r_[True, np.any(points[1:] != points[:-1], axis=1), True])
    stays = [(tuple(points[a].tolist()), int(b - a)) for a, b in pairwise(edges)]
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    lasting = Counter[tuple[float, ...]]()
    for key, rows in stays:
        lasting[key] += rows if rows >= MIN_ROWS else 0
    for key in [*(key for key, _ in lasting.most_common(5)), *_far_places(stays, steps)]:
        inside = np.all(points == np.array(key), axis=1)
        rest = steps[~inside[1:] & ~inside[:-1] & (steps > 0)]
        jumps = steps[inside[1:] != inside[:-1]]
        if inside.sum() < MIN_ROWS or len(rest) < 5 or not len(jumps):
            continue
        usual, jump = float(np.quantile(rest, 0.99)), float(np.median(jumps))
        whole = all(value == int(value) for value in key)
        apart = points[~inside]
        corner = bool(np.any(np.all(apart > key, axis=0) | np.all(apart < key, axis=0)))
        longest = max(count for place, count in stays if place == key)
        elsewhere = max((count for place, count in stays if place != key), default=1)
        stuck = whole and longest >= max(LONG_ROWS, LONGER * elsewhere)
        if jump > FAR * usual or stuck or (jump > 3 * usual and corner and whole):
            return key, True
        if jump > NEAR * usual and len(jumps) >= 2 and lasting[key]:
            return key, False
    return (), True


def _far_places(stays: list[tuple[tuple[float, ...], int]], steps: np.ndarray) -> list[tuple]:
    """The places of `stays` (place, rows) that were come to MIN_ROWS times, those of the largest
    `steps` (m,) first, five at most: a detector that misses single rows."""
    into: dict[tuple[float, ...], list[float]] = {}
    row = 0
    for key, rows in stays:
        if row:
            into.setdefault(key, []).append(float(steps[row - 1]))
        row += rows
    known = [key for key, come in into.items() if len(come) >= MIN_ROWS]
    return sorted(known, key=lambda key: -float(np.median(into[key])))[:5]


def without(columns: list[np.ndarray], codes: tuple[float, ...]) -> list[np.ndarray]:
    """The coordinates with NaN in the rows that mean `no ball`, in all of them at once."""
    gone = np.any([~np.isfinite(values) for values in columns], axis=0)
    if codes:
        pairs = zip(columns, codes, strict=True)
        gone |= np.all([values == code for values, code in pairs], axis=0)
    return [np.where(gone, np.nan, values) for values in columns]
