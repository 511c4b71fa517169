"""Before and after on data that the fit has not seen, over one floor a channel.

The runs (or the halves of a single run) are split in two; every model is refitted on one part and
judged on the other. The floor is what repeated clean runs of this table leave, where the rig file
has it (`rig gap --tolerances-from`), else the right structure refitted on the judged part itself:
the same for every row, never estimated anew for "before".
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from calibration.gap.evidence import Evidence
from calibration.gap.findings import Gap, ProofRow, Step
from calibration.gap.fit import evaluate
from calibration.gap.knobs import BALL, SERVO, Model
from calibration.gap.state import State, refit
from rig.parameters import CHANNELS, Rig
from rig.predict import ball_ahead

OUTLIER = 6.0  # residuals beyond are left out of every RMS (a push not seen as one)


def split(evidence: Evidence) -> tuple[Evidence, Evidence]:
    """Two parts: whole runs by turns, or the halves of one run."""
    first: dict[str, np.ndarray] = {}
    for part in evidence.parts:
        t, run = evidence.times(part)
        chosen = run % 2 == 0 if len(evidence.runs) > 1 else t < 0.5 * (t[0] + t[-1])
        first[part] = chosen.astype(float)
    other = {part: evidence.masks[part] * (1 - chosen) for part, chosen in first.items()}
    mine = {part: evidence.masks[part] * chosen for part, chosen in first.items()}
    return (
        replace(evidence, masks=evidence.masks | mine),
        replace(evidence, masks=evidence.masks | other),
    )


def on(state: State, evidence: Evidence) -> State:
    """The same knobs free, fitted on other evidence."""
    moved = replace(
        state,
        evidence=evidence,
        fit=evaluate(evidence, state.believed, state.fit.setting, evidence.parts),
    )
    for part in evidence.parts:
        moved = refit(moved, moved.bounds((part,)), iterations=3)
    return moved


def rms(evidence: Evidence, model: Model) -> dict[str, float]:
    """RMS innovation by channel [rad or m] over what the masks leave."""
    found = {}
    for part in evidence.parts:
        roll, mask = evidence.roll(model, part), evidence.masks[part] > 0
        good = mask & (np.abs(roll.z) < OUTLIER)
        size = (roll.z * np.exp(roll.log_std)) ** 2
        if part == BALL:
            for a, channel in enumerate(CHANNELS[2:]):
                if evidence.ball_axes[a] and good[a::2].any():
                    found[channel] = float(np.sqrt(np.mean(size[a::2][good[a::2]])))
        elif good.any():
            found[SERVO[SERVO.index(part)]] = float(np.sqrt(np.mean(size[good])))
    return found


def ahead_mm(evidence: Evidence, model: Model) -> float | None:
    """RMS error of the ball's place 1 s ahead [mm] over the exposures that the mask leaves."""
    if BALL not in evidence.parts:
        return None
    errors = np.concatenate(
        [ball_ahead(model.record, run, evidence.levels) for run in evidence.runs]
    )
    inside = evidence.masks[BALL].reshape(-1, 2) > 0
    chosen = inside & np.isfinite(errors)
    return float(1e3 * np.sqrt(np.mean(errors[chosen] ** 2))) if chosen.any() else None


def model_of(state: State) -> Model:
    return state.believed.model(state.fit.setting)


def floors(rig: Rig, fullest: Mapping[str, float]) -> tuple[dict[str, float], str]:
    """The floor of each channel [rad or m], and where it is from."""
    if fullest and all(channel in rig.floors for channel in fullest):
        return {channel: rig.floors[channel] for channel in fullest}, "repeated runs"
    return dict(fullest), "fullest model"


@dataclass(frozen=True, eq=False)
class Proof:
    gap: Gap
    rows: tuple[ProofRow, ...]


def prove(models: Mapping[str, State], after: str, levels: np.record) -> Proof:
    """Judge models (row label -> state; the first is "nothing added") on held-out data.

    `after` labels the accepted one, `levels` are its noise levels, used for all.
    """
    states = {k: replace(s, evidence=s.evidence.with_levels(levels)) for k, s in models.items()}
    train, test = split(states[after].evidence)
    floor_model = model_of(on(states[after], test))
    floor, source = floors(states[after].believed.rig, rms(test, floor_model))
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
    gap = Gap(before.gap, by[after].gap, source, True, floor,
              {k: v for k, v in ahead.items() if v is not None})  # fmt: skip
    return Proof(gap, tuple(rows))


def steps(path: tuple[tuple[str, State], ...], levels: np.record,
          floor: Mapping[str, float]) -> tuple[Step, ...]:  # fmt: skip
    """The gaps as one effect after the other was added, on all data, at one noise."""
    found = []
    for added, state in path:
        sizes = rms(state.evidence.with_levels(levels), model_of(state))
        found.append(Step(added, {c: v / floor[c] for c, v in sizes.items() if c in floor}))
    return tuple(found)
