"""Exports hold every row under the contract's names, exactly, and are whole or not there."""

import csv
import os

import numpy as np
import pyarrow.parquet as pq
import pytest
from scipy.io import loadmat

from experiments.records.exporting import export_log, export_run
from experiments.records.recording import write_run
from rig.log import CONTRACT, INDEX, NAMES, Log, Phase, blank_row


def run_log():
    """Ten rows: two before the release, a ball seen in every third, a few optional columns."""
    rows = np.stack([blank_row()] * 10)
    rows[:, 0] = np.arange(10) * 0.002
    rows[:, 1:5] = np.random.default_rng(3).normal(size=(10, 4)) / 3
    rows[::3, 5:7] = 0.1 + 0.2, -0.0
    rows[::3, INDEX["ball_exposed_s"]] = rows[::3, 0] - 0.012
    rows[:, INDEX["phase"]] = [Phase.PLACE, Phase.HOLD] + [Phase.RUN] * 8
    rows[:, INDEX["wanted_voltage_x_V"]] = 1e-300
    return Log.from_rows(rows)


@pytest.fixture
def folder(tmp_path):
    write_run(tmp_path / "run", {"source": "simulated"}, run_log())
    return tmp_path / "run"


def test_csv_has_the_contract_first_and_blanks_where_no_ball(folder, tmp_path):
    path = export_run(folder, tmp_path / "out/log.csv")
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    names = list(rows[0])
    assert names[:7] == list(CONTRACT[:7])
    assert names[7:] == ["ball_exposed_s", "wanted_voltage_x_V", "phase"]
    assert [row["ball_x_m"] for row in rows[:4]] == [
        "0.30000000000000004",
        "",
        "",
        rows[0]["ball_x_m"],
    ]
    assert rows[0]["ball_y_m"] == "-0.0"
    assert [row["phase"] for row in rows[:3]] == ["0.0", "1.0", "2.0"]
    assert "nan" not in path.read_text().lower()
    log = run_log()
    for name in names:
        values = [float(row[name] or "nan") for row in rows]
        assert np.array(values).tobytes() == log[name].tobytes()


def test_parquet_has_nulls_and_says_units(folder, tmp_path):
    table = pq.read_table(export_run(folder, tmp_path / "log.parquet"))
    assert table["ball_x_m"].null_count == 6
    assert table["theta_x_rad"].null_count == 0
    assert table.schema.field("theta_x_rad").metadata[b"unit"] == b"rad"
    np.testing.assert_array_equal(table["voltage_y_V"].to_numpy(), run_log()["voltage_y_V"])


def test_mat_has_column_vectors(folder, tmp_path):
    found = loadmat(export_run(folder, tmp_path / "log.mat"))
    assert found["t_s"].shape == (10, 1)
    np.testing.assert_array_equal(found["ball_x_m"][:, 0], run_log()["ball_x_m"])
    assert {name for name in found if not name.startswith("__")} <= set(NAMES)


def test_missing_channels_are_blank_columns(tmp_path):
    log = Log.from_columns({"t_s": np.arange(2.0), "theta_x_rad": np.ones(2)})
    text = export_log(log, tmp_path / "log.CSV").read_text()
    assert text.splitlines() == [",".join(CONTRACT[:7]), "0.0,,,1.0,,,", "1.0,,,1.0,,,"]


@pytest.mark.parametrize("name", ["log.xlsx", "log", "csv"])
def test_another_suffix_is_refused_before_anything_is_read(tmp_path, name):
    with pytest.raises(ValueError, match=r"\.csv, \.parquet, \.mat") as caught:
        export_run(tmp_path / "nothing", tmp_path / name)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("suffix", ["csv", "parquet", "mat"])
def test_a_failed_export_leaves_the_old_file_alone(folder, tmp_path, monkeypatch, suffix):
    path = tmp_path / f"log.{suffix}"
    path.write_text("old")

    def refuse(*_):
        raise OSError("no")

    monkeypatch.setattr(os, "rename", refuse)
    monkeypatch.setattr("pathlib.Path.replace", refuse)
    with pytest.raises(OSError, match="no"):
        export_run(folder, path)
    assert path.read_text() == "old"
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([path.name, "run"])
