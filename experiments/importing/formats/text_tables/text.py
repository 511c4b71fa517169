"""Read tables of text: any separator, decimal comma, preamble, row of units, names or none; and
lines that name each number."""

import csv
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain, islice
from pathlib import Path

import numpy as np

from experiments.importing.formats.text_tables.clock_text import clock_seconds, is_clock
from experiments.importing.formats.text_tables.decimals import NumberColumn, is_number
from experiments.importing.formats.text_tables.encodings import encoding_of
from experiments.importing.formats.text_tables.head_rate import time_by_rate
from experiments.importing.formats.text_tables.labelled import is_labelled, labelled
from experiments.importing.formats.text_tables.long_form import LongForm
from experiments.importing.recording import (
    MAX_COLUMNS,
    MIN_ROWS,
    TWICE,
    BadFileError,
    Stream,
    check_lost,
    check_size,
)
from experiments.importing.units import canonical
from experiments.records.csv_files import blocks_of, lines_of

SEPARATORS = (" ", ",", "|", "\t", ";")  # the later, the less likely to mean anything else
MOST_WORDS = 2.0  # beside a number; chosen: long form with a measurement, a field and two tags
FOLLOWING = 10  # lines; chosen: half of a LabVIEW header, in which numbers stand among words
ANNOTATIONS = ("#group", "#datatype", "#default")  # of InfluxDB's CSV, before each part of it
PREAMBLE_LINES = 200  # chosen: LabVIEW's longest headers have some thirty lines
MAX_BYTES = 1_000_000_000
_STAMPED = re.compile(r"^(\d\d:\d\d:\d\d\.\d+) -> ")
_REMARKS = {"", "Comment"}  # LabVIEW's last column, which rows without one have not
_UNIT_CELL = re.compile(r"[\[(]?\s*[A-Za-zµμ°%/0-9^*·\s-]*\s*[\])]?")


def read_text(path: Path) -> list[Stream]:
    """Read a text table as one stream, or as one for each series of a table in long form; blanks
    and words are NaN, times of day are seconds.

    Without a line of names the columns are called `column 1`, `column 2` ... Lines with another
    number of cells are left out, which the stream's notes tell. BadFileError: it is no text, has no
    block of numbers, or is too large.
    """
    size = path.stat().st_size
    if size > MAX_BYTES:
        raise BadFileError(f"it has {size} bytes (limit: {MAX_BYTES}): cut it into parts")
    try:
        with path.open(encoding=encoding_of(path), errors="replace", newline="") as file:
            return table_of(line for line in lines_of(file) if line.strip())
    except BadFileError:
        raise
    except ValueError as error:
        raise BadFileError(str(error)) from error


def table_of(lines: Iterator[str], separators: Sequence[str] = SEPARATORS) -> list[Stream]:
    """The table of these lines, none of which is blank, with one of these separators.
    BadFileError, ValueError: as of `read_text`."""
    head = list(islice(lines, PREAMBLE_LINES))
    if not head:
        raise BadFileError("it is empty")
    if is_labelled(head):
        return [labelled(chain(head, lines))]
    separator, first = _layout(head, separators)
    below = (line for line in chain(head[first:], lines) if not line.startswith(ANNOTATIONS))
    cells = _cells(below, separator)
    begin = list(islice(cells, PREAMBLE_LINES))
    width = Counter(map(len, begin)).most_common(1)[0][0]
    above = _named(_split(head[:first], separator), width)
    cut = 0 if above else _rows_before_names(begin, width)
    if cut:
        above, begin, first = _named([begin[cut]], width), begin[cut + 1 :], first + cut + 1
    names, units = _header(above, width)
    commas = any("," in cell for row in begin for cell in row)
    found = [NumberColumn(name, commas=commas) for name in names]
    long = LongForm(names, begin)
    clocks, count, read, again = set[str](), 0, 0, 0
    for block in blocks_of(chain(begin, cells), width):
        below = _without_headers(block, above, width, first + count + again)
        again += len(block) - len(below)
        count += len(below)
        check_size(count, width)
        rows = [row for row in below if len(row) == width]
        read += len(rows)
        long.extend(rows)
        for one, column in zip(found, zip(*rows, strict=True), strict=bool(rows)):
            if _is_clock(column):
                clocks.add(one.name)
                one.add(map(clock_seconds, column))
            else:
                one.extend(column)
    lost = count - read
    check_lost(lost, count, f"have not {width} cells")
    notes = (
        *([f"lines before the names, left out: {cut}"] if cut else ()),
        *([f"lines without {width} cells, left out: {lost} of {count}"] if lost else ()),
        *([f"lines that name the columns again, left out: {again}"] if again else ()),
    )
    units |= dict.fromkeys(sorted(clocks), "s")
    sure = set().union(*(one.sure for one in found))
    numbers = {one.name: one.numbers(sure) for one in found}
    columns = {name: values for name, (values, _) in numbers.items()}
    columns |= {name: values for one in found for name, values in one.states.items()}
    told = None if clocks else time_by_rate(columns, head[:first])
    if told:
        columns, units = columns | dict([told]), units | {told[0]: "s"}
    stream = Stream(
        columns,
        units,
        by_rate=told[0] if told else None,
        notes=notes,
        unreadable={name: cells for name, (_, cells) in numbers.items() if cells.count},
    )
    return long.parted(stream)


