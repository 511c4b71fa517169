"""Parquet files that unpack to more than they hold: refused by what they say of themselves."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from experiments.importing.formats.tables import read_parquet
from experiments.importing.recording import BadFileError
from experiments.records.importing import read_log
from experiments.records.parquet_files import numbers_of

ROWS = 100_000


@pytest.fixture
def long_text(tmp_path: Path):
    """A file in which the column of this name is one text of 20 kB, 100 000 times: 2 GB."""

    def write(name: str) -> Path:
        one, every = pa.array(["x" * 20_000]), pa.array(np.zeros(ROWS, "i4"))
        text = pa.DictionaryArray.from_arrays(every, one)
        table = pa.table({"t_s": np.arange(ROWS) / 500, "theta_y_rad": np.zeros(ROWS), name: text})
        pq.write_table(table, tmp_path / "f.parquet", use_dictionary=True, store_schema=False)
        return tmp_path / "f.parquet"

    return write


def grown_by(read) -> int:
    """Bytes that arrow allocated at most meanwhile."""
    pool = pa.default_memory_pool()
    before = pool.max_memory()
    read()
    return pool.max_memory() - before


def test_a_text_in_place_of_an_angle_is_refused_before_it_is_read(long_text):
    def read():
        with pytest.raises(ValueError, match="column 'theta_x_rad' holds no numbers"):
            read_log(long_text("theta_x_rad"))

    assert grown_by(read) < 1e8


def test_an_import_leaves_text_where_it_is(long_text):
    def read():
        (stream,) = read_parquet(long_text("note"))
        assert set(stream.columns) == {"t_s", "theta_y_rad"}

    assert grown_by(read) < 1e8


def test_lists_are_counted_by_their_values(tmp_path: Path):
    lists = pa.array([[0.0] * 1000] * 100)
    pq.write_table(pa.table({"t": np.arange(100.0), "state": lists}), tmp_path / "f.parquet")
    with pq.ParquetFile(tmp_path / "f.parquet") as file:
        assert numbers_of(file, 100_100) == ["t", "state.list.element"]
        with pytest.raises(ValueError, match=r"100100 numbers \(limit: 100099\)"):
            numbers_of(file, 100_099)


def test_numbers_of_every_size_and_times_are_read(tmp_path: Path):
    times = pa.array(np.arange(50), pa.timestamp("ms"))
    table = pa.table(
        {
            "half": pa.array(np.arange(50, dtype=np.float16)),
            "decimal": pa.array(range(50), pa.decimal128(30, 2)),
            "flag": pa.array([True] * 50),
            "when": times,
            "inner": pa.StructArray.from_arrays([pa.array(np.arange(50.0))], ["angle"]),
            "name": pa.array(["x"] * 50),
        }
    )
    pq.write_table(table, tmp_path / "f.parquet")
    with pq.ParquetFile(tmp_path / "f.parquet") as file:
        found = numbers_of(file, 1000)
    assert found == ["half", "decimal", "flag", "when", "inner.angle"]
    (stream,) = read_parquet(tmp_path / "f.parquet")
    assert {"half", "flag", "when", "inner.angle"} <= set(stream.columns)


def test_a_damaged_file_stays_one_line(tmp_path: Path):
    (tmp_path / "f.parquet").write_bytes(b"PAR1" + bytes(100) + b"PAR1")
    with pytest.raises(BadFileError, match="not readable as Parquet"):
        read_parquet(tmp_path / "f.parquet")


def test_a_wrong_checksum_is_refused_where_the_file_has_one(tmp_path: Path):
    """One flipped bit of a double, which is a number like another without it."""
    path, columns = tmp_path / "a.parquet", {}
    for name in ("t_s", "theta_x_rad", "theta_y_rad", "voltage_x_V", "voltage_y_V"):
        columns[name] = 0.02 * np.arange(100.0)
    for has_checksum in (True, False):
        pq.write_table(
            pa.table(columns), path, write_page_checksum=has_checksum,
            use_dictionary=False, compression="none",
        )  # fmt: skip
        data = bytearray(path.read_bytes())
        data[data.index(np.float64(0.02 * 50).tobytes()) + 4] ^= 1
        path.write_bytes(data)
        if has_checksum:
            for read, error in ((read_parquet, BadFileError), (read_log, ValueError)):
                with pytest.raises(error, match="not readable as Parquet"):
                    read(path)
        else:
            assert len(read_parquet(path)[0]) == 100
