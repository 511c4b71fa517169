"""Where the search stands: evidence, a fitted setting of the knobs, the effects released so far.

The baseline is the believed model with every knob free inside its tolerance (K, tau and noise free
always).
"""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from calibration.gap.evidence import Evidence
from calibration.gap.fit import Fit, evaluate, fit
from calibration.gap.knobs import BALL, CALIBRATED, SERVO, Believed, Knob
from calibration.gap.menu import GUESSES, released
from calibration.gap.noise import estimate
from rig.effects import BY_NAME, Effect

FAR = 1.7  # times the nominal K or tau: beyond, other starts are tried, too
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
            key = (knob.effect, knob.axis)
            if effect and key in chosen and knob in self._released(effect, knob.axis):
                found[knob.name] = knob.range
            elif knob.tolerance > 0:
                low, high = knob.box
                if knob.effect == "voltage_offset" and ("dead_zone", knob.axis) in chosen:
                    width = self.fit.setting.get(f"dead_zone.half_width_V.{knob.axis}", 0.0)
                    low, high = low - width, high + width  # its inner shape: a side of its own each
                found[knob.name] = low, high
        return found

    def _released(self, effect: Effect, axis: str) -> list[Knob]:
        return released(effect, axis, self.believed, self.fit.setting)


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
    begun = State(evidence, believed, evaluate(evidence, believed, {}, evidence.parts))
    state = _within_boxes(begun, iterations)
    servo = [knob for knob in believed.knobs.values() if not knob.effect]
    ratio = [state.fit.setting.get(k.name, k.believed) / k.believed for k in servo]
    if all(1 / FAR < r < FAR for r in ratio):
        return state
    other = _within_boxes(replace(state, fit=_servo_guess(evidence, believed)), iterations)
    return other if other.fit.cost < state.fit.cost else state


def _within_boxes(state: State, iterations: int) -> State:
    for part in state.evidence.parts:
        state = refit(state, state.bounds((part,)), iterations=iterations)
    return state


def _servo_guess(evidence: Evidence, believed: Believed) -> Fit:
    """The believed model, with K and tau far from their nominal values where that fits better."""
    best = evaluate(evidence, believed, {}, evidence.parts)
    for part in set(SERVO) & set(evidence.parts):
        k, tau = (believed.knobs[f".{key}.{part[-1]}"] for key in CALIBRATED)
        for gain in GUESSES:
            for time in GUESSES:
                tried = {k.name: gain * k.believed, tau.name: time * tau.believed}
                found = evaluate(evidence, believed, best.setting | tried, (part,))
                if found.cost < best.costs[part]:
                    best = Fit(found.setting, best.rolls | found.rolls, best.costs | found.costs)
    return best


def with_levels(state: State, levels: np.record, parts: Collection[str]) -> State:
    """The same at other noise levels of some parts (their costs are those of the new filters)."""
    evidence, old = state.evidence.with_levels(levels), state.fit
    new = evaluate(evidence, state.believed, old.setting, parts)
    columns = {key: column for key, column in old.columns.items() if key[0] not in parts}
    fit = Fit(old.setting, old.rolls | new.rolls, old.costs | new.costs, columns)
    return replace(state, evidence=evidence, fit=fit)


def settle(state: State, parts: Iterable[str]) -> State:
    """Estimate the noise of some parts anew and fit everything that is free on them."""
    parts = tuple(part for part in parts if part in state.evidence.parts)
    model = state.believed.model(state.fit.setting)
    state = with_levels(state, estimate(state.evidence, model, parts), parts)
    return refit(state, state.bounds(parts))
