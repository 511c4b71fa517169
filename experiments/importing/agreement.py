"""Whether a further recording says of itself what the map says that was made from another one."""

from collections.abc import Mapping
from math import pi
from typing import Any

import numpy as np

from experiments.importing.clock import read_clock
from experiments.importing.draft import Proposal
from experiments.importing.import_map import ImportMap, SignalMap, Stated, TimeMap
from experiments.importing.recording import Stream
from experiments.importing.roles import STEPS_S
from experiments.importing.units import canonical, factor, family

ASKED = ("column", "unit", "sign")  # what the recordings of one rig have in common
LOST = (
    "absent",
    "absent_alone",
    "held_rows",
    "seen",
)  # where more may be in one of them than in another


def contradiction(made: ImportMap, found: Proposal) -> str:
    """What a file's own proposal says otherwise than the map, in words; "" for nothing. What the
    file leaves in doubt says nothing, but for its time, and for when its ball was seen, of which
    the map says nothing.
    """
    doubts = {(doubt.place, doubt.key): doubt.why for doubt in found.doubts}
    told = any(signal.seen for signal in made.signals.values())
    for (place, key), why in doubts.items():
        if place == "time" or (key == "seen" and not told):
            return why
    time = {**found.draft["time"]}
    for key in ("column", "unit"):
        if time.get(key, _default(TimeMap, key)) != getattr(made.time, key):
            return f"its time has another {key}: {time.get(key)}"
    for name, signal in found.draft["signals"].items():
        own = made.signals.get(name)
        if own is None:
            continue
        for key in ASKED:
            sure = (name, key) not in doubts and (family(name), key) not in doubts
            says = signal.get(key, _default(SignalMap, key))
            if sure and says is not None and says != getattr(own, key):
                return f"its own {name}.{key} is {says}, not {getattr(own, key)}"
        if _turned(name, signal, own):
            return f"its own {name}.offset is about {signal['offset']:g}, not {own.offset:g}"
        for key in LOST:
            sure = (name, key) not in doubts and (family(name), key) not in doubts
            if sure and not _covered(signal.get(key, ()), own):
                return f"its own {name}.{key} is {signal[key]}, by which no ball is there"
    return ""


def _turned(name: str, signal: Mapping[str, Any], own: SignalMap) -> bool:
    """Whether a file's plate is level more than half a turn from where the map's is: angles go on
    over a turn's end only in files that pass it."""
    size = factor(own.unit, name) if family(name) in ("theta", "command") else None
    return size is not None and abs(signal.get("offset", 0.0) - own.offset) * size > pi


def _covered(lost: int | tuple[float | str, ...], own: SignalMap) -> bool:
    """Whether the map takes for no ball what a file's proposal does: some codes, other columns'
    conditions, or places that are held for so many rows."""
    if isinstance(lost, int):
        return not lost or own.held_rows > 0
    return {*lost} <= {*own.absent, *own.absent_alone, *own.seen}


def other_unit(made: ImportMap, stream: Stream, said: Stated, first: Stream | None = None) -> str:
    """The unit that a file itself states for a mapped column, in a row of units or as its format
    does, where it is not the map's, in words; "" for none. What was `said` holds for all files;
    what the map's `first` file states, too, was understood."""
    for name, own in {"time": made.time, **made.signals}.items():
        unit = _stated(stream, own.column, name)
        known = (own.unit, _stated(first, own.column, name) if first else None)
        if unit is not None and unit not in known and "unit" not in said.get(name, {}):
            return f"its own {name}.unit is {unit}, not {own.unit}"
    return ""


def other_pace(made: ImportMap, stream: Stream) -> str:
    """Why the rows of a file are no table's in the unit of the map's time, which may have been
    stated for another file, in words; "" where they may be. BadFileError: of `read_clock`."""
    steps = np.diff(read_clock(stream, made.time).unrolled)
    usual_s = float(np.median(steps[np.isfinite(steps)])) if np.isfinite(steps).any() else 0.0
    if not usual_s or STEPS_S[0] <= usual_s <= STEPS_S[1]:
        return ""
    return f"its rows would be {usual_s:.4g} s apart"


def _stated(stream: Stream, column: str | None, name: str) -> str | None:
    """The unit that the file states for a column; None: none of which a signal, or time, is."""
    unit = canonical(stream.units.get(column or "", ""))
    try:
        factor(unit or "", "t_s" if name == "time" else name)
    except ValueError:
        return None
    return unit


def _default(kind: type[TimeMap] | type[SignalMap], key: str) -> object:
    default = kind.model_fields[key].get_default()
    return None if default is ... else default
