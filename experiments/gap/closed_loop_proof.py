"""The proof in closed loop: the recorded protocol simulated with the recorded controller settings.

Limit cycle, settling and spread of the recording stand beside those of the model before and after
the named effects: the same targets, start and pushes, several draws of the noise. Of files, whose
controller nobody wrote down, the changes of the target are simulated again (`target_steps`).
"""

from collections.abc import Iterator, Sequence
from math import nan
from typing import TypeVar

import numpy as np

from calibration.gap.findings import ClosedLoopRow
from experiments.analysis.metrics import run_metrics
from experiments.gap.closed_loop_replay import RepeatableRun, repeatable_runs, simulate_again
from experiments.gap.input import GapInput
from experiments.gap.target_steps import means, simulated_numbers, step_numbers, target_steps
from experiments.runs.protocol import Protocol
from rig.log import Log
from rig.parameters import Rig

T = TypeVar("T")
MOST_RUNS = 6  # recordings that are simulated; of more, so many spread over all
MOST_STEPS = 16  # of targets in files, which are shorter than runs
SIMULATIONS = 16  # of either model at most
CYCLE = tuple(f"limit cycle {what} {axis}" for what in ("amplitude", "period") for axis in "xy")
UNITS = (
    dict.fromkeys(CYCLE[:2], "mm")
    | dict.fromkeys(CYCLE[2:], "s")
    | {
        "settling time": "s",
        "spread": "mm",
        "tracking error": "mm",
    }
)


def closed_loop_rows(
    inputs: GapInput, before: Rig, after: Rig, *, seeds: int = 4
) -> tuple[ClosedLoopRow, ...]:
    """Numbers of the recordings and of both models in closed loop, by protocol and arm.

    `before` and `after` are whole models, effects included; gains and control rate are those of
    each run. Simulated numbers are means over `seeds` draws of the noise (fewer with many runs).
    Spread is the RMS distance from the mean after settling, tracking error the RMS distance from a
    target that moves; NaN where a number is not defined in half of the runs or more. Recordings
    without ball, on the servos alone, or pushed in answer to the ball are skipped, and files whose
    commands do not tell their controller; () if none is left.
    """
    runs = _spread_out(list(repeatable_runs(inputs)), MOST_RUNS)
    seeds = max(1, min(seeds, SIMULATIONS // max(len(runs), 1)))
    labels = list(dict.fromkeys(run.label for run in runs))
    rows = []
    for label in labels:
        same = [run for run in runs if run.label == label]
        suffix = f" ({label})" if len(labels) > 1 else ""
        rows += _rows(same, before, after, seeds, suffix)
    return (*rows, *_rows_of_files(inputs, before, after, bool(runs)))


def _rows_of_files(
    inputs: GapInput, before: Rig, after: Rig, others: bool
) -> Iterator[ClosedLoopRow]:
    """The rows of the files, all steps of their targets together; others: there are other rows."""
    files = [log for log, stored in zip(inputs.logs, inputs.protocols, strict=True) if not stored]
    steps = _spread_out([step for log in files for step in target_steps(log)], MOST_STEPS)
    if not steps:
        return
    seeds = max(1, SIMULATIONS // len(steps))
    measured = step_numbers(steps)
    models = [simulated_numbers(steps, model, seeds=seeds) for model in (before, after)]
    suffix = " (files)" if others else ""
    for quantity, value in measured.items():
        simulated = [model[quantity] for model in models]
        if np.isfinite([value, *simulated]).any():
            yield ClosedLoopRow(quantity + suffix, UNITS[quantity], value, *simulated)


def _spread_out(runs: list[T], most: int) -> list[T]:
    """At most so many of the runs, evenly over their order."""
    if len(runs) <= most:
        return runs
    return [runs[i] for i in np.linspace(0, len(runs) - 1, most).round().astype(int)]


def _rows(
    runs: Sequence[RepeatableRun], before: Rig, after: Rig, seeds: int, suffix: str
) -> Iterator[ClosedLoopRow]:
    """The rows of runs of one protocol and arm."""
    measured = means([_numbers(run.log, run.protocol) for run in runs])
    models = [
        means([_simulated(run, model, k) for run in runs for k in range(seeds)])
        for model in (before, after)
    ]
    for quantity, value in measured.items():
        simulated = [model[quantity] for model in models]
        if np.isfinite([value, *simulated]).any():
            yield ClosedLoopRow(quantity + suffix, UNITS[quantity], value, *simulated)


def _simulated(run: RepeatableRun, model: Rig, draw_number: int) -> dict[str, float]:
    """The numbers of the recorded run under a model; NaN where it did not come to its end."""
    result = simulate_again(run, model, draw_number)
    numbers = _numbers(result.log, run.protocol)
    return numbers if result.outcome == "completed" else dict.fromkeys(numbers, nan)


def _numbers(log: Log, protocol: Protocol) -> dict[str, float]:
    """What is compared, by quantity, in its unit."""
    m = run_metrics(log)
    amplitudes = [1e3 * cycle.amplitude_m for cycle in m.cycle]
    periods = [cycle.period_s for cycle in m.cycle]
    found = dict(zip(CYCLE, amplitudes + periods, strict=True)) | {"settling time": m.settling_s}
    if protocol.reference["shape"] == "constant":
        return found | {"spread": 1e3 * m.settled.spread_m}
    return found | {"tracking error": 1e3 * m.settled.error_rms_m}
