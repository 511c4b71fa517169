"""What of a file was not read is told, also where the rest says nothing."""

from decimal import Decimal
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from experiments.importing.formats.choose import read_recording
from tests.support.command import told

K = np.arange(60.0)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A ball whose cells are lists, some of them blank, beside a clock."""
    lists = [[k, -k] if k % 7 else None for k in K]
    path = tmp_path / "a.parquet"
    pq.write_table(pa.table({"t_s": 0.02 * K, "ball_mm": lists}), path)
    return path


def test_in_the_line_that_refuses_the_rest(path: Path):
    code, _, line = told("import", path, "--out", path.with_name("out.csv"), "--yes")
    assert code == 2
    assert "none is left that changes; left out, no numbers or lists of one length: ball_mm" in line
    assert line.count("\n") == 1


def test_decimal_numbers_are_numbers(tmp_path: Path):
    path = tmp_path / "a.parquet"
    pq.write_table(pa.table({"t": K, "x": [Decimal(f"{k:.3f}") for k in K]}), path)
    found = read_recording(path)
    np.testing.assert_array_equal(found.stream.columns["x"], K)
    assert found.notes == ()
