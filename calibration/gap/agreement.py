"""Do the logs of one table agree on the sizes of the names?

The model with all names is fitted to every run alone. With x_i the size in run i and s_i its
standard deviation, one size serves all n runs if

    Q = sum_i ((x_i - m)/s_i)^2,   m = sum_i (x_i/s_i^2)/sum_i (1/s_i^2)

is a draw of chi squared with n - 1 degrees of freedom (Cochran, Biometrics 10, 1954). A healthy
table may change within the size's tolerance t from run to run: s_i^2 holds t^2/3, too, the variance
of what lies anywhere within it. Runs that do not move what the name acts on say nothing. That a
size differs between the halves of all runs bounds the probability of the name
(`calibration.gap.constancy`); this tells which run differs.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isfinite

import numpy as np
from scipy.stats import chi2

from calibration.gap.decision_rule import CHANCE_ONE_IN
from calibration.gap.findings import Interval, Named, SizeByLog
from calibration.gap.model.data import Evidence, gather
from calibration.gap.model.intervals import Spread, deviations
from calibration.gap.model.state import State
from calibration.gap.prove import on
from calibration.gap.report.findings_of_decision import parameters
from calibration.gap.report.units import interval_words, key_words, parameter_unit
from calibration.statistics import student_quantile


@dataclass(frozen=True, eq=False)
class _OneRun:
    """The model fitted to one run: the state, and its standard deviations as of `deviations`."""

    state: State
    spread: dict[str, Spread]


def sizes_by_log(state: State, names: Sequence[Named]) -> tuple[SizeByLog, ...]:
    """The size of each name on each of its axes, fitted to every run alone; none for one run.

    A size is None where the run has no motion that tells it.
    """
    runs = range(len(state.evidence.runs))
    if len(runs) < 2 or not names:
        return ()
    fits = [_fitted(state, run) for run in runs]
    found = []
    for one in names:
        for axis, pairs in one.parameters.items():
            key = next(iter(pairs))
            sizes = tuple(_size(fit, one.name, axis, key) for fit in fits)
            tolerance = state.nominal.of(one.name, axis)[0].tolerance
            found.append(SizeByLog(one.name, axis, key, sizes, _agree(sizes, tolerance)))
    return tuple(found)


def sentences(found: Sequence[SizeByLog], logs: Sequence[str]) -> tuple[str, ...]:
    """A sentence for each size that two logs or more tell, those first on which the logs differ by
    more than chance. `logs`: their names, one a run; without them they are numbered."""
    said = []
    for one in sorted(found, key=lambda one: one.agree):
        unit = parameter_unit(one.name, one.key)
        told = [
            f"{interval_words(size, *unit)} in {logs[i] if i < len(logs) else f'log {i + 1}'}"
            for i, size in enumerate(one.sizes)
            if size is not None
        ]
        head = "the logs agree" if one.agree else "the logs disagree"
        said += (
            [f"{head}: {one.name}: {one.axis} {key_words(one.key)} is {', '.join(told)}"]
            if len(told) > 1
            else []
        )
    return tuple(said)


def _fitted(state: State, run: int) -> _OneRun:
    """The model of a state with its parameters fitted anew to one of its runs."""
    alone = on(state, _alone(state.evidence, run))
    return _OneRun(alone, deviations(alone))


def _alone(evidence: Evidence, run: int) -> Evidence:
    few = gather([evidence.runs[run]], evidence.levels)
    masks = {o: m[evidence.times(o)[1] == run] for o, m in evidence.masks.items()}
    return replace(few, masks={o: m for o, m in masks.items() if o in few.masks})


def _size(fit: _OneRun, name: str, axis: str, key: str) -> Interval | None:
    if (name, axis) not in fit.state.named:
        return None
    found = parameters(fit.state, name, (axis,), fit.spread)[axis].get(key)
    return found if found is not None and isfinite(found.high - found.low) else None


def _agree(sizes: Sequence[Interval | None], tolerance: float) -> bool:
    """Whether Q of the module's equation is below its quantile of 1 in CHANCE_ONE_IN."""
    known = [size for size in sizes if size is not None and size.high > size.low]
    if len(known) < 2:
        return True
    x = np.array([size.value for size in known])
    s = np.array([0.5 * (size.high - size.low) for size in known]) / student_quantile(np.inf)
    s = np.sqrt(s**2 + tolerance**2 / 3.0)
    mean = np.sum(x / s**2) / np.sum(1.0 / s**2)
    q = float(np.sum(((x - mean) / s) ** 2))
    return float(chi2.sf(q, len(known) - 1)) > 1.0 / CHANCE_ONE_IN
