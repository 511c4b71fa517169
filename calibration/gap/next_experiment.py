"""The next experiment: where two names remain, the protocol that tells them apart soonest.

Each protocol of a menu is run in simulation as if the one name were true, and both names are fitted
to that log; then the other way round. The smaller of the two scores between the names is what the
protocol promises: the worse case counts, for nobody knows yet which name is true.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import cos, inf, sin

import numpy as np

from calibration.gap import noise
from calibration.gap.evidence import Evidence, gather, usable
from calibration.gap.findings import NextExperiment
from calibration.gap.fit import Fit, evaluate
from calibration.gap.knobs import CALIBRATED, PERIODIC, Believed
from calibration.gap.menu import released
from calibration.gap.screen import PER_KNOB, screen
from calibration.gap.state import Key, State, refit
from rig.controllers import WITHOUT
from rig.effects import BY_NAME, CATALOGUE
from rig.log import Log
from rig.parameters import Rig
from rig.predict import noise as first_levels
from rig.simulate import Course, Simulated, draw, simulate
from rig.unknown import Unknown

CLEAR = 15.0  # of an expected score: chance moves it by sqrt(2 x 15) = 5.5 and it still decides
LEAST = 3.0  # below it a protocol tells nothing
SURE = 150.0  # beyond it no other start of the wrong name's fit is tried
LONGEST_S = 30.0  # of a protocol that is simulated; what a longer one tells later is not counted
AT_LIMIT = 0.1  # share of a run that may be spent at the limit of volts or angle
ITERATIONS = 8
Effects = Mapping[str, Mapping[str, Mapping[str, float]]]
Choice = tuple[str, Course, float]  # name of a protocol, what it asks for, seconds on the rig


@dataclass(frozen=True)
class Prospect:
    """What a protocol promises: separation = the smaller of `if_first` and `if_second`, the scores
    between the names if the one or the other is true (infinite: not tried, for the first one tells
    nothing already); cannot: why the rig cannot run it."""

    protocol: str
    seconds: float
    if_first: float = 0.0
    if_second: float = 0.0
    cannot: str = ""

    @property
    def separation(self) -> float:
        return min(self.if_first, self.if_second)

    @property
    def clear(self) -> bool:
        return not self.cannot and self.separation >= CLEAR


def propose(rig: Rig, rivals: tuple[Effects, Effects], menu: Sequence[Choice], *, seed: int = 0,
            levels: np.record | None = None) -> NextExperiment | None:  # fmt: skip
    """The shortest protocol that separates the rivals clearly, else the one that does best.

    rig: the model that both share, as believed; rivals: what each of the two adds, as in
    `Rig.effects` ({name: {axis: {key: value}}}). menu: a protocol may be there several times, with
    other targets and pushes: the worst of them counts. levels: the noise (dtype NOISE) seen on the
    real table, without it that of the simulated one. None: no protocol of the menu tells the two
    apart (structural twins: none ever does). ValueError: an effect that is not in the catalogue.
    """
    found = []
    for prospect in prospects(rig, rivals, menu, seed=seed, levels=levels):
        found.append(prospect)
        if prospect.clear:
            break
    if not found or (best := ranked(found)[0]).cannot or best.separation < LEAST:
        return None
    names = (" + ".join(rivals[0]), " + ".join(rivals[1]))
    return NextExperiment(best.protocol, names, best.seconds, best.separation)


def ranked(found: Sequence[Prospect]) -> list[Prospect]:
    """Clear ones first, the shortest before all; then those that separate most.

    Not by separation per second there: what a plainer name gains by being plain comes once, and
    does not grow with time on the rig.
    """

    def order(one: Prospect) -> tuple[int, float]:
        if one.cannot:
            return 2, one.seconds
        return (0, one.seconds) if one.clear else (1, -one.separation)

    return sorted(found, key=order)


def prospects(rig: Rig, rivals: tuple[Effects, Effects], menu: Sequence[Choice], *, seed: int = 0,
              levels: np.record | None = None) -> Iterator[Prospect]:  # fmt: skip
    """What each protocol of the menu promises, the shortest first. Arguments as of `propose`."""
    believed = Believed(rig, load_friction=True)
    names = [_Name.of(effects, believed) for effects in rivals]
    courses: dict[tuple[str, float], list[Course]] = {}
    for protocol, course, seconds in sorted(menu, key=lambda choice: choice[2]):
        courses.setdefault((protocol, seconds), []).append(_first_part(course, rig))
    for i, ((protocol, seconds), ways) in enumerate(courses.items()):
        found = Prospect(protocol, seconds, inf, inf)
        for k, way in enumerate(ways):
            rng = np.random.default_rng([seed, i, k])
            found = _once(found, way, believed, rivals, names, levels, rng)
            if not found.clear:
                break
        yield found


def _first_part(course: Course, rig: Rig) -> Course:
    n = round(LONGEST_S * rig.control_rate_hz)
    return replace(course, targets_m=course.targets_m[:n], pushes_m_s2=course.pushes_m_s2[:n])


def _once(so_far: Prospect, course: Course, believed: Believed, rivals: tuple[Effects, Effects],
          names: Sequence["_Name"], levels: np.record | None, rng: np.random.Generator
          ) -> Prospect:  # fmt: skip
    """What is left of a promise after one more course, both ways."""
    scores = [so_far.if_first, so_far.if_second]
    for j in (0, 1):
        run = record(believed.rig, rivals[j], course, rng)
        if why := cannot(run, believed.rig):
            return Prospect(so_far.protocol, so_far.seconds, cannot=why)
        score = _score(run.log, course, believed, names[j], names[1 - j], levels)
        scores[j] = min(scores[j], score)
        if score < LEAST:
            break
    return Prospect(so_far.protocol, so_far.seconds, scores[0], scores[1])


def with_effects(rig: Rig, effects: Effects) -> Rig:
    """The rig with effects added to those that it has, value by value."""
    merged = {name: {axis: dict(v) for axis, v in by.items()} for name, by in rig.effects.items()}
    for name, by_axis in effects.items():
        for axis, pairs in by_axis.items():
            merged.setdefault(name, {}).setdefault(axis, {}).update(pairs)
    return replace(rig, effects=merged)


def record(rig: Rig, effects: Effects, course: Course, rng: np.random.Generator) -> Simulated:
    """A run of the rig with these effects under its own controller, which does not know them."""
    truth = with_effects(rig, effects)
    known = replace(rig, effects={}, unknown=Unknown())
    return simulate(truth, known, WITHOUT, course, draw(rng, truth, course))


def cannot(run: Simulated, rig: Rig) -> str:
    """Why the rig cannot do what was asked of it, or ""."""
    if run.outcome != "completed":
        return run.outcome
    for key, limit, what in (
        ("voltage_{}_V", rig.servo.voltage_limit_V, "volts"),
        ("theta_{}_rad", rig.servo.angle_limit_rad, "angle"),
    ):
        for axis in "xy":
            share = float(np.mean(np.abs(run.log[key.format(axis)]) >= 0.999 * limit))
            if share > AT_LIMIT:
                return f"servo {axis} is at its limit of {what} for {share:.0%} of the time"
    return ""


def separation(log: Log, course: Course, rig: Rig, own: Effects, other: Effects, *,
               levels: np.record | None = None) -> float:  # fmt: skip
    """The score by which `own` explains a log of the rig better than `other`, both fitted."""
    believed = Believed(rig, load_friction=True)
    first, second = (_Name.of(effects, believed) for effects in (own, other))
    return _score(log, course, believed, first, second, levels)


@dataclass(frozen=True, eq=False)
class _Name:
    """A rival as the fit takes it: what is released, and the setting from which it starts."""

    keys: tuple[Key, ...]
    setting: dict[str, float]

    @classmethod
    def of(cls, effects: Effects, believed: Believed) -> "_Name":
        keys = tuple((name, axis) for name, by_axis in effects.items() for axis in by_axis)
        setting: dict[str, float] = {}
        for name, axis in keys:
            if name not in BY_NAME or axis not in BY_NAME[name].axes:
                raise ValueError(f"no effect '{name}' on axis '{axis}' in the catalogue")
            for key, value in _turned(name, effects[name][axis]).items():
                setting[f"{name}.{key}.{axis}"] = value
        return cls(keys, setting)

    def free(self, believed: Believed) -> set[str]:
        """The knobs that the name costs."""
        found = {
            k.name
            for key in self.keys
            for k in released(BY_NAME[key[0]], key[1], believed, self.setting)
        }
        return found | set(self.setting)


def _turned(name: str, pairs: Mapping[str, float]) -> dict[str, float]:
    """The values of an effect as its knobs have them (sine and cosine of a periodic one)."""
    if name not in PERIODIC:
        return dict(pairs)
    size, phase = pairs.get(PERIODIC[name], 0.0), pairs.get("phase_rad", 0.0)
    periods = pairs.get("periods_per_turn", 1.0)
    return {"sine": size * cos(phase), "cosine": size * sin(phase), "periods_per_turn": periods}


def _score(log: Log, course: Course, believed: Believed, own: _Name, other: _Name,
           levels: np.record | None) -> float:  # fmt: skip
    """Log-likelihood of `own` over `other` on its log, less what their knobs cost."""
    evidence = _evidence(log, course, believed.rig, levels)
    knobs = [believed.knobs[n] for name in (own, other) for n in name.free(believed)]
    parts = tuple(p for p in evidence.parts if any(p in knob.parts for knob in knobs))
    if not parts:
        return 0.0
    evidence = replace(evidence, masks={part: evidence.masks[part] for part in parts})
    if levels is None:
        model = believed.model(own.setting)
        evidence = evidence.with_levels(noise.estimate(evidence, model, parts))
    right = _fitted(
        evidence, believed, own, evaluate(evidence, believed, own.setting, parts), parts
    )
    shared = {n: v for n, v in right.fit.setting.items() if _key(believed, n) not in own.keys}
    dearer = len(other.free(believed)) - len(own.free(believed))
    score = inf
    for start in _starts(evidence, believed, other, shared, parts):
        wrong = _fitted(evidence, believed, other, start, parts)
        score = min(score, wrong.fit.cost - right.fit.cost + PER_KNOB * dearer)
        if not LEAST <= score < SURE:
            break
    return score


def _evidence(log: Log, course: Course, rig: Rig, levels: np.record | None) -> Evidence:
    """One run's evidence; on the servos alone there is no ball, whatever a simulator shows."""
    seen = usable(log, camera_delay_s=rig.camera.delay_s)
    if course.servo_only:
        seen = replace(seen, exposed_s=seen.exposed_s[:0], ball_m=seen.ball_m[:0], fresh=None)
    return gather([seen], first_levels() if levels is None else levels)


