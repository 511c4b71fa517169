"""Angles that begin anew at the end of a turn, or of a counter: 359.9 and then 0.1 degrees."""

from dataclasses import replace
from math import pi

import numpy as np

from experiments.importing.names import hint
from experiments.importing.recording import Stream
from experiments.importing.units import factor, quantity

COUNTERS = (2.0**12, 2.0**14, 2.0**16, 2.0**32)  # of magnetic encoders, and of bytes in a program
ANGLES = ("angle", "theta", "command")
WHOLE = 0.9  # chosen: of a turn, what such a column spans, and steps by, at least
FASTER = 2.0  # chosen: than at any other time nothing passes the end


def unwound(stream: Stream) -> Stream:
    """The stream with angles that go on over the end of their turn, as near 0 as they were; told by
    its notes. Only where every large step is a whole turn but for what a servo does in a row.

    Counts without a turn are an encoder's: a servo's code may jump from one end to the other."""
    for name, values in stream.columns.items():
        one = hint(name, stream.units.get(name))
        unit = one.unit or ""
        ends: tuple[float, ...] = ()
        if one.role in ANGLES and quantity(unit) == "angle":
            ends = (2 * pi / (factor(unit, "theta_x_rad") or 1.0),)
        elif one.role == "theta" and unit in ("", "counts"):
            ends = COUNTERS
        whole = next((end for end in ends if _winds(values, end)), None)
        if whole is not None:
            known = np.isfinite(values)
            steps = np.diff(values[known])
            turns = np.concatenate(([0], np.cumsum(np.round(steps / whole))))
            straight = values.copy()
            straight[known] -= whole * turns
            straight -= whole * np.round(np.nanmedian(straight) / whole)
            note = f"{name} goes on over {whole:.6g}, a turn"
            columns = {**stream.columns, name: straight}
            stream = replace(stream, columns=columns, notes=(*stream.notes, note))
    return stream


def _winds(values: np.ndarray, whole: float) -> bool:
    """Whether a column (n,) spans a turn, and leaves it at one end to come in at the other, moving
    in between as fast: what only jumps was commanded, or stands for nothing (0 of a lost encoder).
    """
    values = values[np.isfinite(values)]
    steps = np.abs(np.diff(values))
    if len(values) < 2 or not WHOLE * whole <= np.ptp(values) <= whole:
        return False
    ends, moves = steps >= WHOLE * whole, (steps > 0) & (steps <= (1 - WHOLE) * whole)
    if not (np.all(ends | moves | (steps == 0)) and 0 < ends.sum() < moves.sum()):
        return False
    return bool(np.max(whole - steps[ends]) <= FASTER * np.max(steps[moves]))
