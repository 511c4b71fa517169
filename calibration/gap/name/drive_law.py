"""A second start of the search: the law of a geared drive, all of it at once.

Forward selection adds what gains most alone. Where Coulomb friction, a voltage offset and play of
the gears act together, as on most drives (breakaway of 0.28 V one way and 0.08 V the other on a
real table), each of them alone gains less than a dead zone, an asymmetric gain or cogging that
stands for all three, and no exchange of one name for another leads back. So where selection put two
names on a servo, it is begun again from the drive's law,

    tau d omega/dt = K (u + u_0 - f sgn(omega)) - omega   behind gears with a play,

and what costs less is kept: a search from the full model, as backward elimination is (Draper and
Smith, Applied Regression Analysis, ch. 15). Names of the law that earn nothing are dropped. It is
begun without play and offset, too: of friction alone that settles within 10 ms, as another engine
has it, a dead zone gains most at first, and half of the friction is left to stand beside it.

The cost is rough along play, friction and offset, since with other values the teeth meet at other
times; so a grid comes before the fit, at K, tau and delay of the rig file and the noise of a right
model (`screen.at_start_noise`).
"""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from functools import reduce
from itertools import product
from math import ceil

import numpy as np

from calibration.gap.decision_rule import NAME_THRESHOLD, penalised_gain
from calibration.gap.model.cost import loss
from calibration.gap.model.fit import evaluate
from calibration.gap.model.noise import least_noise
from calibration.gap.model.parameters import COAST_KEY, SERVO, SETTLING_KEY, NominalModel, released
from calibration.gap.model.state import Key, State, cheaper, drop_effects, price, refit, settle
from calibration.gap.name.candidates import (
    SETTLING_S,
    SIZES,
    Start,
    light_arm_backlash_starts,
    play_ladder,
)
from calibration.gap.name.load_friction import competing
from calibration.gap.name.screen import at_start_noise

LAW = ("gear_backlash", "coulomb_friction", "voltage_offset")
LOADED_LAW = (*LAW, "joint_backlash")  # where the friction behind a joint loads the motor
# Either way, to beyond half of what has been measured on real drives (0.13 and 0.3 V); the fit goes
# on from there. Chosen.
OFFSETS_V = (0.0, 0.05, -0.05, 0.1, -0.1, 0.2, -0.2)
SETTLINGS = 2  # noise and fit each follow the other; chosen


def has_law(nominal: NominalModel) -> bool:
    """Whether the law is of the rig's servos: they take volts."""
    return all(nominal.of(name, axis) for name in LOADED_LAW for axis in "xy")


def begun_with_law(state: State, skip: Collection[Key] = ()) -> list[State]:
    """What selection may go on from in place of `state`: with each model of the load's friction,
    the law on the servos that have a name, fitted, and all other names as they are; none where no
    servo has two names, or the law is not of the rig's, or part of it is in `skip`.
    """
    names = [_servo_names(state, output) for output in SERVO]
    if max(map(len, names)) < 2 or {n for n, _ in skip} & set(LAW) or not has_law(state.nominal):
        return []
    axes = [output[-1] for output, found in zip(SERVO, names, strict=True) if found]
    begun = state.evidence.each(
        lambda nominal: _begun(state, nominal, axes), competing(state.nominal)
    )
    return [one for one in begun if np.isfinite(one.fit.cost)]  # a log may be so spoiled


def _servo_names(state: State, output: str) -> list[Key]:
    """The names that act on a servo's output alone, on its axis."""
    of = state.nominal.of
    return [
        (name, axis)
        for name, axis in state.named
        if all(parameter.outputs == (output,) for parameter in of(name, axis))
    ]


def _begun(state: State, nominal: NominalModel, axes: Iterable[str]) -> State:
    """The state with the law in place of all names of these servos, in `nominal`."""
    outputs = [f"servo_{axis}" for axis in axes]
    gone = {key for output in outputs for key in _servo_names(state, output)}
    setting = {
        name: value
        for name, value in state.fit.setting.items()
        if name in nominal.parameters and not set(nominal.parameters[name].outputs) <= set(outputs)
    }
    evidence = at_start_noise(state, outputs)
    fit = evaluate(evidence, nominal, setting, evidence.outputs)
    kept = tuple(key for key in state.named if key not in gone)
    begun = State(evidence, nominal, fit, kept)
    for axis in axes:
        begun = _with_law(begun, axis)
    return begun


