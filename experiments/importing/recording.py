"""A recording as it stands in somebody's file: streams of named columns, meaning unknown."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from experiments.importing.names import hint
from experiments.importing.units import canonical, factor, is_time

MAX_COLUMNS = (
    2000  # chosen: a table has fewer than a hundred signals, a laboratory's file a few more
)
# Characters, since what names mean is searched for; chosen: of a signal deep in a model.
LONGEST_NAME = 300
MAX_VALUE = 1e20  # a date in nanoseconds is 2e18
MAX_CELLS = 100_000_000  # chosen: 800 MB as doubles, a day of ten signals at 100 Hz
SAME = 1e-3  # of a row: by so little two clocks differ in one moment when units are converted
MIN_ROWS = 20  # fewer say nothing: `rig gap` needs so many
MAX_LOST = 0.01  # chosen: share of lines that a serial port garbles
TWICE = "a column's name stands twice: {}; rename one of them"


class BadFileError(ValueError):
    """A file that cannot be imported; the message is one line."""


@dataclass(frozen=True)
class Unreadable:
    """Cells that are neither blank nor a number: those with digits, words, the first of them."""

    digits: int = 0
    words: int = 0
    first: str = ""

    @property
    def count(self) -> int:
        """How many cells."""
        return self.digits + self.words

    def and_(self, cell: str) -> "Unreadable":
        """These and one more."""
        odd = any(c.isdigit() for c in cell)
        return Unreadable(self.digits + odd, self.words + (not odd), self.first or cell)


@dataclass(frozen=True, eq=False)
class Stream:
    """Columns that share their rows: name -> (n,) float64, NaN where the cell is no number.

    units: column name -> its unit in the file's words, where the format itself says it.
    time: name of the column that the format itself says is the time; None where it says nothing.
    session: name of the column in which every session has another number, if the format has one.
    notes: what was odd; unreadable: column name -> its cells that are NaN without being blank.
    by_rate: name of the time that a stated rate of the rows makes, for want of a clock.
    BadFileError: a column's name or unit is longer than LONGEST_NAME.
    """

    columns: Mapping[str, np.ndarray]
    units: Mapping[str, str] = field(default_factory=dict)
    time: str | None = None
    session: str | None = None
    notes: tuple[str, ...] = ()
    unreadable: Mapping[str, Unreadable] = field(default_factory=dict)
    by_rate: str | None = None

    def __post_init__(self) -> None:
        longest = max((*self.columns, *self.units.values()), key=len, default="")
        if len(longest) > LONGEST_NAME:
            raise BadFileError(
                f"a name of {len(longest)} characters (limit: {LONGEST_NAME}) is no column's: "
                f"{longest[:20]} ...; shorten it"
            )

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(next(iter(self.columns.values()))) if self.columns else 0


def numbers_only(stream: Stream) -> Stream:
    """The stream with NaN for what is infinite or absurd: 1e20 is no time, place or angle."""
    kept = {
        name: np.where(np.abs(np.nan_to_num(values, nan=np.inf)) < MAX_VALUE, values, np.nan)
        for name, values in stream.columns.items()
    }
    return replace(stream, columns=kept, notes=())


@dataclass(frozen=True, eq=False)
class Recording:
    """What one file holds, on the clock of its fastest stream, and notes on how it was read."""

    stream: Stream
    notes: tuple[str, ...] = ()


def once_each(pairs: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    """What names stand for. BadFileError: one stands twice."""
    found: dict[str, Any] = {}
    for name, value in pairs:
        if name in found:
            raise BadFileError(TWICE.format(name))
        found[name] = value
    return found


def check_size(rows: int, columns: int) -> None:
    """Refuse what no table records, before it is read. BadFileError: too many columns or cells."""
    if columns > MAX_COLUMNS:
        raise BadFileError(
            f"it has {columns} columns (limit: {MAX_COLUMNS}): keep the time, the ball, the angles"
        )
    if rows * columns > MAX_CELLS:
        raise BadFileError(
            f"it has {rows} rows of {columns} columns (limit: {MAX_CELLS} cells): cut it into parts"
        )


def check_lost(lost: int, count: int, why: str) -> None:
    """Refuse a file of whose `count` lines too many are no rows: more than one (a last line that
    was cut off), and than MAX_LOST of them. why: what is wrong with them. BadFileError: so many."""
    if lost > max(1, MAX_LOST * count):
        raise BadFileError(
            f"{lost} of {count} lines {why} (limit: {MAX_LOST:.0%}): take them out of the file"
        )


def joined(streams: Sequence[Stream]) -> Recording:
    """Put streams with clocks of their own onto the clock of the one with the most rows.

    Streams without a clock count as sampled together where they have one length. A sample stands
    in the first row that is not earlier than it, in no other: nothing is invented between two
    samples, and nothing is known before it happened. BadFileError: no stream has rows, a name
    stands twice, or a clock runs backwards.
    """
    streams = [stream for stream in streams if len(stream)]
    if not streams:
        raise BadFileError("it holds no rows of numbers")
    base = max(streams, key=lambda stream: (len(stream), stream.time is not None))
    columns, units = dict(base.columns), dict(base.units)
    late_s, left, after = 0.0, [], []
    notes = list(dict.fromkeys(note for stream in streams for note in stream.notes))
    for stream in streams:
        if stream is base:
            continue
        fresh = {name: values for name, values in stream.columns.items() if name != stream.time}
        for name in fresh.keys() & columns.keys():
            raise BadFileError(TWICE.format(name))
        if stream.time is not None and base.time is not None:
            stamps = stream.columns[stream.time] * _ticks(base, stream)
            rows, kept, late = _rows_for(base.columns[base.time], stamps)
            late_s = max(late_s, late)
            if not len(rows):
                after += fresh
                continue
            for name, values in fresh.items():
                columns[name] = np.full(len(base), np.nan)
                columns[name][rows] = values[kept]
        elif len(stream) == len(base):
            columns |= fresh
        else:
            left += [f"{name} ({len(stream)} rows)" for name in fresh]
        units |= {name: unit for name, unit in stream.units.items() if name in columns}
    check_size(len(base), len(columns))
    if late_s > 0:
        notes.append(
            "streams with clocks of their own were put onto the rows of the fastest: "
            f"their samples stand up to {1000 * late_s:.3g} ms late (95 %)"
        )
    if after:
        notes.append(f"left out, later than every row of the fastest: {', '.join(after[:6])}")
    if left:
        notes.append(f"left out, other length and no time: {', '.join(left[:6])}")
    return Recording(replace(base, columns=columns, units=units, notes=()), tuple(notes))


def _ticks(base: Stream, other: Stream) -> float:
    """How many units of the clock of `base` one of the clock of `other` is: 1 where one is open."""
    sizes = []
    for stream in (base, other):
        name = stream.time or ""
        unit = canonical(stream.units.get(name, "")) or hint(name).unit or ""
        sizes.append(factor(unit, "t_s") if is_time(unit) else None)
    return sizes[1] / sizes[0] if all(sizes) else 1.0


def _rows_for(clock: np.ndarray, stamps: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Rows of `clock` (n,) that take the samples at `stamps` (m,), which samples, and how late.

    Of several samples in one row the newest stays. Lateness is the 95 % quantile, in the unit of
    the clock.
    """
    if not np.all(np.diff(clock) >= 0):
        raise BadFileError("it has several streams, and the clock of the fastest runs backwards")
    order = np.argsort(stamps, kind="stable")
    order = order[np.isfinite(stamps[order])]
    steps = np.diff(clock)
    rounding = SAME * float(np.median(steps)) if len(steps) else 0.0
    rows = np.searchsorted(clock, stamps[order] - rounding, side="left")
    order, rows = order[rows < len(clock)], rows[rows < len(clock)]
    last = np.append(rows[1:] != rows[:-1], True)[: len(rows)]
    order, rows = order[last], rows[last]
    late = clock[rows] - stamps[order]
    return rows, order, float(np.quantile(late, 0.95)) if len(late) else 0.0
