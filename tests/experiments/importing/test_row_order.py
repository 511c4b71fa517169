"""Rows out of order, and tables side by side in one: what a row's moment is."""

from pathlib import Path

import numpy as np
import pytest

from experiments.importing.clock import read_clock
from experiments.importing.formats.choose import read_recording
from experiments.importing.import_map import TimeMap
from experiments.importing.recording import BadFileError, Recording

RNG = np.random.default_rng(3)
T = 0.02 * np.arange(400)


def read(path: Path, *columns: np.ndarray, names: str) -> Recording:
    cells = (["" if np.isnan(one) else f"{one:.4f}" for one in row] for row in np.stack(columns, 1))
    path.write_text("\n".join([names, *map(",".join, cells)]))
    return read_recording(path)


def swapped(values: np.ndarray) -> np.ndarray:
    out = values.copy()
    for k in range(5, 390, 20):
        out[[k, k + 1]] = out[[k + 1, k]]
    return out


def test_rows_that_threads_wrote_out_of_order_are_put_back(tmp_path: Path):
    jitter = RNG.uniform(-0.003, 0.003, 400)
    found = read(tmp_path / "a.csv", swapped(T + jitter), swapped(np.sin(T)), names="t_s,x")
    np.testing.assert_allclose(found.stream.columns["x"], np.sin(T), atol=1e-4)
    assert found.notes == ("rows that stood out of the order of t_s, put back: 40",)


def test_late_stamps_put_no_row_elsewhere(tmp_path: Path):
    late = T.copy()
    late[5:390:20] += 0.031
    found = read(tmp_path / "a.csv", late, np.sin(T), names="t_s,x")
    np.testing.assert_allclose(found.stream.columns["x"], np.sin(T), atol=1e-4)
    with pytest.raises(BadFileError, match=r"rows are in order and .*clock=even"):
        read_clock(found.stream, TimeMap(column="t_s"))
    even_s = read_clock(found.stream, TimeMap(column="t_s", clock="even")).t_s
    np.testing.assert_allclose(even_s, T, atol=0.01)


def test_a_second_run_is_no_row_out_of_order(tmp_path: Path):
    twice = np.concatenate((T, T))
    found = read(tmp_path / "a.csv", twice, np.sin(twice), names="t_s,x")
    np.testing.assert_allclose(found.stream.columns["t_s"], twice, atol=1e-4)


def camera(rows: int, step_s: float, times: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    clock = np.full(400, np.nan)
    clock[:rows] = step_s * np.arange(rows) + 0.001
    return times * clock, np.cos(clock)


@pytest.mark.parametrize(("name", "times"), [("t_cam_s", 1.0), ("t_cam_ms", 1000.0)])
def test_tables_side_by_side_keep_their_clocks(tmp_path: Path, name: str, times: float):
    clock, ball = camera(133, 0.06, times)
    blank = np.full(400, np.nan)
    names = f"t_servo_s,cmd,,{name},ball"
    found = read(tmp_path / "a.csv", T, np.sin(T), blank, clock, ball, names=names)
    at = np.flatnonzero(np.isfinite(found.stream.columns["ball"]))
    np.testing.assert_allclose(T[at], 0.06 * np.arange(133) + 0.02, atol=1e-9)
    assert any("tables side by side" in note for note in found.notes)


@pytest.mark.parametrize(
    "second", [T + 0.013, 0.8 * T, T + 1.7e9], ids=["exposure", "simulated", "wall"]
)
def test_a_second_time_of_the_same_rows_parts_nothing(tmp_path: Path, second: np.ndarray):
    names = "t_s,cmd,sim_time_s,ball"
    found = read(tmp_path / "a.csv", T, np.sin(T), second, np.cos(T), names=names)
    assert found.notes == ()
    assert np.isfinite(found.stream.columns["ball"]).all()