def _starts(evidence: Evidence, believed: Believed, name: _Name, shared: Mapping[str, float],
            parts: tuple[str, ...]) -> list[Fit]:  # fmt: skip
    """Where the wrong name starts: as given and as the screen finds it, the better one first."""
    others = {(effect.name, axis) for effect in CATALOGUE for axis in effect.axes} - set(name.keys)
    bare = State(evidence, believed, evaluate(evidence, believed, shared, parts))
    found = screen(bare, parts, without=others)
    screened = {k: v for one in found for k, v in one.start.items()}
    settings = ({**shared, **start} for start in (name.setting, screened))
    fits = [evaluate(evidence, believed, setting, parts) for setting in settings]
    return sorted(fits, key=lambda fit: fit.cost)


def _key(believed: Believed, name: str) -> Key:
    knob = believed.knobs[name]
    return knob.effect, knob.axis


def _fitted(evidence: Evidence, believed: Believed, name: _Name, start: Fit,
            parts: tuple[str, ...]) -> State:  # fmt: skip
    """Everything within its tolerance and the name released, fitted from a start."""
    state = State(evidence, believed, start, name.keys)
    bounds = state.bounds(parts)
    for knob in (believed.knobs[n] for n in bounds if not believed.knobs[n].effect):
        half = CALIBRATED[knob.key] * knob.believed  # the logs that are there know K and tau
        bounds[knob.name] = knob.believed - half, knob.believed + half
    return refit(state, bounds, iterations=ITERATIONS)
