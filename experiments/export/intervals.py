"""The intervals of a `rig gap` answer for a model of the rig file's table."""

from pathlib import Path

from rig import intervals
from rig.intervals import Intervals
from rig.parameters import Rig


def read_intervals(path: Path, rig: Rig) -> tuple[Intervals, list[str]]:
    """Return {"effects.NAME.AXIS.KEY" or "servo.KEY": (low, high)}, and a line for each left out.

    Those of `rig.intervals.read_intervals`, but for a K or tau whose interval does not hold what
    the rig file says. ValueError (one line): not an answer of `rig gap`. OSError: it cannot be
    read.
    """
    found, told = intervals.read_intervals(path, "--intervals ")
    for name, (low, high) in list(found.items()):
        section, *words = name.split(".")
        value = getattr(rig.servo, words[0]) if section == "servo" else low
        if not low <= value <= high:
            del found[name]
            told.append(
                f"The interval of {name}, {low:g} to {high:g}, is not in it: the rig file says "
                f"{value:g}."
            )
    return found, told
