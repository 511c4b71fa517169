"""The verdict: names, something unnamed, both, neither, or two names between which no log decides.

What is left after the names is looked at without names (see `unknown`). Where something is left,
the unnamed term goes into the model first and every name has to earn its place beside it: a name
that only stood in for the unnamed term goes.
"""

from dataclasses import dataclass

from calibration.gap.chance import Chance, by_chance
from calibration.gap.name import MARGIN, THRESHOLD, Accepted, Naming, name_effects, without
from calibration.gap.state import State
from calibration.gap.unknown import Shape, shapes

UNKNOWN_THRESHOLD = 8.0
SHARE = 1.0  # of the unnamed term's score that a name beside it has to reach


@dataclass(frozen=True, eq=False)
class Decision:
    """verdict as in `findings.VERDICTS`; the names that stand, the unnamed term, the last state,
    and what chance alone scores on such a log (where there was a name to judge by it)."""

    verdict: str
    naming: Naming
    accepted: tuple[Accepted, ...]
    shape: Shape | None
    state: State
    chance: Chance | None = None


def decide(before: State) -> Decision:
    """Name, look at what is left, and weigh the two against each other."""
    naming = name_effects(before)
    chance, accepted, state = _beyond_chance(naming)
    left = _first(shapes(state))
    if left is None:
        return Decision(_of(accepted, "nothing-missing"), naming, accepted, None, state, chance)
    accepted, state = _beside(left, accepted, state)
    if not accepted:
        alone = _first(shapes(before)) or left
        return Decision("unknown-effect", naming, (), alone, alone.state, chance)
    return Decision(_of(accepted, ""), naming, accepted, left, left.state, chance)


def _of(accepted: tuple[Accepted, ...], none: str) -> str:
    """The verdict on these names; `none` where there are none."""
    if any(one.margin < MARGIN for one in accepted):
        return "undecided"
    return "named" if accepted else none


def _beyond_chance(naming: Naming) -> tuple[Chance | None, tuple[Accepted, ...], State]:
    """The names whose scores chance alone does not reach on a log like this."""
    state = naming.after
    if not naming.accepted:
        return None, (), state
    chance = by_chance(state, state.evidence.parts)
    kept = tuple(one for one in naming.accepted if one.score >= _needed(one, chance, state))
    lost = [(one.name, axis) for one in naming.accepted if one not in kept for axis in one.axes]
    return chance, kept, without(state, lost) if lost else state


def _needed(one: Accepted, chance: Chance, state: State) -> float:
    """What this name has to score: more than chance where it is felt."""
    knobs = (knob for axis in one.axes for knob in state.believed.of(one.name, axis))
    return chance.of({part for knob in knobs for part in knob.parts})


def _first(found: list[Shape]) -> Shape | None:
    return found[0] if found and found[0].score >= UNKNOWN_THRESHOLD else None


def _beside(left: Shape, accepted: tuple[Accepted, ...],
            state: State) -> tuple[tuple[Accepted, ...], State]:  # fmt: skip
    """The names that still pay beside an unnamed term that may take their place."""
    kept: list[Accepted] = []
    for one in accepted:
        keys = [(one.name, axis) for axis in one.axes]
        bare = without(state, keys)
        rival = _first(shapes(bare))
        need = max(THRESHOLD, SHARE * left.score)
        gain = one.score + left.score - (rival.score if rival is not None else 0.0)
        if gain >= need:
            kept.append(one)
        else:
            state = bare
    return tuple(kept), state
