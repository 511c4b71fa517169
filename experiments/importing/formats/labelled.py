"""Lines that name each number, as a serial plotter's: `t:20, x:12.5, servo x = 91 deg`."""

import re
from collections.abc import Iterable, Sequence

from experiments.importing.formats.messages import messages_of_lines
from experiments.importing.recording import Stream, once_each
from experiments.importing.units import canonical

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[-+]?(?:nan|inf|NaN|Inf|NAN|INF)"
_PAIR = re.compile(rf"[\s,;|]*([^\W\d][^:=,;|]{{0,63}})[:=]\s*({_NUMBER})(?![\d.])")
_UNIT = re.compile(r"\s*([^\W\d]{1,12}(?:/[^\W\d]{1,3})?|°|%)(?=[\s,;|]|$)(?!\s*[:=])")
MIN_SHARE = 0.8  # of a file's first lines that have to be labelled; chosen: a boot message is none


def is_labelled(head: Sequence[str]) -> bool:
    """Whether these lines, the first of a file, name each of their two or more numbers."""
    return sum(len(_pairs(line)) > 1 for line in head) >= MIN_SHARE * len(head)


def labelled(lines: Iterable[str]) -> Stream:
    """The numbers of labelled lines, NaN where a line does not name one; errors and notes as of
    `messages_of_lines`. BadFileError: a line has a name twice."""
    return messages_of_lines(lines, _row, "names with a number each")


def _row(line: str) -> dict[str, float] | None:
    return once_each((name, float(number)) for name, number in _pairs(line)) or None


def _pairs(line: str) -> list[tuple[str, str]]:
    """The names, with a unit behind the number as `x [mm]`, and numbers of a line; none where
    anything else stands in it."""
    found, at = [], 0
    text = line.strip()
    while match := _PAIR.match(text, at):
        name, at = match[1].rstrip(), match.end()
        unit = _UNIT.match(text, at)
        if unit and canonical(unit[1]):
            name, at = f"{name} [{unit[1]}]", unit.end()
        if at < len(text) and text[at] not in " ,;|\t":
            return []
        found.append((name, match[2]))
    return found if not text[at:].strip(" ,;|\t") else []
