"""What programs of laboratories save: pandas' JSON, dSPACE's captures, long form, serial logs."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from experiments.importing.formats.choose import read_recording
from experiments.importing.names import hint

T = 0.02 * np.arange(60)
X = np.round(30 * np.sin(T), 3)
NAMES = ["time_s", "ball_x_mm"]


def rows(names: list[str] = NAMES) -> list[dict[str, float]]:
    return [dict(zip(names, row, strict=True)) for row in zip(T, X, strict=True)]


@pytest.mark.parametrize(
    "whole",
    [
        {"columns": NAMES, "index": [*range(60)], "data": np.stack((T, X), 1).tolist()},
        {n: {str(i): v for i, v in enumerate(each)} for n, each in zip(NAMES, (T, X), strict=True)},
        {str(i): row for i, row in enumerate(rows())},
    ],
    ids=["split", "columns", "index"],
)
def test_a_table_as_pandas_writes_json(tmp_path: Path, whole: dict):
    path = tmp_path / "df.json"
    path.write_text(json.dumps(whole))
    columns = read_recording(path).stream.columns
    assert {*columns} == {"index", *NAMES}
    np.testing.assert_allclose(columns["ball_x_mm"], X)
    np.testing.assert_allclose(columns["index"], np.arange(60))


@pytest.mark.parametrize("stamps", ["ms", "iso"])
def test_an_index_that_does_not_count_is_the_time(tmp_path: Path, stamps: str):
    keys = [1714642200000 + 20 * i for i in range(60)]
    if stamps == "iso":
        keys = [f"2024-05-02T09:30:{i / 50:06.3f}" for i in range(60)]
    whole = {"ball_x_mm": dict(zip(map(str, keys), X, strict=True))}
    (tmp_path / "df.json").write_text(json.dumps(whole))
    stream = read_recording(tmp_path / "df.json").stream
    assert [*stream.columns] == ["time", "ball_x_mm"]
    step = 20.0 if stamps == "ms" else 0.02
    np.testing.assert_allclose(np.diff(stream.columns["time"]), step, rtol=1e-4)


def test_a_json_object_with_other_parts_stays_what_it_is(tmp_path: Path):
    path = tmp_path / "own.json"
    path.write_text(json.dumps({"ball": {"x": X.tolist(), "t": T.tolist()}, "note": {"by": "me"}}))
    assert {*read_recording(path).stream.columns} == {"ball.x", "ball.t"}


def capture(names: list[tuple[str, str]], at: list[int]) -> np.ndarray:
    kinds = [(key, object) for key in ("Name", "Data", "Unit", "XIndex")]
    out = np.zeros((1, len(names)), dtype=kinds)
    for i, (name, unit) in enumerate(names):
        out[0, i] = (name, (T if name == "Time" else X)[None], unit, float(at[i]))
    return out


def test_a_capture_of_controldesk_has_its_signals_names_and_units(tmp_path: Path):
    signals = capture([("BallX", "mm"), ("MotorAngleX", "rad"), ("Mode", "-")], [1, 1, 1])
    own = {"X": capture([("Time", "s")], [1]), "Y": signals, "Description": {"Main": "a"}}
    savemat(tmp_path / "rec.mat", {"rec": own})
    stream = read_recording(tmp_path / "rec.mat").stream
    assert {*stream.columns} == {"rec.Time", "rec.BallX [mm]", "rec.MotorAngleX [rad]", "rec.Mode"}
    assert stream.time == "rec.Time"


def test_a_captures_signals_keep_the_time_that_is_theirs(tmp_path: Path):
    signals = capture([("BallX", "mm"), ("MotorAngleX", "rad")], [2, 1])
    own = {"X": capture([("Time", "s"), ("Time", "s")], [1, 2]), "Y": signals}
    savemat(tmp_path / "rec.mat", {"rec": own})
    assert {*read_recording(tmp_path / "rec.mat").stream.columns} > {
        "rec.1.MotorAngleX [rad]",
        "rec.2.BallX [mm]",
    }


def test_a_column_of_units_in_long_form_is_the_numbers_unit(tmp_path: Path):
    lines = ["time,signal,value,unit"]
    for t, x in zip(T, X, strict=True):
        lines += [f"{t:.2f},ball_x,{x},mm", f"{t:.2f},servo_x,{x / 9:.3f},deg"]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    stream = read_recording(tmp_path / "a.csv").stream
    assert {*stream.columns} == {"time", "ball_x", "servo_x"}
    assert stream.units == {"ball_x": "mm", "servo_x": "deg"}


def test_rows_of_a_board_that_began_anew_stand_before_the_names(tmp_path: Path):
    body = "\n".join(f"{t:.2f}\t{x}" for t, x in zip(T, X, strict=True))
    path = tmp_path / "capture.txt"
    path.write_text(f"731.5\t2.5\n731.52\t2.6\ntime_s\tball_x_mm\n{body}")
    found = read_recording(path)
    assert [*found.stream.columns] == NAMES
    np.testing.assert_allclose(found.stream.columns["time_s"], T)
    assert found.notes == ("lines before the names, left out: 2",)


@pytest.mark.parametrize(
    ("name", "role"),
    [("Load angle X", "theta"), ("load_theta_x", "theta"), ("servo_1_load", "other")],
)
def test_an_angle_of_the_load_is_measured_and_a_servos_load_is_none(name: str, role: str):
    assert hint(name).role == role
