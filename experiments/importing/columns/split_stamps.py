"""A time in two columns of a table, as `sec` and `nanosec`: whole seconds and the part of one."""

import re
from dataclasses import replace

import numpy as np

from experiments.importing.recording import Stream
from experiments.importing.units import FACTORS, canonical

_NAME = re.compile(r"(.*?)[\s._\[(]*([A-Za-zµμ]+)[\])]?")
MIN_GROWING = 0.95  # share of steps forwards of a clock's stamps


def whole_stamps(stream: Stream) -> Stream:
    """The stream with one column for a time in two, under the name of the seconds; told by its
    notes. The two are called alike but for the unit."""
    parts: dict[str, dict[str, str]] = {}
    for name in stream.columns:
        if (match := _NAME.fullmatch(name)) and (unit := canonical(match[2])) in FACTORS["time"]:
            parts.setdefault(match[1], {})[unit] = name
    for names in parts.values():
        if len(names) != 2 or "s" not in names:
            continue
        seconds = names.pop("s")
        ((unit, part),) = names.items()
        size = FACTORS["time"][unit] or 1.0
        stamps = stream.columns[seconds] + stream.columns[part] * size
        known = np.isfinite(stamps)
        whole, fine = stream.columns[seconds][known], stream.columns[part][known] * size
        split = np.all((fine >= 0) & (fine < 1) & (whole % 1 == 0)) and known.sum() > 2
        if split and np.mean(np.diff(stamps[known]) > 0) >= MIN_GROWING:
            kept = {n: v for n, v in stream.columns.items() if n != part} | {seconds: stamps}
            told = f"{seconds} and {part} are one time"
            units = {**stream.units, seconds: "s"}
            stream = replace(stream, columns=kept, units=units, notes=(*stream.notes, told))
    return stream
