"""HDF5 that no MATLAB wrote: groups, attributes, tables of named fields."""

import zlib
from pathlib import Path

import h5py
import numpy as np
import pytest

from experiments.importing.formats.choose import read_recording
from experiments.importing.recording import BadFileError
from experiments.records.mat_files import read_mat

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


def packed_zeros(count: int) -> bytes:
    packer, block = zlib.compressobj(9), bytes(1 << 20)
    return b"".join(packer.compress(block) for _ in range(count >> 20)) + packer.flush()


@pytest.mark.parametrize(("times", "rows"), [(1, 50), (2, 50), (1, 10_000_000)])
@pytest.mark.parametrize("end", ["h5", "mat"])
def test_a_chunk_that_unpacks_to_more_than_it_holds_is_refused(
    end: str, times: int, rows: int, tmp_path: Path
):
    """4 kB, packed three times over, became 3 GB; HDF5 unpacks a chunk whatever size it claims."""
    path = tmp_path / f"a.{end}"
    with h5py.File(path, "w", userblock_size=512) as file:
        made = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        made.set_chunk((rows,))
        for _ in range(times):
            made.set_deflate(9)
        space = h5py.h5s.create_simple((50,), (h5py.h5s.UNLIMITED,))
        x = h5py.h5d.create(file.id, b"t_s", h5py.h5t.IEEE_F64LE, space, made)
        chunk = packed_zeros(1 << 27)
        x.write_direct_chunk((0,), zlib.compress(chunk, 9) if times == 2 else chunk)
    head = b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM"
    path.write_bytes(head + path.read_bytes()[len(head) :])
    with pytest.raises(BadFileError, match="t_s unpacks to more than it holds"):
        read_recording(path)
    with pytest.raises(ValueError, match="t_s unpacks to more than it holds"):
        read_mat(path)


@pytest.mark.parametrize("packed", [{"compression": "gzip"}, {"compression": "lzf"}, {}])
def test_packed_columns_are_read(packed: dict, tmp_path: Path):
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        for name in ("t", "x"):
            file.create_dataset(name, data=T, shuffle=True, fletcher32=True, **packed)
    assert len(read_recording(path).stream) == 50
