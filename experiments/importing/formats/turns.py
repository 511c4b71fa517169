"""Angles that begin anew at the end of a turn, or of a counter: 359.9 and then 0.1 degrees."""

from dataclasses import replace
from math import pi

import numpy as np

from experiments.importing.names import hint
from experiments.importing.recording import Stream

TURNS = {"deg": 360.0, "rad": 2 * pi, "mrad": 2000 * pi, "turn": 1.0}
COUNTERS = (2.0**12, 2.0**14, 2.0**16, 2.0**32)  # of magnetic encoders, and of bytes in a program
ANGLES = ("angle", "theta", "command")
WHOLE = 0.9  # chosen: of a turn, what such a column spans, and steps by, at least


def unwound(stream: Stream) -> Stream:
    """The stream with angles that go on over the end of their turn, as near 0 as they were; told by
    its notes. Only where every large step is a whole turn but for what a servo does in a row."""
    for name, values in stream.columns.items():
        one = hint(name, stream.units.get(name))
        unit = one.unit or ""
        ends = [TURNS[unit]] if unit in TURNS else COUNTERS if unit in ("", "counts") else []
        parts = unit.split("/")
        if parts[0] == "turn" and parts[-1].isdigit():
            ends = [float(parts[1])]
        whole = next((end for end in ends if one.role in ANGLES and _winds(values, end)), None)
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
    in between: what only jumps was commanded."""
    values = values[np.isfinite(values)]
    steps = np.abs(np.diff(values))
    if len(values) < 2 or not WHOLE * whole <= np.ptp(values) <= whole:
        return False
    ends, moves = steps >= WHOLE * whole, (steps > 0) & (steps <= (1 - WHOLE) * whole)
    return bool(np.all(ends | moves | (steps == 0)) and 0 < ends.sum() < moves.sum())
