"""Tables that stand side by side in one, each with a clock of its own: a row is then no moment."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from experiments.importing.names import hint
from experiments.importing.recording import MIN_ROWS, Stream

MAX_DRIFT = 0.05  # chosen: by so much no two clocks of one moment drift apart


def parted(stream: Stream) -> list[Stream]:
    """A stream for each of the tables in one, from a clock to the column before the next; the
    stream as it is where each row has one moment.

    Tables of several rates end in different rows; the rows below the shorter ones are blank.
    """
    names = list(stream.columns)
    clocks = [name for name in names if _is_clock(stream, name)]
    if stream.time is not None or len(clocks) < 2:
        return [stream]
    starts = [0, *(names.index(clock) for clock in clocks[1:]), len(names)]
    blocks = [names[a:b] for a, b in pairwise(starts)]
    ends = [_end(stream, [clock]) for clock in clocks]
    whole = all(
        len(block) > 1 and _end(stream, block) == end
        for block, end in zip(blocks, ends, strict=True)
    )
    if not whole or not _drift(stream, clocks, min(ends)):
        return [stream]
    told = f"tables side by side, each with a clock of its own: {', '.join(clocks)}"
    return [
        replace(
            stream,
            columns={name: stream.columns[name][:end] for name in block},
            units={name: unit for name, unit in stream.units.items() if name in block},
            unreadable={n: cells for n, cells in stream.unreadable.items() if n in block},
            time=clock,
            by_rate=None,
            notes=(*stream.notes, told),
        )
        for block, clock, end in zip(blocks, clocks, ends, strict=True)
    ]


def _is_clock(stream: Stream, name: str) -> bool:
    """Whether a column is a time by its name that grows, without a blank, up to where it ends."""
    values = stream.columns[name][: _end(stream, [name])]
    known = len(values) >= MIN_ROWS and hint(name, stream.units.get(name)).role == "time"
    return bool(known and np.all(np.isfinite(values)) and np.all(np.diff(values) > 0))


def _end(stream: Stream, names: Sequence[str]) -> int:
    """The row behind the last in which one of these columns has a number."""
    known = np.any([np.isfinite(stream.columns[name]) for name in names], axis=0)
    return int(np.max(np.flatnonzero(known), initial=-1)) + 1


def _drift(stream: Stream, clocks: Sequence[str], rows: int) -> bool:
    """Whether clocks that end in different rows drift apart in those that all have; a thousand
    times as fast counts as in another unit."""
    long = [float(np.ptp(stream.columns[clock][:rows])) for clock in clocks]
    powers = [float(np.log10(one / long[0])) / 3 for one in long[1:]]
    apart = [abs(one - round(one)) * 3 * np.log(10) > np.log1p(MAX_DRIFT) for one in powers]
    return any(apart) and len({_end(stream, [clock]) for clock in clocks}) > 1
