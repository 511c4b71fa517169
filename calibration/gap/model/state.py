"""A point of the search: evidence, fitted setting of the parameters, effects released so far.

The baseline is the nominal model with every parameter free inside its tolerance; K, tau and the
noise levels are always free.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from calibration.gap.decision_rule import PENALTY_PER_PARAMETER
from calibration.gap.model.data import OUTPUTS, Evidence
from calibration.gap.model.fit import ITERATIONS, ParameterFit, evaluate, fit
from calibration.gap.model.kept_fits import key_of
from calibration.gap.model.noise import estimate, least_noise
from calibration.gap.model.nuisances import BEGIN_KEY, LOAD_KEY, MOTOR_KEY, SHARE_KEY
from calibration.gap.model.parameters import (
    BALL,
    CALIBRATED,
    GUESSES,
    SERVO,
    NominalModel,
    Parameter,
    released,
)
from calibration.gap.model.seen_effects import IN_BOTH, in_ball
from rig.discrepancy import Discrepancy
from rig.effects import Effect

RESTART_RATIO = 1.7  # of K or tau to its nominal: beyond, other starts are tried, too; chosen
SERVO_GUESSES = dict.fromkeys(CALIBRATED, GUESSES)
# From a motor without a lag nothing tells which share of it is told as dead time; and what is met
# between two commands is another one for each quarter of a period; chosen.
ANSWER_GUESSES = {
    MOTOR_KEY: (0.005, 0.01, 0.02, 0.04),
    SHARE_KEY: (0.0, 1.0),
    BEGIN_KEY: (0.0, 0.5, 1.0, 1.5),
}
Key = tuple[str, str]  # effect, axis


@dataclass(frozen=True, eq=False)
class State:
    """A point of the search: the evidence at its noise levels, the nominal model, the fit, and the
    released effects as pairs (effect, axis)."""

    evidence: Evidence
    nominal: NominalModel
    fit: ParameterFit
    named: tuple[Key, ...] = ()

    def bounds(self, outputs: Iterable[str], named: Iterable[Key] | None = None) -> dict:
        """Parameter name -> (low, high), for every parameter that is free and moves one of the
        outputs.

        Parameters of the released effects `named` (None: those of the state) get the effect's
        range, all others their tolerance box.
        """
        chosen = set(self.named if named is None else named)
        outputs, found = set(outputs), {}
        for parameter in self.nominal.parameters.values():
            if not outputs & set(parameter.outputs) or self._weightless(parameter):
                continue
            effect = self.nominal.catalogue.get(parameter.effect)
            key = (parameter.effect, parameter.axis)
            if effect and key in chosen and parameter in self._released(effect, parameter.axis):
                found[parameter.name] = parameter.range
            elif parameter.tolerance > 0:
                low, high = parameter.box
                if parameter.effect == "voltage_offset" and ("dead_zone", parameter.axis) in chosen:
                    width = self.fit.setting.get(f"dead_zone.half_width_V.{parameter.axis}", 0.0)
                    low, high = low - width, high + width  # a width of its own on each side
                found[parameter.name] = low, high
        return found

    def _weightless(self, parameter: Parameter) -> bool:
        """Whether it is about the weight of a ball that nobody saw."""
        seen = self.evidence.ball_axes
        return parameter.key == LOAD_KEY and not seen["xy".index(parameter.axis)]

    def _released(self, effect: Effect, axis: str) -> list[Parameter]:
        return released(effect, axis, self.nominal, self.fit.setting)


def outputs_of(effect: Effect, axes: Iterable[str]) -> tuple[str, ...]:
    """The outputs in which an effect on these axes is looked for: "ball", or the servos' of the
    axes, or both of them."""
    if in_ball(effect):
        return (BALL,)
    if effect.side == IN_BOTH or "xy" in axes:
        return SERVO
    return tuple(f"servo_{axis}" for axis in axes)


def moved_by(nominal: NominalModel, keys: Iterable[Key]) -> tuple[str, ...]:
    """The outputs that the parameters of the effects `keys` (effect, axis) move: those in which
    `outputs_of` looks for them and, of a joint's play whose friction loads the motors, the servos',
    whose K, tau and noise are others without it."""
    moved = {p for name, axis in keys for k in nominal.of(name, axis) for p in k.outputs}
    return tuple(output for output in OUTPUTS if output in moved)


def refit(
    state: State,
    bounds: Mapping[str, tuple[float, float]],
    *,
    iterations: int = ITERATIONS,
    needed: float = np.inf,
) -> State:
    """The state with the parameters of `bounds` (name -> (low, high)) fitted on the outputs that
    they move, as `fit` does with these options (`needed`: a cost of all outputs); all other
    parameters and outputs stay. `KeyError`: no such parameter."""
    felt = {output for name in bounds for output in state.nominal.parameters[name].outputs}
    old = state.fit
    start = ParameterFit(
        old.setting,
        {p: r for p, r in old.rolls.items() if p in felt},
        {p: c for p, c in old.costs.items() if p in felt},
        {key: column for key, column in old.columns.items() if key[0] in felt},
    )
    evidence, nominal = state.evidence, state.nominal
    needed -= sum(cost for p, cost in old.costs.items() if p not in felt)
    done = evidence.fits.of(
        key_of(evidence, nominal, start, bounds, (iterations, needed)),
        lambda: fit(evidence, nominal, start, bounds, iterations=iterations, needed=needed),
    )
    moved = {name: done.setting[name] for name in bounds if name in done.setting}
    merged = ParameterFit(
        old.setting | moved,
        old.rolls | done.rolls,
        old.costs | done.costs,
        {key: column for key, column in old.columns.items() if key[0] not in felt}
        | dict(done.columns),
    )
    return replace(state, fit=merged)


def baseline(evidence: Evidence, nominal: NominalModel, *, iterations: int = 6) -> State:
    """The nominal model fitted inside its tolerance boxes, output by output, a servo's motor that
    takes an angle from the best start of ANSWER_GUESSES. Where K or tau end beyond RESTART_RATIO of
    nominal, a fit from the best of other starts is tried, too."""
    begun = _servo_guess(evidence, nominal, ANSWER_GUESSES)
    state = _within_boxes(State(evidence, nominal, begun), iterations)
    servo = [k for k in nominal.parameters.values() if k.key in CALIBRATED]
    ratio = [state.fit.setting.get(k.name, k.nominal) / k.nominal for k in servo]
    if all(1 / RESTART_RATIO < r < RESTART_RATIO for r in ratio):
        return state
    guess = State(evidence, nominal, _servo_guess(evidence, nominal, SERVO_GUESSES))
    other = _within_boxes(guess, iterations)
    return other if other.fit.cost < state.fit.cost else state


def _within_boxes(state: State, iterations: int) -> State:
    for output in state.evidence.outputs:
        state = refit(state, state.bounds((output,)), iterations=iterations)
    return state


def _servo_guess(
    evidence: Evidence, nominal: NominalModel, guesses: Mapping[str, Sequence[float]]
) -> ParameterFit:
    """The nominal model, on each axis the best of the grid of `guesses` (key of a servo's own
    parameter -> values, as shares of nominal but for a motor's lag), of those that the model has.
    """
    best = evaluate(evidence, nominal, {}, evidence.outputs)
    for axis in "xy":
        known = [nominal.parameters.get(f".{key}.{axis}") for key in guesses]
        own = [k for k in known if k is not None]
        felt = {p for k in own for p in k.outputs} & set(evidence.outputs)
        if not felt:
            continue
        tries = [
            [v * (k.nominal if k.key in (*CALIBRATED, BEGIN_KEY) else 1.0) for v in guesses[k.key]]
            for k in own
        ]
        for values in product(*tries):
            tried = {k.name: v for k, v in zip(own, values, strict=True)}
            found = evaluate(evidence, nominal, best.setting | tried, felt)
            if found.cost < sum(best.costs[p] for p in felt):
                best = ParameterFit(
                    found.setting, best.rolls | found.rolls, best.costs | found.costs
                )
    return best


def with_levels(state: State, levels: np.record, outputs: Collection[str]) -> State:
    """The state at other noise levels (dtype NOISE), with the costs of `outputs` evaluated anew;
    the setting stays."""
    evidence, old = state.evidence.with_levels(levels), state.fit
    new = evaluate(evidence, state.nominal, old.setting, outputs)
    columns = {key: column for key, column in old.columns.items() if key[0] not in outputs}
    fit = ParameterFit(old.setting, old.rolls | new.rolls, old.costs | new.costs, columns)
    return replace(state, evidence=evidence, fit=fit)


def at_noise(state: State, levels: np.record) -> State:
    """The state at other noise levels (dtype NOISE), all that is free fitted anew there."""
    outputs = state.evidence.outputs
    return _within_boxes(with_levels(state, levels, outputs), ITERATIONS)


def plain(state: State) -> State:
    """The state without the unnamed term in its model: predicted anew, and what is free fitted from
    its setting. What an unnamed term takes up is not told of a name beside it."""
    if state.nominal.rig.unknown == Discrepancy():
        return state
    nominal, outputs = state.nominal.with_unknown(Discrepancy()), state.evidence.outputs
    fit = evaluate(state.evidence, nominal, state.fit.setting, outputs)
    moved = replace(state, nominal=nominal, fit=fit)
    return refit(moved, moved.bounds(outputs), iterations=3)


def drop_effects(state: State, keys: Iterable[Key], *, needed: float = np.inf) -> State:
    """The state with the effects `keys` (effect, axis) back inside their tolerance boxes, refitted
    (`needed`: as of `refit`)."""
    keys = set(keys)
    known = set(state.evidence.outputs)
    outputs = [output for output in moved_by(state.nominal, keys) if output in known]
    parameters = state.nominal.parameters
    setting = {
        name: value
        for name, value in state.fit.setting.items()
        if (parameters[name].effect, parameters[name].axis) not in keys
    }
    moved = evaluate(state.evidence, state.nominal, setting, outputs)
    fit = replace(
        state.fit,
        setting=setting,
        rolls=state.fit.rolls | moved.rolls,
        costs=state.fit.costs | moved.costs,
    )
    bare = replace(state, fit=fit, named=tuple(k for k in state.named if k not in keys))
    return refit(bare, bare.bounds(outputs), needed=needed)


def cheaper(one: State, other: State) -> State:
    """The one that costs less at the smaller noise of both, its effects paid for."""
    levels = least_noise(one.evidence.levels, other.evidence.levels)
    return min((one, other), key=lambda state: price(state, levels))


def price(state: State, levels: np.record) -> float:
    """The cost of a state at these noise levels, and what its effects' parameters are paid for."""
    state = with_levels(state, levels, state.evidence.outputs)
    nominal, setting = state.nominal, state.fit.setting
    free = [released(nominal.catalogue[n], axis, nominal, setting) for n, axis in state.named]
    return state.fit.cost + PENALTY_PER_PARAMETER * sum(map(len, free))


def fall_of_cost(before: State, after: State, outputs: Collection[str]) -> float:
    """By how much the cost of these outputs falls from one state to another, both fitted at the
    smaller noise of both: costs at different noise say nothing of each other."""
    levels = least_noise(before.evidence.levels, after.evidence.levels)

    def cost(state: State) -> float:
        if state.evidence.levels != levels:
            state = with_levels(state, levels, outputs)
            state = refit(state, state.bounds(outputs), iterations=3)
        return sum(state.fit.costs[output] for output in outputs)

    return cost(before) - cost(after)


def settle(state: State, outputs: Iterable[str]) -> State:
    """Estimate the noise levels of some outputs anew, then fit everything that is free on them;
    outputs without evidence are passed over."""
    outputs = tuple(output for output in outputs if output in state.evidence.outputs)
    model = state.nominal.model(state.fit.setting)
    state = with_levels(state, estimate(state.evidence, model, outputs), outputs)
    return refit(state, state.bounds(outputs))
