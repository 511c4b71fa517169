"""One blind trial as plain data: what is hidden, in which table, and what the analysis sees."""

import json
from dataclasses import asdict, dataclass, field
from typing import Any

from rig.parameters import Rig
from rig.rigfile import from_dict, to_dict

KINDS = ("single", "pair", "shape", "stranger", "nothing", "realistic", "weak", "untestable")
KINDS += ("camera", "five")
ENGINES = ("own", "foreign", "mujoco", "camera")
BATTERY = ("steps", "pushed", "free-release", "sine-sweep")
Effects = dict[str, dict[str, dict[str, float]]]


@dataclass(frozen=True)
class Noise:
    """Noise of a log: multiples of the usual process and camera noise, colour and lost frames.

    colour: coefficient a of the camera noise as an AR(1) process, n_k = a n_(k-1) + sqrt(1 - a^2)
    w_k; dropped: share of lost frames.
    """

    process: float = 1.0
    camera: float = 1.0
    colour: float = 0.0
    dropped: float = 0.0  # share of frames, half of them in bursts of 5


@dataclass(frozen=True)
class BlindTrial:
    """The truth of one trial. Only `name` and `believed`, the nominal rig, reach the analysis.

    hidden: the effects to find, with their values; plant: the whole table; protocols: one log each.
    factor: amplitude over the smallest that counts (`sizes.smallest`), of the first hidden effect.
    Other effects of the plant lie within their tolerance of what the rig file says: naming them is
    an error. variant: which uncatalogued effect, noise or count; camera: how a
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
        """What the trial was recorded with: its only protocol's name, or "battery" for several."""
        return self.protocols[0] if len(set(self.protocols)) == 1 else "battery"

    @property
    def plant_rig(self) -> Rig:
        """The simulated table with all that is hidden. ValueError: `plant` is no rig's data."""
        return from_dict(self.plant)

    @property
    def nominal_rig(self) -> Rig:
        """The rig that the analysis is told of. ValueError: `believed` is no rig's data."""
        return from_dict(self.believed)


def rig_data(rig: Rig) -> dict[str, Any]:
    """The rig as JSON types (dict, list, number, string), which `rig.rigfile.from_dict` reads."""
    return json.loads(json.dumps(to_dict(rig)))


def to_plain(trial: BlindTrial) -> dict[str, Any]:
    """The trial's fields as a dict that `json.dumps` takes."""
    return asdict(trial)


def from_plain(data: dict[str, Any]) -> BlindTrial:
    """The trial of a dict that `to_plain` made, also after a way through JSON. KeyError, TypeError:
    fields are missing or unknown.
    """
    noise = Noise(**data["noise"])
    protocols, seeds = tuple(data["protocols"]), tuple(data["seeds"])
    return BlindTrial(**data | {"noise": noise, "protocols": protocols, "seeds": seeds})
