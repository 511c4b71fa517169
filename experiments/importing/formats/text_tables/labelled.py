"""Lines that name each number, as a serial plotter's or a program's log: `t:20, x:12.5 mm`,
`14:05:07.123 INFO ball=(12.5, 3.0)`."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace

from experiments.importing.formats.messages import messages_of_lines
from experiments.importing.formats.text_tables.clock_text import clock_seconds, is_clock
from experiments.importing.recording import Stream, once_each
from experiments.importing.units import canonical

_NUMBER = r"[-+]?(?:(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?|(?:nan|inf|NaN|Inf|NAN|INF))"
_NAME = r"[\s,;|]*([^\W\d][^:=,;|]{0,63})[:=]\s*"
_PAIR = re.compile(rf"{_NAME}({_NUMBER})(?![\d.])")
_LIST = re.compile(rf"{_NAME}[(\[]\s*({_NUMBER}(?:[\s,;]+{_NUMBER}){{1,15}})\s*[)\]]")
_STAMP = re.compile(
    r"[\[(]?((?:\S+[T ])?\d{1,2}:\d\d:\d\d(?:[.,]\d+)?(?:Z|[+-]\d\d:?\d\d)?)[\])]?(?=\s)"
)
_LEVEL = re.compile(r"(?:\s*[\[(]?(?:DEBUG|INFO|WARN|WARNING|ERROR|->|-)[\])]?:?(?=\s))*")
_UNIT = re.compile(r"\s*([^\W\d]{1,12}(?:/[^\W\d]{1,3})?|°|%)(?=[\s,;|]|$)(?!\s*[:=])")
STAMP = "stamp of the line"
MIN_SHARE = 0.8  # of a file's first lines that have to be labelled; chosen: a boot message is none


def is_labelled(head: Sequence[str]) -> bool:
    """Whether these lines, the first of a file, name each of their two or more numbers."""
    return sum(len(_pairs(line)) > 1 for line in head) >= MIN_SHARE * len(head)


def labelled(lines: Iterable[str]) -> Stream:
    """The numbers of labelled lines, NaN where a line does not name one, and the times of day at
    their beginnings as STAMP [s], the last, since a clock of their own is the better one; errors
    and notes as of `messages_of_lines`. BadFileError: a line has a name twice."""
    found = messages_of_lines(lines, _row, "names with a number each")
    return replace(found, units={STAMP: "s"} if STAMP in found.columns else {})


def _row(line: str) -> dict[str, float] | None:
    pairs = _pairs(line)
    if len(pairs) == 1 and pairs[0][0] == STAMP:
        return None
    return once_each((name, float(number)) for name, number in pairs) or None


def _pairs(line: str) -> list[tuple[str, str]]:
    """The names, with a unit behind the number as `x [mm]`, and numbers of a line, behind its time
    of day; none where anything else stands in it."""
    found, stamps, at = [], [], 0
    text = line.strip()
    stamp = _STAMP.match(text)
    if stamp and is_clock(stamp[1]):
        stamps.append((STAMP, str(clock_seconds(stamp[1]))))
        level = _LEVEL.match(text, stamp.end())
        at = level.end() if level else stamp.end()
    while match := _PAIR.match(text, at) or _LIST.match(text, at):
        name, at = match[1].rstrip(), match.end()
        numbers = re.findall(_NUMBER, match[2])
        unit = _UNIT.match(text, at)
        if unit and canonical(unit[1]):
            name, at = f"{name} [{unit[1]}]", unit.end()
        if at < len(text) and text[at] not in " ,;|\t":
            return []
        several = len(numbers) > 1
        found += [(f"{name}[{i + 1}]" if several else name, n) for i, n in enumerate(numbers)]
    return [*found, *stamps] if not text[at:].strip(" ,;|") else []
