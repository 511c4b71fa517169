"""Runs of two tables may lie in folders of one name: each keeps its own pictures."""

import json
from pathlib import Path

import numpy as np
import pytest

from experiments.records.recording import write_run
from experiments.reports.report_runs import report_runs
from rig.log import Log

NAME = "20260101T000000-hold-with"


def recorded(folder: Path, amplitude_m: float, arm: str = "with", **more) -> Path:
    t = np.arange(800) / 200
    columns = {name: amplitude_m * np.cos(t) for name in ("ball_x_m", "ball_y_m")}
    columns |= {"theta_x_rad": 0 * t, "theta_y_rad": 0 * t, "ball_exposed_s": t}
    log = Log.from_columns({"t_s": t, "phase": 2 + 0 * t, **columns})
    start = {"source": "simulated", "arm": arm, "seed": 1, "protocol": {"name": "hold"}}
    write_run(folder / NAME, start | more, log, [], outcome="completed")
    return folder / NAME


def test_each_section_shows_the_pictures_of_its_own_run(tmp_path: Path):
    runs = [recorded(tmp_path / "a", 0.01), recorded(tmp_path / "b", 0.05)]
    out = tmp_path / "out"
    out.mkdir()
    report_runs(runs, out)
    balls = sorted(out.glob(f"*{NAME}-ball.png"))
    assert len(balls) == 2
    assert balls[0].read_bytes() != balls[1].read_bytes()


def test_of_several_runs_the_one_whose_rig_cannot_be_used_is_named(tmp_path: Path):
    good, bad = (recorded(tmp_path / name, 0.01) for name in "ab")
    meta = json.loads((bad / "run.json").read_text())
    (bad / "run.json").write_text(json.dumps(meta | {"rig": {"ball": 3}}))
    with pytest.raises(ValueError, match="cannot be used") as caught:
        report_runs([good, bad], tmp_path)
    assert str(bad) in str(caught.value)


@pytest.mark.parametrize("masses_kg", [(0.003, 0.003), (0.003, 0.006)])
def test_methods_are_compared_on_one_table_alone(tmp_path: Path, masses_kg: tuple[float, float]):
    runs = [
        recorded(tmp_path / arm, size, arm, rig={"ball": {"mass_kg": mass}})
        for arm, size, mass in zip(("without", "with"), (0.04, 0.01), masses_kg, strict=True)
    ]
    page = report_runs(runs, tmp_path).read_text(encoding="utf-8")
    one_table = len(set(masses_kg)) == 1
    assert ("Without and with play compensation" in page) == one_table
    assert ("times nearer to its target" in page) == one_table
    assert page.count("A ball has settled when") == 1
    assert ("hold, with, seed 1, table 2" in page) != one_table
    words = "Not compared, since made otherwise: 1 of 2 runs; ball.mass_kg (0.003, 0.006)."
    assert (words in page) != one_table


def test_a_part_of_a_run_is_noted_with_the_reason_why_it_ended(tmp_path: Path):
    run = recorded(tmp_path, 0.01)
    meta = json.loads((run / "run.json").read_text())
    ended = {"outcome": "aborted", "reason": "stopped by page 2"}
    (run / "run.json").write_text(json.dumps(meta | ended))
    page = report_runs([run], tmp_path).read_text(encoding="utf-8")
    assert "did not run to its end (outcome aborted: stopped by page 2)" in page
