"""Stepwise naming: forward selection of effects, then backward elimination.

Forward: the effect with the largest score S (`calibration.gap.decision_rule`) is added while S
reaches its threshold. An effect is fitted with its inner shape (period, Stribeck speed) at once,
and the noise levels are estimated anew before another may enter.

Where the servos then cost less with the other model of the load's friction
(`calibration.gap.name.load_friction`), or the ball shows a joint's play that loaded motors deny,
effects are selected beside that one, too, and those are kept that cost less at the same noise. The
same goes for what is selected from the law of a drive (`calibration.gap.name.drive_law`) where a
servo got two names.

Backward: each accepted effect is removed and its RIVALS_REFITTED strongest alternatives are
refitted at the final noise levels. It is dropped if its score falls below NAME_THRESHOLD, replaced
if an alternative scores more, and reported as "A or B" if the difference is below RIVAL_MARGIN.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from math import exp

import numpy as np

from calibration.gap.decision_rule import (
    DOUBTED_PROBABILITY,
    DRY_FRICTIONS,
    MAX_EFFECTS,
    MIN_SHARE_OF_TOTAL,
    MIN_SHARE_ON_OUTPUT,
    NAME_THRESHOLD,
    PROBABILITY_TEMPERATURE,
    RELATED_FRICTION_THRESHOLD,
    RIVALS_REFITTED,
)
from calibration.gap.model.data import Evidence
from calibration.gap.model.parameters import NominalModel
from calibration.gap.model.state import (
    Key,
    State,
    baseline,
    cheaper,
    drop_effects,
    fall_of_cost,
    moved_by,
    outputs_of,
    settle,
    with_levels,
)
from calibration.gap.name.drive_law import begun_with_law
from calibration.gap.name.load_friction import better_friction_model, unloaded_model
from calibration.gap.name.naming_steps import NamingStep, Tell, untold
from calibration.gap.name.refit import CandidateFit, rank
from calibration.gap.name.screen import Screened, Screens, screen
from calibration.gap.unnamed.basis import unnamed_terms

Additions = tuple[tuple[str, State], ...]  # additions: the name, and the state with it


@dataclass(frozen=True, eq=False)
class Rival:
    """An alternative to an accepted effect, with its state; `margin`: the accepted effect's score
    minus the rival's; `nameable`: whether the logs could show it (`CandidateFit.score`)."""

    name: str
    margin: float
    state: State
    nameable: bool = True


@dataclass(frozen=True, eq=False)
class Accepted:
    """An accepted effect, the axes on which it is released, its score, and its rivals, best first.
    `explained`: the completeness of the names of its outputs (0 to 1;
    `calibration.gap.specification`)."""

    name: str
    axes: tuple[str, ...]
    score: float
    rivals: tuple[Rival, ...]
    explained: float = 1.0

    @property
    def probability(self) -> float:
        """Probability of the name against its rivals and against chance, with T =
        PROBABILITY_TEMPERATURE.

            1/(1 + sum_rivals exp(-margin/T) + exp(-score/T)), at most `explained`

        It is calibrated on simulated tables alone; on real ones it is only a score.
        """
        odds = [
            exp(-min(max(r.margin, -200.0), 200.0) / PROBABILITY_TEMPERATURE) for r in self.rivals
        ]
        nothing = exp(-max(self.score, 0.0) / PROBABILITY_TEMPERATURE)
        return min(self.explained, 1.0 / (1.0 + sum(odds) + nothing))

    def told_axes(self, state: State) -> tuple[str, ...]:
        """The axes on which its size exceeds the decision rule's minimum; all if none does."""
        setting = state.fit.setting
        told = (a for a in self.axes if state.nominal.exceeds_minimum(self.name, a, setting))
        return tuple(told) or self.axes

    def doubted(self) -> "Accepted":
        """The same name, at most DOUBTED_PROBABILITY likely."""
        return replace(self, explained=min(self.explained, DOUBTED_PROBABILITY))

    @property
    def margin(self) -> float:
        """The margin to the best rival; infinite without one."""
        return min((r.margin for r in self.rivals), default=float("inf"))


@dataclass(frozen=True, eq=False)
class Naming:
    """The result of stepwise naming: the baseline, the final state, the accepted effects in the
    order in which they were added, the last ranking, the path of additions (name, state), which
    begins with ("", baseline), and the last screen."""

    before: State
    after: State
    accepted: tuple[Accepted, ...]
    last: tuple[CandidateFit, ...]
    path: Additions
    screened: list[Screened]


