"""Runs with and without play compensation side by side: a table and one sentence for a person."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees, isfinite, nan

import numpy as np

from experiments.analysis.limit_cycle import FEW, TOLD
from experiments.analysis.numbers import Recorded, found_no_play, measures
from experiments.analysis.statistics import mean_difference, mean_interval

ALIKE = 1.1  # chosen: what differs by less is said to be alike
SAME = "about the same"
HEAD = ("", "without", "with", "with, against without")


@dataclass(frozen=True)
class Measure:
    """A number that people compare: what it is, its unit, its name in `numbers.MEASURES`, what its
    unit there is multiplied by, what stands where a run has none, and whether it is of a target at
    rest alone."""

    label: str
    unit: str
    name: str
    missing: str
    factor: float = 1.0
    at_rest: bool = False


MEASURES = (
    Measure("distance from the target, RMS", "cm", "settled_error", "ball not seen"),
    Measure("spread about its own mean", "cm", "settled_spread", "ball not seen", at_rest=True),
    Measure(
        "limit cycle, amplitude",
        "cm",
        "cycle_amplitude",
        FEW,
        at_rest=True,
    ),
    Measure("settling time", "s", "settling", "never", at_rest=True),
    Measure("servo activity", "deg", "servo_activity", "not measured", degrees(1)),
)


def _values(runs: Sequence[Recorded], one: Measure) -> np.ndarray:
    known = [not (one.at_rest and run.metrics.target_moves) for run in runs]
    found = [measures(run.metrics)[one.name] for run in runs]
    return one.factor * np.where(known, found, nan)


def _cell(runs: Sequence[Recorded], one: Measure) -> str:
    """Mean, and its 95 % interval over runs where there are two or more with a value."""
    values = _values(runs, one)
    found = mean_interval(values)
    if not found.n:
        moves = one.at_rest and any(run.metrics.target_moves for run in runs)
        return "the target moves" if moves else one.missing
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
        return SAME
    return f"{1 / ratio:.1f} times smaller" if ratio < 1 else f"{ratio:.1f} times larger"


def _mean(runs: Sequence[Recorded], one: Measure) -> float:
    return mean_interval(_values(runs, one)).value if runs else nan


def comparison_rows(without: Sequence[Recorded], with_: Sequence[Recorded]) -> list[list[str]]:
    """Rows under HEAD, one a measure; an arm without runs is blank."""
    rows = []
    for one in MEASURES:
        cells = [_cell(runs, one) if runs else "" for runs in (without, with_)]
        rows.append([one.label, *cells, ratio_words(_mean(without, one), _mean(with_, one))])
    return rows


def told_words(rows: Sequence[Sequence[str]]) -> str:
    """What a row says of a limit cycle that is not told, explained; "" where none says it."""
    return TOLD if any(FEW in cell for row in rows for cell in row) else ""


def part_words(runs: Sequence[Recorded]) -> str:
    """Which part of the runs the numbers are of."""
    settled = [run.metrics.has_settled for run in runs]
    if all(settled):
        return "after settling"
    last = "in the last half of each run" if len(runs) > 1 else "in the last half of the run"
    return f"after settling, else {last}" if any(settled) else last


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
    many = "one run of each" if len(without) == len(with_) == 1 else "mean of the runs"
    told = f"RMS {part_words([*without, *with_])}, {many}"
    if words == SAME and all(found_no_play(run.metrics) for run in with_):
        return (
            "Play compensation found no play in this table, so runs with and without it are alike: "
            f"{b:.2f} and {a:.2f} cm from the target ({told})."
        )
    said = "as near to"
    if words != SAME:
        times, _, way = words.rpartition(" ")
        said = f"{times} {nearer[way]}"
    sure = _sure(_values(without, one), _values(with_, one))
    return (
        f"With play compensation the ball stays {said} its target"
        f"{' as without' if said == 'as near to' else ''}: {b:.2f} cm instead of {a:.2f} cm "
        f"({told}{sure})."
    )


def _sure(without: np.ndarray, with_: np.ndarray) -> str:
    """How sure the difference is: by the 95 % interval of the difference of the means. Runs are not
    taken as pairs: of those that somebody chose, nobody knows which belong together."""
    found = mean_difference(without, with_)
    if found.n < 2:
        return ""
    clear = found.low > 0 or found.high < 0
    return ", a clear difference" if clear else ", within what repeats differ by"
