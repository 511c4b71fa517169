"""Tolerances and noise floors of one table, learned from repeated clean runs.

On each of n runs each effect is released alone; its sizes are x_i. The tolerance is a 95 % bound
for the size in the next clean run,

    max(|mean x| + t(0.975, n - 1) sqrt(1 + 1/n) s,  max |x_i|,  the default)

with s their standard deviation. The floor of a channel is the RMS over the runs
of what the model within its tolerance boxes leaves.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibration.gap.investigation import levels_of, usable_runs
from calibration.gap.model.data import gather
from calibration.gap.model.state import State
from calibration.gap.name.load_friction import choose_friction_model
from calibration.gap.name.refit import release_one
from calibration.gap.name.screen import screen
from calibration.gap.name.stepwise import settled_baseline
from calibration.gap.prove import model_of, rms
from calibration.statistics import student_quantile
from rig.log import Log
from rig.parameters import Rig

MIN_CLEAN_RUNS = 5


def learn(logs: Sequence[Log], rig: Rig) -> Rig:
    """The rig with tolerances and noise floors learned from `logs` of clean runs.

    Tolerance: half width for the effect's first key by the module's equation [unit of the key], for
    effects that could be released on at least MIN_CLEAN_RUNS runs. Floor: RMS over the runs, by
    channel [rad or m].

    `ValueError`: fewer than MIN_CLEAN_RUNS logs.
    """
    if len(logs) < MIN_CLEAN_RUNS:
        raise ValueError(
            f"--tolerances-from: {len(logs)} clean runs; the spread needs at least {MIN_CLEAN_RUNS}"
        )
    values: dict[str, list[float]] = {}
    left: dict[str, list[float]] = {}
    for log in logs:
        state = _baseline(log, rig)
        for name, size in _departures(state).items():
            values.setdefault(name, []).append(size)
        for channel, size in rms(state.evidence, model_of(state)).items():
            left.setdefault(channel, []).append(size)
    reach = student_quantile(len(logs) - 1) * (1 + 1 / len(logs)) ** 0.5
    found = {}
    for effect in rig.catalogue.values():
        sizes = np.array(values.get(effect.name, []))
        if len(sizes) < MIN_CLEAN_RUNS or effect.tolerance == 0.0:
            continue
        bound = max(abs(sizes.mean()) + reach * sizes.std(ddof=1), float(np.abs(sizes).max()))
        found[effect.name] = float(max(bound, effect.tolerance))
    floors = {name: float(np.sqrt(np.mean(np.square(sizes)))) for name, sizes in left.items()}
    return replace(rig, tolerances=found, floors=floors)


def _baseline(log: Log, rig: Rig) -> State:
    evidence = gather(usable_runs([log], rig), levels_of(rig))
    return settled_baseline(evidence, choose_friction_model(evidence, rig, None))


def _departures(state: State) -> dict[str, float]:
    """The distance of each effect, released alone, from its nominal value (largest axis)."""
    found: dict[str, float] = {}
    for one in screen(state, state.evidence.outputs):
        if not np.isfinite(one.smallest):
            continue
        done = release_one(state, one)
        for parameter in done.nominal.of(one.name, one.axis)[:1]:
            size = abs(done.fit.setting.get(parameter.name, parameter.nominal) - parameter.nominal)
            if np.isfinite(size):
                found[one.name] = max(found.get(one.name, 0.0), float(size))
    return found
