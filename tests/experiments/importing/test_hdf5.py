"""HDF5 that no MATLAB wrote: groups, attributes, tables of named fields."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from experiments.importing.formats.choose import read_recording
from experiments.importing.recording import BadFileError

T = np.arange(50) * 0.02
PLACE = np.stack([np.sin(T), np.cos(T)], axis=1)


@pytest.mark.parametrize("name", ["a.h5", "a.hdf5"])
def test_groups_and_units_in_attributes(name: str, tmp_path: Path):
    path = tmp_path / name
    with h5py.File(path, "w") as file:
        file["time"] = T
        file["ball/xy"] = PLACE
        file["ball/xy"].attrs["units"] = "mm"
        file["time"].attrs["unit"] = np.bytes_("s")
    stream = read_recording(path).stream
    assert stream.time == "time"
    assert stream.units == {"time": "s", "ball.xy[1]": "mm", "ball.xy[2]": "mm"}
    np.testing.assert_array_equal(stream.columns["ball.xy[2]"], PLACE[:, 1])


def test_a_table_of_named_fields(tmp_path: Path):
    path = tmp_path / "a.h5"
    rows = np.zeros(50, dtype=[("t", "f8"), ("x", "f4"), ("mode", "S4")])
    rows["t"] = T
    with h5py.File(path, "w") as file:
        file["log"] = rows
    stream = read_recording(path).stream
    assert list(stream.columns) == ["log.t", "log.x"]
    assert stream.time == "log.t"


@pytest.mark.parametrize("data", [b"", b"\x89HDF\r\n\x1a\n" + bytes(50), b"no HDF5"])
def test_damaged_files_get_one_line(data: bytes, tmp_path: Path):
    path = tmp_path / "a.h5"
    path.write_bytes(data)
    with pytest.raises(BadFileError, match="not readable as an HDF5 file"):
        read_recording(path)
