"""The linear screen: what releasing each effect of the catalogue promises, before any is fitted."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from calibration.gap.evidence import Roll
from calibration.gap.fit import Fit, bounded_step, differences, normal_equations
from calibration.gap.knobs import Believed, Knob
from calibration.gap.menu import Start, starts
from calibration.gap.state import Key, State, parts_of
from rig.effects import CATALOGUE

SEEN = 12.0  # gain that an effect of its smallest visible size would bring


@dataclass(frozen=True, eq=False)
class Screened:
    """What the linear screen says of an effect on one axis: the gain that it promises; the start
    as the linear fit scales it, and as tried; and the smallest size of its first knob that the log
    would have shown (a score of SEEN)."""

    name: str
    axis: str
    gain: float
    start: Start
    smallest: float
    tried: Start


Screens = dict[str, tuple[Roll, list[Screened]]]


def screen(state: State, parts: Iterable[str], *, without: Iterable[Key] = (),
           known: Screens | None = None) -> list[Screened]:  # fmt: skip
    """Every effect and axis that is not released yet, by the gain that a linear fit promises.

    known: earlier screens by part, good while the part's roll-out is the same; filled in here.
    """
    found: list[Screened] = []
    known = {} if known is None else known
    for part in parts:
        roll = state.fit.rolls[part]
        if part not in known or known[part][0] is not roll:
            known[part] = roll, _screen_part(state, part, set(state.named) | set(without))
        found += known[part][1]
    merged: dict[Key, Screened] = {}
    for one in found:  # an effect on both servos gains on both
        key = (one.name, one.axis)
        if key in merged:
            smallest = min(one.smallest, merged[key].smallest)
            one = replace(one, gain=one.gain + merged[key].gain, smallest=smallest)
        merged[key] = one
    return sorted(merged.values(), key=lambda one: -one.gain)


def _screen_part(state: State, part: str, skip: set[Key]) -> list[Screened]:
    bounds = state.bounds((part,))
    knobs = [state.believed.knobs[name] for name in bounds]
    base = state.fit
    only = Fit(base.setting, {part: base.rolls[part]}, {part: base.costs[part]}, base.columns)
    nuisance = differences(state.evidence, state.believed, only, knobs, bounds)[part]
    tried: list[tuple[str, str, list[Start]]] = []
    for effect in CATALOGUE:
        for axis in effect.axes:
            if part in parts_of(effect, (axis,)) and (effect.name, axis) not in skip:
                groups = starts(effect, axis, state.believed, state.evidence)
                tried += [(effect.name, axis, group) for group in groups]
    rolls = iter(state.evidence.rolls(
        [(state.believed.model(base.setting | s), part) for _, _, group in tried for s in group]
    ))  # fmt: skip
    best: dict[Key, Screened] = {}
    for name, axis, group in tried:
        columns = np.column_stack([next(rolls).z - base.rolls[part].z for _ in group])
        one = _gain(state, part, knobs, bounds, nuisance, name, axis, group, columns)
        if (name, axis) not in best or one.gain > best[name, axis].gain:
            best[name, axis] = one
    return list(best.values())


def _gain(state: State, part: str, knobs: list[Knob], bounds: Mapping, nuisance: np.ndarray,
          name: str, axis: str, group: list[Start], columns: np.ndarray) -> Screened:  # fmt: skip
    """Minimise the linearised cost over the nuisance in its boxes and the sizes of the group."""
    base = state.fit
    own = [knob.effect == name and knob.axis == axis for knob in knobs]
    keep = np.flatnonzero(~np.array(own))
    both = {part: np.column_stack([nuisance[:, keep], columns])}
    only = Fit(base.setting, {part: base.rolls[part]}, {})
    a, b = normal_equations(state.evidence, only, both)
    value = np.array([base.setting.get(knobs[i].name, knobs[i].believed) for i in keep])
    low = np.array([bounds[knobs[i].name][0] for i in keep]) - value
    high = np.array([bounds[knobs[i].name][1] for i in keep]) - value
    k = columns.shape[1]
    first = state.believed.of(name, axis)[0]
    two_sided = k > 1 or first.range[0] < first.believed
    low = np.append(low, np.full(k, -6.0 if two_sided else 0.0))
    high = np.append(high, np.full(k, 6.0))
    scale = np.append([knobs[i].step for i in keep], np.ones(k))
    step = bounded_step(a, b, low, high, scale)
    gain = -float(0.5 * step @ a @ step + b @ step)
    start = _scaled(state.believed, group, step[-k:])
    smallest = abs(next(iter(group[0].values())) - _null(first)) * _units_to_see(a, low, high, k)
    return Screened(name, axis, gain, start, smallest, {k: v for m in group for k, v in m.items()})


def _null(knob: Knob) -> float:
    return knob.believed if np.isfinite(knob.believed) else 0.0


def _units_to_see(a: np.ndarray, low: np.ndarray, high: np.ndarray, k: int) -> float:
    """Units of the start at which the gain would reach SEEN, the nuisance taking its share."""
    prior = np.zeros(len(a))
    prior[:-k] = 12.0 / np.maximum(high - low, 1e-12)[:-k] ** 2  # a box of this width
    h = a + np.diag(prior)
    own, cross, rest = h[-k, -k], h[-k, :-k], h[:-k, :-k]
    seen = own - cross @ np.linalg.solve(rest + 1e-9 * np.diag(np.diag(rest) + 1e-12), cross)
    return float(np.sqrt(2.0 * SEEN / seen)) if seen > 1e-12 * max(own, 1e-30) else float("inf")


def _scaled(believed: Believed, group: list[Start], sizes: np.ndarray) -> Start:
    """The start with its sizes as the linear fit has them (the first knob of each member)."""
    start: Start = {}
    for member, size in zip(group, sizes, strict=True):
        for i, (name, value) in enumerate(member.items()):
            knob = believed.knobs[name]
            absolute = i > 0 or knob.key == "limit_V"
            start[name] = value if absolute else knob.believed + size * (value - knob.believed)
    return start
