"""Forces along the recorded motion that a model cannot hold, fitted to the ball's residuals.

The innovations answer to a force as to many short pushes, so that a term is linear in the sizes of
its forces (`calibration.gap.unnamed.forces`). Its gain is what its normal equations promise or, but
for pushes, by how much Huber's cost falls where that is more: its weights bound the promise.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.signal import lfilter

from calibration.gap.decision_rule import MIN_FELT, PENALTY_PER_PARAMETER, SEARCH_PENALTY
from calibration.gap.model.cost import huber, weights
from calibration.gap.model.fit import ParameterFit, bounded_step, normal_equations
from calibration.gap.model.parameters import BALL
from calibration.gap.model.state import State
from calibration.gap.unnamed.forces import (
    as_one,
    pushes,
    slipping_forces,
    swaying_forces,
    swinging_forces,
    turning_forces,
)
from calibration.gap.unnamed.peaks import peaks
from calibration.gap.unnamed.term import UnnamedTerm

WINDOWS_S = (0.3, 0.6, 1.2, 2.5, 5.0, 10.0)
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
    for forces in swinging_forces(state):
        yield _along(state, nuisance, "swinging", forces, answer, low=0.0, searched=SEARCH_PENALTY)
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
    answers = [np.convolve(answer, np.ones(m)) for m in rows]
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
    k, begin = forces.shape[2], 0
    term = UnnamedTerm(BALL, kind, -PENALTY_PER_PARAMETER * k, state.nominal.rig.unknown, state)
    if not len(answer) or not k:
        return term
    columns = np.zeros_like(forces)
    for run in state.evidence.runs:
        end = begin + len(run.exposed_s)
        if end > begin:
            columns[begin:end] = lfilter(answer, [1.0], forces[begin:end], axis=0)
        begin = end
    joint = np.column_stack([nuisance[0], columns.reshape(-1, k)])
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
