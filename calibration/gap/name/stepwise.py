"""Name what is missing: add the effect that helps most while one is significant, then defend it.

Refine before adding: an effect is tried with its inner shape (period, Stribeck speed), and the
noise is settled anew before another may enter.
Each name is then taken out again and its rivals tried in its place, at the noise of the final
model: names that no longer pay leave, better ones take over, close ones are told as "A or B".
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from math import exp

from calibration.gap.evidence import Evidence
from calibration.gap.fit import evaluate
from calibration.gap.knobs import Believed
from calibration.gap.screen import Screened, Screens, screen
from calibration.gap.search import Trial, rank
from calibration.gap.state import Key, State, baseline, parts_of, refit, settle
from calibration.gap.unknown import shapes
from rig.effects import BY_NAME

THRESHOLD = 5.0  # of a score (log-likelihood beyond its knobs' own) for an effect to be missing
KIN, FRICTIONS = 15.0, ("coulomb_friction", "stribeck_friction", "dead_zone")
MARGIN = 5.0  # between two names below which neither is told alone
SMALL = 0.05  # of all that is explained: a further effect below must not stand in for another
TINY = 0.01  # of what is explained on the same channel: the model is no better than that
MOST = 7
RIVALS = 3
TEMPERATURE = 2.0


@dataclass(frozen=True, eq=False)
class Rival:
    """Another name in the place of an accepted one: how much worse it does (its margin)."""

    name: str
    margin: float
    state: State


@dataclass(frozen=True, eq=False)
class Accepted:
    """A name, the axes on which it is released, its score, and its rivals, best first."""

    name: str
    axes: tuple[str, ...]
    score: float
    rivals: tuple[Rival, ...]

    @property
    def probability(self) -> float:
        odds = [exp(-min(max(r.margin, -200.0), 200.0) / TEMPERATURE) for r in self.rivals]
        nothing = exp(-max(self.score, 0.0) / TEMPERATURE)
        return 1.0 / (1.0 + sum(odds) + nothing)

    @property
    def margin(self) -> float:
        return min((r.margin for r in self.rivals), default=float("inf"))


@dataclass(frozen=True, eq=False)
class Naming:
    """The baseline, the final state, what was accepted in its order, and the last ranking,
    the path of additions, and the last screen."""

    before: State
    after: State
    accepted: tuple[Accepted, ...]
    last: tuple[Trial, ...]
    path: tuple[tuple[str, State], ...]
    screened: list[Screened]


def settled_baseline(evidence: Evidence, believed: Believed) -> State:
    """The baseline at the noise that the log itself shows."""
    state = baseline(evidence, believed, iterations=3)
    return settle(state, state.evidence.parts)


def name_effects(state: State) -> Naming:
    """Add, refine, defend; `state` is the settled baseline."""
    before, path = state, [("", state)]
    last: list[Trial] = []
    screened: list[Screened] = []
    screens: Screens = {}
    total, explained = 0.0, {}
    while len({effect for effect, _ in state.named}) < MOST:
        screened = screen(state, state.evidence.parts, known=screens)
        last = rank(state, screened)
        worth = [trial for trial in last if trial.score >= _needed(state, trial, explained)]
        if not worth or (worth[0].score < SMALL * total and _stands_in(state, worth[0])):
            break
        best = worth[0]
        parts = parts_of(BY_NAME[best.name], best.axes)
        total += best.score
        explained |= {part: explained.get(part, 0.0) + best.score for part in parts}
        state = settle(best.state, parts)
        path.append((best.name, state))
    accepted: list[Accepted] = []
    for name in dict.fromkeys(effect for effect, _ in state.named):
        state, found = _defend(state, name)
        if found:
            accepted.append(found)
    return Naming(before, state, tuple(accepted), tuple(last), tuple(path), screened)


def _needed(state: State, trial: Trial, explained: Mapping[str, float]) -> float:
    """The score from which on an effect may enter: not where a model that is only nearly right
    would ask for it; and beside another dry friction on the same axis (the assumed one of arm and
    joints, too) one more has to be sure of itself."""
    kin = {axis for name, axis in state.named if name in FRICTIONS}
    beside = state.believed.load_friction or kin & set(trial.axes)
    sure = KIN if trial.name in FRICTIONS and beside else THRESHOLD
    there = [explained.get(p, 0.0) for p in parts_of(BY_NAME[trial.name], trial.axes)]
    return max(sure, TINY * max(there))


def _stands_in(state: State, best: Trial) -> bool:
    """Would a term without a name explain far more of what is left than this small addition?"""
    parts = {part for name, axis in best.keys for part in parts_of(BY_NAME[name], (axis,))}
    rivals = [shape.score for shape in shapes(state) if shape.part in parts]
    return max(rivals, default=0.0) > 2.0 * best.score


def without(state: State, keys: Iterable[Key]) -> State:
    """The state with some effects back inside their boxes, refitted."""
    keys = set(keys)
    parts = {p for name, axis in keys for p in parts_of(BY_NAME[name], (axis,))}
    knobs = state.believed.knobs
    setting = {
        name: value
        for name, value in state.fit.setting.items()
        if (knobs[name].effect, knobs[name].axis) not in keys
    }
    moved = evaluate(state.evidence, state.believed, setting, parts)
    fit = replace(state.fit, setting=setting, rolls=state.fit.rolls | moved.rolls,
                  costs=state.fit.costs | moved.costs)  # fmt: skip
    bare = replace(state, fit=fit, named=tuple(k for k in state.named if k not in keys))
    return refit(bare, bare.bounds(parts))


def _twins(own: Trial, other: Trial) -> bool:
    """A turned camera and an antisymmetric cross coupling are the same data, and no rivals."""
    if (own.name, other.name) != ("camera_yaw", "cross_coupling") or len(other.axes) < 2:
        return False
    x, y = (other.state.fit.setting[f"cross_coupling.fraction.{axis}"] for axis in "xy")
    return x * y < 0.0


def _defend(state: State, name: str) -> tuple[State, Accepted | None]:
    """Try the name's place with its rivals: it stays, leaves, or hands over."""
    keys = [key for key in state.named if key[0] == name]
    bare = without(state, keys)
    parts = [p for p in parts_of(BY_NAME[name], [a for _, a in keys]) if p in bare.fit.rolls]
    trials = rank(bare, screen(bare, parts, without=keys), most=RIVALS)
    own = Trial(name, tuple(axis for _, axis in keys), state, bare.fit.cost - state.fit.cost)
    if trials and trials[0].score > own.score and trials[0].score >= THRESHOLD:
        winner = trials[0]
        state = settle(winner.state, parts_of(BY_NAME[winner.name], winner.axes))
        trials = [own, *trials[1:]]
        own = winner
    if own.score < THRESHOLD:
        return bare, None
    rivals = [Rival(t.name, own.score - t.score, t.state) for t in trials if not _twins(own, t)]
    rivals.sort(key=lambda rival: rival.margin)
    return state, Accepted(own.name, own.axes, own.score, tuple(rivals))
