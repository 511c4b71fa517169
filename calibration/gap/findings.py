"""The findings of the gap workflow as plain data: JSON, report and page are made of them.

Gaps are RMS innovations over one noise floor a channel, the same before and after; 1.0 is a perfect
model. Channels: servo_x, servo_y, ball_x, ball_y.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import Any

import numpy as np

from rig.effects import BY_NAME, Effect
from rig.parameters import Rig

VERDICTS = ("named", "nothing-missing", "unknown-effect", "undecided")
UNITS = {"servo_x": "rad", "servo_y": "rad", "ball_x": "m", "ball_y": "m"}
ALIKE = 0.05  # chosen: of a measured number, by which two models differ that are as near to it


@dataclass(frozen=True)
class Interval:
    """A value with the limits of its 95 % interval, all in one unit."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Profile:
    """The gap of one channel over one quantity: where in time or state the model is wrong.

    `quantity`: "time", "position", "speed", "direction", "after reversal" or "voltage"; `unit`: of
    `edges` (n + 1,), the limits of the bins; `gap` (n,): in noise floors, NaN in bins with too few
    samples; `count` (n,): samples in each bin; `starts_s` (r,): over time, when each run begins.
    """

    channel: str
    quantity: str
    unit: str
    edges: np.ndarray
    gap: np.ndarray
    count: np.ndarray
    starts_s: np.ndarray = field(default_factory=lambda: np.zeros(1))


@dataclass(frozen=True, eq=False)
class PlateMap:
    """Mean innovation of the ball over cells of the plate, in noise floors: `x_edges` (n + 1,) and
    `y_edges` (m + 1,) [m], `mean` (m, n, 2) of the channels x and y, `count` (m, n) of samples."""

    x_edges: np.ndarray
    y_edges: np.ndarray
    mean: np.ndarray
    count: np.ndarray


@dataclass(frozen=True)
class Where:
    """A region of a channel in plain words, and the channel's gap there in noise floors."""

    channel: str
    region: str
    gap: float


@dataclass(frozen=True)
class RankedEffect:
    """One effect of the ranking: `score`, its penalised gain in log-likelihood (`decision_rule`),
    its probability (0 to 1), `twins`, the effects that the logs cannot tell from it, and whether
    it was `refused` after its score had been enough (the notes say why)."""

    name: str
    score: float
    probability: float
    twins: tuple[str, ...] = ()
    refused: bool = False


@dataclass(frozen=True)
class Named:
    """An effect that the model lacks, with its probability (0 to 1) and the `twins` that the logs
    cannot tell from it. `parameters`: axis -> catalogue key -> interval [SI]."""

    name: str
    probability: float
    twins: tuple[str, ...]
    parameters: dict[str, dict[str, Interval]]


@dataclass(frozen=True)
class SizeByLog:
    """The size of a name on one axis, fitted to every log alone. `sizes`: one a log [the unit of
    the catalogue's `key`], None where the log does not tell; `agree`: whether one size serves
    all."""

    name: str
    axis: str
    key: str
    sizes: tuple[Interval | None, ...]
    agree: bool


@dataclass(frozen=True)
class Leftover:
    """What no named effect explains: its channel, its shape in words, and a formula where the
    unnamed term closed the gap on held-out data."""

    channel: str
    shape: str
    formula: str | None = None


@dataclass(frozen=True)
class Untestable:
    """An effect that the logs would not have shown, the reason, and `smallest`, by catalogue key,
    the smallest size that they would have shown (empty: not known)."""

    name: str
    why: str
    smallest: dict[str, float]


@dataclass(frozen=True)
class Step:
    """The gaps by channel, in noise floors, after an effect was added; `added`: its name, with the
    axis if it is one ("gear_backlash x"), "" for the model as it came."""

    added: str
    gap: dict[str, float]


@dataclass(frozen=True)
class ProofRow:
    """One model on held-out data: its gap by channel, in noise floors, and its error 1 s ahead, of
    the ball [mm] (None: no ball was seen) and by servo channel [degrees]."""

    model: str  # "nothing added", "best rival: NAME", "unnamed term", "named: NAME + NAME", where
    # the verdict is undecided "supposed: NAME + NAME"
    gap: dict[str, float]
    ahead_1s_mm: float | None
    ahead_1s_deg: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class ClosedLoopRow:
    """One quantity of the recorded protocol: measured, simulated with the model before, and
    simulated with the model after."""

    quantity: str  # "limit cycle amplitude", "limit cycle period", "settling time", "spread"
    unit: str
    measured: float
    before: float
    after: float

    @property
    def nearer(self) -> str:
        """Whether the model after is "nearer" to what was measured than the one before, "farther"
        or "alike", by ALIKE of what was measured; "" where a number is missing."""
        gained = abs(self.before - self.measured) - abs(self.after - self.measured)
        if not isfinite(gained):
            return ""
        if abs(gained) < ALIKE * abs(self.measured):
            return "alike"
        return "nearer" if gained > 0.0 else "farther"


