"""The ticks of a log whose stamps jitter about the clock of its servos, and the rows that date
frames."""

import numpy as np

from rig.log import Log

MOST_JITTER = 0.25  # of a tick: beyond, ticks are not even, and are left as they are; chosen
SAME_CLOCK = 0.002  # by which two clocks may differ that were meant to be one; chosen


def even_ticks(t_s: np.ndarray, period_s: float) -> np.ndarray:
    """The times (n,) [s] of ticks that were meant to come at every multiple of a servo's period, or
    at n or 1/n of that, at the stamps t_s (n,).

    The stamps themselves where they are of no such clock, by SAME_CLOCK, or one is further off than
    MOST_JITTER of a tick. A servo that reads its command at multiples of a period takes a stamp
    that is 1 ms late, as programs on a PC write them, for a command of a whole period later.
    """
    tick_s = float(np.median(np.diff(t_s))) if len(t_s) > 2 else 0.0
    if tick_s <= 0.0:
        return t_s
    number = np.concatenate([[0], np.cumsum(np.maximum(np.rint(np.diff(t_s) / tick_s), 1.0))])
    slope_s = float(np.polyfit(number, t_s, 1)[0])
    ratio = slope_s / period_s
    whole = np.rint(ratio) if ratio >= 1.0 else 1.0 / np.rint(1.0 / ratio)
    if abs(ratio / whole - 1.0) > SAME_CLOCK:
        return t_s
    even = whole * period_s * number
    even += np.rint(np.mean(t_s - even) / period_s) * period_s
    return even if np.abs(even - t_s).max() < MOST_JITTER * slope_s else t_s


def dated_to_s(log: Log) -> float:
    """To how much the frames of a log are dated [s]: to a row, within which they came at some
    moment, where it does not tell when each was exposed; 0 where it does, or holds fewer than
    two."""
    exposed_s, _ = log.ball(0.0)
    told_s = log["ball_exposed_s"]
    if len(exposed_s) < 2 or np.isin(exposed_s, told_s).all():
        return 0.0
    return float(np.median(np.diff(log["t_s"])))
