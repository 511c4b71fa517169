"""What the tab Results says of the runs behind its numbers."""

from pathlib import Path

import numpy as np

from experiments.dashboard.session.tasks import DrawnFigures, list_runs
from experiments.dashboard.tabs.results import card, table
from experiments.records.recording import write_run
from rig.log import Log


def test_the_settling_time_is_defined_where_it_is_told():
    told = DrawnFigures([], [], table=[["settling time", "8.1 s", "2.3 s", "3.5 times smaller"]])
    assert "within 1.2 times the largest distance there, at least 2 mm" in card(told)
    assert "settled when" not in card(DrawnFigures([], []))


def test_a_run_that_did_not_end_as_planned_is_listed_with_the_reason(tmp_path: Path):
    log = Log.from_columns({"t_s": np.arange(5) / 200})
    start = {"source": "simulated", "arm": "with", "seed": 1, "protocol": {"name": "hold"}}
    write_run(tmp_path / "a", start, log, [], outcome="aborted", reason="stopped by page 2")
    rows = list_runs(tmp_path)
    assert [row.how for row in rows] == ["aborted: stopped by page 2"]
    assert "stopped by page 2" in table(rows, {})
