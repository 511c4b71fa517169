"""The proof in closed loop: the recorded protocol simulated with the recorded controller settings.

Limit cycle, settling and spread of the recording stand beside those of the model before and after
the named effects: the same targets, start and pushes, several draws of the noise.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import nan

import numpy as np

from calibration.gap.findings import ClosedLoopRow
from experiments.assemble import known
from experiments.gap_input import GapInput
from experiments.metrics import run_metrics
from experiments.protocol import Protocol, course, parse
from experiments.samples import run_part
from rig.controllers import ARMS
from rig.log import Log
from rig.parameters import Rig
from rig.simulate import Course, draw, simulate

MOST_RUNS = 6  # recordings that are simulated; of more, so many spread over all
SIMULATIONS = 16  # of either model at most
CYCLE = tuple(f"limit cycle {what} {axis}" for what in ("amplitude", "period") for axis in "xy")
UNITS = dict.fromkeys(CYCLE[:2], "mm") | dict.fromkeys(CYCLE[2:], "s") | {
    "settling time": "s", "spread": "mm", "tracking error": "mm",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Recorded:
    """A recording that can be run again: what was asked, by which controller, and what came."""

    label: str
    log: Log
    rig: Rig
    arm: int
    protocol: Protocol
    course: Course
    seed: int


def closed_loop_rows(
    inputs: GapInput, before: Rig, after: Rig, *, seeds: int = 4
) -> tuple[ClosedLoopRow, ...]:
    """Numbers of the recordings and of both models in closed loop, by protocol and arm.

    `before` and `after` are whole models, effects included; gains and control rate are those of
    each run. Simulated numbers are means over `seeds` draws of the noise. Spread is RMS about the
    mean after settling, tracking error RMS about a target that moves; NaN where a number is not
    defined in half of the runs. Recordings of which the controller is not known (files), on the
    servos alone, or pushed in answer to the ball are skipped; none left: ().
    """
    runs = _spread_out(list(_recorded(inputs)), MOST_RUNS)
    seeds = max(1, min(seeds, SIMULATIONS // max(len(runs), 1)))
    labels = list(dict.fromkeys(run.label for run in runs))
    rows = []
    for label in labels:
        same = [run for run in runs if run.label == label]
        suffix = f" ({label})" if len(labels) > 1 else ""
        rows += _rows(same, before, after, seeds, suffix)
    return tuple(rows)


def _spread_out(runs: list[_Recorded], most: int) -> list[_Recorded]:
    """At most so many of the runs, evenly over their order."""
    if len(runs) <= most:
        return runs
    return [runs[i] for i in np.linspace(0, len(runs) - 1, most).round().astype(int)]


def _rows(runs: Sequence[_Recorded], before: Rig, after: Rig, seeds: int, suffix: str
          ) -> Iterator[ClosedLoopRow]:  # fmt: skip
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


def _recorded(inputs: GapInput) -> Iterator[_Recorded]:
    """The recordings that can be run again."""
    for log, rig, arm, stored, seed in zip(
        inputs.logs, inputs.rigs, inputs.arms, inputs.protocols, inputs.seeds, strict=True
    ):
        if stored is None or seed is None or arm not in ARMS or not log.has("ball_x_m", "ball_y_m"):
            continue
        try:
            name = str(stored.get("name", ""))
            protocol = parse(stored, label="run.json", name=name)
            way = course(protocol, rig, seed)
        except ValueError:  # of another version, or with the operator's own changes
            continue
        if protocol.servo_only or protocol.pushes.kind == "at-centre":
            continue
        way = _as_long_as(way, run_part(log))
        yield _Recorded(f"{name}, {arm}", log, rig, ARMS[arm], protocol, way, seed)


def _as_long_as(way: Course, run: Log) -> Course:
    """The course up to where the recording ends (a person may have stopped it)."""
    n = max(1, min(len(run), len(way.targets_m)))
    return replace(way, targets_m=way.targets_m[:n], pushes_m_s2=way.pushes_m_s2[:n])


def _simulated(run: _Recorded, model: Rig, draw_number: int) -> dict[str, float]:
    """The numbers of the recorded run under a model; NaN where it did not come to its end."""
    plant = replace(model, gains=run.rig.gains, control_rate_hz=run.rig.control_rate_hz)
    numbers = draw(np.random.default_rng([run.seed, 6, draw_number]), plant, run.course)
    result = simulate(plant, known(run.rig), run.arm, run.course, numbers)
    found = _numbers(result.log, run.protocol)
    return found if result.outcome == "completed" else dict.fromkeys(found, nan)


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
