"""Gaps before and after on data that the fit has not seen, over one noise floor a channel.

The runs (or the halves of a single run) are split in two; every model is refitted on each half and
judged on the other (two-fold cross-validation). With e the innovations of a channel on both judged
halves,

    gap = RMS(e)/floor,   closed share = (before - after)/(before - 1)

The floor is the RMS that repeated clean runs of this table leave, if the rig file has it
(`rig gap --tolerances-from`), else that of the accepted model refitted on each judged half: the
same for all rows, never estimated anew for "before". The RMS error 1 s ahead of the ball (predicted
from the measured angles alone) and of the servos (from the volts alone) is told as well. Whether a
name may stand at all is judged by `calibration.gap.veto`.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import degrees

import numpy as np

from calibration.gap.findings import Gap, ProofRow, Step
from calibration.gap.model.data import Evidence
from calibration.gap.model.fit import evaluate
from calibration.gap.model.parameters import BALL, SERVO, Model
from calibration.gap.model.state import State, refit
from rig.parameters import CHANNELS, Rig
from rig.prediction.innovations import Signals, ball_ahead, servo_ahead

# Residuals beyond it are left out of every RMS (a disturbance that was not masked); chosen.
OUTLIER_Z = 6.0
FARTHEST = 1e6  # error [m or rad] of a prediction that has run away: its square is still a number


def split(evidence: Evidence) -> tuple[Evidence, Evidence]:
    """Split the evidence in two halves by its masks: runs with even and with odd number or, of a
    single run, the first and the second half of the time in which the output has weight."""
    first: dict[str, np.ndarray] = {}
    for output in evidence.outputs:
        t, run = evidence.times(output)
        begin, end = t[evidence.masks[output] > 0][[0, -1]]
        chosen = run % 2 == 0 if len(evidence.runs) > 1 else t < 0.5 * (begin + end)
        first[output] = chosen.astype(float)
    other = {output: evidence.masks[output] * (1 - chosen) for output, chosen in first.items()}
    mine = {output: evidence.masks[output] * chosen for output, chosen in first.items()}
    return (
        replace(evidence, masks=evidence.masks | mine),
        replace(evidence, masks=evidence.masks | other),
    )


def on(state: State, evidence: Evidence, outputs: Iterable[str] | None = None) -> State:
    """Fit the state's free parameters anew, from its setting, to other evidence; `outputs`: those
    whose parameters are fitted (None: all)."""
    moved = replace(
        state,
        evidence=evidence,
        fit=evaluate(evidence, state.nominal, state.fit.setting, evidence.outputs),
    )
    for output in evidence.outputs if outputs is None else outputs:
        moved = refit(moved, moved.bounds((output,)), iterations=3)
    return moved


def rms(evidence: Evidence, model: Model) -> dict[str, float]:
    """RMS innovation by channel [rad or m] over the samples with a mask above 0 and a residual
    below OUTLIER_Z deviations; channels without samples are left out."""
    return _rms(_squares(evidence, model))


def _rms(squares: Mapping[str, np.ndarray]) -> dict[str, float]:
    return {name: float(np.sqrt(np.mean(values))) for name, values in squares.items()}


def _squares(evidence: Evidence, model: Model) -> dict[str, np.ndarray]:
    """Squared innovations by channel [rad2 or m2] of the samples that `rms` takes."""
    found = {}
    for output in evidence.outputs:
        roll, mask = evidence.roll(model, output), evidence.masks[output] > 0
        good = mask & (np.abs(roll.z) < OUTLIER_Z)
        size = (roll.z * np.exp(roll.log_std)) ** 2
        if output == BALL:
            for a, channel in enumerate(CHANNELS[2:]):
                if evidence.ball_axes[a] and good[a::2].any():
                    found[channel] = size[a::2][good[a::2]]
        elif good.any():
            found[SERVO[SERVO.index(output)]] = size[good]
    return found


def ahead(evidence: Evidence, model: Model, output: str) -> np.ndarray:
    """Errors (m,) of an output predicted 1 s ahead [m or rad], where its mask leaves them, at most
    FARTHEST; those of the ball's axes one after the other."""
    errors = np.concatenate([_ahead_of_run(run, evidence, model, output) for run in evidence.runs])
    errors = errors[(evidence.masks[output] > 0) & np.isfinite(errors)]
    return np.clip(errors, -FARTHEST, FARTHEST)


def _ahead_of_run(run: Signals, evidence: Evidence, model: Model, output: str) -> np.ndarray:
    if output == BALL:
        return ball_ahead(model.record, run, evidence.levels)[0].ravel()
    servo = model.gain_rad_s_V, model.time_constant_s
    return servo_ahead(model.record, run, evidence.levels, *servo, SERVO.index(output))[0]


def unexpected(evidence: Evidence, model: Model) -> np.ndarray:
    """Squared errors (m,) of the ball predicted 1 s ahead, as of `ahead`, over the variances that
    the filter expects of them: 1 on average where the model lacks nothing."""
    pairs = [ball_ahead(model.record, run, evidence.levels) for run in evidence.runs]
    squares = np.concatenate([(e / s[:, None]).ravel() ** 2 for e, s in pairs])
    return squares[(evidence.masks[BALL] > 0) & np.isfinite(squares)]


