"""A name that stands twice in a file that is no text: one of the two columns was read, or none."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from experiments.importing.formats.choose import read_recording
from experiments.importing.recording import BadFileError

K = np.arange(30.0)


@pytest.mark.parametrize(
    ("names", "columns", "twice"),
    [
        (["t", "x", "x"], [K, K, 2 * K], "x"),
        (["t", "a", "a.x"], [K, [{"x": k} for k in K], K], "a.x"),
        (["t", "a", "a[1]"], [K, [[k, k] for k in K], K], "a[1]"),
    ],
)
def test_in_parquet(names: list[str], columns: list, twice: str, tmp_path: Path):
    path = tmp_path / "a.parquet"
    pq.write_table(pa.Table.from_arrays([pa.array(one) for one in columns], names=names), path)
    with pytest.raises(BadFileError) as caught:
        read_recording(path)
    assert f"a column's name stands twice: {twice}; rename" in str(caught.value)


@pytest.mark.parametrize(
    ("line", "twice"),
    [
        ('{"t": 1, "x": 1, "x": 2}', "x"),
        ('{"t": 1, "a": {"x": 1, "x": 2}}', "x"),
        ('{"t": 1, "a": {"x": 1}, "a.x": 2}', "a.x"),
    ],
)
def test_in_json_lines(line: str, twice: str, tmp_path: Path):
    path = tmp_path / "a.jsonl"
    path.write_text(f"{line}\n" * 30)
    with pytest.raises(BadFileError, match=f"stands twice: {twice}; rename"):
        read_recording(path)
