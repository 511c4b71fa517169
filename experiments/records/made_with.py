"""What was a run made with: source, table, protocol, rig and gains, entry by entry?"""

from contextlib import suppress
from pathlib import Path
from typing import Any

from experiments.records.run_folder import protocol_of
from rig.files import json_of

Entries = dict[str, Any]  # "section.key" -> value
# Of a protocol: its words, and what tells the repetitions of one plan apart.
_NOT_COMPARED = ("protocol.title", "protocol.arms", "protocol.seed", "protocol.repetitions")


def entries(folder: Path, meta: dict) -> Entries:
    """What a run was made with, from its folder and its run.json; of a simulated one the plant's
    own numbers, with the controller's gains."""
    rig = meta.get("rig") or {}
    plant = rig
    if meta.get("source") == "simulated":
        with suppress(OSError, ValueError, TypeError, KeyError):
            plant = dict(json_of(folder / "truth.json")["rig"])
            plant["gains"] = rig["gains"]
    told = {key: meta[key] for key in ("source", "table", "camera") if meta.get(key)}
    found = _flat({**told, "protocol": protocol_of(meta), **plant})
    found |= {"effects": True} if "effects" in plant else {}  # said, whether any or none
    return {key: value for key, value in found.items() if key not in _NOT_COMPARED}


def of_table(made: Entries) -> Entries:
    """The entries of the table alone, whatever is done with it, controls it and looks at it."""
    others = ("protocol.", "gains.", "camera")
    return {key: value for key, value in made.items() if not key.startswith(others)}


def _flat(data: dict[str, Any], before: str = "") -> Entries:
    found: Entries = {}
    for key, value in data.items():
        name = f"{before}{key}"
        if isinstance(value, dict):
            found |= _flat(value, f"{name}.")
        else:
            found[name] = value
    return found
