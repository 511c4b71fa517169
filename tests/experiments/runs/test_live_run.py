"""Rows that a stalled disk lost are told: in the run, and wherever it is read."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from experiments.records.importing import read_log
from experiments.records.recording import read_run
from experiments.records.run_folder import lost_words
from experiments.reports.report_runs import report_runs
from experiments.runs import live_run
from experiments.runs.assemble import load_rig
from experiments.runs.protocol import read_protocol
from experiments.runs.runner import RunRequest, keep_simulated, simulate_run, start_record
from rig.log import COLUMNS
from rig.loop.loop import Ending
from tests.support.command import call

LOST = "312 rows are missing: they were not written in time (a disk that stood still)"


def ended(folder: Path, lost: int, reason: str, monkeypatch) -> tuple[Ending, Any]:
    """How a run of ten rows ended whose ring lost some."""

    def loop(keep, event) -> Ending:
        for k in range(10):
            keep(np.array([0.002 * k, *[0.0] * (len(COLUMNS) - 1)]))
        return Ending("completed", reason)

    made = SimpleNamespace(run=loop, notes={"lost_rows": lost}, put=print)
    monkeypatch.setattr(live_run, "LoopProcess", lambda job: made)
    request = RunRequest(load_rig(None), read_protocol("hold"), "without", 1, folder)
    with live_run.AnnouncingRecorder(folder, start_record(request)) as recorder:
        ending = live_run.record_live(None, recorder)  # pyright: ignore[reportArgumentType]
    return ending, read_run(folder)


@pytest.mark.parametrize(("before", "reason"), [("", LOST), ("odd", f"odd; {LOST}")])
def test_rows_that_were_lost_are_told_in_the_run(tmp_path: Path, monkeypatch, before, reason):
    ending, run = ended(tmp_path / "run", 312, before, monkeypatch)
    assert ending == Ending("completed", reason)
    assert run.meta["reason"] == reason
    assert [(event["text"], round(event["t_s"], 9)) for event in run.events] == [(LOST, 0.018)]


def test_nothing_is_told_where_nothing_was_lost(tmp_path: Path, monkeypatch):
    ending, run = ended(tmp_path / "run", 0, "", monkeypatch)
    assert (ending.reason, run.meta["reason"], run.events) == ("", "", [])
    for loop in (None, 3, {}, {"lost_rows": "many"}, {"lost_rows": None}):
        assert lost_words({"loop": loop}) == ""
    assert lost_words({}) == ""


def test_whoever_reads_a_run_is_told_that_rows_are_missing(tmp_path: Path, capsys):
    protocol = read_protocol("free-release").model_copy(update={"duration_s": 2.0})
    request = RunRequest(load_rig(None), protocol, "without", 1, tmp_path)
    folder = keep_simulated(request, simulate_run(request))
    meta = json.loads((folder / "run.json").read_text())
    (folder / "run.json").write_text(json.dumps(meta | {"loop": {"lost_rows": 312}}))
    assert LOST in read_log(folder).notes
    (tmp_path / "report").mkdir()
    page = report_runs([folder], tmp_path / "report")
    assert f"{folder.name}: {LOST}." in page.read_text()
    capsys.readouterr()
    assert call("export", folder, "--out", tmp_path / "run.csv") == 0
    assert capsys.readouterr().err == f"note: {folder}: {LOST}\n"