def settled_baseline(evidence: Evidence, nominal: NominalModel) -> State:
    """The baseline fit of `nominal` with the noise levels estimated on the logs."""
    state = baseline(evidence, nominal, iterations=3)
    return settle(state, state.evidence.outputs)


def name_effects(state: State, barred: Collection[str] = (), tell: Tell = untold) -> Naming:
    """Stepwise naming from the settled baseline `state`: forward selection, then backward
    elimination; the effects `barred` are not tried."""
    skip = [(name, axis) for name in barred for axis in state.nominal.catalogue[name].axes]
    chosen = _selected(state, skip, tell)
    other = None
    if not chosen.has_law:
        found, screened = chosen.state, chosen.screened
        other = better_friction_model(found) or unloaded_model(found, screened)
    if other is not None:
        begun = settled_baseline(state.evidence, other)
        again = _selected(begun, skip, tell)
        chosen = chosen if cheaper(chosen.state, again.state) is chosen.state else again
    after, accepted = _eliminated(chosen.state, skip, tell)
    return Naming(chosen.path[0][1], after, accepted, chosen.last, chosen.path, chosen.screened)


@dataclass(frozen=True, eq=False)
class _Selection:
    """Forward selection: the path of additions (name, state), beginning with ("", baseline), the
    last ranking, the last screen, and whether it began again with the law of a drive."""

    path: Additions
    last: tuple[CandidateFit, ...]
    screened: list[Screened]
    has_law: bool

    @property
    def state(self) -> State:
        """The state with all that was added."""
        return self.path[-1][1]


def _selected(state: State, skip: Sequence[Key], tell: Tell = untold) -> _Selection:
    """Forward selection from the settled baseline `state`; `skip` is not tried."""
    path: Additions = (("", state),)
    last: list[CandidateFit] = []
    screened: list[Screened] = []
    screens: Screens = {}
    total, explained, tried, has_law = 0.0, {}, False, False
    while len({effect for effect, _ in state.named}) < MAX_EFFECTS:
        tell(NamingStep.SEARCH, f"looking for an effect{_beside(state)}")
        screened = screen(state, state.evidence.outputs, skip=skip, known=screens)
        last = rank(state, screened)
        worth = [
            candidate
            for candidate in last
            if candidate.score >= entry_threshold(state, candidate, explained)
        ]
        if not worth or (
            worth[0].score < MIN_SHARE_OF_TOTAL * total and _stands_in_for_unnamed(state, worth[0])
        ):
            break
        best = worth[0]
        outputs = moved_by(state.nominal, best.keys)
        total += best.score
        for o in set(outputs) & set(state.fit.costs):
            fall = fall_of_cost(state, best.state, (o,))
            explained[o] = explained.get(o, 0.0) + max(fall, 0.0)
        state = settle(best.state, outputs)
        path = (*path, (best.name, state))
        if not tried and (starts := begun_with_law(state, skip)):
            tried, chosen = True, reduce(cheaper, starts, state)
            if chosen is not state:
                has_law, state, path = True, chosen, _path_to(chosen, path[0][1])
                explained = _explained(path[0][1], state)
                total = sum(explained.values())
    return _Selection(path, tuple(last), screened, has_law)


def _beside(state: State) -> str:
    """ " beside a, b" of the effects of a state; "" without any."""
    found = ", ".join(dict.fromkeys(effect for effect, _ in state.named))
    return f" beside {found}" if found else ""


def _path_to(state: State, before: State) -> Additions:
    """The path from the baseline to a state: its names, in their order, one after the other."""
    if before.nominal is not state.nominal:
        before = settled_baseline(before.evidence, state.nominal)
    path: Additions = ()
    for name in reversed(dict.fromkeys(effect for effect, _ in state.named)):
        path = ((name, state), *path)
        state = drop_effects(state, [key for key in state.named if key[0] == name])
    return (("", before), *path)


def _explained(before: State, state: State) -> dict[str, float]:
    """By how much the cost of each output fell from the baseline to a state, at the state's noise,
    at which what comes next gains, too."""
    costs = with_levels(before, state.evidence.levels, before.evidence.outputs).fit.costs
    falls = {o: costs[o] - cost for o, cost in state.fit.costs.items()}
    return {o: fall if 0.0 < fall < np.inf else 0.0 for o, fall in falls.items()}


