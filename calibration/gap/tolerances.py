"""What counts as nothing missing on one table: the spread of repeated clean runs.

Runs of one real table differ from each other by more than any guess. Each effect is released alone
on each run; its box must hold all the values that clean runs give.
"""

from collections.abc import Sequence

import numpy as np
from scipy.stats import t as student

from calibration.gap.believe import believe
from calibration.gap.evidence import gather
from calibration.gap.name import settled_baseline
from calibration.gap.screen import screen
from calibration.gap.search import rank_one
from calibration.gap.workflow import levels_of, usable_runs
from rig.effects import CATALOGUE
from rig.log import Log
from rig.parameters import Rig

FEWEST = 5


def learn(logs: Sequence[Log], rig: Rig) -> dict[str, float]:
    """Name -> half width of the first key: a 95 % bound for the next clean run, at least the
    default. ValueError: fewer than FEWEST logs."""
    if len(logs) < FEWEST:
        raise ValueError(
            f"--tolerances-from: {len(logs)} clean runs; the spread needs at least {FEWEST}"
        )
    values: dict[str, list[float]] = {}
    for log in logs:
        for name, size in _departures(log, rig).items():
            values.setdefault(name, []).append(size)
    reach = float(student.ppf(0.975, len(logs) - 1)) * (1 + 1 / len(logs)) ** 0.5
    found = {}
    for effect in CATALOGUE:
        sizes = np.array(values.get(effect.name, []))
        if len(sizes) < FEWEST or effect.tolerance == 0.0:
            continue
        bound = max(abs(sizes.mean()) + reach * sizes.std(ddof=1), float(np.abs(sizes).max()))
        found[effect.name] = float(max(bound, effect.tolerance))
    return found


def _departures(log: Log, rig: Rig) -> dict[str, float]:
    """How far each effect, released alone, leaves its believed value on this run (largest axis)."""
    evidence = gather(usable_runs([log], rig), levels_of(rig))
    state = settled_baseline(evidence, believe(evidence, rig, None))
    found: dict[str, float] = {}
    for one in screen(state, evidence.parts):
        if not np.isfinite(one.smallest):
            continue
        done = rank_one(state, one)
        for knob in done.believed.of(one.name, one.axis)[:1]:
            size = abs(done.fit.setting.get(knob.name, knob.believed) - knob.believed)
            if np.isfinite(size):
                found[one.name] = max(found.get(one.name, 0.0), float(size))
    return found
