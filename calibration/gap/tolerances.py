"""What counts as nothing missing on one table: the spread of repeated clean runs, and their noise.

Runs of one real table differ from each other by more than any guess. Each effect is released alone
on each run; its box must hold all the values that clean runs give. What the model within its boxes
leaves of each run is the table's floor.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import t as student

from calibration.gap.believe import believe
from calibration.gap.evidence import gather
from calibration.gap.name import settled_baseline
from calibration.gap.prove import model_of, rms
from calibration.gap.screen import screen
from calibration.gap.search import rank_one
from calibration.gap.state import State
from calibration.gap.workflow import levels_of, usable_runs
from rig.effects import CATALOGUE
from rig.log import Log
from rig.parameters import Rig

FEWEST = 5


def learn(logs: Sequence[Log], rig: Rig) -> Rig:
    """The rig with the tolerances (half width of the first key: a 95 % bound for the next clean
    run, at least the default) and the floors (RMS over all runs) of clean runs.

    ValueError: fewer than FEWEST logs.
    """
    if len(logs) < FEWEST:
        raise ValueError(
            f"--tolerances-from: {len(logs)} clean runs; the spread needs at least {FEWEST}"
        )
    values: dict[str, list[float]] = {}
    left: dict[str, list[float]] = {}
    for log in logs:
        state = _baseline(log, rig)
        for name, size in _departures(state).items():
            values.setdefault(name, []).append(size)
        for channel, size in rms(state.evidence, model_of(state)).items():
            left.setdefault(channel, []).append(size)
    reach = float(student.ppf(0.975, len(logs) - 1)) * (1 + 1 / len(logs)) ** 0.5
    found = {}
    for effect in CATALOGUE:
        sizes = np.array(values.get(effect.name, []))
        if len(sizes) < FEWEST or effect.tolerance == 0.0:
            continue
        bound = max(abs(sizes.mean()) + reach * sizes.std(ddof=1), float(np.abs(sizes).max()))
        found[effect.name] = float(max(bound, effect.tolerance))
    floors = {name: float(np.sqrt(np.mean(np.square(sizes)))) for name, sizes in left.items()}
    return replace(rig, tolerances=found, floors=floors)


def _baseline(log: Log, rig: Rig) -> State:
    evidence = gather(usable_runs([log], rig), levels_of(rig))
    return settled_baseline(evidence, believe(evidence, rig, None))


def _departures(state: State) -> dict[str, float]:
    """How far each effect, released alone, leaves its believed value on a run (largest axis)."""
    found: dict[str, float] = {}
    for one in screen(state, state.evidence.parts):
        if not np.isfinite(one.smallest):
            continue
        done = rank_one(state, one)
        for knob in done.believed.of(one.name, one.axis)[:1]:
            size = abs(done.fit.setting.get(knob.name, knob.believed) - knob.believed)
            if np.isfinite(size):
                found[one.name] = max(found.get(one.name, 0.0), float(size))
    return found