@dataclass(frozen=True)
class Gap:
    """Gaps by channel, `before` and `after` the names were added, over one noise floor.

    `floor`: where the floor comes from; `floors`: its values by channel [rad or m]; `held_out`:
    whether the gaps are on data that were not fitted. `ahead_1s_mm`, `ahead_1s_deg`: RMS error 1 s
    ahead of the ball, and by servo channel, each under the keys "before", "after" and "floor";
    where nothing is missing, under "before" alone.
    """

    before: dict[str, float] = field(default_factory=dict)
    after: dict[str, float] = field(default_factory=dict)
    floor: str = "fullest model"  # or "repeated runs"
    held_out: bool = False
    floors: dict[str, float] = field(default_factory=dict)
    ahead_1s_mm: dict[str, float] = field(default_factory=dict)
    ahead_1s_deg: dict[str, dict[str, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class NextExperiment:
    """The protocol that separates two names, and its duration [s]. `separation`: the expected
    difference of their scores."""

    protocol: str
    separates: tuple[str, str]
    seconds: float
    separation: float = 0.0


@dataclass(frozen=True, eq=False)
class Findings:
    """The whole answer of `rig gap`. Tuples are empty, and other fields at their default, for
    stages that did not run.

    `verdict`: one of VERDICTS, in words `sentence`. `where`: regions in which the model is wrong,
    with `profiles` and `maps`; `effects`: what is named, `by_log`: their sizes in every log alone,
    `unknown`: what is left without a name, `ranking`: every effect considered, `untestable`: what
    the logs would not show. `calibrated`: K [rad/s/V] and tau [s] of the servos by label; `gap`,
    `steps`, `proof`, `closed_loop`: before and after; `noise`: levels by their name in NOISE, means
    of both axes [SI]; `rig_before`, `rig_after`: the nominal rig, and the one extended by the
    names.
    """

    verdict: str
    sentence: str
    where: tuple[Where, ...] = ()
    effects: tuple[Named, ...] = ()
    unknown: Leftover | None = None
    untestable: tuple[Untestable, ...] = ()
    calibrated: dict[str, Interval] = field(default_factory=dict)
    by_log: tuple[SizeByLog, ...] = ()
    gap: Gap = field(default_factory=Gap)
    next_experiment: NextExperiment | None = None
    ranking: tuple[RankedEffect, ...] = ()
    profiles: tuple[Profile, ...] = ()
    maps: tuple[PlateMap, ...] = ()
    steps: tuple[Step, ...] = ()
    proof: tuple[ProofRow, ...] = ()
    closed_loop: tuple[ClosedLoopRow, ...] = ()
    notes: tuple[str, ...] = ()
    noise: dict[str, float] = field(default_factory=dict)
    rig_before: Rig | None = None
    rig_after: Rig | None = None

    @property
    def known(self) -> Mapping[str, Effect]:
        """The effects that could be named, by name: those of the nominal rig."""
        return self.rig_before.catalogue if self.rig_before is not None else BY_NAME

    def to_json(self) -> dict[str, Any]:
        """The dictionary that `rig gap --json` prints: plain types, SI units but for keys that name
        another."""
        gap: dict[str, Any] = {
            "before": self.gap.before,
            "after": self.gap.after,
            "held_out": self.gap.held_out,
            "floor": self.gap.floor,
            "floor_si": self.gap.floors,
            "ahead_1s_mm": self.gap.ahead_1s_mm,
            "ahead_1s_deg": self.gap.ahead_1s_deg,
        }
        following = self.next_experiment
        left = self.unknown
        return {
            "verdict": self.verdict,
            "sentence": self.sentence,
            "where": [vars(w) for w in self.where],
            "effects": [_named(e) for e in self.effects],
            "unknown": {k: v for k, v in vars(left).items() if v is not None} if left else None,
            "untestable": [vars(u) for u in self.untestable],
            "calibrated": {k: vars(v) for k, v in self.calibrated.items()},
            "gap": gap,
            "next_experiment": vars(following) | {"separates": list(following.separates)}
            if following
            else None,
            "ranking": [vars(c) | {"twins": list(c.twins)} for c in self.ranking],
            "notes": list(self.notes),
        }


def _named(effect: Named) -> dict[str, Any]:
    parameters = {
        axis: {key: vars(interval) for key, interval in pairs.items()}
        for axis, pairs in effect.parameters.items()
    }
    if set(parameters) <= {"x", "y"}:
        parameters = {"x": {}, "y": {}} | parameters
    return {
        "name": effect.name,
        "probability": effect.probability,
        "twins": list(effect.twins),
        "parameters": parameters,
    }
