"""What no name explains: an unnamed term on a fixed basis, fitted to the residuals.

Families, each linear in its k coefficients c. A model can hold (`rig.discrepancy`) a map (force
over the plate, volts over the servo's angle, or the angle by which it is drawn off where it takes
one), a dependence on speed, one rhythm and one segment of time; it cannot hold pushes at several
times, the forces of a ball that slips or is heavy on a side, those of a plate that swings behind
its servos, and a rhythm of its own on each axis (`calibration.gap.unnamed.along`).
A periodogram proposes the frequency, a matched filter the windows. With the other parameters free
within their tolerance boxes, the score is

    S = G - PENALTY_PER_PARAMETER k - SEARCH_PENALTY (for each frequency or window searched)

with G what the secants promise or, but of a segment and of pushes, by how much the cost falls where
that is more; 0 where the term's RMS along the recorded motion is below what counts
(`_least_felt`).
"""

from collections.abc import Iterator
from dataclasses import fields, replace

import numpy as np
from scipy.signal import correlate

from calibration.gap.decision_rule import MIN_FELT, PENALTY_PER_PARAMETER, SEARCH_PENALTY
from calibration.gap.model.cost import weights
from calibration.gap.model.data import Evidence
from calibration.gap.model.fit import (
    ParameterFit,
    bounded_step,
    differences,
    evaluate,
    normal_equations,
)
from calibration.gap.model.parameters import BALL, SERVO
from calibration.gap.model.state import State
from calibration.gap.unnamed.along import (
    UNIT_BALL,
    WINDOWS_S,
    Nuisance,
    along_the_motion,
    pushed,
)
from calibration.gap.unnamed.peaks import peaks
from calibration.gap.unnamed.term import UnnamedTerm
from rig.discrepancy import Discrepancy, discrepancy_acceleration, pack, servo_discrepancy

PUSH_S = 0.02  # of a push as short as an impulse: one step of the ball before and behind
# A filter of the ball with little process noise remembers a push for seconds. Until MEMORY_S, or
# OVER of the most that it does; chosen.
MEMORY_S, OVER = 20.0, 0.01
ORDERS = (1, 2, 3)  # of a map over the plate
SMOOTHING_SAMPLES = 15  # of a servo's speed: encoder counts are steps
UNIT_VOLTS, UNIT_ANGLE = 0.02, 0.002  # trial coefficients of a servo [V], of its angle [rad]


def unnamed_terms(state: State) -> list[UnnamedTerm]:
    """Every family of terms fitted on every output of the state, best score first."""
    found = [term for output in state.evidence.outputs for term in _terms_of(state, output)]
    return sorted(found, key=lambda term: -term.score)


def _terms_of(state: State, output: str) -> Iterator[UnnamedTerm]:
    side = "ball" if output == BALL else "servo"
    axes = "xy" if output == BALL else output[-1]
    nuisance = _nuisance(state, output)
    for order in ORDERS if side == "ball" else (4,):
        places = [i * 4 + j for i in range(4) for j in range(4) if i + j <= order]
        places = places if side == "ball" else list(range(4))
        units = [(f"{side}_map_{a}", i) for a in axes for i in places]
        yield _fitted(state, output, "map", units, nuisance, {})
    # On a servo the term proportional to speed is K and tau, or the lag: it is left out.
    units = [(f"{side}_speed_{a}", i) for a in axes for i in range(4) if output == BALL or i != 1]
    yield _fitted(state, output, "speed", units, nuisance, {})
    units = [(f"{side}_rhythm_{a}", i) for a in axes for i in range(2)]
    for hz in peaks(state, output):
        yield _fitted(
            state, output, "rhythm", units, nuisance, {f"{side}_rhythm_hz": hz}, SEARCH_PENALTY
        )
    alone: list[tuple[float, float]] = []
    if output == BALL and all(state.evidence.ball_axes):
        answer = _answer(state)
        found = pushed(state, answer)
        yield from along_the_motion(state, nuisance, answer, found)
        t = state.evidence.times(BALL)[0][::2]
        alone = [(float(t[i]), float(t[j - 1])) for i, j in found[:1] if len(found) == 1]
    units = [(f"{side}_segment", "xy".index(a)) for a in axes]
    for window in [*_windows(state, output, side), *alone]:
        fixed = {f"{side}_segment_s": window}
        yield _fitted(state, output, "segment", units, nuisance, fixed, SEARCH_PENALTY)


Unit = tuple[str, int]  # a coefficient: field of `Unknown` and index in it


