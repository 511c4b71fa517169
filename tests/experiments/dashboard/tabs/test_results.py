"""What the tab Results says of the runs behind its numbers."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np

from experiments.dashboard.app import App
from experiments.dashboard.server.controls import Controls
from experiments.dashboard.server.server import open_server
from experiments.dashboard.session.gap_tasks import ShortAnswer
from experiments.dashboard.session.live import LiveBuffer
from experiments.dashboard.session.tasks import DrawnFigures, RunSummary, list_runs
from experiments.dashboard.tabs.results import ResultsTab, card, table
from experiments.dashboard.tabs.tour import next_step
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


def test_a_centroid_breaks_between_its_coordinates_where_the_panel_is_narrow():
    rows = [RunSummary(Path("a"), "hold", "with", 1, "completed")]
    assert "(-10.09, +10.00)" in table(rows, {"a": (-10.09, 10.0)})  # an ordinary space


def test_it_says_which_runs_count():
    rows = [RunSummary(Path("a"), "hold", "with", 1, "completed")] * 8
    said = card(DrawnFigures([], rows, "The ball stays nearer.", counts=(4, 3)))
    assert "Counted of the newest 8 runs: 4 without, 3 with play compensation." in said


def test_while_new_figures_are_drawn_the_old_ones_are_called_so(tmp_path: Path):
    server, _ = open_server("127.0.0.1", 0, "a-token-of-some-length-for-tests")
    controls = Controls(lambda *what: None, print)
    worker = SimpleNamespace(put=lambda item, instead: None, check_free=lambda name: None)
    tab = ResultsTab(server, controls, worker, tmp_path, LiveBuffer(500.0), lambda page, path: None)  # pyright: ignore[reportArgumentType]
    log = Log.from_columns({"t_s": np.arange(5) / 200})
    start = {"source": "simulated", "arm": "with", "seed": 1, "protocol": {"name": "hold"}}
    said = []
    for day in (1, 2):
        write_run(tmp_path / f"runs/2026010{day}T000000-hold-with", start, log, [], "completed")
        tab.refresh()
        tab._on_message("figures", tab._drawn, "progress", ("drawing", 0, 1))
        said.append(tab._words.content)
        tab._on_message("figures", tab._drawn, "done", DrawnFigures([], tab.rows, "Nearer."))
        said.append(tab._words.content)
    controls.queue.close()
    server.stop()
    assert "drawn before" not in said[0]  # there was nothing
    assert "What is below was drawn before.** New figures come, of the newest 2 runs" in said[2]
    assert said[1] == said[3] == ""


def test_an_older_pair_of_another_protocol_is_not_what_is_shown(tmp_path: Path):
    """After a restart the guide led to Results for a sentence that is not there."""
    server, _ = open_server("127.0.0.1", 0, "a-token-of-some-length-for-tests")
    controls = Controls(lambda *what: None, print)
    log = Log.from_columns({"t_s": np.arange(5) / 200})
    for day, protocol, method in (
        (1, "circle", "with"),
        (2, "circle", "without"),
        (3, "hold", "with"),
    ):
        start = {"source": "simulated", "arm": method, "seed": 1, "protocol": {"name": protocol}}
        write_run(tmp_path / f"runs/2026010{day}T000000", start, log, [], "completed")
    worker = SimpleNamespace(put=lambda item, instead: None, check_free=lambda name: None)
    try:
        tab = ResultsTab(
            server, controls, worker, tmp_path, LiveBuffer(500.0), lambda page, path: None
        )  # pyright: ignore[reportArgumentType]
        app = SimpleNamespace(
            results=tab,
            _replayed=False,
            calibrate=SimpleNamespace(accepted=()),
            gap=SimpleNamespace(answer=None),
        )
        assert next_step(App._steps_done(app)) == 0  # pyright: ignore[reportArgumentType]
        tab.compared = True  # by this program, before
        assert next_step(App._steps_done(app)) == 2  # pyright: ignore[reportArgumentType]
        for truth in ("", "hidden: 2 degrees"):  # own runs were analysed; the demo, the fifth step
            app.gap.answer = SimpleNamespace(short=ShortAnswer([], [], truth=truth))
            assert App._steps_done(app)[4] == bool(truth)  # pyright: ignore[reportArgumentType]
    finally:
        controls.queue.close()
        server.stop()
