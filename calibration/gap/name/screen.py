"""The linear screen: the gain that releasing each effect of the catalogue promises, before any fit.

With J the secants of the free parameters beside the change of z that each start of the effect
makes, A = J'WJ and b = J'Wz, the gain is that of the quadratic model within the bounds,

    G = max_d -(d'Ad/2 + b'd),   low <= d <= high,

a score test (Rao) with secants for derivatives: backlash, friction and delays have none at zero.
"""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from calibration.gap.decision_rule import (
    CERTAIN_GAIN,
    DETECTABLE_GAIN,
    FAILED_MODEL_NOISE_V,
    penalised_gain,
)
from calibration.gap.model.data import Evidence, Roll
from calibration.gap.model.fit import (
    ParameterFit,
    bounded_step,
    differences,
    evaluate,
    normal_equations,
)
from calibration.gap.model.parameters import CALIBRATED, SERVO, NominalModel, Parameter
from calibration.gap.model.state import Key, State, fall_of_cost, outputs_of, refit, settle
from calibration.gap.name.candidates import (
    Start,
    largest_volts,
    light_arm_backlash_starts,
    low_saturation_starts,
    play_ladder,
    starts,
    wide_dead_zone_starts,
)
from rig.prediction.innovations import noise

# Times the tried size to which a screen extrapolates: sizes of a ladder stand 2 to 5 apart, an
# effect with one size is nearly linear; chosen.
LADDER_REACH, LINEAR_REACH = 2.0, 6.0
# Of the ladder's plays, those about which more are tried, and where: the teeth meet at other times
# a few per cent beside the right play, so the ladder's best may be another; chosen.
PLAYS_REFINED, BETWEEN_PLAYS = 3, (0.9, 0.95, 1.0, 1.06, 1.12)


@dataclass(frozen=True, eq=False)
class Screened:
    """The linear screen of an effect on one axis.

    `gain`: in log-likelihood; `start`: the setting with the sizes of the linear fit; `tried`: the
    setting as it was tried; `smallest`: size of the first parameter [its unit] at which the
    expected gain reaches DETECTABLE_GAIN.
    """

    name: str
    axis: str
    gain: float
    start: Start
    smallest: float
    tried: Start

    @property
    def worth(self) -> float:
        """The penalised gain, for as many parameters as `start` sets."""
        return penalised_gain(self.gain, len(self.start))


Screens = dict[str, tuple[Roll, list[Screened]]]


def screen(
    state: State, outputs: Iterable[str], *, skip: Iterable[Key] = (), known: Screens | None = None
) -> list[Screened]:
    """Screen every effect and axis that is neither released yet nor in `skip`; largest gain first.
    An effect on both servos has the sum of both gains.

    `known`: earlier screens by output, used where the prediction is still that of the state; new
    ones are stored in it.
    """
    found: list[Screened] = []
    known = {} if known is None else known
    outputs, rolls, done = list(outputs), state.fit.rolls, set(state.named) | set(skip)
    new = [o for o in outputs if o not in known or known[o][0] is not rolls[o]]
    screens = state.evidence.each(lambda output: _screen_output(state, output, done), new)
    known |= {o: (rolls[o], one) for o, one in zip(new, screens, strict=True)}
    for output in outputs:
        found += known[output][1]
    merged: dict[Key, Screened] = {}
    for one in found:  # an effect on both servos: the sum
        key = (one.name, one.axis)
        if key in merged:
            smallest = min(one.smallest, merged[key].smallest)
            one = replace(one, gain=one.gain + merged[key].gain, smallest=smallest)
        merged[key] = one
    return sorted(merged.values(), key=lambda one: -one.gain)


@dataclass(frozen=True, eq=False)
class Candidate:
    """An effect on one axis as it is tried: its k starts (`group`), the places (k,) of the changes
    that they make among the columns of `Candidates`, and by how much more than its size the linear
    screen may extrapolate (`reach`)."""

    name: str
    axis: str
    group: list[Start]
    places: np.ndarray
    reach: float

    def others(self, parameters: list[Parameter]) -> np.ndarray:
        """Indices of those of `parameters` that belong to another effect or axis than this
        candidate."""
        return np.flatnonzero([k.effect != self.name or k.axis != self.axis for k in parameters])

    def two_sided(self, nominal: NominalModel) -> bool:
        """Whether the effect's size may have either sign; False: only the sign of the start."""
        first = nominal.of(self.name, self.axis)[0]
        return len(self.group) > 1 or first.range[0] < first.nominal


@dataclass(frozen=True, eq=False)
class Candidates:
    """The candidates of one output: the m parameters that are free in any case and their bounds,
    every effect that is tried beside them, and `columns`: the secants (n, m) of the parameters,
    followed by the change of z (n,) by each start of each effect."""

    parameters: list[Parameter]
    bounds: Mapping[str, tuple[float, float]]
    columns: np.ndarray
    effects: list[Candidate]


