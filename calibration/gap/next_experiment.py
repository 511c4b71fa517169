"""The next experiment: the shortest protocol that separates two names which the logs do not.

Each protocol of a menu is simulated with effect A in the plant and both A and B are fitted to that
log, then with B in the plant. With C the costs of the fits and k their parameters,

    S_A = C_B - C_A + PENALTY_PER_PARAMETER (k_B - k_A)   on a log of A,   S_B likewise,
    separation = min(S_A, S_B)

the worse case, for it is not known which is true (cf. Hunter and Reiner, Technometrics 7, 1965).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import cos, inf, sin

import numpy as np

from calibration.gap.decision_rule import PENALTY_PER_PARAMETER
from calibration.gap.findings import NextExperiment
from calibration.gap.model import noise
from calibration.gap.model.data import Evidence, gather, usable
from calibration.gap.model.fit import ParameterFit, evaluate
from calibration.gap.model.parameters import (
    CALIBRATED,
    PERIODIC,
    NominalModel,
    released,
)
from calibration.gap.model.state import Key, State, refit
from calibration.gap.name.screen import screen
from rig.control.controllers import WITHOUT
from rig.course import Course
from rig.discrepancy import Discrepancy
from rig.log import Log
from rig.parameters import Rig
from rig.prediction.innovations import noise as first_levels
from rig.simulation.simulate import Simulated, draw, simulate

CLEAR_SEPARATION = 15.0  # S scatters by sqrt(2 S) = 5.5: 96 % of logs exceed RIVAL_MARGIN = 5
MIN_SEPARATION = 3.0  # below it a protocol is not proposed; chosen
ENOUGH_SEPARATION = 150.0  # beyond it no other start of the wrong effect's fit is tried
# A longer protocol is simulated and judged up to here.
MAX_SIMULATED_S = 30.0
MAX_SHARE_AT_LIMIT = 0.1  # share of a run that may be spent at the limit of volts or angle
FIT_ITERATIONS = 8
Effects = Mapping[str, Mapping[str, Mapping[str, float]]]
Choice = tuple[str, Course, float]  # name of a protocol, what it asks for, seconds on the rig


@dataclass(frozen=True)
class Prospect:
    """What a protocol promises for telling two effects apart.

    `seconds`: its duration on the rig [s]; `if_first`, `if_second`: expected scores S_A, S_B
    between the two, if the first or the second is true (infinite: not simulated, because the other
    is too small already); `cannot`: why the rig cannot run it, "" if it can.
    """

    protocol: str
    seconds: float
    if_first: float = 0.0
    if_second: float = 0.0
    cannot: str = ""

    @property
    def separation(self) -> float:
        """The smaller of `if_first` and `if_second`."""
        return min(self.if_first, self.if_second)

    @property
    def clear(self) -> bool:
        """Whether the rig can run the protocol and its separation reaches CLEAR_SEPARATION."""
        return not self.cannot and self.separation >= CLEAR_SEPARATION


def propose(
    rig: Rig,
    rivals: tuple[Effects, Effects],
    menu: Sequence[Choice],
    *,
    seed: int = 0,
    levels: np.record | None = None,
) -> NextExperiment | None:
    """The shortest protocol of `menu` that separates the rivals clearly, else the one that
    separates them best; None: none does, as with structural twins.

    `rig`: the nominal model that both rivals share; `rivals`: what each adds, as in `Rig.effects`
    ({name: {axis: {key: value}}}). `menu`: a protocol may be there several times, with other
    targets and pushes; the worst of them counts. `levels`: the noise (dtype NOISE) seen on the real
    table (None: that of the simulated one).

    `ValueError`: an effect that is not in the catalogue.
    """
    found = []
    for prospect in prospects(rig, rivals, menu, seed=seed, levels=levels):
        found.append(prospect)
        if prospect.clear:
            break
    if not found or (best := ranked(found)[0]).cannot or best.separation < MIN_SEPARATION:
        return None
    names = (" + ".join(rivals[0]), " + ".join(rivals[1]))
    return NextExperiment(best.protocol, names, best.seconds, best.separation)


def ranked(found: Sequence[Prospect]) -> list[Prospect]:
    """The prospects in order: clear ones first, the shortest before all; then those that separate
    most; those that the rig cannot run last.

    Separation per second is not used: the penalty of parameters does not grow with time.
    """

    def order(one: Prospect) -> tuple[int, float]:
        if one.cannot:
            return 2, one.seconds
        return (0, one.seconds) if one.clear else (1, -one.separation)

    return sorted(found, key=order)


def prospects(
    rig: Rig,
    rivals: tuple[Effects, Effects],
    menu: Sequence[Choice],
    *,
    seed: int = 0,
    levels: np.record | None = None,
) -> Iterator[Prospect]:
    """Yield the prospect of each protocol of the menu, the shortest first; a protocol that is there
    several times gets the worst of its courses. Arguments as of `propose`.

    `ValueError`: an effect that is not in the catalogue.
    """
    nominal = NominalModel(rig, load_friction=True)
    names = [_Name.of(effects, nominal) for effects in rivals]
    courses: dict[tuple[str, float], list[Course]] = {}
    for protocol, course, seconds in sorted(menu, key=lambda choice: choice[2]):
        courses.setdefault((protocol, seconds), []).append(_first_part(course, rig))
    for i, ((protocol, seconds), ways) in enumerate(courses.items()):
        found = Prospect(protocol, seconds, inf, inf)
        for k, way in enumerate(ways):
            rng = np.random.default_rng([seed, i, k])
            found = _once(found, way, nominal, rivals, names, levels, rng)
            if not found.clear:
                break
        yield found


def _first_part(course: Course, rig: Rig) -> Course:
    n = round(MAX_SIMULATED_S * rig.control_rate_hz)
    return replace(course, targets_m=course.targets_m[:n], pushes_m_s2=course.pushes_m_s2[:n])


def _once(
    so_far: Prospect,
    course: Course,
    nominal: NominalModel,
    rivals: tuple[Effects, Effects],
    names: Sequence["_Name"],
    levels: np.record | None,
    rng: np.random.Generator,
) -> Prospect:
    """The prospect after one more course: the worst so far, either effect in the plant."""
    scores = [so_far.if_first, so_far.if_second]
    for j in (0, 1):
        run = record(nominal.rig, rivals[j], course, rng)
        if why := cannot(run, nominal.rig):
            return Prospect(so_far.protocol, so_far.seconds, cannot=why)
        score = _score(run.log, course, nominal, names[j], names[1 - j], levels)
        scores[j] = min(scores[j], score)
        if score < MIN_SEPARATION:
            break
    return Prospect(so_far.protocol, so_far.seconds, scores[0], scores[1])


def with_effects(rig: Rig, effects: Effects) -> Rig:
    """The rig with `effects` ({name: {axis: {key: value}}}) added to those that it has; a value
    that is there already is replaced."""
    merged = {name: {axis: dict(v) for axis, v in by.items()} for name, by in rig.effects.items()}
    for name, by_axis in effects.items():
        for axis, pairs in by_axis.items():
            merged.setdefault(name, {}).setdefault(axis, {}).update(pairs)
    return replace(rig, effects=merged)


def record(rig: Rig, effects: Effects, course: Course, rng: np.random.Generator) -> Simulated:
    """A simulated run of the course by the rig with these effects, under its own controller, which
    does not know them."""
    truth = with_effects(rig, effects)
    known = replace(rig, effects={}, unknown=Discrepancy())
    return simulate(truth, known, WITHOUT, course, draw(rng, truth, course))


def cannot(run: Simulated, rig: Rig) -> str:
    """Why the rig cannot do what the run asked of it (not completed, or volts or angle at their
    limit for over MAX_SHARE_AT_LIMIT of the time); "" if it can."""
    if run.outcome != "completed":
        return run.outcome
    for key, limit, what in (
        ("voltage_{}_V", rig.servo.voltage_limit_V, "volts"),
        ("theta_{}_rad", rig.servo.angle_limit_rad, "angle"),
    ):
        for axis in "xy":
            share = float(np.mean(np.abs(run.log[key.format(axis)]) >= 0.999 * limit))
            if share > MAX_SHARE_AT_LIMIT:
                return f"servo {axis} is at its limit of {what} for {share:.0%} of the time"
    return ""


def separation(
    log: Log,
    course: Course,
    rig: Rig,
    own: Effects,
    other: Effects,
    *,
    levels: np.record | None = None,
) -> float:
    """The score S by which the effects `own` explain a log better than `other`, both fitted to it
    (the module's equation for S_A).

    `own`, `other`: {name: {axis: {key: value}}}; `levels`: noise levels (dtype NOISE; None:
    estimated from the log). `ValueError`: an effect that is not in the catalogue.
    """
    nominal = NominalModel(rig, load_friction=True)
    first, second = (_Name.of(effects, nominal) for effects in (own, other))
    return _score(log, course, nominal, first, second, levels)


@dataclass(frozen=True, eq=False)
class _Name:
    """A rival as the fit takes it: the (effect, axis) released, and the setting it starts from."""

    keys: tuple[Key, ...]
    setting: dict[str, float]

    @classmethod
    def of(cls, effects: Effects, nominal: NominalModel) -> "_Name":
        keys = tuple((name, axis) for name, by_axis in effects.items() for axis in by_axis)
        setting: dict[str, float] = {}
        known = nominal.catalogue
        for name, axis in keys:
            if name not in known or axis not in known[name].axes:
                raise ValueError(f"no effect '{name}' on axis '{axis}' in the catalogue")
            for key, value in _turned(name, effects[name][axis]).items():
                setting[f"{name}.{key}.{axis}"] = value
        return cls(keys, setting)

    def free(self, nominal: NominalModel) -> set[str]:
        """Names of the parameters that the rival costs."""
        found = {
            k.name
            for key in self.keys
            for k in released(nominal.catalogue[key[0]], key[1], nominal, self.setting)
        }
        return found | set(self.setting)


def _turned(name: str, pairs: Mapping[str, float]) -> dict[str, float]:
    """The values of an effect as its parameters have them (sine and cosine of a periodic one)."""
    if name not in PERIODIC:
        return dict(pairs)
    size, phase = pairs.get(PERIODIC[name], 0.0), pairs.get("phase_rad", 0.0)
    periods = pairs.get("periods_per_turn", 1.0)
    return {"sine": size * cos(phase), "cosine": size * sin(phase), "periods_per_turn": periods}


def _score(
    log: Log,
    course: Course,
    nominal: NominalModel,
    own: _Name,
    other: _Name,
    levels: np.record | None,
) -> float:
    """The score S of `own` over `other` on a log of `own`."""
    evidence = _evidence(log, course, nominal.rig, levels)
    parameters = [nominal.parameters[n] for name in (own, other) for n in name.free(nominal)]
    outputs = tuple(
        p for p in evidence.outputs if any(p in parameter.outputs for parameter in parameters)
    )
    if not outputs:
        return 0.0
    evidence = evidence.of(outputs)
    if levels is None:
        model = nominal.model(own.setting)
        evidence = evidence.with_levels(noise.estimate(evidence, model, outputs))
    right = _fitted(
        evidence, nominal, own, evaluate(evidence, nominal, own.setting, outputs), outputs
    )
    shared = {n: v for n, v in right.fit.setting.items() if _key(nominal, n) not in own.keys}
    dearer = len(other.free(nominal)) - len(own.free(nominal))
    score = inf
    for start in _starts(evidence, nominal, other, shared, outputs):
        wrong = _fitted(evidence, nominal, other, start, outputs)
        score = min(score, wrong.fit.cost - right.fit.cost + PENALTY_PER_PARAMETER * dearer)
        if not MIN_SEPARATION <= score < ENOUGH_SEPARATION:
            break
    return score


def _evidence(log: Log, course: Course, rig: Rig, levels: np.record | None) -> Evidence:
    """One run's evidence; on the servos alone there is no ball, whatever a simulator shows."""
    told = rig.servo.takes_angle
    seen = usable(log, camera_delay_s=rig.camera.delay_s, commanded=told)
    if course.servo_only:
        seen = replace(seen, exposed_s=seen.exposed_s[:0], ball_m=seen.ball_m[:0], fresh=None)
    return gather([seen], first_levels() if levels is None else levels)


def _starts(
    evidence: Evidence,
    nominal: NominalModel,
    name: _Name,
    shared: Mapping[str, float],
    outputs: tuple[str, ...],
) -> list[ParameterFit]:
    """Starts of the wrong effect: as given and as the screen finds it, the better one first."""
    others = {(effect.name, axis) for effect in nominal.effects for axis in effect.axes} - set(
        name.keys
    )
    bare = State(evidence, nominal, evaluate(evidence, nominal, shared, outputs))
    found = screen(bare, outputs, skip=others)
    screened = {k: v for one in found for k, v in one.start.items()}
    settings = ({**shared, **start} for start in (name.setting, screened))
    fits = [evaluate(evidence, nominal, setting, outputs) for setting in settings]
    return sorted(fits, key=lambda fit: fit.cost)


def _key(nominal: NominalModel, name: str) -> Key:
    parameter = nominal.parameters[name]
    return parameter.effect, parameter.axis


def _fitted(
    evidence: Evidence,
    nominal: NominalModel,
    name: _Name,
    start: ParameterFit,
    outputs: tuple[str, ...],
) -> State:
    """The fit with the rival released and everything else within its tolerance."""
    state = State(evidence, nominal, start, name.keys)
    bounds = state.bounds(outputs)
    # K and tau are known from the logs at hand, within their tolerance.
    for parameter in (nominal.parameters[name] for name in list(bounds)):
        if parameter.key not in CALIBRATED:
            continue
        half = CALIBRATED[parameter.key] * parameter.nominal
        bounds[parameter.name] = parameter.nominal - half, parameter.nominal + half
    return refit(state, bounds, iterations=FIT_ITERATIONS)
