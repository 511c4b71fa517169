"""Gaps before and after on data that the fit has not seen, over one noise floor a channel.

The runs (or the halves of a single run) are split in two; every model is refitted on one half and
judged on the other. With e the innovations of a channel on the judged half,

    gap = RMS(e)/floor,   closed share = (before - after)/(before - 1)

The floor is the RMS that repeated clean runs of this table leave, if the rig file has it
(`rig gap --tolerances-from`), else that of the accepted model refitted on the judged half: the same
for all rows, never estimated anew for "before". The proof is reported; it takes no name back.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from calibration.gap.findings import Gap, ProofRow, Step
from calibration.gap.model.data import Evidence
from calibration.gap.model.fit import evaluate
from calibration.gap.model.parameters import BALL, SERVO, Model
from calibration.gap.model.state import State, refit
from rig.parameters import CHANNELS, Rig
from rig.prediction.innovations import ball_ahead

# Residuals beyond it are left out of every RMS (a disturbance that was not masked); chosen.
OUTLIER_Z = 6.0


def split(evidence: Evidence) -> tuple[Evidence, Evidence]:
    """Split the evidence in two halves by its masks: runs with even and with odd number or, of a
    single run, the first and the second half of its time."""
    first: dict[str, np.ndarray] = {}
    for output in evidence.outputs:
        t, run = evidence.times(output)
        chosen = run % 2 == 0 if len(evidence.runs) > 1 else t < 0.5 * (t[0] + t[-1])
        first[output] = chosen.astype(float)
    other = {output: evidence.masks[output] * (1 - chosen) for output, chosen in first.items()}
    mine = {output: evidence.masks[output] * chosen for output, chosen in first.items()}
    return (
        replace(evidence, masks=evidence.masks | mine),
        replace(evidence, masks=evidence.masks | other),
    )


def on(state: State, evidence: Evidence) -> State:
    """Fit the state's free parameters anew, from its setting, to other evidence."""
    moved = replace(
        state,
        evidence=evidence,
        fit=evaluate(evidence, state.nominal, state.fit.setting, evidence.outputs),
    )
    for output in evidence.outputs:
        moved = refit(moved, moved.bounds((output,)), iterations=3)
    return moved


def rms(evidence: Evidence, model: Model) -> dict[str, float]:
    """RMS innovation by channel [rad or m] over the samples with a mask above 0 and a residual
    below OUTLIER_Z deviations; channels without samples are left out."""
    found = {}
    for output in evidence.outputs:
        roll, mask = evidence.roll(model, output), evidence.masks[output] > 0
        good = mask & (np.abs(roll.z) < OUTLIER_Z)
        size = (roll.z * np.exp(roll.log_std)) ** 2
        if output == BALL:
            for a, channel in enumerate(CHANNELS[2:]):
                if evidence.ball_axes[a] and good[a::2].any():
                    found[channel] = float(np.sqrt(np.mean(size[a::2][good[a::2]])))
        elif good.any():
            found[SERVO[SERVO.index(output)]] = float(np.sqrt(np.mean(size[good])))
    return found


def ahead_mm(evidence: Evidence, model: Model) -> float | None:
    """RMS error of the ball's position predicted 1 s ahead [mm], over the exposures that the mask
    leaves; None where no ball was seen or no exposure is left."""
    if BALL not in evidence.outputs:
        return None
    errors = np.concatenate(
        [ball_ahead(model.record, run, evidence.levels) for run in evidence.runs]
    )
    inside = evidence.masks[BALL].reshape(-1, 2) > 0
    chosen = inside & np.isfinite(errors)
    return float(1e3 * np.sqrt(np.mean(errors[chosen] ** 2))) if chosen.any() else None


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
    """The gaps before and after, and one row for each model."""

    gap: Gap
    rows: tuple[ProofRow, ...]


def prove(models: Mapping[str, State], after: str, levels: np.record) -> Proof:
    """Judge models on held-out data: each is refitted on one half and judged on the other.

    `models`: label -> state, of which the first is "nothing added"; `after`: label of the accepted
    one; `levels`: its noise levels (dtype NOISE), used for all models.
    """
    states = {k: replace(s, evidence=s.evidence.with_levels(levels)) for k, s in models.items()}
    train, test = split(states[after].evidence)
    floor_model = model_of(on(states[after], test))
    floor, source = floors(states[after].nominal.rig, rms(test, floor_model))
    floor_ahead = ahead_mm(test, floor_model)
    rows, raw = [], {}
    for label, state in states.items():
        fitted = model_of(on(state, train))
        raw[label] = rms(test, fitted)
        gaps = {c: raw[label][c] / floor[c] for c in floor if c in raw[label]}
        rows.append(ProofRow(label, gaps, ahead_mm(test, fitted)))
    by = {row.model: row for row in rows}
    before = rows[0]
    ahead = {"before": before.ahead_1s_mm, "after": by[after].ahead_1s_mm, "floor": floor_ahead}
    gap = Gap(
        before.gap,
        by[after].gap,
        source,
        True,
        floor,
        {k: v for k, v in ahead.items() if v is not None},
    )
    return Proof(gap, tuple(rows))


def steps(
    path: tuple[tuple[str, State], ...], levels: np.record, floor: Mapping[str, float]
) -> tuple[Step, ...]:
    """The gaps by channel after each addition of `path` (name added, state), over `floor` (channel
    -> rad or m), on all data and at the same noise `levels` (dtype NOISE)."""
    found = []
    for added, state in path:
        sizes = rms(state.evidence.with_levels(levels), model_of(state))
        found.append(Step(added, {c: v / floor[c] for c, v in sizes.items() if c in floor}))
    return tuple(found)
