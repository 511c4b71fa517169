"""Forces along the recorded motion that a model cannot hold, fitted to the ball's residuals.

The innovations answer to a force as to many short pushes, so that a term is linear in the sizes of
its forces (`calibration.gap.unnamed.forces`). Its gain is what its normal equations promise or, but
for pushes, by how much Huber's cost falls where that is more: its weights bound the promise.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import orth
from scipy.signal import lfilter

from calibration.gap.decision_rule import MIN_FELT, PENALTY_PER_PARAMETER, SEARCH_PENALTY
from calibration.gap.model.cost import huber, weights
from calibration.gap.model.fit import ParameterFit, bounded_step, normal_equations
from calibration.gap.model.parameters import BALL
from calibration.gap.model.state import State
from calibration.gap.unnamed.forces import (
    Swing,
    as_one,
    pushes,
    slipping_forces,
    swaying_forces,
    swinging_forces,
    swung,
    turning_forces,
)
from calibration.gap.unnamed.peaks import peaks
from calibration.gap.unnamed.term import UnnamedTerm

WINDOWS_S = (0.3, 0.6, 1.2, 2.5, 5.0, 10.0)
FOUND_BY_S = 1.0  # of the answer to a push behind its end: a later one is found, too; chosen
UNIT_BALL = 0.02  # RMS of a force at its trial size [m/s2]
# Of the parameters that are free beside a term: secants (n, k), room below and above, steps.
Nuisance = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def along_the_motion(
    state: State, nuisance: Nuisance, answer: np.ndarray, found: list[tuple[int, int]]
) -> Iterator[UnnamedTerm]:
    """Every term of this module; `answer`: the residuals' to a force of 1 m/s2 about one exposure;
    `found`: of `pushed`."""
    yield _along(state, nuisance, "turning", turning_forces(state), answer)
    for forces in slipping_forces(state):
        yield _along(state, nuisance, "slipping", forces[:, :, None], answer, low=0.0)
    yield _swinging(state, nuisance, answer)
    yield from _swaying(state, nuisance, answer)
    if len(found) > 1:
        yield _pushes(state, nuisance, answer, found)


def pushed(state: State, answer: np.ndarray) -> list[tuple[int, int]]:
    """The rows of the exposures at which pushes of the ball begin and end, in order; `answer`: of
    `along_the_motion`."""
    t, run = (column[::2] for column in state.evidence.times(BALL))
    if not len(answer):
        return []
    z = state.fit.z(BALL)
    w = weights(z, state.evidence.masks[BALL]).reshape(-1, 2)
    step_s = float(np.median(np.diff(t)))
    rows = [max(round(length / step_s), 1) for length in WINDOWS_S]
    cost = 2 * PENALTY_PER_PARAMETER + SEARCH_PENALTY
    behind = round(FOUND_BY_S / step_s)
    answers = [np.convolve(answer, np.ones(m))[: m + behind] for m in rows]
    found = pushes(z.reshape(-1, 2), w, run, answers, cost)
    return as_one([(i, i + rows[j], size) for i, j, size in found], rows[0], run)


def _pushes(
    state: State, nuisance: Nuisance, answer: np.ndarray, found: list[tuple[int, int]]
) -> UnnamedTerm:
    """Pushes of the ball at several times, each of its own size."""
    t, run = (column[::2] for column in state.evidence.times(BALL))
    forces = np.zeros((len(t), 2, 2 * len(found)))
    for k, (first, end) in enumerate(found):
        forces[first:end, [0, 1], [2 * k, 2 * k + 1]] = 1.0
    term = _along(state, nuisance, "pushes", forces, answer, searched=SEARCH_PENALTY * len(found))
    windows_s = tuple((float(t[i]), float(t[j - 1])) for i, j in found)
    return replace(term, windows_s=windows_s, runs=tuple(int(run[i]) for i, _ in found))


def _swaying(state: State, nuisance: Nuisance, answer: np.ndarray) -> Iterator[UnnamedTerm]:
    """A rhythm of its own on each axis, as of a floor; none where an axis has no frequency."""
    hz = tuple(peaks(state, BALL, (a,))[:1] for a in range(2))
    if all(hz):
        (x_hz,), (y_hz,) = hz
        forces = swaying_forces(state.evidence.times(BALL)[0][::2], (x_hz, y_hz))
        searched = 2 * SEARCH_PENALTY
        term = _along(state, nuisance, "swaying", forces, answer, searched=searched)
        yield replace(term, rhythms_hz=(x_hz, y_hz))


def _swinging(state: State, nuisance: Nuisance, answer: np.ndarray) -> UnnamedTerm:
    """A plate that swings behind its servos, on each axis with the frequency and damping that
    explain most beside the free parameters, whatever their room: of each axis a size of what is
    damped in the elastic part, of both one of what is damped against the table besides."""
    z = state.fit.z(BALL)
    root = np.sqrt(weights(z, state.evidence.masks[BALL]))
    held = orth(root[:, None] * nuisance[0] * nuisance[3])
    left = root * z
    left -= held @ (held.T @ left)
    best, swings = np.zeros(2), dict[int, Swing]()
    forces = np.zeros((len(z) // 2, 2, 3))
    for swing, force in swinging_forces(state) if len(answer) else ():
        column = root.reshape(-1, 2) * _answered(state, force, answer)
        for a in range(2):
            inside = held[a::2].T @ column[:, a]
            energy = max(float(column[:, a] @ column[:, a] - inside @ inside), 1e-12)
            gain = min(float(column[:, a] @ left[a::2]), 0.0) ** 2 / (2.0 * energy)
            if gain > best[a]:
                best[a], swings[a], forces[:, a, a] = gain, swing, force[:, a]
    if not swings:
        return _none(state, "swinging", 3)
    forces[:, :, 2] = forces[:, :, 0] + forces[:, :, 1]  # as large as what is damped otherwise
    parts = [*(([a], False) for a in sorted(swings)), (list(swings), True)]
    columns = np.column_stack([_swung(state, swings, *part) for part in parts])
    searched = len(swings) * SEARCH_PENALTY
    forces = forces[:, :, [*sorted(swings), 2]]
    term = _beside(state, nuisance, "swinging", forces, columns, low=0.0, searched=searched)
    x_hz, y_hz = (swings[a][0] if a in swings else 0.0 for a in range(2))
    return replace(term, rhythms_hz=(x_hz, y_hz))


def _swung(
    state: State, swings: Mapping[int, Swing], axes: Sequence[int], damped: bool
) -> np.ndarray:
    """The change (2 n,) of the ball's residuals where the plate adds to the angles of these axes
    what `swung` says."""
    model, runs = state.nominal.model(state.fit.setting), []
    for run in state.evidence.runs:
        t, theta = run.angles(model.record)
        theta = theta.copy()
        for a in axes:
            theta[:, a] += swung(t, theta[:, a], swings[a], damped=damped)
        runs.append(replace(run, t_s=t, theta_rad=theta, told_rad=None))
    evidence = replace(state.evidence, runs=runs)
    return evidence.roll(model, BALL).z - state.fit.z(BALL)


def _answered(state: State, forces: np.ndarray, answer: np.ndarray) -> np.ndarray:
    """The change of the ball's residuals by forces (n, 2, ...) [m/s2] about their exposures."""
    columns, begin = np.zeros_like(forces), 0
    for run in state.evidence.runs:
        end = begin + len(run.exposed_s)
        if end > begin:
            columns[begin:end] = lfilter(answer, [1.0], forces[begin:end], axis=0)
        begin = end
    return columns


