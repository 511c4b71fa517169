"""The numbers of messages, whatever decoded them: a column a path."""

from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping
from math import nan
from typing import Any

import numpy as np

from experiments.importing.names import STATED, STATES
from experiments.importing.recording import (
    MAX_COLUMNS,
    BadFileError,
    Stream,
    check_lost,
    check_size,
)

MAX_WIDTH = 64  # chosen: a longer array in a message is a picture or a point cloud
MAX_DEPTH = 8
OF_JOINTS = ("position", "velocity", "effort")  # of JointState: one number a name


class Columns:
    """The numbers of messages, a column a path, eight bytes each; `len`: messages."""

    def __init__(self) -> None:
        self.columns: dict[str, array[float]] = {}
        self._count = 0

    def __len__(self) -> int:
        """Return the number of messages."""
        return self._count

    def append(self, row: Mapping[str, float]) -> None:
        """Append a message. BadFileError: its fields make too many columns."""
        for name, value in row.items():
            column = self.columns.setdefault(name, array("d"))
            column.extend([nan] * (self._count - len(column)))
            column.append(value)
        self._count += 1
        if len(self.columns) > MAX_COLUMNS:
            check_size(1, len(self.columns))

    def column(self, name: str) -> np.ndarray:
        """Return a column (n,), NaN where a message lacks the field."""
        found = np.frombuffer(self.columns[name])
        return np.concatenate([found, np.full(len(self) - len(found), nan)])


def messages_of_lines(
    lines: Iterable[str], row_of: Callable[[str], Mapping[str, float] | None], kind: str
) -> Stream:
    """The messages of lines, one a line, NaN where one lacks a field; blank lines are none.

    row_of: a line's numbers by name, None where it is no message; kind: what a message is, in
    words. Lines that are none are left out, which the stream's notes tell. BadFileError: there are
    too many of those, or too many columns or cells, or no numbers.
    """
    found, lost = Columns(), 0
    for line in lines:
        if not line.strip():
            continue
        row = row_of(line)
        if row is None:
            lost += 1
        else:
            found.append(row)
            check_size(len(found), len(found.columns))
    count = len(found) + lost
    check_lost(lost, count, f"are not {kind}")
    if not found.columns:
        raise BadFileError(f"no numbers were found in it: every line has to be {kind}")
    notes = (f"lines that are not {kind}, left out: {lost} of {count}",) if lost else ()
    return Stream({name: found.column(name) for name in found.columns}, notes=notes)


def numbers(name: str, value: Any, depth: int) -> Iterator[tuple[str, float]]:
    """Yield the numbers of a message with their paths; joints are called by their names."""
    if isinstance(value, bool | int | float | np.number):
        yield name, float(value)
    elif isinstance(value, str) and value.lower() in STATES:
        yield STATED.format(name), STATES[value.lower()]
    elif isinstance(value, str | bytes | bytearray) or value is None or depth > MAX_DEPTH:
        return
    elif hasattr(value, "__len__") and not isinstance(value, dict):
        if len(value) <= MAX_WIDTH:
            for i, one in enumerate(value):
                yield from numbers(f"{name}[{i}]", one, depth + 1)
    else:
        fields = _fields(value) or {}
        whole, part = fields.get("sec"), fields.get("nanosec")
        if len(fields) == 2 and isinstance(whole, int) and isinstance(part, int):
            yield name, whole + 1e-9 * part
            return
        joints = fields.get("name")
        for key, one in fields.items():
            path = f"{name}.{key}" if name else key
            if key in OF_JOINTS and isinstance(joints, list | tuple) and _matches(joints, one):
                for joint, number in zip(joints, one, strict=True):
                    yield f"{path}.{joint}", float(number)
            else:
                yield from numbers(path, one, depth + 1)


def _fields(message: Any) -> dict[str, Any] | None:
    """Fields of a message by name, whatever decoded it; None where it is no message."""
    if isinstance(message, dict):
        return message
    if hasattr(message, "DESCRIPTOR"):
        return {field.name: getattr(message, field.name) for field in message.DESCRIPTOR.fields}
    names = getattr(message, "__slots__", None) or getattr(message, "__dict__", {})
    return {name: getattr(message, name) for name in names if not name.startswith("_")} or None


def _matches(joints: Any, values: Any) -> bool:
    """Whether `values` are numbers, one for each of the names `joints` (as in JointState)."""
    return (
        hasattr(values, "__len__")
        and not isinstance(values, str | bytes | dict)
        and 0 < len(joints) == len(values)
        and all(isinstance(joint, str) for joint in joints)
        and all(isinstance(one, int | float | np.number) for one in values)
    )
