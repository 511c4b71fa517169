"""Seconds from a recording's time column: units, sessions, repeated stamps, clocks that stutter."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from experiments.importing.import_map import TimeMap
from experiments.importing.recording import BadFileError, Stream
from experiments.importing.units import factor

HOLE_S = 2.0  # chosen: no table of such a kind is asked or seen so seldom
MAX_BACKWARDS = 0.01  # share of rows whose stamp is not later: they are left out; more is a fault
REPEATED = 0.2  # share of rows with the stamp of the row before: the stamps are coarser than rows
DAY_S = 86400.0
COUNTERS = (2.0**16, 2.0**32)  # at which a microcontroller's ticks begin anew
NEAR_ROWS = 10  # chosen: rows that may be missing where a clock begins anew; a session seldom fits
STEPS_AWAY = 1.5  # resolutions of such a stamp by which it may lie off an even clock


@dataclass(frozen=True, eq=False)
class Clock:
    """t_s (n,): seconds from the session's start, NaN in rows that are left out; session (n,): its
    number; notes: what was odd."""

    t_s: np.ndarray
    session: np.ndarray
    notes: tuple[str, ...] = ()

    @property
    def unrolled(self) -> np.ndarray:
        """One growing time (n,) for all sessions, 10 s apart; NaN in rows that are left out."""
        out, start = np.full(len(self.t_s), np.nan), 0.0
        for number in np.unique(self.session):
            rows = self.session == number
            out[rows] = self.t_s[rows] + start
            end = out[rows][np.isfinite(out[rows])]
            start = (float(end.max()) if len(end) else start) + 10.0
        return out


def read_clock(stream: Stream, time: TimeMap) -> Clock:
    """Seconds and sessions of every row.

    BadFileError: no such column, it has no numbers, or more than 1 % of a session runs backwards.
    """
    rows = len(stream)
    marks = _marks(stream, time)
    if time.column is None:
        return Clock(_counted(marks) / (time.rate_hz or 1.0), marks)
    if time.column not in stream.columns:
        raise BadFileError(f"no column {time.column!r} for the time; there are {_some(stream)}")
    scale = factor(time.unit, "t_s") or 1.0
    raw = growing_on(stream.columns[time.column], (*COUNTERS, DAY_S / scale))
    finite = np.isfinite(raw)
    if finite.sum() < 2:
        raise BadFileError(f"{time.column}, the time, has no numbers")
    t_s = (raw - raw[finite][0]) * scale
    session = _sessions(t_s, finite, marks)
    out, left = np.full(rows, np.nan), 0
    twice = written_twice(stream)
    for number in np.unique(session):
        at = np.flatnonzero((session == number) & finite)
        if len(at) == 0:
            continue
        own = t_s[at] - t_s[at[0]]
        if time.clock == "even":
            own = even(own)
        good = own > np.concatenate(([-np.inf], np.maximum.accumulate(own)[:-1]))
        left += int((~good & ~twice[at]).sum())
        out[at[good]] = own[good]
    if left > MAX_BACKWARDS * rows and time.clock == "as recorded":
        raise BadFileError(
            f"{time.column} does not grow in {left} of {rows} rows (limit: 1 %): where rows are in "
            "order and stamps are coarse or late, --set time.clock=even; else sort the rows"
        )
    lost = int(np.isnan(out).sum())
    notes = (f"{lost} rows without a time of their own are left out",) if lost else ()
    return Clock(out, session, notes)


def written_twice(stream: Stream) -> np.ndarray:
    """Rows (n,) that say in all columns what the row before says: written twice, and left out."""
    same = np.concatenate(([False], np.ones(len(stream) - 1, bool)))
    for values in stream.columns.values():
        same[1:] &= (values[1:] == values[:-1]) | (np.isnan(values[1:]) & np.isnan(values[:-1]))
    return same


def _some(stream: Stream) -> str:
    names = list(stream.columns)
    return ", ".join(names[:12]) + (f" and {len(names) - 12} more" if len(names) > 12 else "")


def _marks(stream: Stream, time: TimeMap) -> np.ndarray:
    """Number (n,) of the session by the column that says it; zeros without one."""
    if time.session is None:
        return np.zeros(len(stream), int)
    if time.session not in stream.columns:
        raise BadFileError(f"no column {time.session!r} for the session")
    number = np.nan_to_num(stream.columns[time.session])
    return np.concatenate(([0], np.cumsum(np.diff(number) != 0)))


def _counted(session: np.ndarray) -> np.ndarray:
    """Number of the row within its session, from 0."""
    starts = np.flatnonzero(np.concatenate(([True], np.diff(session) != 0)))
    lengths = np.diff(np.append(starts, len(session)))
    return np.arange(len(session)) - np.repeat(starts, lengths)


def _sessions(t_s: np.ndarray, finite: np.ndarray, marks: np.ndarray) -> np.ndarray:
    """Session (n,): a new one where the mark changes, the time falls back far, or has a hole.

    Far is half a second, or ten rows: less is a clock that was set, or rows out of order.
    """
    steps = np.diff(t_s[finite])
    usual = float(np.median(steps[steps > 0])) if np.any(steps > 0) else 1.0
    anew = (steps < -max(0.5, 10 * usual)) | (steps > max(HOLE_S, 20 * usual))
    number = np.zeros(len(t_s), int)
    number[np.flatnonzero(finite)[1:]] = anew
    return np.cumsum(number) + marks * (len(t_s) + 1)


def growing_on(stamps: np.ndarray, ends: Sequence[float]) -> np.ndarray:
    """Stamps (n,) that go on growing where they begin anew at one of `ends`: a time of day at
    midnight, a counter that is full. Over the end they take a step of NEAR_ROWS at most."""
    known = np.isfinite(stamps)
    steps = np.diff(stamps[known])
    if not np.any(steps < 0) or not np.any(steps > 0):
        return stamps
    near = NEAR_ROWS * float(np.median(steps[steps > 0]))
    grown = stamps[known]
    for end in ends:
        inside = np.ptp(grown) < end  # a signed counter goes on at its lowest number
        anew = (steps < 0) & (steps + end <= near)
        if inside and near < end / 2 and np.any(anew):
            grown = grown + end * np.concatenate(([0], np.cumsum(anew)))
            out = stamps.copy()
            out[known] = grown
            return out
    return stamps


def even(t_s: np.ndarray) -> np.ndarray:
    """Equally spaced times through the stamps t_s (n,), by least squares; starts at 0."""
    k = np.arange(len(t_s))
    return k * float(np.polyfit(k, t_s, 1)[0]) if len(t_s) > 1 else np.zeros(len(t_s))


def coarse(t_s: np.ndarray) -> bool:
    """Whether stamps t_s (n,) of one session repeat, and lie on an even clock but for rounding."""
    steps = np.diff(t_s)
    held = np.mean(steps == 0) if len(steps) >= 20 else 0.0
    if held < REPEATED or held == 1.0 or np.any(steps < 0):  # 1: they stand still
        return False
    fit = np.polyfit(np.arange(len(t_s)), t_s, 1)
    away = np.abs(t_s - np.polyval(fit, np.arange(len(t_s))))
    return bool(away.max() <= STEPS_AWAY * np.min(steps[steps > 0]))