def candidates(state: State, output: str, skip: set[Key]) -> Candidates:
    """The candidates of an output: every effect and axis that acts on it, but those of `skip`, with
    the change of z by each of their starts."""
    bounds = state.bounds((output,))
    parameters = [state.nominal.parameters[name] for name in bounds]
    base = state.fit
    only = ParameterFit(
        base.setting, {output: base.rolls[output]}, {output: base.costs[output]}, base.columns
    )
    nuisance = differences(state.evidence, state.nominal, only, parameters, bounds)[output]
    tried: list[tuple[str, str, list[Start], float]] = []
    for effect in state.nominal.effects:
        for axis in effect.axes:
            if output in outputs_of(effect, (axis,)) and (effect.name, axis) not in skip:
                groups = starts(effect, axis, state.nominal, state.evidence)
                reach = LADDER_REACH if len(groups) > 1 else LINEAR_REACH
                tried += [(effect.name, axis, group, reach) for group in groups]
    models = [state.nominal.model(base.setting | s) for _, _, group, _ in tried for s in group]
    rolls = state.evidence.rolls([(model, output) for model in models])
    changes = [roll.change(base.rolls[output]) for roll in rolls]
    places = iter(range(len(parameters), len(parameters) + len(rolls)))
    found = [
        Candidate(name, axis, group, np.array([next(places) for _ in group]), reach)
        for name, axis, group, reach in tried
    ]
    return Candidates(parameters, bounds, np.column_stack([nuisance, *changes]), found)


def _screen_output(state: State, output: str, skip: set[Key]) -> list[Screened]:
    tried = candidates(state, output, skip)
    only = ParameterFit(state.fit.setting, {output: state.fit.rolls[output]}, {})
    equations = normal_equations(state.evidence, only, {output: tried.columns})
    best: dict[Key, Screened] = {}
    for effect in tried.effects:
        one, key = _gain(state, tried, effect, *equations), (effect.name, effect.axis)
        if key not in best or one.worth > best[key].worth:
            best[key] = one
    most = max((one.gain for one in best.values()), default=0.0)
    certain = most > CERTAIN_GAIN
    for anew in (
        _light_arm_backlash(state, output, skip) if certain else None,
        _low_saturation(state, output, skip) if certain else None,
        _wide_dead_zone(state, output, skip),
    ):
        if anew and anew.gain > best[anew.name, anew.axis].gain:
            best[anew.name, anew.axis] = anew
    return list(best.values())


def at_start_noise(state: State, outputs: Collection[str]) -> Evidence:
    """The evidence with the noise of the servos in `outputs` at its start level, since noise that
    was estimated beside a model far from the truth contains the misfit."""
    if not outputs:
        return state.evidence
    first, levels = noise(), state.evidence.levels.copy()
    for a, output in enumerate(SERVO):
        if output in outputs:
            levels["servo_process"][a] = 2.0 * first["servo_process"][a]  # impacts of the teeth
            levels["servo_measured"][a] = state.nominal.rig.servo.encoder_step_rad / 12**0.5
    return state.evidence.with_levels(levels)


def _light_arm_backlash(state: State, output: str, skip: set[Key]) -> Screened | None:
    """Gear backlash with an arm that no friction loads, fitted from its best start.

    None: friction of arm or joints does load it, or there is no gain.
    """
    axis = output[-1]
    first = next(iter(state.nominal.of("gear_backlash", axis)), None) if output in SERVO else None
    held = state.nominal.load_friction or ("gear_backlash", axis) in skip
    if first is None or held or first.nominal > 0.0:
        return None
    evidence = at_start_noise(state, (output,))

    def by_cost(plays: Iterable[float]) -> list[tuple[Start, ParameterFit]]:
        tried = light_arm_backlash_starts(axis, state.nominal, plays)
        fits = [evaluate(evidence, state.nominal, bare | start, (output,)) for start in tried]
        return sorted(zip(tried, fits, strict=True), key=lambda pair: pair[1].cost)

    bare = state.fit.setting
    found = by_cost(play_ladder(state.nominal, axis))
    plays = list(dict.fromkeys(start[first.name] for start, _ in found))[:PLAYS_REFINED]
    keys, start = by_cost([play * ratio for play in plays for ratio in BETWEEN_PLAYS])[0]
    return _fitted_from_reset(state, evidence, "gear_backlash", output, start, keys)


def _wide_dead_zone(state: State, output: str, skip: set[Key]) -> Screened | None:
    """A dead zone so wide that the model without it has failed, fitted from the best of many
    starts. None: the process noise is below FAILED_MODEL_NOISE_V, or there is no gain."""
    if output not in SERVO or ("dead_zone", axis := output[-1]) in skip:
        return None
    if not state.nominal.of("dead_zone", axis):
        return None
    gain, time = (state.fit.setting[f".{key}.{axis}"] for key in CALIBRATED)
    if (
        state.evidence.levels["servo_process"][SERVO.index(output)] * time / gain
        < FAILED_MODEL_NOISE_V
    ):
        return None
    evidence = at_start_noise(state, (output,))
    tried = wide_dead_zone_starts(axis, state.nominal, largest_volts(evidence, axis))
    fits = [evaluate(evidence, state.nominal, state.fit.setting | s, (output,)) for s in tried]
    start = min(fits, key=lambda fit: fit.cost)
    return _fitted_from_reset(state, evidence, "dead_zone", output, start, tried[0])


