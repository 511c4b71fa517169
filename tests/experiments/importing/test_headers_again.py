"""A second header in a table of text: skipped where it is the first one, else no other reading."""

from pathlib import Path

import pytest

from experiments.importing.formats.choose import read_recording
from experiments.importing.recording import BadFileError

HEADER = "t [s];x [mm];y [mm]"
ROWS = [f"{k / 50};{k % 7};lost" for k in range(400)]


def written(folder: Path, *lines: str) -> Path:
    path = folder / "a.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("again", [[HEADER], ["# t [s]; x [mm];y [mm]", "s;mm;mm"]])
def test_the_same_one_is_skipped_and_told(again: list[str], tmp_path: Path):
    path = written(tmp_path, HEADER, "s;mm;mm", *ROWS, *again, *ROWS)
    found = read_recording(path)
    assert list(found.stream.columns) == ["t [s]", "x [mm]", "y [mm]"]
    assert len(found.stream) == 800
    assert found.stream.unreadable["y [mm]"].count == 800
    told = f"lines that name the columns again, left out: {len(again)}"
    assert found.notes == (told,)


@pytest.mark.parametrize("first", [[HEADER], []])
@pytest.mark.parametrize("again", ["t [s];y [mm];x [mm]", "t [s];x [cm];y [cm]", "s;cm;cm"])
@pytest.mark.parametrize("at", [100, 400])
def test_another_one_is_refused(first: list[str], again: str, at: int, tmp_path: Path):
    path = written(tmp_path, *first, "", *ROWS[:at], again, *ROWS[at:])
    line = rf"line {len(first) + at + 1} \(blank ones not counted\) names its columns anew"
    with pytest.raises(BadFileError, match=line):
        read_recording(path)


def test_rows_with_few_words_or_any_number_are_rows(tmp_path: Path):
    path = written(tmp_path, HEADER, *ROWS, "7.98;lost;lost", ";;stop", "1 2;3,4,5;6 7", *ROWS[:9])
    assert len(read_recording(path).stream) == 412
