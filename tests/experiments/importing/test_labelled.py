"""Lines that name each of their numbers, as microcontrollers send them to a serial plotter."""

from pathlib import Path

import numpy as np
import pytest

from experiments.importing.formats.text_tables.text import read_text
from experiments.importing.proposal import propose
from experiments.importing.recording import BadFileError

T_S = np.arange(0.0, 20.0, 0.02)
X_MM, Y_MM = 40 * np.sin(T_S), -30 * np.cos(1.3 * T_S)


def written(path: Path, line: str, before: str = "") -> Path:
    rows = [line.format(t=1e3 * t, x=x, y=y) for t, x, y in zip(T_S, X_MM, Y_MM, strict=True)]
    path.write_text(before + "".join(rows), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "line",
    [
        "time_ms:{t:.0f},ball_x_mm:{x:.2f},ball_y_mm:{y:.2f}\n",
        "time_ms={t:.0f} ball_x_mm={x:.2f} ball_y_mm={y:.2f}\r\n",
        "time_ms: {t:.0f}\tball_x_mm: {x:.2f}\tball_y_mm: {y:.2f}\n",
        "time_ms = {t:.0f}; ball_x_mm = {x:.2f}; ball_y_mm = {y:.2f};\n",
    ],
)
@pytest.mark.parametrize("before", ["", "ball balancer v2, ready\n"])
def test_each_number_goes_to_the_column_of_its_name(line: str, before: str, tmp_path: Path):
    (stream,) = read_text(written(tmp_path / "log.txt", line, before))
    assert list(stream.columns) == ["time_ms", "ball_x_mm", "ball_y_mm"]
    np.testing.assert_allclose(stream.columns["time_ms"], 1e3 * T_S)
    np.testing.assert_allclose(stream.columns["ball_x_mm"], X_MM, atol=0.006)
    np.testing.assert_allclose(stream.columns["ball_y_mm"], Y_MM, atol=0.006)


def test_words_within_names_and_numbers_with_exponents(tmp_path: Path):
    line = "Servo X [deg]: {x:.4e}, Servo Y [deg]: {y:+.4e}, t: {t:.0f}\n"
    (stream,) = read_text(written(tmp_path / "log.txt", line))
    assert list(stream.columns) == ["Servo X [deg]", "Servo Y [deg]", "t"]
    np.testing.assert_allclose(stream.columns["Servo Y [deg]"], Y_MM, rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("line", ["t: {t:.0f} ms, x: {x:.2f} mm, a = {y:.2f}°\n",
                                  "t={t:.0f}ms x={x:.2f}mm a={y:.2f}°\r\n"])  # fmt: skip
def test_a_unit_behind_a_number_is_its_columns(line: str, tmp_path: Path):
    (stream,) = read_text(written(tmp_path / "log.txt", line))
    assert list(stream.columns) == ["t [ms]", "x [mm]", "a [°]"]
    np.testing.assert_allclose(stream.columns["x [mm]"], X_MM, atol=0.006)


@pytest.mark.parametrize("level", ["INFO ", "[DEBUG]: ", "-> ", ""])
def test_a_programs_log_has_stamps_levels_and_places_in_brackets(level: str, tmp_path: Path):
    path = tmp_path / "log.txt"
    rows = [
        f"2024-03-11 14:05:{k:02d},500 {level}ball=({k}, -1.5e0) servo=[{k}; 90]" for k in range(50)
    ]
    path.write_text("\n".join(["2024-03-11 14:05:00,100 INFO camera opened", *rows]))
    (stream,) = read_text(path)
    *names, stamp = stream.columns
    assert names == ["ball[1]", "ball[2]", "servo[1]", "servo[2]"]
    assert stream.units == {stamp: "s"}
    np.testing.assert_allclose(np.diff(stream.columns[stamp]), 1.0)
    np.testing.assert_array_equal(stream.columns["servo[1]"], np.arange(50))


def test_a_long_line_of_blanks_does_not_hold_it_up(tmp_path: Path):
    path = tmp_path / "log.txt"
    path.write_text(("a" + " " * 1_000_000 + "b\n") * 3)
    with pytest.raises(BadFileError, match="1000001 columns"):
        read_text(path)


def test_a_name_that_is_a_unit_is_a_name(tmp_path: Path):
    (stream,) = read_text(written(tmp_path / "log.txt", "t={t:.0f} m = {x:.2f} s={y:.2f}\n"))
    assert list(stream.columns) == ["t", "m", "s"]


@pytest.mark.parametrize("line", ["t:1 ball lost\n", "x=1.2.3 y=4\n", "mode: run, x: 1\n"])
def test_lines_with_anything_else_are_no_rows(line: str, tmp_path: Path):
    path = tmp_path / "log.txt"
    path.write_text(line * 30)
    with pytest.raises(BadFileError, match="no rows of numbers"):
        read_text(path)


def test_a_line_that_was_cut_off_is_left_out_and_told(tmp_path: Path):
    path = written(tmp_path / "log.txt", "t:{t:.0f},x:{x:.2f},y:{y:.2f}\n")
    lines = path.read_text().splitlines()
    lines[7] = "t:140,x:"
    path.write_text("\n".join(lines) + "\n")
    (stream,) = read_text(path)
    assert len(stream.columns["t"]) == len(T_S) - 1
    assert "left out: 1" in stream.notes[0]
    path.write_text("\n".join([*lines, *lines[7:8] * 20]) + "\n")
    with pytest.raises(BadFileError, match="21 of 1020 lines"):
        read_text(path)


def test_what_a_line_does_not_name_is_no_number_in_it(tmp_path: Path):
    path = tmp_path / "log.txt"
    path.write_text("t:1,x:2\ny:3,t:4\n" * 50)
    (stream,) = read_text(path)
    np.testing.assert_array_equal(stream.columns["t"], [1, 4] * 50)
    np.testing.assert_array_equal(stream.columns["x"], [2, np.nan] * 50)
    np.testing.assert_array_equal(stream.columns["y"], [np.nan, 3] * 50)


def test_a_name_that_stands_twice_in_a_line_is_refused(tmp_path: Path):
    path = tmp_path / "log.txt"
    path.write_text("t:1,x:2,x:3\n" * 50)
    with pytest.raises(BadFileError, match="stands twice: x"):
        read_text(path)


def test_a_table_with_times_of_day_is_no_list_of_names(tmp_path: Path):
    path = tmp_path / "log.csv"
    path.write_text("when,x,y\n" + "".join(f"12:00:{i:02d}.5,{i},{-i}\n" for i in range(50)))
    assert list(read_text(path)[0].columns) == ["when", "x", "y"]


@pytest.mark.parametrize("name", ["Idő (ms)", "Čas [ms]"])
def test_a_clock_in_a_language_unknown_is_known_by_its_unit(name: str, tmp_path: Path):
    line = f"{name}: {{t:.0f}}, ball x mm: {{x:.2f}}, servo cmd x deg: {{y:.2f}}\n"
    (stream,) = read_text(written(tmp_path / "log.txt", line))
    time = propose(stream).draft["time"]
    assert (time["column"], time["unit"]) == (name, "ms")
