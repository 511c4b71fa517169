"""Read JSON: an object a line, as a web page's or a Python program's log, or one whole value."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from experiments.importing.formats.matlab import streams_of
from experiments.importing.formats.messages import Columns, messages_of_lines, numbers
from experiments.importing.formats.text_tables.clock_text import clock_seconds, is_clock
from experiments.importing.formats.text_tables.decimals import is_number
from experiments.importing.formats.text_tables.encodings import encoding_of
from experiments.importing.recording import MIN_ROWS, BadFileError, Stream, check_size, once_each
from experiments.records.csv_files import lines_of

T = TypeVar("T")
MAX_BYTES = 200_000_000  # of one value, which is read whole: some GB as Python's objects


def read_json_lines(path: Path) -> list[Stream]:
    """Read the numbers of every line's object as one stream, a column a path (`ball.x`); texts that
    are times of day are seconds.

    BadFileError: no text, a name stands twice in an object, or as of `messages_of_lines`.
    """
    clocks: set[str] = set()

    def row(line: str) -> dict[str, float] | None:
        try:
            message = json.loads(line, object_pairs_hook=once_each)
            return _row(message, clocks) if isinstance(message, dict) else None
        except BadFileError:
            raise
        except (ValueError, RecursionError, OverflowError):  # 10**400 is no float
            return None

    def read() -> Stream:
        with path.open(encoding=encoding_of(path), errors="replace") as file:
            return messages_of_lines(lines_of(file), row, "a JSON object")

    return [_timed(_read(read), clocks)]


def read_json(path: Path) -> list[Stream]:
    """Read a list of objects, one a moment, or an object of lists, one a signal, and what is nested
    in them; objects a line as `read_json_lines`. BadFileError: none of it, too large, or damaged.
    """
    size = path.stat().st_size
    if size > MAX_BYTES:
        raise BadFileError(
            f"it has {size} bytes (limit: {MAX_BYTES}): write an object a line, .jsonl"
        )
    text = _read(lambda: path.read_text(encoding=encoding_of(path), errors="replace"))
    clocks: set[str] = set()
    try:
        whole = json.loads(text, object_pairs_hook=once_each)
        tree = _tree("", _of_pandas(whole), clocks)
        found = list(streams_of(tree if isinstance(tree, dict) else {"column": tree}))
    except BadFileError:
        raise
    except (ValueError, RecursionError, OverflowError) as error:
        if text.lstrip().startswith("{"):
            return read_json_lines(path)
        raise BadFileError(f"not readable as JSON ({error})") from error
    streams = [_timed(stream, clocks) for stream in found if len(stream)]
    if not streams:
        raise BadFileError("no numbers were found in it: a list of objects, or an object of lists")
    return streams


def _of_pandas(whole: Any) -> Any:
    """A table as `DataFrame.to_json` writes it, as an object of lists; any other value as it is.

    "split" has the names beside the rows; the usual form has an object of all rows a column, and
    "index" an object of all columns a row.
    """
    if not isinstance(whole, dict):
        return whole
    names, rows = whole.get("columns"), whole.get("data")
    if isinstance(names, list) and isinstance(rows, list) and _is_table(rows, len(names)):
        pairs = zip(map(str, names), map(list, zip(*rows, strict=True)), strict=True)
        return once_each([_index(whole.get("index")), *pairs])
    parts = list(whole.values())
    if not all(isinstance(part, dict) and part.keys() == parts[0].keys() for part in parts):
        return whole
    if len(parts) >= MIN_ROWS and not any(map(_is_nested, parts)) and _is_index(whole):
        name, rows = _index([*whole])
        return [{name: at, **part} for at, part in zip(rows, parts, strict=True)]
    if parts and len(parts[0]) >= MIN_ROWS and _is_index(parts[0]):
        return dict([_index([*parts[0]])]) | {k: [*part.values()] for k, part in whole.items()}
    return whole


def _index(rows: Any) -> tuple[str, Any]:
    """Name and values of a table's index: whatever does not number the rows is their time."""
    if not isinstance(rows, list) or not _is_index(rows):
        return "index", None
    if not all(is_number(str(row)) for row in rows):
        return "time", [str(row) for row in rows]
    numbers = [float(row) for row in rows]
    return "index" if numbers == [*map(float, range(len(rows)))] else "time", numbers


def _is_table(rows: Sequence[Any], width: int) -> bool:
    return len(rows) > 0 and all(isinstance(row, list) and len(row) == width for row in rows)


def _is_nested(part: Mapping[str, Any]) -> bool:
    return any(isinstance(value, dict | list) for value in part.values())


def _is_index(rows: Iterable[Any]) -> bool:
    """Whether these are numbers, or all of them times of day."""
    words = [str(row) for row in rows]
    return all(map(is_number, words)) or all(map(is_clock, words))


def _read(read: Callable[[], T]) -> T:
    """What `read` returns. BadFileError: another error of a value, in its words."""
    try:
        return read()
    except BadFileError:
        raise
    except ValueError as error:
        raise BadFileError(str(error)) from error


def _tree(path: str, value: Any, clocks: set[str]) -> Any:
    """A value as arrays in dictionaries, None for what is neither; `clocks` takes their paths."""
    if isinstance(value, dict):
        return {k: _tree(f"{path}.{k}" if path else k, one, clocks) for k, one in value.items()}
    if not isinstance(value, list) or not value:
        return None
    if all(isinstance(one, dict) for one in value):
        rows, own = Columns(), set[str]()
        for one in value:
            rows.append(_row(one, own))
        check_size(len(rows), len(rows.columns))
        clocks |= {f"{path}.{name}" if path else name for name in own}
        return {name: rows.column(name) for name in rows.columns}
    if all(one is None or isinstance(one, str) for one in value):
        clocks.add(path)
        return _seconds(value)
    try:
        return np.array(value, dtype=np.float64)
    except (TypeError, ValueError):  # of several lengths or kinds
        return None


def _seconds(texts: Sequence[str | None]) -> np.ndarray:
    return np.array([clock_seconds(text or "") for text in texts])


def _timed(stream: Stream, clocks: set[str]) -> Stream:
    """The stream with the unit of its times of day."""
    times = sorted(clocks & stream.columns.keys())
    return replace(stream, units=dict.fromkeys(times, "s"))


def _row(message: Mapping[str, Any], clocks: set[str]) -> dict[str, float]:
    """The numbers of an object by their paths; `clocks` takes the paths of times of day."""
    times = dict(_times("", message))
    clocks.update(times)
    return times | once_each(numbers("", message, 0))


def _times(path: str, message: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
    """The times of day in the texts of an object, in seconds, by their paths."""
    for name, value in message.items():
        here = f"{path}.{name}" if path else name
        if isinstance(value, dict):
            yield from _times(here, value)
        elif isinstance(value, str) and is_clock(value):
            yield here, clock_seconds(value)