def _cells(lines: Iterable[str], separator: str) -> Iterator[list[str]]:
    """Cells of every line, behind the time that a serial monitor puts before it (`10:02:03.456 ->
    1,2`). `csv.Error`: quotes that do not close, or a cell of absurd length."""
    lines = (_STAMPED.sub(rf"\1{separator}", one) if " -> " in one else one for one in lines)
    return (
        (one.split() for one in lines)
        if separator == " "
        else csv.reader(lines, delimiter=separator)
    )


def _split(lines: Sequence[str], separator: str) -> list[list[str]]:
    """Cells of some lines. BadFileError: quotes that do not close, or a cell of absurd length."""
    try:
        return list(_cells(lines, separator))
    except csv.Error as error:
        raise BadFileError(f"not readable as a table ({error})") from error


def _layout(
    head: Sequence[str], separators: Sequence[str], words_each: float = 0.5
) -> tuple[str, int]:
    """The separator, one of `separators`, and the first line of the block of numbers, of the first
    lines of a file. words_each: how many words a number may stand beside; MOST_WORDS where no line
    has fewer.

    The separator is the one with which the most lines behind the first numeric one look alike.
    BadFileError: no line begins a block of numbers.
    """
    best: tuple[tuple[float, int], str, int] | None = None
    for rank, separator in enumerate(separators):
        if separator != " " and not any(separator in line for line in head):
            continue
        if max(line.count(separator) for line in head) >= MAX_COLUMNS:
            check_size(0, max(line.count(separator) for line in head) + 1)
        rows = _split(head, separator)
        numeric = [len(cells) > 1 and _mostly_numbers(cells, words_each) for cells in rows]
        first = next((i for i, yes in enumerate(numeric) if yes and _begins(rows[i:])), None)
        if first is None:
            continue
        width = len(rows[first])
        alike = [yes and len(r) == width for yes, r in zip(numeric, rows, strict=True)][first:]
        found = ((round(sum(alike) / len(alike), 2), rank), separator, first)
        if best is None or found[0] > best[0]:
            best = found
    if best is None and words_each < MOST_WORDS:
        return _layout(head, separators, MOST_WORDS)
    if best is None:
        raise BadFileError("no rows of numbers were found in it: one row a moment, one column each")
    return best[1], best[2]


def _begins(rows: Sequence[Sequence[str]]) -> bool:
    """Whether the first row begins a block of numbers: at most one of words follows soon. A line
    of numbers among lines of words is of the preamble; a row of words has no number where the first
    row has one, as the time of a row without a ball is."""
    at = [i for i, cell in enumerate(rows[0]) if _is_number(cell)]
    words = 0
    for cells in rows[1 : 1 + FOLLOWING]:
        numbers, others = _counts(cells)
        words += others > numbers and not any(_is_number(cells[i]) for i in at if i < len(cells))
    return words <= 1


def _mostly_numbers(cells: Sequence[str], words_each: float) -> bool:
    """Whether a line is one of data: numbers stand in it, and of words at most so many each."""
    if any(_several_numbers(cell) for cell in cells):
        return False
    numbers, words = _counts(cells)
    return numbers >= 2 and words <= words_each * numbers


def _counts(cells: Sequence[str]) -> tuple[int, int]:
    """How many numbers, and how many words, a line has."""
    numbers = sum(map(_is_number, cells))
    return numbers, sum(bool(cell.strip()) for cell in cells) - numbers


def _several_numbers(cell: str) -> bool:
    """Whether a cell holds numbers with another separator between them."""
    parts = re.split(r"[;|\s]+", cell.strip())
    whole = is_clock(cell)
    return len(parts) > 1 and not whole and all(map(_is_number, parts))


def _is_number(cell: str) -> bool:
    return is_number(cell) or is_clock(cell)


