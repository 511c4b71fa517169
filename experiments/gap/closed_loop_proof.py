"""The proof in closed loop: the recorded protocol simulated with the recorded controller settings.

Limit cycle, settling and spread of the recording stand beside those of the model before and after
the named effects: the same targets, start and pushes, several draws of the noise.
"""

from collections.abc import Iterator, Sequence
from math import nan

import numpy as np

from calibration.gap.findings import ClosedLoopRow
from experiments.analysis.metrics import run_metrics
from experiments.gap.closed_loop_replay import RepeatableRun, repeatable_runs, simulate_again
from experiments.gap.input import GapInput
from experiments.runs.protocol import Protocol
from rig.log import Log
from rig.parameters import Rig

MOST_RUNS = 6  # recordings that are simulated; of more, so many spread over all
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
    whose controller is not known (files), without ball, on the servos alone, or pushed in answer to
    the ball are skipped; () if none is left.
    """
    runs = _spread_out(list(repeatable_runs(inputs)), MOST_RUNS)
    seeds = max(1, min(seeds, SIMULATIONS // max(len(runs), 1)))
    labels = list(dict.fromkeys(run.label for run in runs))
    rows = []
    for label in labels:
        same = [run for run in runs if run.label == label]
        suffix = f" ({label})" if len(labels) > 1 else ""
        rows += _rows(same, before, after, seeds, suffix)
    return tuple(rows)


def _spread_out(runs: list[RepeatableRun], most: int) -> list[RepeatableRun]:
    """At most so many of the runs, evenly over their order."""
    if len(runs) <= most:
        return runs
    return [runs[i] for i in np.linspace(0, len(runs) - 1, most).round().astype(int)]


def _rows(
    runs: Sequence[RepeatableRun], before: Rig, after: Rig, seeds: int, suffix: str
) -> Iterator[ClosedLoopRow]:
    """The rows of runs of one protocol and arm."""
    measured = _mean([_numbers(run.log, run.protocol) for run in runs])
    models = [
        _mean([_simulated(run, model, k) for run in runs for k in range(seeds)])
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


def _mean(found: Sequence[dict[str, float]]) -> dict[str, float]:
    """Mean of each quantity over the runs in which it is defined; NaN if in under half of them."""
    means = {}
    for quantity in found[0]:
        values = np.array([one[quantity] for one in found])
        there = values[np.isfinite(values)]
        means[quantity] = float(there.mean()) if 2 * len(there) >= len(values) else nan
    return means
