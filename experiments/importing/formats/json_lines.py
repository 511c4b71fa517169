"""Read JSON Lines: one object a line, as a web page's or a Python program's log."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from experiments.importing.formats.clock_text import clock_seconds, is_clock
from experiments.importing.formats.messages import Columns, numbers
from experiments.importing.recording import BadFileError, Stream, check_size
from experiments.records.csv_files import lines_of

MAX_BAD_SHARE = 0.01  # of the lines, that are no objects; chosen: one is a last line cut off


def read_json_lines(path: Path) -> list[Stream]:
    """Read the numbers of every line's object as one stream, a column a path (`ball.x`); texts that
    are times of day are seconds.

    Lines that are no object are left out, which the stream's notes tell. BadFileError: too many of
    them, too many columns or cells, no text, or no numbers.
    """
    found, lost, clocks = Columns(), 0, set[str]()
    try:
        with path.open(encoding="utf-8-sig") as file:
            for line in lines_of(file):
                if not line.strip():
                    continue
                row = _row(line, clocks)
                lost += row is None
                if row is not None:
                    found.append(row)
                    check_size(len(found), len(found.columns))
    except UnicodeDecodeError as error:
        raise BadFileError("it is no text in UTF-8") from error
    except BadFileError:
        raise
    except ValueError as error:
        raise BadFileError(str(error)) from error
    count = len(found) + lost
    if lost > max(1, MAX_BAD_SHARE * count):
        raise BadFileError(f"{lost} of {count} lines are no JSON object: one object a line")
    if not found.columns:
        raise BadFileError("no numbers were found in it: one JSON object a line")
    notes = (f"lines that are no JSON object, left out: {lost} of {count}",) if lost else ()
    columns = {name: found.column(name) for name in found.columns}
    return [Stream(columns, dict.fromkeys(sorted(clocks), "s"), notes=notes)]


def _row(line: str, clocks: set[str]) -> dict[str, float] | None:
    """The numbers of a line's object by their paths; the names of texts that are times of day go to
    `clocks`. None: it is no object, or one with a whole number beyond all measure."""
    try:
        message = json.loads(line)
        return dict(_all_numbers(message, clocks)) if isinstance(message, dict) else None
    except (ValueError, RecursionError, OverflowError):
        return None


def _all_numbers(message: dict[str, Any], clocks: set[str]) -> Iterator[tuple[str, float]]:
    for name, value in message.items():
        if isinstance(value, str) and is_clock(value):
            clocks.add(name)
            yield name, clock_seconds(value)
        else:
            yield from numbers(name, value, 0)
