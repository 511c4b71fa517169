"""Which effect helps most: a screen over all, exact refits of those that it puts first.

Releasing an effect's knobs from their box gains log-likelihood; an effect is missing when that
gain is beyond what chance and small faults of the model give.
"""

from dataclasses import dataclass, replace

from calibration.gap.fit import evaluate
from calibration.gap.knobs import PERIODIC
from calibration.gap.menu import LEAST_PHASE_RAD, Start, largest_volts, reach, released
from calibration.gap.screen import Screened
from calibration.gap.state import Key, State, refit
from rig.effects import BY_NAME

PER_KNOB = 3.0  # log-likelihood that a released knob costs
MISFIT = 0.004  # of the gain, per knob: the rest of the model is only nearly right
WORTH_AN_AXIS = 6.0  # gain on an axis below which the effect is not released there
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
        if not any(self._is_one(axis) for axis in self.axes):
            return -float("inf")
        knobs = sum(
            len(released(BY_NAME[self.name], axis, self.state.believed)) for axis in self.axes
        )
        return self.gain - (PER_KNOB + MISFIT * max(self.gain, 0.0)) * knobs

    def _is_one(self, axis: str) -> bool:
        """Is it on this axis what its name says, and larger than nothing?"""
        believed, setting = self.state.believed, self.state.fit.setting
        if self.name == "saturation":
            reached = largest_volts(self.state.evidence, axis)
            return setting[f"saturation.limit_V.{axis}"] < CUTS * reached
        if self.name in PERIODIC:  # a fraction of a period is a curve, and no ripple
            turns = setting[f"{self.name}.periods_per_turn.{axis}"]
            if turns * reach(self.state.evidence, axis) < LEAST_PHASE_RAD:
                return False
        return believed.beyond(self.name, axis, setting)


def rank(state: State, screened: list[Screened], *, most: int = REFITS) -> list[Trial]:
    """The effects that the screen puts first, each released on the axes that need it; refitted."""
    by_name: dict[str, list[Screened]] = {}
    for one in screened:
        by_name.setdefault(one.name, []).append(one)
    promise = {name: sum(max(o.gain, 0.0) for o in found) for name, found in by_name.items()}
    first = sorted(promise, key=lambda name: -promise[name])[:most]
    least = max(LEAST_PROMISE, FAR_BEHIND * max(promise.values(), default=0.0))
    first = [name for name in first if promise[name] >= least]
    trials = [_release(state, name, by_name[name]) for name in first]
    return sorted(trials, key=lambda trial: -trial.score)


def rank_one(state: State, one: Screened) -> State:
    """The state with one screened effect released on its axis and fitted."""
    return _release(state, one.name, [one]).state


def _release(state: State, name: str, found: list[Screened]) -> Trial:
    chosen = [one for one in found if one.gain > WORTH_AN_AXIS] or found[:1]
    axes = tuple(one.axis for one in chosen)
    keys = tuple((name, axis) for axis in axes)
    felt = {part for axis in axes for k in state.believed.of(name, axis) for part in k.parts}
    parts = tuple(part for part in state.evidence.parts if part in felt)
    starts = [
        {k: v for one in chosen for k, v in getattr(one, which).items()}
        for which in ("start", "tried")
    ]
    moved = min(
        (
            evaluate(state.evidence, state.believed, _inside(state, start), parts)
            for start in starts
        ),
        key=lambda found: found.cost,
    )
    begun = replace(
        state,
        named=(*state.named, *keys),
        fit=replace(state.fit, setting=moved.setting, rolls=state.fit.rolls | moved.rolls,
                    costs=state.fit.costs | moved.costs),
    )  # fmt: skip
    done = refit(begun, begun.bounds(parts))
    return Trial(name, axes, done, state.fit.cost - done.fit.cost)


def _inside(state: State, start: Start) -> dict[str, float]:
    """The state's setting with a start in it, every knob in its range."""
    knobs = state.believed.knobs
    clipped = {k: min(max(v, knobs[k].range[0]), knobs[k].range[1]) for k, v in start.items()}
    return state.fit.setting | clipped
