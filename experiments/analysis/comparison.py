"""Runs with and without play compensation side by side: a table and one sentence for a person."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees, isfinite, nan

import numpy as np

from experiments.analysis.numbers import Recorded, measures
from experiments.analysis.statistics import mean_interval

ALIKE = 1.1  # chosen: what differs by less is said to be alike
HEAD = ("", "without", "with", "with, against without")


@dataclass(frozen=True)
class Measure:
    """A number that people compare: what it is, its unit, its name in `numbers.MEASURES`, what its
    unit there is multiplied by, and what stands where a run has none."""

    label: str
    unit: str
    name: str
    missing: str
    factor: float = 1.0


MEASURES = (
    Measure("distance from the target, RMS, settled", "cm", "settled_error", "ball not seen"),
    Measure("spread about its own mean, settled", "cm", "settled_spread", "ball not seen"),
    Measure("limit cycle, amplitude", "cm", "cycle_amplitude", "fewer than 2 cycles"),
    Measure("settling time, to its last swing", "s", "settling", "never"),
    Measure("servo activity, settled", "deg", "servo_activity", "not measured", degrees(1)),
)


def _values(runs: Sequence[Recorded], one: Measure) -> np.ndarray:
    return one.factor * np.array([measures(run.metrics)[one.name] for run in runs])


def _cell(values: np.ndarray, one: Measure) -> str:
    """Mean, and its 95 % interval over runs where there are two or more with a value."""
    found = mean_interval(values)
    if not found.n:
        return one.missing
    text = f"{found.value:.2f} {one.unit}"
    if found.n > 1:
        text += f" ({max(found.low, 0.0):.2f} to {found.high:.2f}, {found.n} runs)"
    absent = len(values) - found.n
    return text + (f"; {absent} x {one.missing}" if absent else "")


def ratio_words(without: float, with_: float) -> str:
    """How many times larger or smaller `with_` is, in words; "" where one is no positive number."""
    if not (isfinite(without) and isfinite(with_) and without > 0 and with_ > 0):
        return ""
    ratio = with_ / without
    if 1 / ALIKE < ratio < ALIKE:
        return "about the same"
    return f"{1 / ratio:.1f} times smaller" if ratio < 1 else f"{ratio:.1f} times larger"


def _mean(runs: Sequence[Recorded], one: Measure) -> float:
    return mean_interval(_values(runs, one)).value if runs else nan


def comparison_rows(without: Sequence[Recorded], with_: Sequence[Recorded]) -> list[list[str]]:
    """Rows under HEAD, one a measure; an arm without runs is blank."""
    rows = []
    for one in MEASURES:
        cells = [_cell(_values(runs, one), one) if runs else "" for runs in (without, with_)]
        rows.append([one.label, *cells, ratio_words(_mean(without, one), _mean(with_, one))])
    return rows


def comparison_sentence(without: Sequence[Recorded], with_: Sequence[Recorded]) -> str:
    """What play compensation changed, in one sentence with numbers, sample size and how sure.

    "" where an arm has no run with a ball.
    """
    one = MEASURES[0]
    a, b = _mean(without, one), _mean(with_, one)
    words = ratio_words(a, b)
    if not words:
        return ""
    nearer = {"smaller": "nearer to", "larger": "farther from"}
    said = "as near to"
    if words != "about the same":
        times, _, way = words.rpartition(" ")
        said = f"{times} {nearer[way]}"
    n = min(len(without), len(with_))
    many = "one run of each" if len(without) == len(with_) == 1 else "mean of the runs"
    return (
        f"With play compensation the ball stays {said} its target"
        f"{' as without' if said == 'as near to' else ''}: {b:.2f} cm instead of {a:.2f} cm "
        f"(RMS after settling, {many}{_sure(_values(without, one), _values(with_, one), n)})."
    )


def _sure(without: np.ndarray, with_: np.ndarray, n: int) -> str:
    """How sure the difference is: by the 95 % interval of the differences pair by pair."""
    if n < 2 or len(without) != len(with_):
        return ""
    found = mean_interval(with_ - without)
    if found.n < 2:
        return ""
    clear = found.low > 0 or found.high < 0
    return ", a clear difference" if clear else ", within what repeats differ by"
