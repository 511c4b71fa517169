"""The decision before the proof, which `calibration.gap.veto` upholds or changes: names, an unknown
effect, names beside one, nothing missing, or two names that no log separates.

1. Names from stepwise selection (`stepwise`).
2. Names whose score chance alone reaches on such a log are dropped (`bootstrap`).
3. The residuals of the final model are fitted by unnamed terms (`calibration.gap.unnamed.basis`).
4. Where an unnamed term is significant, a name stays only if it still scores beside that term:
   otherwise it stood in for it.
"""

from collections.abc import Collection
from dataclasses import dataclass

from calibration.gap.decision_rule import (
    DOUBTED_PROBABILITY,
    MIN_COMPLETENESS,
    NAME_THRESHOLD,
    RIVAL_MARGIN,
    UNNAMED_SHARE,
    UNNAMED_THRESHOLD,
)
from calibration.gap.model.change import Change
from calibration.gap.model.state import State, drop_effects
from calibration.gap.name.bootstrap import ChanceScores, chance_scores
from calibration.gap.name.naming_steps import NamingStep, Tell, untold
from calibration.gap.name.refit import CandidateFit
from calibration.gap.name.stepwise import Accepted, Naming, name_effects
from calibration.gap.unnamed.basis import unnamed_terms
from calibration.gap.unnamed.term import UnnamedTerm

# Families of terms that act throughout and hold no effect with a name, as a map holds a level.
HOLDS_NO_NAMES = ("rhythm", "swaying", "turning", "slipping", "swinging")


@dataclass(frozen=True, eq=False)
class Decision:
    """The verdict (one of `findings.VERDICTS`), the naming behind it, the accepted effects, the
    significant unnamed term (None: there is none), the final state, the chance thresholds (None:
    there was no name to judge), the names that were dropped here, each with the reason in words,
    and, where no name is accepted, the parameter that changes over the logs (None: none does)."""

    verdict: str
    naming: Naming
    accepted: tuple[Accepted, ...]
    unnamed: UnnamedTerm | None
    state: State
    chance: ChanceScores | None = None
    dropped: tuple[str, ...] = ()
    change: Change | None = None


def decide(before: State, barred: Collection[str] = (), tell: Tell = untold) -> Decision:
    """The decision on a settled baseline, by the module's four steps; `barred`: effects that are
    not tried."""
    naming = name_effects(before, barred, tell)
    tell(NamingStep.CHANCE, "what would chance alone give?")
    chance, accepted, state = _beyond_chance(naming)
    dropped = _reasons(naming.accepted, accepted, "chance alone may score as much on such a log")
    tell(NamingStep.UNNAMED, "what is left without a name?")
    left = significant(unnamed_terms(state))
    if left is None:
        verdict = verdict_of(accepted, None, none="nothing-missing")
        return Decision(verdict, naming, accepted, None, state, chance, dropped)
    known = accepted
    accepted, state = _names_beside(left, accepted, state)
    dropped += _reasons(known, accepted, "something without a name explains the same")
    if not accepted:
        alone = significant(unnamed_terms(before)) or left
        return Decision("unknown-effect", naming, (), alone, alone.state, chance, dropped)
    verdict = verdict_of(accepted, left)
    return Decision(verdict, naming, accepted, left, left.state, chance, dropped)


def _reasons(
    before: Collection[Accepted], after: Collection[Accepted], why: str
) -> tuple[str, ...]:
    """The reason in words for each name that is no longer there."""
    kept = {one.name for one in after}
    return tuple(f"not named: {one.name}: {why}" for one in before if one.name not in kept)


def verdict_of(
    accepted: Collection[Accepted], unnamed: UnnamedTerm | None, none: str = "undecided"
) -> str:
    """The verdict on these effects and what is left without a name; `none`: where there is
    neither. Names that are told as "A or B", or of which none is certain, are undecided."""
    if not accepted:
        return "unknown-effect" if unnamed is not None else none
    close = any(one.margin < RIVAL_MARGIN for one in accepted)
    doubted = all(one.explained <= DOUBTED_PROBABILITY for one in accepted)
    return "undecided" if close or doubted else "named"


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
    MIN_COMPLETENESS of what the term scores in its place, which is the effect and a remainder then,
    or all that a term of HOLDS_NO_NAMES does. After each that does not stay the others are asked
    again: names that together stand in for one thing hold each other up.
    """
    for one in accepted:
        bare = drop_effects(state, [(one.name, axis) for axis in one.axes])
        score = CandidateFit(one.name, one.axes, state, bare.fit.cost - state.fit.cost).score
        rival = significant(unnamed_terms(bare))
        in_its_place = rival.score if rival is not None else 0.0
        need = max(NAME_THRESHOLD, UNNAMED_SHARE * left.score)
        other = rival is not None and rival.kind in HOLDS_NO_NAMES
        is_it = score >= (1.0 if other else MIN_COMPLETENESS) * in_its_place
        if not is_it and score + left.score - in_its_place < need:
            rest = tuple(kept for kept in accepted if kept is not one)
            return _names_beside(rival or left, rest, bare)
    return accepted, state
