"""The intervals of a `rig gap` answer (its JSON) by the names of the rig file's numbers, and tables
drawn from them.
"""

from collections.abc import Mapping
from dataclasses import replace
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from rig import effects
from rig.files import json_of, printable
from rig.parameters import Rig

Intervals = dict[str, tuple[float, float]]
_SERVO = {
    "servo.gain_rad_s_V": "gain_{}_rad_s_V",
    "servo.time_constant_s": "time_constant_{}_s",
}
TRIES = 1000  # chosen: where not one of so many draws is a table, the intervals are none of one


def read_intervals(path: Path, label: str = "") -> tuple[Intervals, list[str]]:
    """Return {"effects.NAME.AXIS.KEY" or "servo.KEY": (low, high)}, and a line for each left out.

    A bound that the answer leaves open leaves the interval out. K and tau are one number for both
    axes in the rig file: the interval is that from the lower of both lows to the higher of both
    highs. label: the option that names the file, for messages. ValueError (one line): not an
    answer of `rig gap`. OSError: it cannot be read.
    """
    try:
        answer = json_of(path)
    except ValueError as error:
        raise ValueError(f"{label}{path}: {error}") from None
    try:
        listed = [
            (printable(f"effects.{effect['name']}.{axis}.{key}"), ends)
            for effect in answer["effects"]
            for axis, keys in effect["parameters"].items()
            for key, ends in keys.items()
        ]
        found, told = {}, []
        for name, ends in listed:
            if ends["low"] is None or ends["high"] is None:
                told.append(f"The interval of {name} is open and not in it.")
            else:
                found[name] = (float(ends["low"]), float(ends["high"]))
        found |= _of_servo(answer.get("calibrated", {}))
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        what = f"{error} is missing" if isinstance(error, KeyError) else "a part is of another kind"
        raise ValueError(
            f"{label}{path}: not what `rig gap LOG... --json FILE` writes ({what})"
        ) from None
    return found, told


def _of_servo(calibrated: dict[str, Any]) -> Intervals:
    """K and tau of both axes together."""
    found = {}
    for name, label in _SERVO.items():
        ends = [calibrated[key] for n in "xy" if (key := label.format(n)) in calibrated]
        ends = [e for e in ends if e["low"] is not None and e["high"] is not None]
        if ends:
            found[name] = (min(float(e["low"]) for e in ends), max(float(e["high"]) for e in ends))
    return found


def check_intervals(rig: Rig, intervals: Mapping[str, tuple[float, float]]) -> None:
    """Raise ValueError (one line) where an interval is none or names no number that can be drawn,
    or where no table can be drawn from them (`drawn`).
    """
    for name, (low, high) in intervals.items():
        if not (low <= high and isfinite(high - low)):
            raise ValueError(f"interval of {name}, {low:g} to {high:g}: must be finite and rise")
        kind, *words = name.split(".")
        if name not in _SERVO and (kind != "effects" or len(words) != 3):
            known = ", ".join(["effects.NAME.AXIS.KEY", *_SERVO])
            raise ValueError(f"interval of '{name}': no number that can be drawn; known: {known}")
    drawn(rig, intervals, np.random.default_rng(0))


def drawn(rig: Rig, intervals: Mapping[str, tuple[float, float]], rng: np.random.Generator) -> Rig:
    """Return the rig with each number that has an interval drawn uniformly from it.

    intervals: those of `read_intervals`. Numbers are drawn together again where the rig file's
    checks refuse them (the middle of a play lies beyond its half). ValueError (one line): TRIES
    draws were refused, with the last reason.
    """
    names, why = sorted(intervals), ""
    ends = np.array([intervals[name] for name in names]).reshape(-1, 2)
    for _ in range(TRIES):
        values = dict(zip(names, rng.uniform(ends[:, 0], ends[:, 1]).tolist(), strict=True))
        try:
            return _with(rig, values)
        except ValueError as error:
            why = str(error)
    raise ValueError(f"no table can be drawn from these intervals: {why}")


def _with(rig: Rig, values: Mapping[str, float]) -> Rig:
    """The rig with these numbers, by the names of `read_intervals`, checked as a rig file's."""
    have = {name: {a: dict(v) for a, v in by.items()} for name, by in rig.effects.items()}
    servo = {}
    for name, value in values.items():
        kind, *words = name.split(".")
        if kind == "servo":
            servo[words[0]] = value
        else:
            effect, axis, key = words
            have.setdefault(effect, {}).setdefault(axis, {})[key] = value
    effects.check(have, rig.catalogue)
    return replace(rig, servo=replace(rig.servo, **servo), effects=have)
