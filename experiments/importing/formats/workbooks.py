"""Read the sheets of a workbook (Excel's .xlsx and .xlsm) as tables of text.

Formulas count as what the program that saved the file had worked out for them. Sheets with the same
columns are sessions of one recording; of others each column bears its sheet's name, as in
`Run 2/time`.
"""

import warnings
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import date, datetime, time, timedelta
from pathlib import Path
from typing import IO, Any
from xml.parsers import expat
from zipfile import ZipFile

import numpy as np

from experiments.importing.formats.extra import library
from experiments.importing.formats.text_tables.text import table_of
from experiments.importing.recording import BadFileError, Stream, check_size

MAX_SHEET_BYTES = 1_000_000_000  # of all sheets, unpacked: as of text; they are read row by row
# Of a row, which is read at once; chosen: MAX_COLUMNS cells have a twentieth.
MAX_ROW_BYTES = 10_000_000
MAX_ROWS = 1_048_576  # of a sheet, and the number of the last; Excel's own limit
MAX_OTHER_BYTES = 50_000_000  # of the rest, read at once; chosen: a million dates as words
# Elements but for WORDS, each of which costs far more than its bytes; a row with cells beyond
# column ZZ counts for all columns up to its last, since it is read as wide. Chosen: of all sheets a
# minute's work, a full one of fourteen columns; of the rest ten times the most styles of Excel.
MAX_ELEMENTS, MAX_OTHER_ELEMENTS = 30_000_000, 655_360
WORDS = ("si", "t")
MAX_SHEETS = 1000  # chosen: more than anybody keeps sessions in one file
BLOCK_BYTES = 1 << 20
SESSION = "sheet"  # the column that says of which sheet a row is


def read_workbook(path: Path) -> list[Stream]:
    """Read every sheet that holds rows of numbers. BadFileError: none does, it is no workbook, too
    large, or openpyxl is missing."""
    openpyxl = library("openpyxl", "a workbook")
    try:
        _check_bytes(path)
        with warnings.catch_warnings(action="ignore"):  # of styles, which are not read
            book = openpyxl.load_workbook(path, read_only=True, data_only=True)
            try:
                return _streams(book)
            finally:
                book.close()
    except BadFileError:
        raise
    except Exception as error:  # of damaged bytes openpyxl raises whatever it meets
        raise BadFileError(
            f"not readable as a workbook ({error}): save the sheet as .csv"
        ) from error


def _check_bytes(path: Path) -> None:
    """BadFileError: it unpacks to more than is read, at once or row by row."""
    with ZipFile(path) as parts:
        whole = {one: one.file_size for one in parts.infolist()}
        sheets = [one for one in whole if one.filename.startswith("xl/worksheets/")]
        size = sum(whole[one] for one in sheets)
        _check_limit("sheets unpack to", size, MAX_SHEET_BYTES)
        _check_limit("other parts unpack to", sum(whole.values()) - size, MAX_OTHER_BYTES)
        cells, others = 0, 0
        for one in whole:
            with parts.open(one) as file:
                if one in sheets:
                    cells = _counted(file, cells, MAX_ELEMENTS)
                    continue
                with suppress(expat.ExpatError):  # no part of XML, or one that is not read
                    others = _counted(file, others, MAX_OTHER_ELEMENTS)


def _check_limit(what: str, size: int, most: int, unit: str = "bytes") -> None:
    if size > most:
        raise BadFileError(f"its {what} {size} {unit} (limit: {most}): save the sheet as .csv")


def _counted(file: IO[bytes], elements: int, most: int) -> int:
    """The number of elements but for WORDS of the parts so far and this one. BadFileError: they are
    more than `most`, or it has more rows than a sheet, or one or a tag that is too long."""
    parser, fed, begin, rows, far = expat.ParserCreate(), 0, 0, 0, 0
    number_of = library("openpyxl.utils", "a workbook").column_index_from_string

    def begins(name: str, said: dict[str, str]) -> None:
        nonlocal begin, rows, elements, far
        name = name.rpartition(":")[2]
        elements += name not in WORDS
        if name == "c" and said.get("r", "")[2:3].isalpha():
            far = number_of(said["r"][:3])
        if name == "row":
            elements, far = elements + far, 0
            begin, rows = parser.CurrentByteIndex, max(rows + 1, int(said.get("r", 0)))

    parser.StartElementHandler = begins
    while block := file.read(BLOCK_BYTES):
        parser.Parse(block)
        fed, at = fed + len(block), max(parser.CurrentByteIndex, 0)
        _check_limit("longest tag has", fed - at, MAX_ROW_BYTES)
        _check_limit("longest row has", at - begin if rows else 0, MAX_ROW_BYTES)
        _check_limit("sheet has", rows, MAX_ROWS, "rows")
        _check_limit("parts have", elements, most, "cells, rows, styles or other elements")
    return elements + far