def _term(units: list[Unit], sizes: np.ndarray, fixed: dict, base: Discrepancy) -> Discrepancy:
    """The unnamed term with the units at these sizes, on top of `base`."""
    values = {f.name: getattr(base, f.name) for f in fields(Discrepancy)} | fixed
    for (name, i), size in zip(units, sizes, strict=True):
        row = list(values[name])
        row[i] += float(size)
        values[name] = tuple(row)
    return Discrepancy(**values)


def _nuisance(state: State, output: str) -> Nuisance:
    """Secants (n, k) of the free parameters of an output, room below and above, steps."""
    bounds = state.bounds((output,))
    parameters = [state.nominal.parameters[name] for name in bounds]
    only = ParameterFit(state.fit.setting, {output: state.fit.rolls[output]}, {}, state.fit.columns)
    columns = differences(state.evidence, state.nominal, only, parameters, bounds)[output]
    value = np.array([state.fit.setting.get(k.name, k.nominal) for k in parameters])
    low, high = (np.array([bounds[k.name][i] for k in parameters]) for i in (0, 1))
    return columns, low - value, high - value, np.array([k.step for k in parameters])


def _fitted(
    state: State,
    output: str,
    kind: str,
    units: list[Unit],
    nuisance: Nuisance,
    fixed: dict,
    searched: float = 0.0,
) -> UnnamedTerm:
    """Fit a family linearly beside the free parameters; its gain is what it adds to theirs. A map
    holds much of what its name gives, so that the term is what the names leave: they are held."""
    unit = _unit(state, output)
    base, nominal = state.fit.rolls[output], state.nominal
    have = nominal.rig.unknown
    eye = np.eye(len(units)) * unit
    models = [
        nominal.with_unknown(_term(units, row, fixed, have)).model(state.fit.setting) for row in eye
    ]
    rolls = state.evidence.rolls([(model, output) for model in models])
    columns = np.column_stack([nuisance[0], *[r.slope(base, unit) for r in rolls]])
    k = len(units)
    only = ParameterFit(state.fit.setting, {output: base}, {})
    a, b = normal_equations(state.evidence, only, {output: columns})
    low = np.append(nuisance[1], np.full(k, -np.inf))
    high = np.append(nuisance[2], np.full(k, np.inf))
    step = bounded_step(a, b, low, high, np.append(nuisance[3], np.full(k, unit)))
    alone = bounded_step(a[:-k, :-k], b[:-k], nuisance[1], nuisance[2], nuisance[3])
    unknown = _term(units, step[-k:], fixed, have)
    gain = -float(0.5 * step @ a @ step + b @ step)
    if kind != "segment":  # a push lies beyond Huber's bound: that it counts for little is meant
        joint = replace(state, nominal=nominal.with_unknown(unknown))
        gain = max(gain, _fall(joint, output, step[:-k]))
    gain += float(0.5 * alone @ a[:-k, :-k] @ alone + b[:-k] @ alone)
    felt = float(np.sqrt(np.mean(np.square(_felt(state, output, unknown)))))
    if felt < _least_felt(state, output):
        gain = 0.0
    free = [nominal.parameters[name] for name in state.bounds((output,))]
    held = [(parameter.effect, parameter.axis) in state.named for parameter in free]
    low[:-k][held] = high[:-k][held] = 0.0
    step = bounded_step(a, b, low, high, np.append(nuisance[3], np.full(k, unit)))
    unknown = _term(units, step[-k:], fixed, have)
    new = replace(state, nominal=nominal.with_unknown(unknown))
    return UnnamedTerm(output, kind, gain - PENALTY_PER_PARAMETER * k - searched, unknown, new)


def _fall(new: State, output: str, step: np.ndarray) -> float:
    """By how much the cost of an output falls with a term in the model and its free parameters
    moved by `step`. Secants promise less where residuals lie beyond Huber's bound, whose weights
    make their square an upper bound of the cost: a rhythm promised 2463 of 3134, and a delay that
    gained 2498 stood in its place. Of parameters that are not linear they may promise more."""
    setting = dict(new.fit.setting)
    for name, change in zip(new.bounds((output,)), step, strict=True):
        setting[name] = setting.get(name, new.nominal.parameters[name].nominal) + float(change)
    moved = evaluate(new.evidence, new.nominal, setting, (output,))
    return new.fit.costs[output] - moved.costs[output]


def _unit(state: State, output: str) -> float:
    """The size of the trial coefficients of an output [m/s2, V or rad]."""
    if output == BALL:
        return UNIT_BALL
    return UNIT_ANGLE if state.nominal.rig.servo.takes_angle else UNIT_VOLTS


