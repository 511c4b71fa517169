"""Numbers of a text table: a decimal point or a decimal comma, the other one between thousands.

`1.250` may be either. Each column is read both ways, and what else stands in it, and in the table,
decides; where that tells nothing, the column is refused.
"""

import re
from array import array
from collections.abc import Iterable, Sequence

import numpy as np

from experiments.importing.names import STATED, STATES, YES
from experiments.importing.recording import BadFileError, Unreadable

MARKS = (".", ",")
OTHER = {".": ",", ",": "."}
_NUMBER = {
    mark: re.compile(
        rf"[-+]?(?:[1-9]\d{{0,2}}(?:\{OTHER[mark]}\d{{3}})+|\d*)(?:\{mark}\d*)?(?:[eE][-+]?\d+)?"
    )
    for mark in MARKS
}
_ONE_GROUP = re.compile(r"[-+]?[1-9]\d{0,2}[.,]\d{3}")
_BLANKS = {"", "nan", "none", "null", "na", "n/a", "#n/a", "nil", "-", "--", "?"}
_WORDS = {"true": 1.0, "false": 0.0}


def number(cell: str, mark: str) -> float | None:
    """The number in a cell with this decimal mark; None: it is none."""
    cell = cell.strip()
    if "_" in cell:  # which Python takes for a mark between digits
        return None
    if "." in cell or "," in cell:
        if not _NUMBER[mark].fullmatch(cell):
            return None
        cell = cell.replace(OTHER[mark], "").replace(mark, ".")
    try:
        return float(cell)
    except ValueError:
        return _WORDS.get(cell.lower())


def is_number(cell: str) -> bool:
    """Whether a cell is a number with one of the decimal marks."""
    return any(number(cell, mark) is not None for mark in MARKS) and cell.lower() not in _WORDS


def _told(cell: str) -> str:
    """What a cell tells of the column's decimal mark: which it is, "?" before it where it may stand
    between thousands as well, "" for nothing, "long" for a whole number without such marks."""
    cell = cell.strip()
    there = [mark for mark in MARKS if mark in cell]
    if not there:
        return "long" if len(cell.lstrip("+-")) > 3 and cell.lstrip("+-").isdigit() else ""
    if _ONE_GROUP.fullmatch(cell):
        return f"?{there[0]}"
    able = [mark for mark in MARKS if number(cell, mark) is not None]
    return able[0] if len(able) == 1 else ""


class NumberColumn:
    """A column's numbers as they come, read with both decimal marks where a comma may be one."""

    def __init__(self, name: str, *, commas: bool) -> None:
        self.name = name
        self._values = {mark: array("d") for mark in (MARKS if commas else ".")}
        self._unreadable = dict.fromkeys(self._values, Unreadable())
        self._told: set[str] = set()
        self._short = False  # a whole number below 1000 stands in it
        self._plain = False  # yes or no stands in it
        self._states: array[float] | None = array("d")  # while no number stands in it

    @property
    def sure(self) -> set[str]:
        """The decimal marks that cells of it can be read with alone."""
        return self._told & set(MARKS)

    def add(self, numbers: Iterable[float]) -> None:
        """Take cells that were read by other means: times of day."""
        numbers, self._states = list(numbers), None
        for values in self._values.values():
            values.extend(numbers)

    def extend(self, cells: Sequence[str]) -> None:
        """Take the next cells."""
        doubtful = ".,_" if "," in self._values else "_"
        if not any(mark in cell for cell in cells for mark in doubtful):
            try:
                return self.add(np.array(cells, dtype=np.float64))
            except ValueError:
                pass
        if len(self._values) > 1:
            self._told |= {_told(cell) for cell in cells}
            self._short |= any(cell.strip().lstrip("+-").isdigit() for cell in cells)
        if self._states is not None:
            self._states.extend(self._state(cell.strip().lower()) for cell in cells)
            self._states = None if any(map(is_number, cells)) else self._states
        for mark, values in self._values.items():
            for cell in cells:
                found = number(cell, mark)
                values.append(np.nan if found is None else found)
                if found is None and cell.strip().lower() not in _BLANKS:
                    self._unreadable[mark] = self._unreadable[mark].and_(cell)
        if len(self.sure) == 1:  # what does not agree with it from now on is unreadable
            self._values = {mark: self._values[mark] for mark in self.sure}

    def _state(self, word: str) -> float:
        self._plain |= word in YES
        return STATES.get(word, YES.get(word, np.nan))

    @property
    def states(self) -> dict[str, np.ndarray]:
        """1 and 0 (n,) by its name where the column is of words that say yes or no, or of a name
        that tells it where they say if there was a ball; NaN for other words."""
        found = np.array([] if self._states is None else self._states)
        name = self.name if self._plain else STATED.format(self.name)
        return {name: found} if {0.0, 1.0} <= {*found[np.isfinite(found)]} else {}

    def numbers(self, sure: set[str]) -> tuple[np.ndarray, Unreadable]:
        """The column (n,) and what could not be read. sure: decimal marks of the table's columns.
        BadFileError: nothing tells which mark its is.
        """
        mark = self._mark(sure)
        return np.array(self._values[mark]), self._unreadable[mark]

    def _mark(self, sure: set[str]) -> str:
        if len(self.sure) > 1:
            raise BadFileError(
                f"column '{self.name}' has numbers with a decimal point and with a decimal comma: "
                "write all with one"
            )
        if self.sure:
            return next(iter(self.sure))
        open_ = {told[1] for told in self._told if told.startswith("?")}
        if not open_:
            return "."
        (mark, *more) = open_
        if not more and (sure == {mark} or (not sure and mark == ".")):
            return mark
        between = self._short and "long" not in self._told  # as thousands are marked
        if not more and sure == {OTHER[mark]} and between:
            return OTHER[mark]
        raise BadFileError(
            f"column '{self.name}': 1{mark}250 may be 1250 or 1.25 there: write its numbers "
            "without a mark between thousands"
        )
