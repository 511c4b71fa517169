"""Which effect helps most: a screen over all, exact refits of those that it puts first.

Releasing an effect's knobs from their box gains log-likelihood; an effect is missing when that
gain is beyond what chance and small faults of the model give.
"""

from dataclasses import dataclass, replace

from calibration.gap.fit import evaluate
from calibration.gap.knobs import PERIODIC
from calibration.gap.menu import (
    LEAST_PHASE_RAD,
    Start,
    afresh,
    fastest,
    largest_volts,
    reach,
    released,
    swallows,
)
from calibration.gap.screen import Screened, at_first_noise, beyond_knobs
from calibration.gap.state import Key, State, refit, settle
from rig.effects import BY_NAME

WORTH_AN_AXIS = 6.0  # gain on an axis below which the effect is not released there
OUTDONE = 0.8  # of what the best effect promises on an axis, below which it is left to that one
WORTH_ANOTHER = 12.0  # promise of one behind that is still tried while none before keeps its own
FALLS = 0.4  # of the fastest motion: a Stribeck speed beyond is Coulomb friction
LEAST_PROMISE, FAR_BEHIND = 4.0, 0.1  # a screened gain below is not worth a fit
CUTS = 1.03  # of the volts that a log reached: a limit above has hardly cut anything
REFITS = 5  # so many of the screened effects are fitted exactly


@dataclass(frozen=True, eq=False)
class Trial:
    """An effect released on some axes and refitted: its gain beyond what its knobs cost."""

    name: str
    axes: tuple[str, ...]
    state: State
    gain: float

    @property
    def keys(self) -> tuple[Key, ...]:
        return tuple((self.name, axis) for axis in self.axes)

    @property
    def score(self) -> float:
        if not any(self.is_one(axis) for axis in self.axes):
            return -float("inf")
        knobs = sum(
            len(released(BY_NAME[self.name], axis, self.state.believed, self.state.fit.setting))
            for axis in self.axes
        )
        return beyond_knobs(self.gain, knobs)

    def is_one(self, axis: str) -> bool:
        """Is it on this axis what its name says, and larger than nothing?"""
        believed, setting = self.state.believed, self.state.fit.setting
        if self.name == "saturation":
            reached = largest_volts(self.state.evidence, axis)
            return setting[f"saturation.limit_V.{axis}"] < CUTS * reached
        if self.name in PERIODIC:  # a fraction of a period is a curve, and no ripple
            turns = setting[f"{self.name}.periods_per_turn.{axis}"]
            if turns * reach(self.state.evidence, axis) < LEAST_PHASE_RAD[self.name]:
                return False
        if self.name == "stribeck_friction":  # one that does not fall with speed is Coulomb's
            falls = setting[f"stribeck_friction.speed_rad_s.{axis}"]
            if falls > FALLS * fastest(self.state.evidence, axis):
                return False
        return believed.beyond(self.name, axis, setting)


def rank(state: State, screened: list[Screened], *, most: int = REFITS) -> list[Trial]:
    """The effects that the screen puts first, each released on the axes that need it; refitted."""
    by_name: dict[str, list[Screened]] = {}
    for one in screened:
        by_name.setdefault(one.name, []).append(one)
    promise = {name: sum(max(o.gain, 0.0) for o in found) for name, found in by_name.items()}
    order = sorted(promise, key=lambda name: -promise[name])
    most_on = {BY_NAME[name].side: promise[name] for name in reversed(order)}
    trials: list[Trial] = []
    for i, name in enumerate(order):
        best = max((trial.score for trial in trials), default=0.0)
        if promise[name] < LEAST_PROMISE or (i >= most and best >= promise[name]):
            break
        if promise[name] < FAR_BEHIND * most_on[BY_NAME[name].side]:
            continue
        if i < most or promise[name] >= WORTH_ANOTHER:
            trials.append(_release(state, name, _axes(by_name[name], screened)))
    return sorted(trials, key=lambda trial: -trial.score)


def rank_one(state: State, one: Screened) -> State:
    """The state with one screened effect released on its axis and fitted."""
    return _release(state, one.name, [one]).state


def _axes(found: list[Screened], screened: list[Screened]) -> list[Screened]:
    """The axes on which an effect is worth its release: another does not promise far more there."""
    best = {one.axis: one.gain for one in reversed(screened)}  # best first
    worth = [one for one in found if one.gain > max(WORTH_AN_AXIS, OUTDONE * best[one.axis])]
    return worth or found[:1]


def _release(state: State, name: str, chosen: list[Screened]) -> Trial:
    axes = tuple(one.axis for one in chosen)
    keys = tuple((name, axis) for axis in axes)
    felt = {part for axis in axes for k in state.believed.of(name, axis) for part in k.parts}
    parts = tuple(part for part in state.evidence.parts if part in felt)
    starts = [
        {k: v for one in chosen for k, v in getattr(one, which).items()}
        for which in ("start", "tried")
    ]
    anew = {f"servo_{one.axis}" for one in chosen if afresh(one.start)}
    evidence = at_first_noise(state, anew)
    moved = min(
        (evaluate(evidence, state.believed, _inside(state, start), parts) for start in starts),
        key=lambda found: found.cost,
    )
    begun = replace(
        state,
        evidence=evidence,
        named=(*state.named, *keys),
        fit=replace(state.fit, setting=moved.setting, rolls=state.fit.rolls | moved.rolls,
                    costs=state.fit.costs | moved.costs),
    )  # fmt: skip
    done = refit(begun, begun.bounds(parts))
    if loud := {f"servo_{one.axis}" for one in chosen if swallows(one.start)}:
        done = settle(done, loud)
    trial = Trial(name, axes, done, state.fit.cost - done.fit.cost)
    real = [one for one in chosen if trial.is_one(one.axis)]
    return _release(state, name, real) if 0 < len(real) < len(chosen) else trial


def _inside(state: State, start: Start) -> dict[str, float]:
    """The state's setting with a start in it, every knob in its range."""
    knobs = state.believed.knobs
    clipped = {k: min(max(v, knobs[k].range[0]), knobs[k].range[1]) for k, v in start.items()}
    return state.fit.setting | clipped
