"""The decision before the proof, which `calibration.gap.veto` upholds or changes: names, an unknown
effect, names beside one, nothing missing, or two names that no log separates.

1. Names from stepwise selection (`stepwise`). Where the servos cost less with the same names and
   the other model of the load's friction (`load_friction`), names from that one, too; those are
   kept that cost less in the end, at the same noise.
2. Names whose score chance alone reaches on such a log are dropped (`bootstrap`).
3. The residuals of the final model are fitted by unnamed terms (`calibration.gap.unnamed.basis`).
4. Where an unnamed term is significant, a name stays only if it still scores beside that term:
   otherwise it stood in for it.
"""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from calibration.gap.decision_rule import (
    MIN_COMPLETENESS,
    NAME_THRESHOLD,
    PENALTY_PER_PARAMETER,
    RIVAL_MARGIN,
    UNNAMED_SHARE,
    UNNAMED_THRESHOLD,
)
from calibration.gap.model.noise import least_noise
from calibration.gap.model.parameters import released
from calibration.gap.model.state import State, with_levels
from calibration.gap.name.bootstrap import ChanceScores, chance_scores
from calibration.gap.name.load_friction import better_friction_model
from calibration.gap.name.stepwise import (
    Accepted,
    Naming,
    drop_effects,
    name_effects,
    settled_baseline,
)
from calibration.gap.unnamed.basis import UnnamedTerm, unnamed_terms


@dataclass(frozen=True, eq=False)
class Decision:
    """The verdict (one of `findings.VERDICTS`), the naming behind it, the accepted effects, the
    significant unnamed term (None: there is none), the final state, and the chance thresholds
    (None: there was no name to judge)."""

    verdict: str
    naming: Naming
    accepted: tuple[Accepted, ...]
    unnamed: UnnamedTerm | None
    state: State
    chance: ChanceScores | None = None


def decide(before: State, barred: Collection[str] = ()) -> Decision:
    """The decision on a settled baseline, by the module's four steps; `barred`: effects that are
    not tried."""
    naming = _named(before, barred)
    chance, accepted, state = _beyond_chance(naming)
    left = significant(unnamed_terms(state))
    if left is None:
        return Decision(
            _verdict(accepted, "nothing-missing"), naming, accepted, None, state, chance
        )
    accepted, state = _names_beside(left, accepted, state)
    if not accepted:
        alone = significant(unnamed_terms(before)) or left
        return Decision("unknown-effect", naming, (), alone, alone.state, chance)
    return Decision(_verdict(accepted, ""), naming, accepted, left, left.state, chance)


def _named(before: State, barred: Collection[str]) -> Naming:
    """The naming from the baseline, or from that of the other model of the load's friction."""
    naming = name_effects(before, barred)
    other = better_friction_model(naming.after)
    if other is None:
        return naming
    again = name_effects(settled_baseline(before.evidence, other), barred)
    levels = least_noise(naming.after.evidence.levels, again.after.evidence.levels)
    return min((naming, again), key=lambda one: _price(one, levels))


def _price(naming: Naming, levels: np.record) -> float:
    """The cost of the names at these noise levels, and what their parameters are paid for."""
    state = with_levels(naming.after, levels, naming.after.evidence.outputs)
    nominal, setting = state.nominal, state.fit.setting
    free = [released(nominal.catalogue[n], a, nominal, setting) for n, a in state.named]
    return state.fit.cost + PENALTY_PER_PARAMETER * sum(map(len, free))


def _verdict(accepted: tuple[Accepted, ...], none: str) -> str:
    """The verdict on these effects; `none` where there are none."""
    if any(one.margin < RIVAL_MARGIN for one in accepted):
        return "undecided"
    return "named" if accepted else none


def _beyond_chance(naming: Naming) -> tuple[ChanceScores | None, tuple[Accepted, ...], State]:
    """The chance thresholds, the effects that exceed them, and the state with those alone."""
    state = naming.after
    if not naming.accepted:
        return None, (), state
    chance = chance_scores(state, state.evidence.outputs)
    kept = tuple(
        one for one in naming.accepted if one.score >= _chance_threshold(one, chance, state)
    )
    lost = [(one.name, axis) for one in naming.accepted if one not in kept for axis in one.axes]
    return chance, kept, drop_effects(state, lost) if lost else state


def _chance_threshold(one: Accepted, chance: ChanceScores, state: State) -> float:
    """The score that chance reaches on the outputs of this effect."""
    parameters = (parameter for axis in one.axes for parameter in state.nominal.of(one.name, axis))
    return chance.of({output for parameter in parameters for output in parameter.outputs})


def significant(found: list[UnnamedTerm]) -> UnnamedTerm | None:
    """The best of the unnamed terms, if it is significant."""
    return found[0] if found and found[0].score >= UNNAMED_THRESHOLD else None


def _names_beside(
    left: UnnamedTerm, accepted: tuple[Accepted, ...], state: State
) -> tuple[tuple[Accepted, ...], State]:
    """The effects that still score beside the unnamed term, and the state with those alone.

    An effect's score beside the term is S + S_term - S_term without the effect: what both explain
    together less what the term explains alone. An effect stays as well if it scores
    MIN_COMPLETENESS of what the term scores in its place: the term is the effect and a remainder.
    """
    kept: list[Accepted] = []
    for one in accepted:
        keys = [(one.name, axis) for axis in one.axes]
        bare = drop_effects(state, keys)
        rival = significant(unnamed_terms(bare))
        in_its_place = rival.score if rival is not None else 0.0
        need = max(NAME_THRESHOLD, UNNAMED_SHARE * left.score)
        is_it = one.score >= MIN_COMPLETENESS * in_its_place
        if is_it or one.score + left.score - in_its_place >= need:
            kept.append(one)
        else:
            state = bare
    return tuple(kept), state