def _low_saturation(state: State, output: str, skip: set[Key]) -> Screened | None:
    """Volts that are cut far below the largest, fitted from the best of some limits. None: there is
    no gain."""
    if output not in SERVO or ("saturation", axis := output[-1]) in skip:
        return None
    if not state.nominal.of("saturation", axis):
        return None
    evidence = at_start_noise(state, (output,))
    tried = low_saturation_starts(axis, state.nominal, largest_volts(evidence, axis))
    fits = [evaluate(evidence, state.nominal, state.fit.setting | s, (output,)) for s in tried]
    start = min(fits, key=lambda fit: fit.cost)
    return _fitted_from_reset(state, evidence, "saturation", output, start, tried[0])


def _fitted_from_reset(
    state: State,
    evidence: Evidence,
    name: str,
    output: str,
    start: ParameterFit,
    keys: Collection[str],
) -> Screened | None:
    """An effect of an output fitted from a start that sets K and tau anew, and the noise estimated
    beside it; None: no gain, or none before that, which takes long."""
    begun = replace(state, evidence=evidence, fit=start, named=(*state.named, (name, output[-1])))
    done = refit(begun, begun.bounds((output,)), iterations=3)
    if not penalised_gain(fall_of_cost(state, done, (output,)), len(keys)) > 0.0:
        return None
    done = settle(done, (output,))
    gain = fall_of_cost(state, done, (output,))
    if not gain > 0.0:
        return None
    moved = {key: done.fit.setting[key] for key in keys}
    return Screened(name, output[-1], gain, moved, 0.0, moved)


def _gain(
    state: State, tried: Candidates, one: Candidate, a: np.ndarray, b: np.ndarray
) -> Screened:
    """The screen of one candidate: other parameters within bounds, sizes of its group free; a, b:
    the normal equations of all columns of `tried`."""
    base, parameters, bounds, group = state.fit, tried.parameters, tried.bounds, one.group
    keep = one.others(parameters)
    used = np.append(keep, one.places)
    a, b = a[np.ix_(used, used)], b[used]
    value = np.array([base.setting.get(parameters[i].name, parameters[i].nominal) for i in keep])
    low = np.array([bounds[parameters[i].name][0] for i in keep]) - value
    high = np.array([bounds[parameters[i].name][1] for i in keep]) - value
    k = len(group)
    first = state.nominal.of(one.name, one.axis)[0]
    low = np.append(low, np.full(k, -one.reach if one.two_sided(state.nominal) else 0.0))
    high = np.append(high, np.full(k, one.reach))
    scale = np.append([parameters[i].step for i in keep], np.ones(k))
    step = bounded_step(a, b, low, high, scale)
    gain = -float(0.5 * step @ a @ step + b @ step)
    start = _scaled(state.nominal, group, step[-k:])
    smallest = abs(next(iter(group[0].values())) - _null(first)) * _units_to_see(a, low, high, k)
    tried_with = {k: v for member in group for k, v in member.items()}
    return Screened(one.name, one.axis, gain, start, smallest, tried_with)


def _null(parameter: Parameter) -> float:
    return parameter.nominal if np.isfinite(parameter.nominal) else 0.0


def _units_to_see(a: np.ndarray, low: np.ndarray, high: np.ndarray, k: int) -> float:
    """Size, in units of the start, at which the expected gain reaches DETECTABLE_GAIN:
    sqrt(2 DETECTABLE_GAIN/I), I the information left when the other parameters are free."""
    prior = np.zeros(len(a))  # inverse variance of a uniform between the bounds
    prior[:-k] = 12.0 / np.maximum(high - low, 1e-12)[:-k] ** 2
    h = a + np.diag(prior)
    own, cross, rest = h[-k, -k], h[-k, :-k], h[:-k, :-k]
    seen = own - cross @ np.linalg.solve(rest + 1e-9 * np.diag(np.diag(rest) + 1e-12), cross)
    return (
        float(np.sqrt(2.0 * DETECTABLE_GAIN / seen))
        if seen > 1e-12 * max(own, 1e-30)
        else float("inf")
    )


def _scaled(nominal: NominalModel, group: list[Start], sizes: np.ndarray) -> Start:
    """The start with the first parameter of each member scaled by the linear fit."""
    start: Start = {}
    for member, size in zip(group, sizes, strict=True):
        for i, (name, value) in enumerate(member.items()):
            parameter = nominal.parameters[name]
            absolute = i > 0 or parameter.key in ("limit_V", "limit_rad_s")
            start[name] = (
                value if absolute else parameter.nominal + size * (value - parameter.nominal)
            )
    return start
