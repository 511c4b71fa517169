"""Rows that a program's threads wrote out of order: put back by their stamps."""

from dataclasses import replace

import numpy as np

from experiments.importing.names import hint
from experiments.importing.recording import MIN_ROWS, Stream

FARTHEST = 10  # rows; chosen: farther back is another session, or a counter that begins anew
MOST_ALIKE = 0.05  # share of rows with another's stamp; chosen: more are coarse and order nothing
EVEN = 0.4  # of the usual step; chosen: a late stamp takes another row's place by half a step
MOST_UNEVEN = 0.1  # chosen, of the steps beside rows that were put back


def in_order(stream: Stream) -> Stream:
    """The stream with its rows in the order of their time, told by its notes: only where each then
    stands as far from the next as rows that were in order do, so that stamps were not merely late.
    """
    names = [stream.time] if stream.time else stream.columns
    for name in names:
        values = stream.columns[name]
        if hint(name, stream.units.get(name)).role != "time" or not np.all(np.isfinite(values)):
            continue
        order = np.argsort(values, kind="stable")
        moved = order != np.arange(len(order))
        if np.any(moved) and _belongs(values, order, moved):
            columns = {key: each[order] for key, each in stream.columns.items()}
            told = f"rows that stood out of the order of {name}, put back: {int(moved.sum())}"
            return replace(stream, columns=columns, notes=(*stream.notes, told))
    return stream


def _belongs(stamps: np.ndarray, order: np.ndarray, moved: np.ndarray) -> bool:
    """Whether the order (n,) of the stamps is that of the rows, of which some stand elsewhere."""
    grown, first = np.unique(stamps, return_index=True)
    if len(grown) < max(MIN_ROWS, (1 - MOST_ALIKE) * len(stamps)):
        return False
    if np.max(np.abs(order - np.arange(len(order)))) > FARTHEST:
        return False
    steps = np.diff(grown)
    there = np.isin(first, order[moved])  # of the stamps, those of rows that were put back
    beside = steps[there[1:] | there[:-1]]
    uneven = np.abs(beside / np.median(steps) - 1) > EVEN
    return bool(np.mean(uneven) <= MOST_UNEVEN)
