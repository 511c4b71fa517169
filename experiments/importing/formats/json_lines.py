"""Read JSON Lines: one object a line, as a web page's or a Python program's log."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from experiments.importing.formats.clock_text import clock_seconds, is_clock
from experiments.importing.formats.messages import messages_of_lines, numbers
from experiments.importing.recording import BadFileError, Stream, once_each
from experiments.records.csv_files import lines_of


def read_json_lines(path: Path) -> list[Stream]:
    """Read the numbers of every line's object as one stream, a column a path (`ball.x`); texts that
    are times of day are seconds.

    BadFileError: no text in UTF-8, a name stands twice in an object, or as of `messages_of_lines`.
    """
    clocks: set[str] = set()

    def row(line: str) -> dict[str, float] | None:
        try:
            message = json.loads(line, object_pairs_hook=once_each)
            if not isinstance(message, dict):
                return None
            times = dict(_times("", message))
            clocks.update(times)
            return times | once_each(numbers("", message, 0))
        except BadFileError:
            raise
        except (ValueError, RecursionError, OverflowError):  # 10**400 is no float
            return None

    try:
        with path.open(encoding="utf-8-sig") as file:
            stream = messages_of_lines(lines_of(file), row, "a JSON object")
    except UnicodeDecodeError as error:
        raise BadFileError("it is no text in UTF-8") from error
    except BadFileError:
        raise
    except ValueError as error:
        raise BadFileError(str(error)) from error
    return [replace(stream, units=dict.fromkeys(sorted(clocks), "s"))]


def _times(path: str, message: dict[str, Any]) -> Iterator[tuple[str, float]]:
    """The times of day in the texts of an object, in seconds, by their paths."""
    for name, value in message.items():
        here = f"{path}.{name}" if path else name
        if isinstance(value, dict):
            yield from _times(here, value)
        elif isinstance(value, str) and is_clock(value):
            yield here, clock_seconds(value)
