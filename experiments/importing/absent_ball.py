"""Which values of the ball's columns mean `no ball`: -1, 0, 9999, the panel's end, a corner."""

from collections import Counter
from itertools import pairwise

import numpy as np

MIN_RUNS = 1
MIN_ROWS = 3
FAR = 8.0  # of the 99 % quantile of the steps between rows: no ball moves so between two rows
NEAR = 2.0  # so far a ball may move: between NEAR and FAR it cannot be told


def absent_codes(columns: list[np.ndarray]) -> tuple[tuple[float, ...], bool]:
    """The value of each coordinate ((n,) each, 1 or 2) that means `no ball`, and if that is sure.

    Such a value is repeated exactly in all coordinates at once, and the ball jumps to it and from
    it. Empty where there is none. Not sure: the jumps are no larger than a fast ball's.
    """
    points = np.column_stack(columns)
    known = np.isfinite(points).all(axis=1)
    points = points[known]
    if len(points) < 10:
        return (), True
    keys = [tuple(point) for point in points.tolist()]
    often = [key for key, count in Counter(keys).most_common(5) if count >= MIN_ROWS]
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    for key in often:
        inside = np.all(points == np.array(key), axis=1)
        crossing = inside[1:] != inside[:-1]
        rest = steps[~inside[1:] & ~inside[:-1] & (steps > 0)]
        if len(rest) < 5:
            continue
        usual = float(np.quantile(rest, 0.99))
        jumps = steps[crossing]
        still = [value for value, count in _runs(inside) if value and count >= MIN_ROWS]
        outside = bool(
            np.any((points[~inside] > key).all(axis=0) | (points[~inside] < key).all(axis=0))
        )
        if not len(jumps) or not still or usual == 0:
            continue
        middle = float(np.median(jumps))
        if middle > FAR * usual or (middle > 3 * usual and outside and key[0] == int(key[0])):
            return key, True
        if middle > NEAR * usual and len(jumps) >= 2:
            return key, False
    return (), True


def _runs(inside: np.ndarray) -> list[tuple[bool, int]]:
    """Lengths of the runs of equal values."""
    edges = np.flatnonzero(np.concatenate(([True], inside[1:] != inside[:-1], [True])))
    return [(bool(inside[a]), int(b - a)) for a, b in pairwise(edges)]


def without(columns: list[np.ndarray], codes: tuple[float, ...]) -> list[np.ndarray]:
    """The coordinates with NaN in the rows that mean `no ball`, in all of them at once."""
    gone = np.any([~np.isfinite(values) for values in columns], axis=0)
    if codes:
        gone |= np.all(
            [values == code for values, code in zip(columns, codes, strict=True)], axis=0
        )
    return [np.where(gone, np.nan, values) for values in columns]
