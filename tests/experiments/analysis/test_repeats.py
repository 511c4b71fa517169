"""Equal runs count once, in a report too; runs that differ by one number are two."""

import json
from pathlib import Path

import numpy as np

from experiments.analysis.numbers import recorded
from experiments.analysis.repeats import distinct, repeats_words
from experiments.records.recording import write_run
from experiments.reports.report_runs import report_runs
from rig.log import Log

T = np.arange(2000) / 200


def log(amplitude_m: float) -> Log:
    columns = {name: amplitude_m * np.cos(T) for name in ("ball_x_m", "ball_y_m")}
    columns |= {f"theta_{axis}_rad": 0.1 * np.sin(T) for axis in "xy"}
    return Log.from_columns({"t_s": T, "phase": 2 + 0 * T, "ball_exposed_s": T, **columns})


def test_of_equal_logs_the_first_is_kept_and_one_number_makes_another_run():
    runs = [recorded(Path(str(i)), log(size), "completed") for i, size in enumerate((1, 2, 1, 1))]
    assert [run.folder.name for run in distinct(runs)] == ["0", "1"]
    other = runs[0].log.rows.copy()
    other[-1, 0] += 1e-9
    runs.append(recorded(Path("4"), Log.from_rows(other), "completed"))
    assert [run.folder.name for run in distinct(runs)] == ["0", "1", "4"]
    assert repeats_words(0) == ""
    assert repeats_words(2).startswith("2 runs are each the same simulation")


def test_a_report_of_the_same_simulation_twice_has_one_run_of_each_and_says_so(tmp_path: Path):
    folders = []
    for day, (arm, size) in enumerate((("without", 0.02), ("with", 0.01)) * 2, 1):
        start = {"source": "simulated", "arm": arm, "seed": 1, "protocol": {"name": "hold"}}
        folders.append(tmp_path / f"2026010{day}T000000-hold-{arm}")
        write_run(folders[-1], start, log(size), [], outcome="completed")
    page = report_runs(folders, tmp_path).read_text(encoding="utf-8")
    assert "one run of each" in page
    assert "2 runs)" not in page
    assert "2 runs are each the same simulation as another one" in page
    found = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))
    arms = [one["arm"] for one in found["runs"]]
    assert arms == sorted(arms, reverse=True)  # without before with, in every table
