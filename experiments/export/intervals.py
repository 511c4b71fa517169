"""The intervals of a `rig gap` answer (its JSON) by the names of the rig file's numbers."""

from pathlib import Path
from typing import Any

from rig.parameters import Rig
from rig.validation import printable, read_json

Intervals = dict[str, tuple[float, float]]
_SERVO = {
    "servo.gain_rad_s_V": "gain_{}_rad_s_V",
    "servo.time_constant_s": "time_constant_{}_s",
}


def read_intervals(path: Path, rig: Rig) -> tuple[Intervals, list[str]]:
    """Return {"effects.NAME.AXIS.KEY" or "servo.KEY": (low, high)}, and a line for each left out.

    A bound that the answer leaves open leaves the interval out. K and tau are one number for both
    axes in the rig file: the interval is that from the lower of both lows to the higher of both
    highs. ValueError (one line): not an answer of `rig gap`. OSError: it cannot be read.
    """
    try:
        answer = read_json(path.read_text(encoding="utf-8"))
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
        servo = _of_servo(answer.get("calibrated", {}))
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        what = f"{type(error).__name__}: {error}"
        raise ValueError(
            f"--intervals {path}: not what `rig gap LOG... --json FILE` writes ({what})"
        ) from None
    for name, (low, high) in servo.items():
        value = getattr(rig.servo, name.split(".")[1])
        if low <= value <= high:
            found[name] = (low, high)
        else:
            told.append(
                f"The interval of {name}, {low:g} to {high:g}, is not in it: the rig file says "
                f"{value:g}."
            )
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
