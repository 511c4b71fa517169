"""The time of rows that no clock stamps, by what the lines above a table say of their rate."""

import re
from collections.abc import Iterable, Iterator, Mapping

import numpy as np

_OF_ROWS = re.compile(
    r"(?:^|data|log\w*|record\w*|acqui\w*)[\W_]*(?:rate|freq)|sampl|abtast|chantillon|muestr"
    r"|campion|amostr|bemonster|\b(?:fs|dt)\b",
    re.IGNORECASE,
)
_OF_FRAMES = re.compile(r"fram|bild|image|imagen|fps", re.IGNORECASE)
_NUMBER = r"(\d+(?:[.,]\d+)?(?:[eE][-+]?\d+)?)"
_VALUES = (  # a number before its unit, behind one, behind what alone means hertz or seconds
    re.compile(rf"(?<![\w.,]){_NUMBER}\s*[\[(]?(k?hz|fps|[mµu]?s)\b", re.IGNORECASE),
    re.compile(rf"\b(k?hz|fps|[mµu]?s)\b[\])]?\s*[:=,;\t ]\s*{_NUMBER}(?!\w)", re.IGNORECASE),
    re.compile(rf"\b(fs|dt)\b\s*[:=,;\t]\s*{_NUMBER}(?!\s*\w)", re.IGNORECASE),
    re.compile(rf"^\W*(?:[a-zé]+[\s_-]?)?(rate|freq|fps)[a-z]*[\W_]+{_NUMBER}\W*$", re.IGNORECASE),
)
_STEP = re.compile(  # what seconds are those of
    r"\bdt\b|interv|p[eé]r[ií]od|step|every|zeit|takt|time|temps|tiempo|tempo|tijd|\bpas",
    re.IGNORECASE,
)
_HERTZ = {"hz": 1.0, "fps": 1.0, "khz": 1e3, "fs": 1.0, "rate": 1.0, "freq": 1.0}
_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "dt": 1.0}
LONGEST = 1000  # characters of a line that is searched; chosen: one that states a rate has a tenth
RATES_HZ = (4.0, 5000.0)  # slower no such table is read, faster none can be
MIN_COUNTED = 0.5  # chosen: share of rows one after the other in a column that counts them


def time_by_rate(
    columns: Mapping[str, np.ndarray], lines: Iterable[str]
) -> tuple[str, np.ndarray] | None:
    """A name, and seconds (n,) of the rows of these columns by the rate that lines of text state,
    as `Sample rate: 50 Hz`, `dt = 0.02`; None where they state none, or several. A line with one
    more number says of what the rate is, as of samples of which each tenth was written.

    The first column that counts rows counts, as frames may be missing, else their order. A camera's
    rate is one of rows only where they are counted.
    """
    counted = next((values for values in columns.values() if _counts(values)), None)
    lines = [line for line in lines if len(line) <= LONGEST]
    lines = [line for line in lines if counted is not None or not _OF_FRAMES.search(line)]
    of = [line for line in lines if _OF_ROWS.search(line) or _OF_FRAMES.search(line)]
    of = [line for line in of if len(re.findall(_NUMBER, line)) == 1]
    rates = {round(rate, 6) for line in of for rate in _rates(line)}
    fitting = [rate for rate in rates if RATES_HZ[0] <= rate <= RATES_HZ[1]]
    rows = len(next(iter(columns.values())))
    if len(fitting) != 1 or not rows:
        return None
    if counted is None:
        counted = np.arange(rows)
    return f"rows at {fitting[0]:g} Hz", (counted - counted[0]) / fitting[0]


def _rates(line: str) -> Iterator[float]:
    """Yield the rates [Hz] that a line may state."""
    for pattern in _VALUES:
        for pair in pattern.findall(line):
            number, unit = pair if pair[0][0].isdigit() else pair[::-1]
            value, unit = float(number.replace(",", ".")), unit.lower()
            if value > 0 and unit in _HERTZ:
                yield value * _HERTZ[unit]
            elif value > 0 and _STEP.search(line):
                yield 1 / (value * _SECONDS[unit])


def _counts(values: np.ndarray) -> bool:
    """Whether a column numbers the rows: whole, growing, mostly by one."""
    steps = np.diff(values)
    whole = np.all(np.isfinite(values)) and np.all(values % 1 == 0)
    return bool(len(steps) and whole and np.all(steps > 0) and np.mean(steps == 1) >= MIN_COUNTED)
