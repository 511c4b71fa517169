"""The linear screen: what releasing each effect of the catalogue promises, before any is fitted."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from calibration.gap.evidence import Evidence, Roll
from calibration.gap.fit import Fit, bounded_step, differences, evaluate, normal_equations
from calibration.gap.knobs import CALIBRATED, SERVO, Believed, Knob
from calibration.gap.menu import (
    Start,
    coasting_starts,
    largest_volts,
    starts,
    swallowing_starts,
    swallows,
)
from calibration.gap.state import Key, State, parts_of, refit, settle
from rig.effects import CATALOGUE
from rig.predict import noise

MISSING = 50.0  # a gain beyond which something is missing for certain
LOUD_V = 0.1  # per root hertz of a servo's noise, 150 times the usual: the volts explain nothing
SMALLEST_PLAY_RAD = 0.005  # of gears that coast
PER_KNOB = 3.0  # log-likelihood that a released knob costs
MISFIT = 0.004  # of the gain, per knob: the rest of the model is only nearly right
SEEN = 12.0  # gain that an effect of its smallest visible size would bring


def beyond_knobs(gain, knobs: int):
    """What is left of gains in log-likelihood when the knobs released for them have been paid."""
    return gain - (PER_KNOB + MISFIT * np.maximum(gain, 0.0)) * knobs


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

    @property
    def worth(self) -> float:
        """The gain beyond what the knobs that were tried cost."""
        return beyond_knobs(self.gain, len(self.start))


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


@dataclass(frozen=True, eq=False)
class Candidate:
    """An effect on one axis as it is tried: its starts, and what each changes of z, (n, k)."""

    name: str
    axis: str
    group: list[Start]
    columns: np.ndarray

    def others(self, knobs: list[Knob]) -> np.ndarray:
        """Indices of the knobs that are not its own."""
        return np.flatnonzero([k.effect != self.name or k.axis != self.axis for k in knobs])

    def two_sided(self, believed: Believed) -> bool:
        first = believed.of(self.name, self.axis)[0]
        return len(self.group) > 1 or first.range[0] < first.believed


@dataclass(frozen=True, eq=False)
class Candidates:
    """What may be released on a part: the knobs that are free there anyway, name -> bounds, their
    secants (n, k), and every effect that is tried beside them."""

    knobs: list[Knob]
    bounds: Mapping[str, tuple[float, float]]
    nuisance: np.ndarray
    effects: list[Candidate]


def candidates(state: State, part: str, skip: set[Key]) -> Candidates:
    """Every effect and axis that acts on a part, but those of `skip`."""
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
    found = [
        Candidate(name, axis, group,
                  np.column_stack([next(rolls).z - base.rolls[part].z for _ in group]))
        for name, axis, group in tried
    ]  # fmt: skip
    return Candidates(knobs, bounds, nuisance, found)


def _screen_part(state: State, part: str, skip: set[Key]) -> list[Screened]:
    tried = candidates(state, part, skip)
    best: dict[Key, Screened] = {}
    for effect in tried.effects:
        one, key = _gain(state, part, tried, effect), (effect.name, effect.axis)
        if key not in best or one.worth > best[key].worth:
            best[key] = one
    most = max((one.gain for one in best.values()), default=0.0)
    coasting = _coasting(state, part, skip) if most > MISSING else None
    if coasting and coasting.gain > best["gear_backlash", coasting.axis].gain:
        best["gear_backlash", coasting.axis] = coasting
    swallowing = _swallowing(state, part, skip)
    if swallowing and swallowing.gain > best["dead_zone", swallowing.axis].gain:
        best["dead_zone", swallowing.axis] = swallowing
    return list(best.values())


def at_first_noise(state: State, parts: Collection[str]) -> Evidence:
    """The evidence with the noise of some servos as without a log: one that was settled beside a
    model far from the truth has taken the misfit for noise."""
    if not parts:
        return state.evidence
    first, levels = noise(), state.evidence.levels.copy()
    for a, part in enumerate(SERVO):
        if part in parts:
            levels["servo_process"][a] = 2.0 * first["servo_process"][a]  # teeth meet with a jerk
            levels["servo_measured"][a] = state.believed.rig.servo.encoder_step_rad / 12**0.5
    return state.evidence.with_levels(levels)


def _coasting(state: State, part: str, skip: set[Key]) -> Screened | None:
    """Gears with play through whose gap the arm coasts: what their best start gains as it is.

    None: the plate's friction holds the arm there, or it does not help.
    """
    axis = part[-1]
    first = state.believed.of("gear_backlash", axis)[0] if part in SERVO else None
    held = state.believed.load_friction or ("gear_backlash", axis) in skip
    if first is None or held or first.believed > 0.0:
        return None
    evidence = at_first_noise(state, (part,))

    def best(plays: list[float]) -> Fit:
        tried = [state.fit.setting | s for s in coasting_starts(axis, state.believed, plays)]
        fits = [evaluate(evidence, state.believed, setting, (part,)) for setting in tried]
        return min(fits, key=lambda fit: fit.cost)

    play = best([SMALLEST_PLAY_RAD * 1.25**n for n in range(10)]).setting[first.name]
    start = best([play * ratio for ratio in (0.9, 0.95, 1.0, 1.06, 1.12)])
    keys = coasting_starts(axis, state.believed, [play])[0]
    return _afresh(state, evidence, "gear_backlash", part, start, keys)


def _swallowing(state: State, part: str, skip: set[Key]) -> Screened | None:
    """A dead zone so wide that the model without it has the volts explain nothing: what the best
    of many starts gains as it is. None: the servo is not that noisy, or it does not help."""
    if part not in SERVO or ("dead_zone", axis := part[-1]) in skip:
        return None
    gain, time = (state.fit.setting[f".{key}.{axis}"] for key in CALIBRATED)
    if state.evidence.levels["servo_process"][SERVO.index(part)] * time / gain < LOUD_V:
        return None
    evidence = at_first_noise(state, (part,))
    tried = swallowing_starts(axis, state.believed, largest_volts(evidence, axis))
    fits = [evaluate(evidence, state.believed, state.fit.setting | s, (part,)) for s in tried]
    start = min(fits, key=lambda fit: fit.cost)
    return _afresh(state, evidence, "dead_zone", part, start, tried[0])


def _afresh(state: State, evidence: Evidence, name: str, part: str, start: Fit,
            keys: Iterable[str]) -> Screened | None:  # fmt: skip
    """An effect of a part fitted from a start that forgets K and tau; None: it gains nothing."""
    begun = replace(state, evidence=evidence, fit=start, named=(*state.named, (name, part[-1])))
    done = refit(begun, begun.bounds((part,)), iterations=3)
    found = (settle(done, (part,)) if swallows(keys) else done).fit
    gain = state.fit.costs[part] - found.cost
    if not gain > 0.0:
        return None
    moved = {key: found.setting[key] for key in keys}
    return Screened(name, part[-1], gain, moved, 0.0, moved)


def _gain(state: State, part: str, tried: Candidates, one: Candidate) -> Screened:
    """Minimise the linearised cost over the nuisance in its boxes and the sizes of the group."""
    base, knobs, bounds, group = state.fit, tried.knobs, tried.bounds, one.group
    keep = one.others(knobs)
    both = {part: np.column_stack([tried.nuisance[:, keep], one.columns])}
    only = Fit(base.setting, {part: base.rolls[part]}, {})
    a, b = normal_equations(state.evidence, only, both)
    value = np.array([base.setting.get(knobs[i].name, knobs[i].believed) for i in keep])
    low = np.array([bounds[knobs[i].name][0] for i in keep]) - value
    high = np.array([bounds[knobs[i].name][1] for i in keep]) - value
    k = len(group)
    first = state.believed.of(one.name, one.axis)[0]
    low = np.append(low, np.full(k, -6.0 if one.two_sided(state.believed) else 0.0))
    high = np.append(high, np.full(k, 6.0))
    scale = np.append([knobs[i].step for i in keep], np.ones(k))
    step = bounded_step(a, b, low, high, scale)
    gain = -float(0.5 * step @ a @ step + b @ step)
    start = _scaled(state.believed, group, step[-k:])
    smallest = abs(next(iter(group[0].values())) - _null(first)) * _units_to_see(a, low, high, k)
    tried_with = {k: v for member in group for k, v in member.items()}
    return Screened(one.name, one.axis, gain, start, smallest, tried_with)


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
