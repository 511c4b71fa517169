"""A table with a row for each number, which words beside it name: of InfluxDB, pandas or MQTT."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from experiments.importing.formats.text_tables.clock_text import is_clock
from experiments.importing.formats.text_tables.decimals import is_number
from experiments.importing.names import hint, words_of
from experiments.importing.recording import Stream, check_size

UNITS = {"unit", "units", "einheit", "unité", "unite", "unidad", "unità", "unidade", "eenheid"}
VALUES = {"value", "val", "wert", "valeur", "valor", "valore", "waarde"}


class LongForm:
    """The series of such a table: which of them each row is of, as the rows come."""

    def __init__(self, names: Sequence[str], begin: Iterable[Sequence[str]]) -> None:
        """names: of the columns; begin: the first rows, by which those of words are known."""
        named = [name for name in names if {*words_of(name)} & VALUES]
        columns = list(zip(*(row for row in begin if len(row) == len(names)), strict=True))
        self._value = named[0] if len(named) == 1 else ""
        self._words = [i for i, cells in enumerate(columns) if self._value and _are_words(cells)]
        self._unit = next(
            (k for k, i in enumerate(self._words) if {*words_of(names[i])} & UNITS), -1
        )
        self._series: dict[tuple[str, ...], int] = {}
        self._rows: list[int] = []

    def extend(self, rows: Iterable[Sequence[str]]) -> None:
        """Take the next rows of the table's width."""
        if self._words:
            each = (tuple(row[i].strip() for i in self._words) for row in rows)
            self._rows += [self._series.setdefault(one, len(self._series)) for one in each]
            check_size(1, len(self._series))

    def parted(self, stream: Stream) -> list[Stream]:
        """A stream for each series, with its time: of such a table; else the stream as it is."""
        rows, columns = np.array(self._rows, dtype=int), stream.columns
        time = next((name for name in columns if hint(name).role == "time"), None)
        more = columns.keys() - {time, self._value}
        if len(self._series) < 2 or time is None:
            return [stream]
        each = [rows == i for i in range(len(self._series))]
        more = {name for name in more if np.any(np.diff(columns[name]) != 1)}  # but rows' numbers
        if any(np.ptp(columns[name][one]) > 0 for name in more for one in each):
            return [stream]
        kinds = [len({*words}) for words in zip(*self._series, strict=True)]
        kinds = [1 if i == self._unit else kind for i, kind in enumerate(kinds)]
        telling = sorted((i for i, kind in enumerate(kinds) if kind > 1), key=lambda i: kinds[i])
        if len({tuple(words[i] for i in telling) for words in self._series}) < len(self._series):
            return [stream]
        found = []
        for words, one in zip(self._series, each, strict=True):
            name = " ".join(words[i] for i in telling)  # a measurement before its fields
            kept = {time: columns[time][one], name: columns[self._value][one]}
            unit = {time: stream.units[time]} if time in stream.units else {}
            unit |= {name: words[self._unit]} if self._unit >= 0 else {}
            found.append(replace(stream, columns=kept, units=unit, time=time, unreadable={}))
        return found


def _are_words(cells: Sequence[str]) -> bool:
    return all(cell.strip() and not is_number(cell) and not is_clock(cell) for cell in cells)
