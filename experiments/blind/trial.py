"""One blind trial as plain data: what is hidden, in which table, and what the analysis is told."""

import json
from dataclasses import asdict, dataclass, field
from typing import Any

from rig.parameters import Rig
from rig.rigfile import from_dict, to_dict

KINDS = ("single", "pair", "shape", "stranger", "nothing", "realistic", "weak", "untestable")
KINDS += ("camera",)
ENGINES = ("own", "foreign", "mujoco", "camera")
BATTERY = ("steps", "pushed", "free-release", "sine-sweep")
Effects = dict[str, dict[str, dict[str, float]]]


@dataclass(frozen=True)
class Noise:
    """Noise of a log, as multiples of the usual; `colour` of the camera's is that of an AR(1)."""

    process: float = 1.0
    camera: float = 1.0
    colour: float = 0.0
    dropped: float = 0.0  # share of frames, half of them in bursts of 5


@dataclass(frozen=True)
class Trial:
    """The truth of one trial. Only `name` and what `believed` says reach the analysis.

    hidden: the effects to find, with their values; plant: the whole table; protocols: one log each.
    factor: amplitude over the smallest that counts (`sizes.smallest`), of the first hidden effect.
    Other effects of the plant lie within their tolerance of what the rig file says: naming them is
    an error. variant: which stranger, noise or count; camera: how a
    rendered camera is mounted (`through_camera.py`).
    """

    name: str
    kind: str
    variant: str
    protocols: tuple[str, ...]
    seeds: tuple[int, ...]
    plant: dict[str, Any]
    believed: dict[str, Any]
    hidden: Effects = field(default_factory=dict)
    factor: float = 0.0
    noise: Noise = Noise()
    stranger: dict[str, Any] | None = None
    engine: str = "own"
    camera: dict[str, Any] | None = None

    @property
    def battery(self) -> str:
        """What it was recorded with: a protocol's name, or "battery"."""
        return self.protocols[0] if len(set(self.protocols)) == 1 else "battery"

    @property
    def plant_rig(self) -> Rig:
        return from_dict(self.plant)

    @property
    def believed_rig(self) -> Rig:
        return from_dict(self.believed)


def rig_data(rig: Rig) -> dict[str, Any]:
    """The rig as JSON gives it back, lists for tuples."""
    return json.loads(json.dumps(to_dict(rig)))


def to_plain(trial: Trial) -> dict[str, Any]:
    """The trial as JSON takes it."""
    return asdict(trial)


def from_plain(data: dict[str, Any]) -> Trial:
    """`to_plain` backwards."""
    noise = Noise(**data["noise"])
    protocols, seeds = tuple(data["protocols"]), tuple(data["seeds"])
    return Trial(**data | {"noise": noise, "protocols": protocols, "seeds": seeds})
