"""Read tables of text: any separator, decimal comma, preamble, row of units, names or none."""

import csv
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from experiments.importing.recording import MAX_COLUMNS, BadFileError, Stream, check_size

SEPARATORS = (" ", ",", "|", "\t", ";")  # the later, the less likely to mean anything else
PREAMBLE_LINES = 200  # chosen: LabVIEW's longest headers have some thirty lines
MAX_BYTES = 1_000_000_000
_COMMA_NUMBER = re.compile(r"\s*[-+]?\d*,\d+([eE][-+]?\d+)?\s*")
_CLOCK = re.compile(r"\s*(?:(\d{4}-\d\d-\d\d)[T ])?(\d{1,2}):(\d\d):(\d\d(?:[.,]\d+)?)\s*Z?\s*")
_UNIT_CELL = re.compile(r"[\[(]?\s*[A-Za-zµμ°%/0-9^*·\s-]{0,12}\s*[\])]?")


def read_text(path: Path) -> list[Stream]:
    """Read a text table as one stream; blanks and words are NaN, times of day are seconds.

    Without a line of names the columns are called `column 1`, `column 2` ... BadFileError: it is
    no text, has no block of numbers, or is too large.
    """
    size = path.stat().st_size
    if size > MAX_BYTES:
        raise BadFileError(f"it has {size} bytes (limit: {MAX_BYTES}): cut it into parts")
    lines = [line for line in _decoded(path.read_bytes()).splitlines() if line.strip()]
    if not lines:
        raise BadFileError("it is empty")
    separator, first = _layout(lines)
    cells = _split(lines[first:], separator)
    width = Counter(map(len, cells)).most_common(1)[0][0]
    check_size(len(cells), width)
    names, units = _header(_split(lines[:first], separator), width)
    rows = [row for row in cells if len(row) == width]
    lost = len(cells) - len(rows)
    if lost > max(1, 0.01 * len(cells)):  # a last line that was cut off is normal
        raise BadFileError(f"{lost} of {len(cells)} lines have not {width} cells")
    comma = separator != "," and _has_decimal_comma(rows)
    columns = list(zip(*rows, strict=True))
    table = [_numbers(column, comma) for column in columns]
    clocks = [name for name, one in zip(names, columns, strict=True) if _is_clock(one)]
    units |= dict.fromkeys(clocks, "s")
    return [Stream(dict(zip(names, table, strict=True)), units)]


def _decoded(data: bytes) -> str:
    """Text of `data` by its byte order mark, else as UTF-8, else as Latin-1 (old Windows)."""
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return data.decode("utf-16", errors="replace")
    if b"\0" in data[:4096]:
        raise BadFileError("it is no text (it has zero bytes)")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _split(lines: Sequence[str], separator: str) -> list[list[str]]:
    """Cells of every line. BadFileError: quotes that do not close, or a cell of absurd length."""
    if separator == " ":
        return [line.split() for line in lines]
    try:
        return list(csv.reader(lines, delimiter=separator))
    except csv.Error as error:
        raise BadFileError(f"not readable as a table ({error})") from error


def _layout(lines: Sequence[str]) -> tuple[str, int]:
    """The separator, and the first line of the block of numbers.

    The separator is the one with which the most lines behind the first numeric one look alike.
    BadFileError: no line begins a block of numbers.
    """
    head = lines[:PREAMBLE_LINES]
    best: tuple[tuple[float, int], str, int] | None = None
    for rank, separator in enumerate(SEPARATORS):
        if separator != " " and not any(separator in line for line in head):
            continue
        if max(line.count(separator) for line in head) >= MAX_COLUMNS:
            check_size(0, max(line.count(separator) for line in head) + 1)
        rows = _split(head, separator)
        numeric = [len(cells) > 1 and _mostly_numbers(cells, separator) for cells in rows]
        first = next((i for i, yes in enumerate(numeric) if yes), None)
        if first is None:
            continue
        width = len(rows[first])
        alike = [yes and len(r) == width for yes, r in zip(numeric, rows, strict=True)][first:]
        found = ((round(sum(alike) / len(alike), 2), rank), separator, first)
        if best is None or found[0] > best[0]:
            best = found
    if best is None:
        raise BadFileError("no rows of numbers were found in it: one row a moment, one column each")
    return best[1], best[2]