def _least_felt(state: State, output: str) -> float:
    """The smallest RMS of an unnamed term that counts [m/s2, V or rad]. Of an angle it is as far as
    a well-kept servo may stop short of its command."""
    if output == BALL:
        return MIN_FELT["ball"]
    nominal = state.nominal
    if nominal.rig.servo.takes_angle:
        return nominal.tolerance("command_dead_band", output[-1])
    return MIN_FELT["servo"] + nominal.friction_slack_V


def _felt(state: State, output: str, unknown: Discrepancy) -> np.ndarray:
    """The unnamed term along the recorded motion [m/s2, V or rad], (n,)."""
    rig = state.nominal.rig
    u, half = pack(unknown, rig.servo.angle_limit_rad), rig.linkage.side_m / 2
    values: list[float] = []
    for run in state.evidence.runs:
        if output == BALL and len(run.exposed_s) > 2:
            v = np.gradient(run.ball_m, run.exposed_s, axis=0)
            for i in range(0, len(v), 5):
                x, y = run.ball_m[i] / half
                values += [
                    discrepancy_acceleration(u, a, x, y, v[i, a], run.exposed_s[i])
                    for a in range(2)
                ]
        elif output != BALL:
            a = SERVO.index(output)
            omega = np.gradient(run.theta_rad[:, a], run.t_s)
            omega = np.convolve(
                omega, np.ones(SMOOTHING_SAMPLES) / SMOOTHING_SAMPLES, "same"
            )  # counts are steps
            values += [
                servo_discrepancy(u, a, run.theta_rad[i, a], omega[i], run.t_s[i])
                for i in range(0, len(run.t_s), 20)
            ]
    return np.array(values)


def _windows(state: State, output: str, side: str) -> list[tuple[float, float]]:
    """The two windows of time in which a constant force explains most (matched filter)."""
    t, run = state.evidence.times(output)
    z = state.fit.z(output) * np.sqrt(weights(state.fit.z(output), state.evidence.masks[output]))
    stride = 2 if output == BALL else 1
    t, run, z = t[::stride], run[::stride], z.reshape(-1, stride)
    found: list[tuple[float, float, float]] = []
    for length in WINDOWS_S:
        kernel = _response(state.evidence, state, output, side, length, stride)
        if kernel is None or len(kernel) >= len(t):
            continue
        match = correlate(z, kernel[:, None], "valid")
        score = np.sum(match**2, axis=1) / max(float(kernel @ kernel), 1e-30)
        i = int(np.argmax(score))
        begin = float(t[i])
        found.append((0.5 * float(score[i]), begin, begin + length))
    found.sort(reverse=True)
    return [(begin, end) for _, begin, end in found[:2]]


def _response(
    evidence: Evidence,
    state: State,
    output: str,
    side: str,
    length: float,
    stride: int,
    early: float = 0.0,
    tail_s: float = 1.0,
) -> np.ndarray | None:
    """The change of the residuals by a unit force of `length` seconds that begins `early` seconds
    before the first of them, until `tail_s` after its end; None where no samples show it: the first
    run that has the output is too short, or has a gap there."""
    t, run = evidence.times(output)
    first = run[::stride] == run[:1]
    t = t[::stride][first]
    if not len(t) or t[-1] - t[0] < length + 3.0:
        return None
    i = int(np.searchsorted(t, t[0] + 1.0))
    begin = float(t[i])
    fixed = {f"{side}_segment_s": (begin - early, begin - early + length)}
    axis = 0 if output == BALL else SERVO.index(output)
    push = np.array([_unit(state, output)])
    unknown = _term([(f"{side}_segment", axis)], push, fixed, Discrepancy())
    model = state.nominal.with_unknown(unknown).model(state.fit.setting)
    z = evidence.roll(model, output).z - state.fit.z(output)
    z = z.reshape(-1, stride)[first, 0]
    end = int(np.searchsorted(t, begin + length + tail_s))
    return z[i:end] if end > i else None


def _answer(state: State) -> np.ndarray:
    """The change of the ball's residuals (m,), from then on until it is over, by an impulse at one
    exposure as large as 1 m/s2 is from one to the next. Empty where no samples show it."""
    answer = _response(state.evidence, state, BALL, "ball", PUSH_S, 2, PUSH_S / 2, MEMORY_S)
    if answer is None:
        return np.zeros(0)
    size = np.abs(answer)
    answer = answer[: np.flatnonzero(size >= OVER * size.max())[-1] + 1]
    step_s = float(np.median(np.concatenate([np.diff(r.exposed_s) for r in state.evidence.runs])))
    return answer * step_s / (UNIT_BALL * PUSH_S)