def _eliminated(
    state: State, skip: Sequence[Key], tell: Tell = untold
) -> tuple[State, tuple[Accepted, ...]]:
    """Backward elimination of each name in turn. One that takes another's place on an axis and
    stands on a second one already is judged once, on both."""
    accepted: dict[str, Accepted] = {}
    for name in dict.fromkeys(effect for effect, _ in state.named):
        if name not in {effect for effect, _ in state.named}:
            continue  # it went with one that took it for another's place
        tell(NamingStep.RIVALS, f"what else could {name} be?")
        state, found = backward_step(state, name, skip)
        if found and {axis for effect, axis in state.named if effect == found.name} != set(
            found.axes
        ):
            state, found = backward_step(state, found.name, skip)
        if found:
            accepted[found.name] = found
    return state, tuple(accepted.values())


def entry_threshold(state: State, candidate: CandidateFit, explained: Mapping[str, float]) -> float:
    """The score that a candidate needs to enter; `explained`: output -> gain that is named there
    so far.

    NAME_THRESHOLD; RELATED_FRICTION_THRESHOLD for a dry friction beside another one on the same
    axis, the assumed one of arm and joints included; and at least MIN_SHARE_ON_OUTPUT of the gain
    that is already named on its outputs, since the model is not exact.
    """
    related = {axis for name, axis in state.named if name in DRY_FRICTIONS}
    beside = state.nominal.friction_slack_V or related & set(candidate.axes)
    enough = (
        RELATED_FRICTION_THRESHOLD if candidate.name in DRY_FRICTIONS and beside else NAME_THRESHOLD
    )
    outputs = outputs_of(state.nominal.catalogue[candidate.name], candidate.axes)
    named = [explained.get(p, 0.0) for p in outputs]
    return max(enough, MIN_SHARE_ON_OUTPUT * max(named))


def _stands_in_for_unnamed(state: State, best: CandidateFit) -> bool:
    """True if an unnamed term on the same outputs scores more than twice this small addition."""
    known = state.nominal.catalogue
    outputs = {output for name, axis in best.keys for output in outputs_of(known[name], (axis,))}
    rivals = [term.score for term in unnamed_terms(state) if term.output in outputs]
    return max(rivals, default=0.0) > 2.0 * best.score


def _same_data(own: CandidateFit, other: CandidateFit) -> bool:
    """True for camera yaw and an antisymmetric cross coupling: the same data, so no rivals."""
    if (own.name, other.name) != ("camera_yaw", "cross_coupling") or len(other.axes) < 2:
        return False
    x, y = (other.state.fit.setting[f"cross_coupling.fraction.{axis}"] for axis in "xy")
    return x * y < 0.0


def backward_step(
    state: State, name: str, skip: Sequence[Key] = ()
) -> tuple[State, Accepted | None]:
    """Remove an effect and refit its alternatives, but those of `skip`: it stays, is replaced by an
    alternative that scores more, or is dropped.

    Returns the state that follows, and the effect that stands in its place (None: dropped).
    """
    keys = [key for key in state.named if key[0] == name]
    bare = drop_effects(state, keys, needed=state.fit.cost + NAME_THRESHOLD)
    known, axes = state.nominal.catalogue, [a for _, a in keys]
    outputs = [p for p in outputs_of(known[name], axes) if p in bare.fit.rolls]
    screened = screen(bare, outputs, skip=[*keys, *skip])
    own = CandidateFit(name, tuple(axis for _, axis in keys), state, bare.fit.cost - state.fit.cost)
    fits = rank(bare, screened, most=RIVALS_REFITTED, in_place_on=axes, rivalled=own.score)
    if fits and fits[0].score > own.score and fits[0].score >= NAME_THRESHOLD:
        winner = fits[0]
        state = settle(winner.state, moved_by(state.nominal, winner.keys))
        fits = [own, *fits[1:]]
        own = replace(winner, state=state)  # settled, it may no longer be of a size that counts
    if own.score < NAME_THRESHOLD:
        return bare, None
    others = [one for one in fits if not _same_data(own, one)]
    rivals = [
        Rival(t.name, own.score - t.rival_score, t.state, np.isfinite(t.score)) for t in others
    ]
    rivals.sort(key=lambda rival: rival.margin)
    return state, Accepted(own.name, own.axes, own.score, tuple(rivals))
