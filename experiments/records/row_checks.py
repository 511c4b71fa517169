"""Rows that no table can have made: times that do not grow, infinite values, another clock."""

import numpy as np

from experiments.records.exporting import ALWAYS
from rig.log import Log

MIN_RATE_HZ, MAX_RATE_HZ = 10.0, 5000.0
RATE_TOLERANCE = 1.1
MAX_PAUSE_S = 60.0  # chosen: time is filled with ticks, of which a day would fill the memory
MAX_POSITION_M = 2.0  # no plate or beam is longer
BALL = ("ball_x_m", "ball_y_m")


def check_rows(log: Log) -> None:
    """ValueError (one line) where the rows of a recording cannot be those of a table."""
    check_order(log["t_s"])
    for name in ALWAYS:
        check_finite(name, log[name])
    if len(log) > 1:
        check_clock(log["t_s"])
    for name in BALL:
        most = float(np.nanmax(np.abs(log[name]), initial=0.0))
        if most > MAX_POSITION_M:
            raise ValueError(
                f"{name} reaches {most:.4g} (limit: {MAX_POSITION_M:g} m): give metres"
            )


def check_order(t_s: np.ndarray) -> None:
    """ValueError where a time is no number or not later than the one before."""
    bad = np.flatnonzero(~np.isfinite(t_s))
    if len(bad):
        raise ValueError(f"t_s is blank or not finite in {which(bad)}: every row needs its time")
    bad = np.flatnonzero(t_s[1:] <= t_s[:-1]) + 1
    if len(bad):
        was, now = float(t_s[bad[0] - 1]), float(t_s[bad[0]])
        raise ValueError(
            f"time does not grow in {which(bad)} (from {was!r} to {now!r} s): "
            "sort the rows, keep one a tick, import one run at a time"
        )


def check_finite(name: str, values: np.ndarray) -> None:
    """ValueError where one of the values (n,) of a column is infinite."""
    bad = np.flatnonzero(np.isinf(values))
    if len(bad):
        raise ValueError(f"{name} is infinite in {which(bad)}")


def check_clock(t_s: np.ndarray) -> None:
    """ValueError where the times (n,) [s] of two rows or more are in another unit, or jump."""
    with np.errstate(over="ignore"):
        steps = np.diff(t_s)
    tick = float(np.median(steps))
    if not 1 / (MAX_RATE_HZ * RATE_TOLERANCE) <= tick <= RATE_TOLERANCE / MIN_RATE_HZ:
        slow = "is t_s in milliseconds? then divide it by 1000"
        raise ValueError(
            f"rows come every {tick:.4g} s, at {1 / tick:.5g} Hz (limit: {MIN_RATE_HZ:g} to "
            f"{MAX_RATE_HZ:g} Hz): {slow if tick > 1 / MIN_RATE_HZ else 'resample the log'}"
        )
    longest = int(np.argmax(steps))
    pause_s = float(steps[longest])
    if pause_s > MAX_PAUSE_S:
        raise ValueError(
            f"t_s jumps by {pause_s:.4g} s after row {longest + 1} (limit: {MAX_PAUSE_S:g} s), as "
            "where a clock was set: cut the log there"
        )


def which(rows: np.ndarray) -> str:
    """Say which rows, counted from 1."""
    more = f" and {len(rows) - 1} more" if len(rows) > 1 else ""
    return f"row {rows[0] + 1}{more}"