def _ahead_squares(evidence: Evidence, model: Model) -> dict[str, np.ndarray]:
    """Squared errors 1 s ahead by output [m2 or rad2]; outputs in which no prediction ends are left
    out."""
    errors = {output: ahead(evidence, model, output) for output in evidence.outputs}
    return {output: e * e for output, e in errors.items() if len(e)}


def model_of(state: State) -> Model:
    """The model at the fitted setting of a state."""
    return state.nominal.model(state.fit.setting)


def floors(rig: Rig, fullest: Mapping[str, float]) -> tuple[dict[str, float], str]:
    """The noise floor of each channel [rad or m] and its source: "repeated runs" if the rig file
    has floors for all channels of `fullest`, else `fullest` (the RMS of the fullest model by
    channel) and "fullest model"."""
    if fullest and all(channel in rig.floors for channel in fullest):
        return {channel: rig.floors[channel] for channel in fullest}, "repeated runs"
    return dict(fullest), "fullest model"


@dataclass(frozen=True, eq=False)
class Proof:
    """The gaps before and after, and one row of errors for each model that was judged."""

    gap: Gap
    rows: tuple[ProofRow, ...]


def prove(models: Mapping[str, State], after: str, levels: np.record) -> Proof:
    """Judge models on held-out data: each is refitted on each half and judged on the other.

    `models`: label -> state, of which the first is "nothing added"; `after`: label of the accepted
    one; `levels`: its noise levels (dtype NOISE), used for all models.
    """
    states = {k: replace(s, evidence=s.evidence.with_levels(levels)) for k, s in models.items()}
    halves = split(states[after].evidence)
    wanted = [(state, half) for state in states.values() for half in halves]
    each = iter(wanted[0][0].evidence.each(lambda pair: model_of(on(*pair)), wanted))
    fitted = {label: [next(each) for _ in halves] for label in states}
    fullest, ahead_floor = _judged(halves, fitted[after])
    floor, source = floors(states[after].nominal.rig, fullest)
    aheads, rows = {"floor": ahead_floor}, []
    for label, models_of_halves in fitted.items():
        raw, aheads[label] = _judged(halves[::-1], models_of_halves)
        gaps = {c: raw[c] / floor[c] for c in floor if c in raw}
        rows.append(ProofRow(label, gaps, *_in_units(aheads[label])))
    by = {row.model: row for row in rows}
    before, last = rows[0], by[after]
    told = {"before": before.model, "after": after, "floor": "floor"}
    mm = {k: 1e3 * aheads[label][BALL] for k, label in told.items() if BALL in aheads[label]}
    deg = {
        output: {k: degrees(aheads[label][output]) for k, label in told.items()}
        for output in SERVO
        if all(output in aheads[label] for label in told.values())
    }
    return Proof(Gap(before.gap, last.gap, source, True, floor, mm, deg), tuple(rows))


def gap_of_one(state: State) -> Gap:
    """The gap of the only model there is, on all data: that to the floors of repeated runs, else
    none, and its errors 1 s ahead."""
    evidence, model = state.evidence, model_of(state)
    left = rms(evidence, model)
    floor, source = floors(state.nominal.rig, left)
    gaps = {channel: left[channel] / floor[channel] for channel in left}
    ball_mm, servos_deg = _in_units(_rms(_ahead_squares(evidence, model)))
    mm = {} if ball_mm is None else {"before": ball_mm}
    deg = {output: {"before": size_deg} for output, size_deg in servos_deg.items()}
    return Gap(gaps, gaps, source, False, floor, mm, deg)


def _judged(
    halves: Sequence[Evidence], models: Sequence[Model]
) -> tuple[dict[str, float], dict[str, float]]:
    """RMS innovation by channel and RMS error 1 s ahead by output [m, rad], of each half under the
    model beside it."""
    found = []
    for size in (_squares, _ahead_squares):
        parts = [size(half, model) for half, model in zip(halves, models, strict=True)]
        names = dict.fromkeys(name for part in parts for name in part)
        found.append(_rms({n: np.concatenate([p[n] for p in parts if n in p]) for n in names}))
    return found[0], found[1]


def _in_units(errors: Mapping[str, float]) -> tuple[float | None, dict[str, float]]:
    """Errors 1 s ahead by output: of the ball [mm] (None: not there), of the servos [degrees]."""
    ball = 1e3 * errors[BALL] if BALL in errors else None
    return ball, {output: degrees(errors[output]) for output in SERVO if output in errors}


def steps(
    path: tuple[tuple[str, State], ...], levels: np.record, floor: Mapping[str, float]
) -> tuple[Step, ...]:
    """The gaps by channel after each addition of `path` (name added, state), over `floor` (channel
    -> rad or m), on all data and at the same noise `levels` (dtype NOISE). An effect that an
    addition brings on one axis is told with it."""
    found, before = [], set()
    for added, state in path:
        sizes = rms(state.evidence.with_levels(levels), model_of(state))
        axes = [axis for name, axis in {*state.named} - before if name == added]
        words = f"{added} {axes[0]}" if axes in (["x"], ["y"]) else added
        found.append(Step(words, {c: v / floor[c] for c, v in sizes.items() if c in floor}))
        before = {*state.named}
    return tuple(found)
