"""The ticks of a log whose stamps jitter about an even clock."""

import numpy as np

MOST_JITTER = 0.25  # of a tick: beyond, ticks are not even, and are left as they are; chosen


def even_ticks(t_s: np.ndarray) -> np.ndarray:
    """The times (n,) [s] of an even clock, t_0 + k T by least squares, at the stamps t_s (n,); the
    stamps themselves where one is further off than MOST_JITTER of a tick T.

    k is the stamp's number, rows that are missing counted. A servo that reads its command at
    multiples of a period takes a stamp 1 ms late, as programs on a PC write them, for a command of
    a whole period later.
    """
    if len(t_s) < 3:
        return t_s
    tick_s = float(np.median(np.diff(t_s)))
    number = np.concatenate([[0], np.cumsum(np.maximum(np.rint(np.diff(t_s) / tick_s), 1.0))])
    slope_s, begin_s = np.polyfit(number, t_s, 1)
    even = begin_s + slope_s * number
    return even if np.abs(even - t_s).max() < MOST_JITTER * slope_s else t_s