def _mostly_numbers(cells: Sequence[str], separator: str) -> bool:
    """Whether a line is one of data: a number stands in it, and at most half of the rest is words.

    With a comma as the separator a decimal comma cannot be told, so it is none.
    """
    if any(_several_numbers(cell) for cell in cells):
        return False
    numbers = sum(_is_number(cell, separator != ",") for cell in cells)
    words = sum(bool(cell.strip()) for cell in cells) - numbers
    return numbers >= 2 and words <= numbers / 2


def _several_numbers(cell: str) -> bool:
    """Whether a cell holds numbers with another separator between them."""
    parts = re.split(r"[;|\s]+", cell.strip())
    whole = _CLOCK.fullmatch(cell) is not None
    return len(parts) > 1 and not whole and all(_is_number(part, True) for part in parts)


def _is_number(cell: str, comma: bool) -> bool:
    try:
        float(cell)
    except ValueError:
        return bool(comma and _COMMA_NUMBER.fullmatch(cell)) or bool(_CLOCK.fullmatch(cell))
    return True


def _has_decimal_comma(rows: Sequence[Sequence[str]]) -> bool:
    return any(_COMMA_NUMBER.fullmatch(cell) for cells in rows[:1000] for cell in cells)


def _header(before: Sequence[Sequence[str]], width: int) -> tuple[list[str], dict[str, str]]:
    """Names of the columns, and their units where a row of units follows the names."""
    fitting = [[c.strip(' \t"').lstrip("#%").strip() for c in cells] for cells in before]
    fitting = [cells + [""] * (len(cells) == width - 1) for cells in fitting]
    fitting = [cells for cells in fitting if len(cells) == width and sum(map(bool, cells)) > 1]
    names = [f"column {i + 1}" for i in range(width)]
    units: dict[str, str] = {}
    if fitting:
        cells = fitting[-1]
        if len(fitting) > 1 and all(_UNIT_CELL.fullmatch(c) and len(c) < 9 for c in cells):
            said, cells = cells, fitting[-2]
        else:
            said = [""] * width
        names = [cell or name for cell, name in zip(cells, names, strict=True)]
        units = {n: u.strip("[]() ") for n, u in zip(names, said, strict=True) if u}
    twice = {name for name in names if names.count(name) > 1} if width <= MAX_COLUMNS else set()
    if twice:
        raise BadFileError(f"a column's name stands twice: {', '.join(sorted(twice))}")
    return names, units


def _is_clock(cells: Sequence[str]) -> bool:
    """Whether a column holds times of day, which are read as seconds."""
    return any(_CLOCK.fullmatch(cell) for cell in cells[:100])


def _numbers(cells: Sequence[str], comma: bool) -> np.ndarray:
    """The cells (n,) as float64: NaN where blank or a word, seconds where a time of day."""
    try:
        return np.array(cells, dtype=np.float64)
    except ValueError:
        pass
    if _is_clock(cells):
        return np.array([_seconds(cell) for cell in cells])
    return np.array([_number(cell.replace(",", ".") if comma else cell) for cell in cells])


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return {"true": 1.0, "false": 0.0}.get(cell.strip().lower(), np.nan)


def _seconds(cell: str) -> float:
    """Seconds of a date with time (since 1970), or of a time of day (since midnight)."""
    match = _CLOCK.fullmatch(cell)
    if not match:
        return np.nan
    day, hours, minutes, seconds = match.groups()
    since = 0.0
    if day:
        try:
            since = np.datetime64(day, "s").astype(np.int64)
        except ValueError:
            return np.nan
    return float(since) + 3600 * int(hours) + 60 * int(minutes) + float(seconds.replace(",", "."))
