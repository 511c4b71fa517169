"""Exact refits of the effects that the linear screen ranks first.

A candidate's parameters are released from their tolerance box and fitted with all others. Its gain
G is the fall of the cost C (`calibration.gap.model.fit`), its score the penalised gain of the
parameters released (`calibration.gap.decision_rule`).
"""

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from calibration.gap.decision_rule import (
    EFFECTS_REFITTED,
    MAX_SATURATION_RATIO,
    MAX_SETTLING_SHARE,
    MAX_STRIBECK_SPEED_SHARE,
    MIN_AXIS_GAIN,
    MIN_LATE_REFIT_GAIN,
    MIN_PHASE_RAD,
    MIN_REFIT_GAIN,
    MIN_SHARE_BELOW_LIMIT,
    MIN_SHARE_OF_BEST,
    MIN_SHARE_OF_BEST_ON_AXIS,
    penalised_gain,
)
from calibration.gap.model.fit import evaluate
from calibration.gap.model.parameters import PERIODIC, SETTLING_KEY, released
from calibration.gap.model.state import Key, State, fall_of_cost, moved_by, refit, settle
from calibration.gap.name.candidates import (
    Start,
    fastest,
    largest_volts,
    reach,
    resets_servo,
    share_of_lower_volts,
)
from calibration.gap.name.screen import Screened, at_start_noise


@dataclass(frozen=True, eq=False)
class CandidateFit:
    """An effect released on some axes and refitted, with the state of that fit; `gain`: the fall of
    the cost C."""

    name: str
    axes: tuple[str, ...]
    state: State
    gain: float

    @property
    def keys(self) -> tuple[Key, ...]:
        """The effect on each of its axes, as (effect, axis)."""
        return tuple((self.name, axis) for axis in self.axes)

    @property
    def score(self) -> float:
        """The penalised gain of the parameters released; -inf if the effect is identified on no
        axis."""
        if not any(self.is_identified(axis) for axis in self.axes):
            return -float("inf")
        return self._penalised

    @property
    def rival_score(self) -> float:
        """The score as a rival: a wave of which the motion spans too little to be named may be what
        looks like a curve."""
        nominal, setting = self.state.nominal, self.state.fit.setting
        wave = self.name in PERIODIC
        if wave and any(nominal.exceeds_minimum(self.name, axis, setting) for axis in self.axes):
            return self._penalised
        return self.score

    @property
    def _penalised(self) -> float:
        nominal = self.state.nominal
        parameters = sum(
            len(released(nominal.catalogue[self.name], axis, nominal, self.state.fit.setting))
            for axis in self.axes
        )
        return penalised_gain(self.gain, parameters)

    def is_identified(self, axis: str) -> bool:
        """Whether the fitted size on this axis exceeds the decision rule's minimum and the logs
        show its shape: saturation is reached, and lower volts tell the gain; the motion spans
        enough of a period; Stribeck friction falls with speed; Coulomb friction stops the motor
        sooner than it stops alone."""
        nominal, setting = self.state.nominal, self.state.fit.setting
        if self.name == "saturation":
            evidence, limit_V = self.state.evidence, setting[f"saturation.limit_V.{axis}"]
            if share_of_lower_volts(evidence, axis, limit_V) < MIN_SHARE_BELOW_LIMIT:
                return False
            return limit_V < MAX_SATURATION_RATIO * largest_volts(evidence, axis)
        if self.name in PERIODIC:
            periods = setting[f"{self.name}.periods_per_turn.{axis}"]
            if periods * reach(self.state.evidence, axis) < MIN_PHASE_RAD[self.name]:
                return False
        if self.name == "stribeck_friction":
            speed = setting[f"stribeck_friction.speed_rad_s.{axis}"]
            if speed > MAX_STRIBECK_SPEED_SHARE * fastest(self.state.evidence, axis):
                return False
        if self.name == "coulomb_friction":
            settling, motor = (
                setting.get(name, nominal.parameters[name].nominal)
                for name in (f"{self.name}.{SETTLING_KEY}.{axis}", f".time_constant_s.{axis}")
            )
            if settling > MAX_SETTLING_SHARE * motor:
                return False
        return nominal.exceeds_minimum(self.name, axis, setting)