def _with_law(state: State, axis: str) -> State:
    """The state with the law on one axis, the best of the fits from each start of the grid, of
    which the cheaper half is followed each time that the noise is estimated beside them
    (successive halving); then without what earns nothing."""
    law = LOADED_LAW if state.nominal.load_friction else LAW
    named = tuple((name, axis) for name in law if (name, axis) not in state.named)
    each = state.evidence.each
    fits = each(lambda start: _fitted(state, start, named), best_of_grid(state, axis))
    for _ in range(SETTLINGS):
        fits = each(lambda one: settle(one, (f"servo_{axis}",)), _cheaper_half(fits))
    state = reduce(cheaper, fits)
    for key in named:
        bare = drop_effects(state, [key], needed=state.fit.cost + NAME_THRESHOLD)
        free = released(state.nominal.catalogue[key[0]], axis, state.nominal, state.fit.setting)
        gain = bare.fit.cost - state.fit.cost
        if penalised_gain(gain, len(free)) < NAME_THRESHOLD:
            state = bare
    return state


def _cheaper_half(states: Sequence[State]) -> list[State]:
    """Those that cost less at the smallest noise of all, more than half of an odd number."""
    levels = reduce(least_noise, [one.evidence.levels for one in states])
    return sorted(states, key=lambda one: price(one, levels))[: ceil(len(states) / 2)]


def _fitted(state: State, start: Start, named: tuple[Key, ...]) -> State:
    """The state with these names from a start, fitted at the noise of `state`."""
    output, parameters = f"servo_{named[0][1]}", state.nominal.parameters
    outputs = {p for key in start for p in parameters[key].outputs} & set(state.evidence.outputs)
    found = evaluate(state.evidence, state.nominal, state.fit.setting | start, outputs)
    fit = replace(
        state.fit,
        setting=found.setting,
        rolls=state.fit.rolls | found.rolls,
        costs=state.fit.costs | found.costs,
    )
    state = replace(state, fit=fit, named=(*state.named, *named))
    return refit(state, state.bounds((output,)))


def best_of_grid(state: State, axis: str) -> list[Start]:
    """Settings of the law's parameters on an axis to fit from, a start each: the best of play and
    offset from a grid with the smallest friction; then, for every play of the joint that is tried,
    the best friction and the time in which it settles. state: K, tau and noise to try them with.
    """
    nominal, output = state.nominal, f"servo_{axis}"
    friction, offset, joint = (nominal.of(name, axis)[0] for name in LOADED_LAW[1:])
    sizes = [friction.nominal + size for size in (0.0, *SIZES["friction_V"])]
    joints = [state.fit.setting.get(joint.name, joint.nominal)]
    if nominal.load_friction and (joint.effect, axis) not in state.named:
        joints += [joint.nominal + size for size in SIZES["play_rad"]]

    def best(starts: list[Start]) -> Start:
        models = [nominal.model(state.fit.setting | start) for start in starts]
        rolls = state.evidence.rolls([(model, output) for model in models])
        return starts[int(np.argmin([loss(roll, state.evidence.masks[output]) for roll in rolls]))]

    plays = light_arm_backlash_starts(axis, nominal, [0.0, *play_ladder(nominal, axis)])
    if nominal.load_friction:  # no arm coasts
        plays = [one for one in plays if not one.get(f"gear_backlash.{COAST_KEY}.{axis}")]
    found = best(
        [
            play | {friction.name: sizes[1], offset.name: offset.nominal + volts}
            for play, volts in product(plays, OFFSETS_V)
        ]
    )
    settling = f"{friction.effect}.{SETTLING_KEY}.{axis}"
    laws = list(product(sizes, (0.0, *SETTLING_S)))
    tight = plays[0] | {offset.name: offset.nominal}
    return [
        best([way | {friction.name: f, settling: s, joint.name: play} for f, s in laws])
        for way, play in product((found, tight), joints)
    ]