def _along(
    state: State,
    nuisance: Nuisance,
    kind: str,
    forces: np.ndarray,
    answer: np.ndarray,
    *,
    low: float = -np.inf,
    searched: float = 0.0,
) -> UnnamedTerm:
    """A term c f of the ball that the model cannot hold: forces f (n, 2, k) along the recorded
    motion [m/s2], to which the innovations answer as to many short pushes (`answer`), and their
    sizes c (k,), none below `low`. `nuisance`: columns, room below and above, and steps of the
    parameters that are free beside it; `searched`: what the search for the forces costs.
    """
    if not len(answer) or not forces.shape[2]:
        return _none(state, kind, forces.shape[2])
    columns = _answered(state, forces, answer).reshape(-1, forces.shape[2])
    return _beside(state, nuisance, kind, forces, columns, low=low, searched=searched)


def _none(state: State, kind: str, k: int) -> UnnamedTerm:
    """A term of k sizes that explains nothing."""
    return UnnamedTerm(BALL, kind, -PENALTY_PER_PARAMETER * k, state.nominal.rig.unknown, state)


def _beside(
    state: State,
    nuisance: Nuisance,
    kind: str,
    forces: np.ndarray,
    columns: np.ndarray,
    *,
    low: float,
    searched: float,
) -> UnnamedTerm:
    """The term of `_along` whose forces change the residuals by `columns` (2 n, k)."""
    k = forces.shape[2]
    term = _none(state, kind, k)
    joint = np.column_stack([nuisance[0], columns])
    only = ParameterFit(state.fit.setting, {BALL: state.fit.rolls[BALL]}, {})
    a, b = normal_equations(state.evidence, only, {BALL: joint})
    least = np.append(nuisance[1], np.full(k, low))
    most = np.append(nuisance[2], np.full(k, np.inf))
    size = np.sqrt(np.mean(np.square(forces), axis=(0, 1))) + 1e-12
    step = bounded_step(a, b, least, most, np.append(nuisance[3], UNIT_BALL / size))
    felt = np.sqrt(np.mean(np.square(forces @ step[-k:]), axis=0))
    if np.sqrt(np.mean(felt**2)) < MIN_FELT["ball"]:
        return term
    gain = -float(0.5 * step @ a @ step + b @ step)
    if kind != "pushes":  # a push lies beyond Huber's bound: that it counts for little is meant
        z, mask = state.fit.z(BALL), state.evidence.masks[BALL]
        gain = max(gain, float(np.sum(mask * (huber(z) - huber(z + joint @ step)))))
    return replace(term, score=gain + term.score - searched, felt_m_s2=tuple(felt.tolist()))