def rank(
    state: State,
    screened: list[Screened],
    *,
    most: int = EFFECTS_REFITTED,
    in_place_on: Collection[str] = (),
    rivalled: float = -np.inf,
) -> list[CandidateFit]:
    """Refit the `most` effects that the screen ranks first, each released on the axes that need it;
    best score first.

    Lower-ranked effects are refitted, too, while no better-ranked one has kept its screened gain.
    `in_place_on`: the axes of a name in whose place they are tried, on all of them; `rivalled`: its
    score: a fit that has no chance of one as high is given up (`calibration.gap.model.fit`).
    """
    by_name: dict[str, list[Screened]] = {}
    for one in screened:
        by_name.setdefault(one.name, []).append(one)
    gain = {name: sum(max(o.gain, 0.0) for o in found) for name, found in by_name.items()}
    order = sorted(gain, key=lambda name: -gain[name])
    known = state.nominal.catalogue
    side = {name: (known[name].side, known[name].servos) for name in order}
    best_on_side = {side[name]: gain[name] for name in reversed(order)}

    def released(name: str) -> CandidateFit:
        return _release(state, name, _axes(by_name[name], screened, in_place_on), rivalled)

    order = [name for name in order if gain[name] >= MIN_REFIT_GAIN]
    worth = [gain[name] >= MIN_SHARE_OF_BEST * best_on_side[side[name]] for name in order]
    first = [name for name, tried in zip(order[:most], worth, strict=False) if tried]
    fits = state.evidence.each(released, first)
    for name, tried in zip(order[most:], worth[most:], strict=True):
        if max((candidate.score for candidate in fits), default=0.0) >= gain[name]:
            break
        if tried and gain[name] >= MIN_LATE_REFIT_GAIN:
            fits.append(released(name))
    return sorted(fits, key=lambda candidate: -candidate.score)


def release_one(state: State, one: Screened) -> State:
    """The state with one screened effect released on its axis and all parameters of its outputs
    refitted."""
    return _release(state, one.name, [one]).state


def _axes(
    found: list[Screened], screened: list[Screened], in_place_on: Collection[str]
) -> list[Screened]:
    """The axes on which to release an effect: that of its largest gain, and those on which it gains
    enough and no other far more. `found`, `screened`: of the effect and of all, best first;
    `in_place_on`: as of `rank`; there another may gain more alone."""
    best = {one.axis: one.gain for one in reversed(screened)}
    return [
        one
        for one in found
        if one is found[0]
        or (
            one.gain > MIN_AXIS_GAIN
            and (one.axis in in_place_on or one.gain > MIN_SHARE_OF_BEST_ON_AXIS * best[one.axis])
        )
    ]


def _release(
    state: State, name: str, chosen: list[Screened], rivalled: float = -np.inf
) -> CandidateFit:
    """The effect released on the axes of `chosen` and refitted; without the axes on which it turns
    out not to be identified, where another axis is left. `rivalled`: as of `rank`."""
    axes = tuple(one.axis for one in chosen)
    keys = tuple((name, axis) for axis in axes)
    felt = moved_by(state.nominal, keys)
    outputs = tuple(output for output in felt if output in state.evidence.outputs)
    starts = [
        {k: v for one in chosen for k, v in getattr(one, which).items()}
        for which in ("start", "tried")
    ]
    anew = {f"servo_{one.axis}" for one in chosen if resets_servo(one.start)}
    evidence = at_start_noise(state, anew)
    moved = min(
        (evaluate(evidence, state.nominal, _inside(state, start), outputs) for start in starts),
        key=lambda found: found.cost,
    )
    begun = replace(
        state,
        evidence=evidence,
        named=(*state.named, *keys),
        fit=replace(
            state.fit,
            setting=moved.setting,
            rolls=state.fit.rolls | moved.rolls,
            costs=state.fit.costs | moved.costs,
        ),
    )
    needed = np.inf if anew else state.fit.cost - rivalled
    done = refit(begun, begun.bounds(outputs), needed=needed)
    gain = sum(state.fit.costs[o] - done.fit.costs[o] for o in state.fit.costs if o not in anew)
    if anew:
        done = settle(done, anew)
        gain += fall_of_cost(state, done, anew)
    candidate = CandidateFit(name, axes, done, gain)
    real = [one for one in chosen if candidate.is_identified(one.axis)]
    return _release(state, name, real, rivalled) if 0 < len(real) < len(chosen) else candidate


def _inside(state: State, start: Start) -> dict[str, float]:
    """The state's setting with a start in it, every parameter clipped to its range."""
    parameters = state.nominal.parameters
    clipped = {
        k: min(max(v, parameters[k].range[0]), parameters[k].range[1]) for k, v in start.items()
    }
    return state.fit.setting | clipped
