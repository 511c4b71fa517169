"""What the gap workflow found, as plain data: the answer that JSON, report and page are made of.

Gaps are RMS innovations over one noise floor a channel, the same before and after; 1.0 is a perfect
model. Channels: servo_x, servo_y, ball_x, ball_y.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rig.parameters import Rig

VERDICTS = ("named", "nothing-missing", "unknown-effect", "undecided")
UNITS = {"servo_x": "rad", "servo_y": "rad", "ball_x": "m", "ball_y": "m"}


@dataclass(frozen=True)
class Interval:
    """A value with its 95 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Profile:
    """The gap of one channel over one quantity: where in time or state the model is wrong.

    quantity: "time", "position", "speed", "direction", "after reversal", "voltage"; unit of
    `edges`; edges (n + 1,) and gap (n,), NaN where too few samples (`count` (n,)) fell.
    """

    channel: str
    quantity: str
    unit: str
    edges: np.ndarray
    gap: np.ndarray
    count: np.ndarray


@dataclass(frozen=True, eq=False)
class PlateMap:
    """Mean innovation of the ball over the plate, in floors: x_edges (n + 1,), y_edges (m + 1,),
    mean (m, n, 2) of the x and y channels and count (m, n)."""

    x_edges: np.ndarray
    y_edges: np.ndarray
    mean: np.ndarray
    count: np.ndarray


@dataclass(frozen=True)
class Where:
    channel: str
    region: str
    gap: float


@dataclass(frozen=True)
class Candidate:
    """One name of the ranking: score = gain in log-likelihood beyond its parameters' own."""

    name: str
    score: float
    probability: float
    twins: tuple[str, ...] = ()


@dataclass(frozen=True)
class Named:
    """An effect that is missing from the model. parameters: axis -> key -> interval."""

    name: str
    probability: float
    twins: tuple[str, ...]
    parameters: dict[str, dict[str, Interval]]


@dataclass(frozen=True)
class Leftover:
    """What no name explains: its channel, its shape in words, and a formula if one holds."""

    channel: str
    shape: str
    formula: str | None = None


@dataclass(frozen=True)
class Untestable:
    name: str
    why: str
    smallest: dict[str, float]


@dataclass(frozen=True)
class Step:
    """The gaps by channel after an effect was added (`added` = "" for the model as it came)."""

    added: str
    gap: dict[str, float]


@dataclass(frozen=True)
class ProofRow:
    """One model on held-out data: its gap by channel and its error 1 s ahead [mm]."""

    model: str  # "nothing added", "best rival: NAME", "unnamed term", "named: NAME + NAME"
    gap: dict[str, float]
    ahead_1s_mm: float | None


@dataclass(frozen=True)
class ClosedLoopRow:
    """One quantity of the recorded protocol: measured, simulated before and after."""

    quantity: str  # "limit cycle amplitude", "limit cycle period", "settling time", "spread"
    unit: str
    measured: float
    before: float
    after: float


@dataclass(frozen=True)
class Gap:
    before: dict[str, float] = field(default_factory=dict)
    after: dict[str, float] = field(default_factory=dict)
    floor: str = "fullest model"  # or "repeated runs"
    held_out: bool = False
    floors: dict[str, float] = field(default_factory=dict)  # channel -> floor [rad or m]
    ahead_1s_mm: dict[str, float] = field(default_factory=dict)  # before, after, floor


@dataclass(frozen=True)
class NextExperiment:
    """separation: expected score between the two names, per run of the protocol."""

    protocol: str
    separates: tuple[str, str]
    seconds: float
    separation: float = 0.0


@dataclass(frozen=True, eq=False)
class Findings:
    """The whole answer of `rig gap`; lists are empty for the stages that did not run."""

    verdict: str
    sentence: str
    where: tuple[Where, ...] = ()
    effects: tuple[Named, ...] = ()
    unknown: Leftover | None = None
    untestable: tuple[Untestable, ...] = ()
    calibrated: dict[str, Interval] = field(default_factory=dict)
    gap: Gap = field(default_factory=Gap)
    next_experiment: NextExperiment | None = None
    ranking: tuple[Candidate, ...] = ()
    profiles: tuple[Profile, ...] = ()
    maps: tuple[PlateMap, ...] = ()
    steps: tuple[Step, ...] = ()
    proof: tuple[ProofRow, ...] = ()
    closed_loop: tuple[ClosedLoopRow, ...] = ()
    notes: tuple[str, ...] = ()
    noise: dict[str, float] = field(default_factory=dict)  # process, camera, colour as estimated
    rig_before: Rig | None = None
    rig_after: Rig | None = None

    def to_json(self) -> dict[str, Any]:
        """The dictionary of `rig gap --json` (the contract of DESIGN.md)."""
        gap: dict[str, Any] = {
            "before": self.gap.before,
            "after": self.gap.after,
            "held_out": self.gap.held_out,
            "floor": self.gap.floor,
            "floor_si": self.gap.floors,
            "ahead_1s_mm": self.gap.ahead_1s_mm,
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