def _streams(book: Any) -> list[Stream]:
    """The streams of all sheets, sessions in one."""
    if len(book.worksheets) > MAX_SHEETS:
        raise BadFileError(f"it has {len(book.worksheets)} sheets (limit: {MAX_SHEETS})")
    parts = {sheet._worksheet_path for sheet in book.worksheets}
    if len(parts) < len(book.worksheets):  # each name would cost the time of reading it
        raise BadFileError("it names one sheet twice: save the sheet as .csv")
    found: list[tuple[str, Stream]] = []
    left: list[str] = []
    for sheet in book.worksheets:
        sheet.reset_dimensions()  # it may say more than there is
        try:
            streams = table_of(_lines(sheet), separators=["\t"])
        except ValueError as error:  # a sheet of words, for instance
            left.append(f"sheet {sheet.title}, left out: {error}")
            continue
        found += [(f"{sheet.title} {i}" if i else sheet.title, x) for i, x in enumerate(streams)]
    if not found:
        raise BadFileError("; ".join(left[:3]) or "it has no sheet")
    hidden = [one.title for one in book.worksheets if one.sheet_state != "visible"]
    left += [
        f"sheet {title} is hidden in the workbook, and read like any other" for title in hidden
    ]
    streams = [replace(one, notes=(*one.notes, *left)) for _, one in found]
    names = [[*one.columns] for one in streams]
    if len(streams) > 1 and all(one == names[0] for one in names) and SESSION not in names[0]:
        return [_sessions(streams)]
    if len(streams) > 1:
        return [_named(title, one) for (title, _), one in zip(found, streams, strict=True)]
    return streams


def _sessions(streams: Sequence[Stream]) -> Stream:
    """One stream of several with the same columns, one after the other."""
    rows = [len(one) for one in streams]
    check_size(sum(rows), len(streams[0].columns) + 1)
    columns = {n: np.concatenate([one.columns[n] for one in streams]) for n in streams[0].columns}
    columns[SESSION] = np.repeat(np.arange(len(rows), dtype=np.float64), rows)
    units = {n: unit for one in reversed(streams) for n, unit in one.units.items()}
    notes = tuple(dict.fromkeys(note for one in streams for note in one.notes))
    return replace(streams[0], columns=columns, units=units, session=SESSION, notes=notes)


def _named(title: str, one: Stream) -> Stream:
    """The stream with its sheet's name before the name of each column."""
    clock, session, by_rate = (
        f"{title}/{name}" if name else None for name in (one.time, one.session, one.by_rate)
    )
    return Stream(
        {f"{title}/{name}": values for name, values in one.columns.items()},
        {f"{title}/{name}": unit for name, unit in one.units.items()},
        clock,
        session,
        one.notes,
        {f"{title}/{name}": cells for name, cells in one.unreadable.items()},
        by_rate,
    )


def _lines(sheet: Any) -> Iterator[str]:
    """The rows of a sheet that are not blank, cells apart by tabs, all as wide as the widest so
    far."""
    width = 0
    for row in sheet.iter_rows(values_only=True):
        cells = [_text(cell) for cell in row]
        while cells and not cells[-1]:
            cells.pop()
        if cells:
            width = max(width, len(cells))
            check_size(0, width)
            yield "\t".join(cells + [""] * (width - len(cells)))


def _text(cell: Any) -> str:
    """A cell as a table of text has it: times in seconds or as a clock shows them."""
    match cell:
        case None:
            return ""
        case bool():
            return str(int(cell))
        case timedelta():
            return repr(cell.total_seconds())
        case datetime() | time():
            return cell.isoformat(*([" "] if isinstance(cell, datetime) else []))
        case date():
            return cell.isoformat()
        case int() | float():
            return repr(cell)
        case _:
            return " ".join(str(cell).replace('"', "'").split())
