"""Decimal points and commas, and the marks between thousands: read right, or refused."""

from pathlib import Path

import numpy as np
import pytest

from experiments.importing.conversion import convert
from experiments.importing.formats.text_tables.text import read_text
from experiments.importing.import_map import ImportMap
from experiments.importing.recording import BadFileError, Stream

ROWS = 60
T = [k / 50 for k in range(ROWS)]


def table(folder: Path, separator: str, *columns: list[str]) -> Path:
    path = folder / "table.csv"
    quoted = [[f'"{c}"' if separator in c else c for c in cells] for cells in columns]
    rows = [separator.join(cells) for cells in zip(*quoted, strict=True)]
    names = separator.join(["t", "u", "v"][: len(columns)])
    path.write_text("\n".join([names, *rows]))
    return path


def read(path: Path) -> Stream:
    (stream,) = read_text(path)
    return stream


def german(value: float, decimals: int) -> str:
    return f"{value:,.{decimals}f}".translate(str.maketrans(",.", ".,"))


VALUES = [float(v) for v in np.round(np.linspace(-1500, 1500, ROWS), 1)]


@pytest.mark.parametrize("decimals", [0, 1])
@pytest.mark.parametrize(
    ("separator", "write"), [(";", german), (",", lambda v, d: f"{v:,.{d}f}"), ("\t", german)]
)
def test_thousands_are_no_decimals(tmp_path: Path, separator, write, decimals):
    """Volts in whole mV, of which those from 1000 on have a mark in them."""
    cells = [write(value, decimals) for value in VALUES]
    stream = read(table(tmp_path, separator, [write(t, 3) for t in T], cells))
    assert stream.columns["t"] == pytest.approx(T)
    assert stream.columns["u"] == pytest.approx([round(v, decimals) for v in VALUES])
    assert stream.unreadable == {}


def test_a_column_with_decimal_points_stands_beside_one_with_commas(tmp_path: Path):
    cells = [f"{value / 1000:.3f}" for value in VALUES]
    stream = read(table(tmp_path, ";", [german(t, 3) for t in T], cells))
    assert stream.columns["u"] == pytest.approx([round(v / 1000, 3) for v in VALUES])


@pytest.mark.parametrize(
    ("clock", "cells"),
    [
        ("0,5", ["1.250", "2.375"]),  # thousands, or three decimals of a program that mixes
        ("0.5", ["1,250", "2,375"]),
        ("0,5", ["1.250", "1250"]),
        ("7", ["1,250", "2"]),
        ("7", ["1.250", "1,250"]),
    ],
)
def test_what_may_be_either_is_refused(tmp_path: Path, clock: str, cells: list[str]):
    path = table(tmp_path, ";", [clock] * ROWS, [cells[k % 2] for k in range(ROWS)])
    with pytest.raises(BadFileError, match=r"column 'u': 1[.,]250 may be 1250 or 1.25 there"):
        read(path)


def test_points_and_commas_in_one_column_are_refused(tmp_path: Path):
    cells = [("0.5", "0,5")[k % 2] for k in range(ROWS)]
    with pytest.raises(BadFileError, match="'u' has numbers with a decimal point and with a"):
        read(table(tmp_path, ";", [str(t) for t in range(ROWS)], cells))


def test_three_decimals_without_any_comma_are_decimals(tmp_path: Path):
    path = table(tmp_path, ";", list(map(str, range(ROWS))), ["1.250", "2"] * (ROWS // 2))
    assert read(path).columns["u"].tolist() == [1.25, 2.0] * (ROWS // 2)


@pytest.mark.parametrize("other", ["1.5", "1,5"])
def test_a_cell_with_an_underscore_is_no_number(tmp_path: Path, other: str):
    """`46_26340`, as of two writers in one file, was 4626340."""
    cells = [*[other] * (ROWS - 2), "46_26340", "7_3.5"]
    stream = read(table(tmp_path, ";", list(map(str, range(ROWS))), cells))
    assert np.isnan(stream.columns["u"][-2:]).all()
    assert stream.columns["u"][:-2].tolist() == [1.5] * (ROWS - 2)
    assert (stream.unreadable["u"].digits, stream.unreadable["u"].first) == (2, "46_26340")


MAP = {
    "time": {"column": "t", "unit": "s"},
    "signals": {
        "voltage_x_V": {"column": "u", "unit": "V"},
        "ball_x_m": {"column": "v", "unit": "m"},
    },
}


def logs(folder: Path, volts: dict[int, str], ball: str = "0.1", rows: int = 400):
    cells = [volts.get(k, "1.5") for k in range(rows)]
    balls = [ball if k % 2 else "0.2" for k in range(rows)]
    clock = [f"{k / 50:.2f}" for k in range(rows)]
    return convert(read(table(folder, ";", clock, cells, balls)), ImportMap.model_validate(MAP))


def test_cells_that_are_no_numbers_are_told_and_never_held_in_silence(tmp_path: Path):
    (log,) = logs(tmp_path, {5: "1'250", 9: "overload", 11: "", 12: "NaN"})
    assert log.notes == ("2 of 400 cells of column 'u' are no numbers: taken as blank",)
    with pytest.raises(BadFileError, match=r"6 of 400 .* 'u' are no numbers .*'1'250'\): mend"):
        logs(tmp_path, dict.fromkeys(range(6), "1'250"))
    (log,) = logs(tmp_path, {}, ball="lost")  # words tell that it was not seen
    assert log.notes == ()
    with pytest.raises(BadFileError, match=r"200 of 400 cells of column 'v' are no numbers"):
        logs(tmp_path, {}, ball="1 250")