def _named(lines: Iterable[Sequence[str]], width: int) -> list[list[str]]:
    """Cells, as bare words, of those lines that may name `width` columns or their units."""
    fitting = [[c.strip(' \t"').lstrip("#%").strip() for c in cells] for cells in lines]
    fitting = [cells[len(cells) == width + 1 and not cells[0] :] for cells in fitting]
    fitting = [cells[:width] if set(cells[width:]) <= _REMARKS else cells for cells in fitting]
    fitting = [cells + [""] * (len(cells) == width - 1) for cells in fitting]
    return [cells for cells in fitting if len(cells) == width and sum(map(bool, cells)) > 1]


def _without_headers(
    block: Sequence[list[str]], above: Sequence[Sequence[str]], width: int, line: int
) -> list[list[str]]:
    """The rows of a block without those that say again what stands `above`. BadFileError: most of
    a row are other words, and none of it is a number; line: how many stand before the block."""
    try:
        np.array([row[0] for row in block], dtype=np.float64)
        return list(block)  # each begins with a number, as a rule the time
    except ValueError:
        rows = []
    for at, row in enumerate(block, line + 1):
        words = _named([row], width) if _names_all(row, width) else []
        if not words:
            rows.append(row)
        elif words[0] not in above:
            told = ", ".join(words[0])[:80]
            raise BadFileError(
                f"line {at} (blank ones not counted) names its columns anew, and not as before "
                f"({told}): make it two files"
            )
    return rows


def _names_all(row: Sequence[str], width: int) -> bool:
    """Whether most of a row of `width` cells are words, and none of it is a number."""
    words = [] if any(map(_is_number, row)) else _named([row], width)
    return bool(words) and sum(any(map(str.isalpha, c)) for c in words[0]) > width / 2


def _rows_before_names(begin: Sequence[list[str]], width: int) -> int:
    """How many of the first rows stand before a row of names, too few for a recording: a serial
    port was opened before the board began anew."""
    return next((i for i, row in enumerate(begin[:MIN_ROWS]) if _names_all(row, width)), 0)


def _header(fitting: Sequence[list[str]], width: int) -> tuple[list[str], dict[str, str]]:
    """Names of the columns, and their units where a row of units follows the names."""
    names = [f"column {i + 1}" for i in range(width)]
    units: dict[str, str] = {}
    if fitting:
        cells = fitting[-1]
        if len(fitting) > 1 and _below_names(cells, fitting[-2]):
            said, cells = cells, fitting[-2]
        else:
            said = next(filter(_are_units, reversed(fitting[:-1])), [""] * width)
            said = [one if _known(one) else "" for one in said]
        above = [line for line in fitting if line not in (cells, said, fitting[-1])]
        cells = _told_apart(cells, above)
        names = [cell or name for cell, name in zip(cells, names, strict=True)]
        units = {n: u.strip("[]() ") for n, u in zip(names, said, strict=True) if u}
    twice = {name for name in names if names.count(name) > 1} if width <= MAX_COLUMNS else set()
    if twice:
        raise BadFileError(TWICE.format(", ".join(sorted(twice))))
    return names, units


def _below_names(cells: Sequence[str], names: Sequence[str]) -> bool:
    """Whether cells are the units below these names: one is known, or each name stands once."""
    return all(map(_is_unit, cells)) and (_once_each(names) or any(map(_known, cells)))


def _once_each(names: Sequence[str]) -> bool:
    """Whether each name but blank ones stands once."""
    told = [name for name in names if name]
    return len({*told}) == len(told)


def _known(cell: str) -> bool:
    return canonical(cell.strip("[]() ")) is not None


def _told_apart(names: list[str], above: Sequence[list[str]]) -> list[str]:
    """The names, with the words `above` them before each where some stand twice without these."""
    for line in reversed(above):
        if _once_each(names):
            break
        names = [f"{one} {name}".strip() for one, name in zip(line, names, strict=True)]
    return names


def _are_units(cells: Sequence[str]) -> bool:
    """Whether a line above the names says units: two known ones at least, and a word at most."""
    known = sum(map(_known, cells))
    return known > 1 and sum(map(bool, cells)) - known <= 1


def _is_unit(cell: str) -> bool:
    """Whether a cell may be a unit: a known one, or as short as a name seldom is."""
    return _known(cell) or (len(cell) < 9 and _UNIT_CELL.fullmatch(cell) is not None)


def _is_clock(cells: Sequence[str]) -> bool:
    """Whether a column holds times of day, which are read as seconds."""
    return any(map(is_clock, cells[:100]))
