"""Which effect helps most: the baseline inside its tolerances, a screen over all, exact refits.

The baseline is the believed model with every knob free inside its tolerance (K, tau and noise free
always). Releasing an effect's knobs from their box gains log-likelihood; an effect is missing when
that gain is beyond what chance and small faults of the model give.
"""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from calibration.gap.evidence import Evidence, Roll
from calibration.gap.fit import (
    Fit,
    bounded_step,
    differences,
    evaluate,
    fit,
    normal_equations,
)
from calibration.gap.knobs import BALL, SERVO, Believed, Knob
from calibration.gap.menu import Start, released, starts
from rig.effects import BY_NAME, CATALOGUE, Effect

PER_KNOB = 3.0  # log-likelihood that a released knob costs
MISFIT = 0.004  # of the gain, per knob: the rest of the model is only nearly right
WORTH_AN_AXIS = 6.0  # gain on an axis below which the effect is not released there
SEEN = 12.0
LEAST_PROMISE, FAR_BEHIND = 4.0, 0.1  # a screened gain below is not worth a fit
REFITS = 5  # so many of the screened effects are fitted exactly
Key = tuple[str, str]  # effect, axis


@dataclass(frozen=True, eq=False)
class State:
    """Where the search stands: evidence at its noise levels, the fit, the effects released."""

    evidence: Evidence
    believed: Believed
    fit: Fit
    named: tuple[Key, ...] = ()

    def bounds(self, parts: Iterable[str], named: Iterable[Key] | None = None) -> dict:
        """Name -> (low, high) of every knob that is free on some of the parts."""
        chosen = set(self.named if named is None else named)
        parts, found = set(parts), {}
        for knob in self.believed.knobs.values():
            if not parts & set(knob.parts):
                continue
            effect = BY_NAME.get(knob.effect)
            shape = knob.name in self.fit.setting
            if effect is not None and (knob.effect, knob.axis) in chosen:
                if knob in released(effect, knob.axis, self.believed) or shape:
                    found[knob.name] = knob.range
            elif knob.tolerance > 0:
                found[knob.name] = knob.box
        return found


@dataclass(frozen=True, eq=False)
class Trial:
    """An effect released on some axes and refitted: its gain beyond what its knobs cost."""

    name: str
    axes: tuple[str, ...]
    state: State
    gain: float

    @property
    def keys(self) -> tuple[Key, ...]:
        return tuple((self.name, axis) for axis in self.axes)

    @property
    def score(self) -> float:
        believed, setting = self.state.believed, self.state.fit.setting
        if not any(believed.beyond(self.name, axis, setting) for axis in self.axes):
            return -float("inf")
        knobs = sum(
            len(released(BY_NAME[self.name], axis, self.state.believed)) for axis in self.axes
        )
        return self.gain - (PER_KNOB + MISFIT * max(self.gain, 0.0)) * knobs


def parts_of(effect: Effect, axes: Iterable[str]) -> tuple[str, ...]:
    if effect.side != "servo":
        return (BALL,)
    return SERVO if "xy" in axes else tuple(f"servo_{axis}" for axis in axes)


def refit(state: State, bounds: Mapping[str, tuple[float, float]], *, iterations: int = 6) -> State:
    """Fit the knobs of `bounds` on the parts that they feel; the rest stays."""
    felt = {part for name in bounds for part in state.believed.knobs[name].parts}
    old = state.fit
    start = Fit(
        old.setting,
        {p: r for p, r in old.rolls.items() if p in felt},
        {p: c for p, c in old.costs.items() if p in felt},
        old.columns,
    )
    bent = {effect for effect, _ in state.named}
    done = fit(state.evidence, state.believed, start, bounds, iterations=iterations, bent=bent)
    merged = Fit(
        done.setting,
        old.rolls | done.rolls,
        old.costs | done.costs,
        done.columns,
    )
    return replace(state, fit=merged)


def baseline(evidence: Evidence, believed: Believed, *, iterations: int = 6) -> State:
    """The believed model, every knob free inside its box, part by part."""
    state = State(evidence, believed, evaluate(evidence, believed, {}, evidence.parts))
    for part in evidence.parts:
        state = refit(state, state.bounds((part,)), iterations=iterations)
    return state


def with_levels(state: State, levels: np.record, parts: Collection[str]) -> State:
    """The same at other noise levels of some parts (their costs are those of the new filters)."""
    evidence, old = state.evidence.with_levels(levels), state.fit
    new = evaluate(evidence, state.believed, old.setting, parts)
    columns = {key: column for key, column in old.columns.items() if key[0] not in parts}
    fit = Fit(old.setting, old.rolls | new.rolls, old.costs | new.costs, columns)
    return replace(state, evidence=evidence, fit=fit)


@dataclass(frozen=True, eq=False)
class Screened:
    """What the linear screen says of an effect on one axis: the gain that it promises, the start
    that gave it, and the smallest size of its first knob that the log would have shown (a score
    of SEEN)."""

    name: str
    axis: str
    gain: float
    start: Start
    smallest: float


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
    return Screened(name, axis, gain, start, smallest)


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


def rank(state: State, screened: list[Screened], *, most: int = REFITS) -> list[Trial]:
    """The effects that the screen puts first, each released on the axes that need it; refitted."""
    by_name: dict[str, list[Screened]] = {}
    for one in screened:
        by_name.setdefault(one.name, []).append(one)
    promise = {name: sum(max(o.gain, 0.0) for o in found) for name, found in by_name.items()}
    first = sorted(promise, key=lambda name: -promise[name])[:most]
    least = max(LEAST_PROMISE, FAR_BEHIND * max(promise.values(), default=0.0))
    first = [name for name in first if promise[name] >= least]
    trials = [_release(state, name, by_name[name]) for name in first]
    return sorted(trials, key=lambda trial: -trial.score)


def rank_one(state: State, one: Screened) -> State:
    """The state with one screened effect released on its axis and fitted."""
    return _release(state, one.name, [one]).state


def _release(state: State, name: str, found: list[Screened]) -> Trial:
    chosen = [one for one in found if one.gain > WORTH_AN_AXIS] or found[:1]
    axes = tuple(one.axis for one in chosen)
    keys = tuple((name, axis) for axis in axes)
    parts = parts_of(BY_NAME[name], axes)
    start = {k: v for one in chosen for k, v in one.start.items()}
    setting = state.fit.setting | {
        k: min(max(v, state.believed.knobs[k].range[0]), state.believed.knobs[k].range[1])
        for k, v in start.items()
    }
    moved = evaluate(state.evidence, state.believed, setting, parts)
    begun = replace(
        state,
        named=(*state.named, *keys),
        fit=replace(state.fit, setting=setting, rolls=state.fit.rolls | moved.rolls,
                    costs=state.fit.costs | moved.costs),
    )  # fmt: skip
    done = refit(begun, begun.bounds(parts))
    return Trial(name, axes, done, state.fit.cost - done.fit.cost)
