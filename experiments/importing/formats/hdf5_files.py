"""Read HDF5: data sets in groups, and tables of named fields; units stand in attributes."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from experiments.importing.formats.matlab import hdf5_tree, streams_of
from experiments.importing.recording import MIN_ROWS, BadFileError, Stream

UNIT_NAMES = ("unit", "units", "Unit", "Units", "UNIT", "UNITS")


def read_hdf5(path: Path) -> list[Stream]:
    """Read every array of MIN_ROWS or more, a column a path (`ball.x`); one stream a group that has
    a time of its own. BadFileError: damaged, too large, or nothing of it."""
    tree, _ = hdf5_tree(path, "an HDF5 file")
    units = _units(path)
    streams = [stream for stream in streams_of(tree) if len(stream)]
    if not streams:
        raise BadFileError(f"it holds no array of {MIN_ROWS} rows or more")
    return [
        replace(
            stream,
            units={n: units[n.split("[")[0]] for n in stream.columns if n.split("[")[0] in units},
        )
        for stream in streams
    ]


def _units(path: Path) -> dict[str, str]:
    """The units that attributes state, by the data sets' paths. BadFileError: damaged."""
    import h5py

    found: dict[str, str] = {}

    def look(name: str, value: Any) -> None:
        for key in UNIT_NAMES:
            said = value.attrs.get(key)
            said = said.decode(errors="replace") if isinstance(said, bytes) else said
            if isinstance(said, str):
                found[name.replace("/", ".")] = said

    try:
        with h5py.File(path, "r") as file:
            file.visititems(look)
    except Exception as error:  # of damaged bytes h5py raises whatever it meets
        raise BadFileError(f"not readable as an HDF5 file ({error})") from error
    return found
