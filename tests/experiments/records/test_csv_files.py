"""A table of text is read block by block: what is too long is refused before it fills memory."""

import tracemalloc
from io import StringIO
from pathlib import Path

import pytest

from experiments.importing.formats.text_tables import text
from experiments.records import csv_files, importing
from experiments.records.csv_files import blocks_of, lines_of

ROWS = 300_000


def test_blocks_hold_a_bounded_number_of_cells(monkeypatch):
    monkeypatch.setattr(csv_files, "BLOCK_CELLS", 100)
    blocks = list(blocks_of(([str(i)] * 40 for i in range(10)), 40))
    assert [len(block) for block in blocks] == [3, 3, 3, 1]
    assert [row[0] for block in blocks for row in block] == [str(i) for i in range(10)]


def test_a_line_without_end_is_refused(monkeypatch):
    monkeypatch.setattr(csv_files, "LONGEST_LINE", 10)
    assert list(lines_of(StringIO("123456789\n1\n"))) == ["123456789\n", "1\n"]
    with pytest.raises(ValueError, match="more than 10 characters"):
        list(lines_of(StringIO("1\n12345678901\n")))


@pytest.fixture
def long(tmp_path: Path) -> Path:
    path = tmp_path / "long.csv"
    path.write_text("t_s,theta_x_rad\n" + "".join(f"{i / 500},0.25\n" for i in range(ROWS)))
    return path


def most_while(read) -> int:
    """Bytes that Python held at most meanwhile."""
    tracemalloc.start()
    try:
        read()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("read", [importing.READERS[".csv"], text.read_text])
def test_memory_is_that_of_the_numbers_and_a_block(long: Path, monkeypatch, read):
    """As text the cells take 60 bytes each, 36 MB; as numbers 5 MB, which grow by doubling."""
    monkeypatch.setattr(csv_files, "BLOCK_CELLS", 10_000)
    assert most_while(lambda: read(long)) < 20e6


def test_rows_are_counted_while_they_are_read(long: Path, monkeypatch):
    monkeypatch.setattr(importing, "MOST_ROWS", 1000)
    monkeypatch.setattr(csv_files, "BLOCK_CELLS", 1000)
    with pytest.raises(ValueError, match="more than 1000 rows"):
        importing.read_log(long)


def test_a_fault_far_down_is_named_by_its_row(long: Path, monkeypatch):
    monkeypatch.setattr(csv_files, "BLOCK_CELLS", 1000)
    lines = long.read_text().splitlines()
    lines[1234] = "2.466,abc"
    long.write_text("\n".join(lines))
    with pytest.raises(ValueError, match="row 1234: theta_x_rad is 'abc'"):
        importing.read_log(long)
    lines[1234] = "2.466"
    long.write_text("\n".join(lines))
    with pytest.raises(ValueError, match="line 1235 has 1 cells, not 2"):
        importing.read_log(long)
