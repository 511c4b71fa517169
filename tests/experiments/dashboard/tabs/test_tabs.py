"""What the tabs say and show, as plain functions of what happened."""

import os
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from experiments.dashboard.server.controls import ControlLock, Controls
from experiments.dashboard.server.server import open_server
from experiments.dashboard.session.calibration_tasks import (
    CalibrationRequest,
    calibration_step,
    steps_of,
)
from experiments.dashboard.session.live import LiveBuffer, LiveState
from experiments.dashboard.session.plan import (
    BOTH,
    METHODS,
    STUDY,
    RunPlan,
    SessionStatus,
    planned_runs,
    shipped_plan,
)
from experiments.dashboard.session.tasks import (
    MOST_LISTED,
    DrawnFigures,
    RunSummary,
    draw_figures,
    list_runs,
    recover_runs,
)
from experiments.dashboard.session.worker_process import ProgressSender
from experiments.dashboard.tabs.gap import BEGINS, STAGES, stage_lines
from experiments.dashboard.tabs.header import link_words
from experiments.dashboard.tabs.results import NEWEST, ResultsTab, card, table
from experiments.dashboard.tabs.run import (
    progress_words,
)
from experiments.dashboard.view.elapsed import minutes
from experiments.dashboard.view.side_plates import CELL_PX, map_image, off_words
from experiments.gap.closed_loop_replay import table_motion
from experiments.records.recording import Recorder, write_run
from experiments.records.run_folder import file_name
from experiments.runs.assemble import load_rig
from experiments.runs.protocol import read_protocol
from rig.log import Log
from tests.support import ROOT
from tests.support.greyed import why


def test_the_map_lies_as_seen_from_above():
    size = np.array([[0.0, 1.0], [np.nan, 4.0]])  # rows: y upwards; columns: x to the right
    image = map_image((np.arange(3.0), np.arange(3.0), size))
    assert image.shape == (2 * CELL_PX, 2 * CELL_PX, 4)
    assert image[0, 0, 3] == 0  # +y, -x: no data
    assert image[0, -1, :3].sum() < image[-1, 0, :3].sum()  # the largest is the darkest
    assert image[-1, 0, 3] > 0


def test_five_stages_are_marked_in_turn():
    assert list(STAGES) == ["locate", "name", "add", "prove", "next"]
    assert stage_lines(-1, False).count("·") == 5
    assert stage_lines(1, False).startswith("✓ **1 locate**")
    assert stage_lines(4, True).count("✓") == 5
    stages, begins, ends = zip(*BEGINS.values(), strict=True)
    assert list(stages) == sorted(stages)
    assert set(stages) <= set(range(5))
    assert list(begins) == [0, *ends[:-1]]  # the bar never goes back from stage to stage
    assert ends[-1] < 100


def test_progress_says_what_is_on_and_how_long_it_takes():
    planned = planned_runs(RunPlan(read_protocol("free-release"), ("without", "with"), 1, 1))[0]
    words = progress_words(SessionStatus("running", planned.words, planned, 8.25))
    assert "run 1 of 2" in words
    assert "8.2 of 16.5 s" in words
    assert "0:25 left" in words
    idle = [progress_words(SessionStatus(state)) for state in ("balancing", "stopped")]
    assert ["without play compensation" in words for words in idle] == [True, False]
    pause = progress_words(SessionStatus("pause", "run 2 of 2 is next", planned))
    assert "run 2 of 2 is next" in pause
    assert not any("press" in words for words in [pause, *idle])  # who watches may press nothing
    assert minutes(61.4) == "1:01"


def test_while_the_operator_is_waited_for_the_runs_clock_stands_still():
    plan = RunPlan(read_protocol("free-release"), ("without", "with"), 1, 1, by_hand=True)
    planned = planned_runs(plan)[0]
    words = progress_words(SessionStatus("running", "", planned, 0.0, "place it", waited_s=74.0))
    assert "waiting for you** (1:14 of 2:00)" in words
    assert "left" not in words


def test_a_run_that_does_not_count_says_why_and_what_was_not_begun():
    first, second, third = planned_runs(RunPlan(read_protocol("hold"), ("with",), 3, 1))
    said = first.ended("aborted", "stopped by page 2", 4.31)
    assert said.startswith("Run 1 of 3 was stopped by page 2 after 4.3 s and does not count")
    assert said.endswith("; runs 2 to 3 were not begun.")
    assert "run 3 was not begun" in second.ended("aborted", "stopped by page 2", 4.31)
    assert third.ended("completed", "", 60.0).startswith("All 3 runs are done")
    failed = third.ended("not released", "the ball was not seen to leave", 120.5)
    assert failed.startswith("Run 3 of 3 failed after 120.5 s and does not count: the ball was not")
    status = SessionStatus("stopped", "the table rests at 0 V", last=said)
    assert progress_words(status).startswith("**Run 1 of 3 was stopped")


def test_the_end_of_a_plan_is_said_and_a_stopped_one_is_not_done():
    first, last = planned_runs(RunPlan(read_protocol("free-release"), ("without", "with"), 1, 1))
    assert first.ended("completed", "", 16.5) == ""
    said = progress_words(SessionStatus("balancing", last=last.ended("completed", "", 16.5)))
    assert said.startswith("**Both runs are done&#58; see the tab Results&#46;**")
    assert "done" not in last.ended("aborted", "stopped by page 2", 3.0)
    (alone,) = planned_runs(RunPlan(read_protocol("servo-squares"), ("without",), 1, 1))
    assert alone.ended("completed", "", 15.0).startswith("The run is done")


def test_a_silent_loop_and_an_unseen_ball_are_said():
    row = np.zeros(40)
    row[0] = 5.0
    on = SessionStatus("balancing")
    seen = LiveState(row, 4.99, (0, 0, 0), 500.0, 0.0, 1)
    assert link_words(seen, on, 500.0) == "● running on time · ● ball in sight"
    late = LiveState(row, 4.99, (0, 0, 0), 400.0, 0.0, 1)
    assert "slow: 400 of 500 ticks/s" in link_words(late, on, 500.0)
    blind = LiveState(row, 4.0, (0, 0, 0), 500.0, 0.0, 1)
    assert "not in sight" in link_words(blind, on, 500.0)
    (squares,) = planned_runs(RunPlan(read_protocol("servo-squares"), ("without",), 1, 1))
    alone = SessionStatus("running", run=squares)
    assert link_words(blind, alone, 500.0).endswith("the servos alone, without a ball")
    silent = LiveState(row, 4.99, (0, 0, 0), 500.0, 3.0, 1)
    assert "silent for 3 s" in link_words(silent, on, 500.0)
    assert "off" in link_words(seen, SessionStatus("stopped"), 500.0)
    assert "are starting (" in link_words(seen, SessionStatus("starting"), 500.0)
    begun = LiveState(None, float("nan"), (0, 0, 0), float("nan"), 34.2, 1)
    assert "are starting, 34 s so far (" in link_words(begun, SessionStatus("starting"), 500.0)


def test_before_and_after_say_how_far_off_they_are():
    assert off_words(np.array([0.01, 0.0]), np.array([0.01, 0.012])) == "12 mm from the ball"
    assert off_words(np.array([np.nan, 0.0]), np.zeros(2)) == "no ball"


def test_runs_are_listed_newest_first_and_read_as_a_film(tmp_path: Path):
    t = np.arange(500) / 500
    ball = np.where(np.arange(500) % 10 == 5, 0.01, np.nan)
    log = Log.from_columns({"t_s": t, "ball_x_m": ball, "ball_y_m": ball, "phase": 2 + 0 * t})
    for name in ("20260101T000000-hold-with", "20260102T000000-hold-without"):
        start = {"source": "simulated", "arm": name.split("-")[-1], "seed": 1}
        write_run(tmp_path / name, start, log, outcome="completed")
    (tmp_path / "no-run").mkdir()
    rows = list_runs(tmp_path)
    assert [row.method for row in rows] == ["without", "with"]
    words = table(rows, {rows[0].folder.name: (0.1, -0.2)})
    assert "(+0.10, -0.20)" in words
    assert "No runs" in table([], {})
    assert isinstance(rows[0], RunSummary)
    film = table_motion(log)
    assert len(film.t_s) < 40
    assert np.isnan(film.at(0.0)[1]).all()  # not seen yet
    assert np.allclose(film.at(0.5)[1], 0.01)


@pytest.mark.parametrize(
    ("name", "virtual", "real"),
    [
        ("default", "camera table time level servo play", "camera table time level"),
        ("bus-servos", "camera table time level servo play", "camera table time level servo"),
        ("hobby-two-servos", "camera table servo level play", "camera table servo level"),
    ],
)
def test_only_steps_that_the_table_allows_are_offered(name, virtual, real, tmp_path: Path):
    rig = load_rig(ROOT / "experiments" / "rigs" / f"{name}.toml")
    assert steps_of(rig, real=False) == tuple(virtual.split())
    assert steps_of(rig, real=True) == tuple(real.split())
    request = CalibrationRequest("play", rig, tmp_path, rig_file=tmp_path / "rig.toml")
    with pytest.raises(ValueError, match="play is found from its runs"):
        calibration_step(request, lambda *_: None)  # pyright: ignore[reportArgumentType]


def test_a_run_of_somebody_else_writes_no_html_onto_the_page():
    text = "with <iframe srcdoc='<script>alert(1)</script>'></iframe> | **x** | `y`"
    words = table([RunSummary(Path("run"), text, text, 1, text)], {})
    own = '<span class="rig-name">', "</span>"  # the program's own, about what comes from files
    assert [words.count(mark) for mark in own] == [3, 3]
    assert "<" not in words.replace(own[0], "").replace(own[1], "")
    assert words.count("|") == 3 * 5  # of the program's own cells
    assert "<" not in progress_words(SessionStatus("stopped", text))
    hostile = RunSummary(Path(text), text, text, 1, text, by_hand=(text,))
    for figures in (
        DrawnFigures([], [], sentence=text),
        DrawnFigures([], [], table=[[text] * 4]),
        DrawnFigures([], [hostile]),
    ):
        words = card(figures)
        assert "iframe" in words
        assert "<" not in words
        assert "`" not in words


def test_what_a_worker_says_of_somebody_elses_run_is_no_html_either(tmp_path: Path):
    server, _ = open_server("127.0.0.1", 0, "a-token-of-some-length-for-tests")
    controls = Controls(lambda *what: None, print)
    tab = ResultsTab(
        server, controls, SimpleNamespace(), tmp_path, LiveBuffer(500.0), lambda page, path: None
    )  # pyright: ignore[reportArgumentType]
    for kind, what in (("progress", ("<b>", 1, 2)), ("failed", "<b>: no run")):
        tab._on_message("report", lambda made: None, kind, what)
        assert "<" not in tab._words.content
        assert "b" in tab._words.content
    controls.queue.close()
    server.stop()


def test_results_follow_the_newest_run_until_a_protocol_is_chosen(tmp_path: Path):
    server, _ = open_server("127.0.0.1", 0, "a-token-of-some-length-for-tests")
    controls, asked = Controls(lambda *what: None, print), []
    worker = SimpleNamespace(put=lambda item, instead: asked.append(item.task.args[0][0].protocol))
    worker.check_free = lambda name: None
    tab = ResultsTab(server, controls, worker, tmp_path, LiveBuffer(500.0), lambda page, path: None)  # pyright: ignore[reportArgumentType]
    controls.lock = ControlLock().joined(1)
    assert why(controls, tab._picked) == "no runs yet: make some in the tab Run"

    def record(day: int, name: str, *, servo_only: bool = False) -> None:
        protocol = {"name": name, "servo_only": servo_only}
        start = {"source": "simulated", "arm": "with", "seed": 1, "protocol": protocol}
        log = Log.from_columns({"t_s": np.arange(5) / 200})
        folder = tmp_path / "runs" / f"202601{day:02d}T000000-{name}-with"
        write_run(folder, start, log, [], outcome="completed")
        tab.refresh()

    record(1, "hold")
    record(2, "servo-squares", servo_only=True)  # nothing of it can be drawn
    record(2, "steps")
    tab._protocol.now = "hold"
    record(3, "steps")  # another protocol's: what is looked at stays
    tab.refresh()
    record(4, "hold")
    report = next(h for h, _ in controls.checks.values() if h.label == "Download the report")
    assert "wait for it" in why(controls, report)  # it would wait for the figures
    tab._drawn(DrawnFigures([], [], "", []))
    assert why(controls, report) == ""
    tab._protocol.now, tab.started = NEWEST, "hold"  # a series that began with it
    record(5, "hold")
    record(6, "steps")
    assert tab._named(NEWEST) == "hold"
    assert "are of **hold**; there are runs of steps, too" in tab._others.content
    assert why(controls, tab._picked) == ""
    controls.queue.close()
    server.stop()
    assert asked == ["hold", "steps", "hold", "hold"]


def test_a_run_that_was_listed_while_it_was_recorded_is_drawn_when_it_ends(tmp_path: Path):
    """The next run of a series may begin before the end of the one before is taken note of."""
    server, _ = open_server("127.0.0.1", 0, "a-token-of-some-length-for-tests")
    controls, asked = Controls(lambda *what: None, print), []
    worker = SimpleNamespace(put=lambda item, instead: asked.append(len(item.task.args[0])))
    worker.check_free = lambda name: None
    tab = ResultsTab(server, controls, worker, tmp_path, LiveBuffer(500.0), lambda page, path: None)  # pyright: ignore[reportArgumentType]
    start = {"source": "simulated", "arm": "with", "seed": 1, "protocol": {"name": "hold"}}
    recorder = Recorder(tmp_path / "runs/20260101T000000-hold-with", start)
    tab.refresh()
    assert [row.outcome for row in tab.rows] == ["being recorded"]
    recorder.finish("completed")
    tab.refresh()
    tab.refresh()
    controls.queue.close()
    server.stop()
    assert asked == [1]


def test_runs_of_the_servos_alone_say_why_there_is_no_figure(tmp_path: Path):
    protocol = {"name": "servo-squares", "servo_only": True}
    start = {"source": "simulated", "arm": "without", "seed": 1, "protocol": protocol}
    log = Log.from_columns({"t_s": np.arange(50) / 200, "theta_x_rad": np.zeros(50)})
    write_run(tmp_path / "20260101T000000-servo-squares", start, log, [], outcome="completed")
    done = draw_figures(list_runs(tmp_path), tmp_path / "f", False, ProgressSender(lambda m: None))
    assert done.pictures == []
    assert "the servos alone" in card(done)


def test_both_methods_behind_a_target_that_moves_are_drawn_without_centroids(tmp_path: Path):
    t = np.arange(2000) / 200
    columns = {f"{what}_{axis}_m": 0.03 * np.cos(t) for what in ("ball", "target") for axis in "xy"}
    columns |= {f"theta_{axis}_rad": 0.1 * np.sin(t) for axis in "xy"} | {"ball_exposed_s": t}
    log = Log.from_columns({"t_s": t, "phase": 2 + 0 * t, **columns})
    for day, arm in ((1, "without"), (2, "with")):
        start = {"source": "simulated", "arm": arm, "seed": 1, "protocol": {"name": "circle"}}
        folder = tmp_path / f"2026010{day}T000000-circle-{arm}"
        write_run(folder, start, log, [], outcome="completed")
    drawn = draw_figures(
        list_runs(tmp_path), tmp_path / "f", False, ProgressSender(lambda message: None)
    )
    assert [p.path.name for p in drawn.pictures] == ["fig10.png", "ball-time.png", "fig11.png"]
    assert [row.centroid_cm for row in drawn.rows] == [None, None]


@pytest.mark.slow
def test_a_run_disturbed_by_hand_is_named_and_not_counted(tmp_path: Path):
    t = np.arange(2000) / 200
    columns = {name: 0.01 * np.cos(t) for name in ("ball_x_m", "ball_y_m")}
    columns |= {"theta_x_rad": 0 * t, "theta_y_rad": 0 * t, "ball_exposed_s": t}
    log = Log.from_columns({"t_s": t, "phase": 2 + 0 * t, **columns})
    push = {"t_s": 2.0, "text": "by hand: push to the left, 0.15 m/s"}
    for number, arm in enumerate(("without", "with")):
        folder = tmp_path / f"2026010{number + 1}T000000-hold-{arm}"
        start = {"source": "simulated", "arm": arm, "seed": 1, "protocol": {"name": "hold"}}
        if arm == "with":
            start["by_hand"] = ["2.0 s: push to the left, 0.15 m/s"]
        write_run(folder, start, log, [push] if arm == "with" else [], outcome="completed")
    rows = list_runs(tmp_path)
    assert [row.how for row in rows] == ["completed, disturbed by hand", "completed"]
    drawn = draw_figures(rows, tmp_path / "figures", False, ProgressSender(lambda message: None))
    assert drawn.sentence == ""  # of two methods only one counts
    assert card(drawn).startswith("hold: **to compare&#44; run it with and without")
    assert "By hand in" in card(drawn)
    assert "push to the left" in card(drawn)
    both = draw_figures(rows, tmp_path / "figures", True, ProgressSender(lambda message: None))
    assert "as near to its target as without" in both.sentence
    assert [p.path.name for p in both.pictures] == ["fig10.png", "ball-time.png", "fig11.png"]


def test_what_was_cut_off_is_said_with_its_cure(tmp_path: Path):
    folder = tmp_path / "20260101T000000-hold-with"
    recorder = Recorder(folder, {"source": "simulated", "arm": "with"})
    assert [row.how for row in list_runs(tmp_path)] == ["being recorded"]
    os.close(recorder._file)  # as a kill does
    assert [row.how for row in list_runs(tmp_path)] == ["cut off: Recover"]
    torn = tmp_path / "20260102T000000-hold-with"
    recorder = Recorder(torn, {"source": "simulated", "arm": "with"})
    os.close(recorder._file)
    (torn / "samples.mcap").unlink()
    left = recover_runs([torn, folder], ProgressSender(lambda message: None))
    assert torn.name in left
    assert folder.name not in left
    assert [row.outcome for row in list_runs(tmp_path)] == ["unfinished", "killed"]


def test_a_run_that_cannot_be_read_is_named_and_hides_no_other(tmp_path: Path):
    t = np.arange(400) / 200
    columns = {name: 0.01 * np.cos(t) for name in ("ball_x_m", "ball_y_m")}
    columns |= {"theta_x_rad": 0 * t, "theta_y_rad": 0 * t, "ball_exposed_s": t}
    log = Log.from_columns({"t_s": t, "phase": 2 + 0 * t, **columns})
    for day in (1, 2):
        start = {"source": "simulated", "arm": "with", "seed": day, "protocol": {"name": "hold"}}
        folder = tmp_path / f"2026010{day}T000000-hold-with"
        write_run(folder, start, log, [], outcome="completed")
    (tmp_path / "20260102T000000-hold-with/samples.mcap").write_bytes(bytes(100))
    drawn = draw_figures(list_runs(tmp_path), tmp_path / "f", False, ProgressSender(lambda m: None))
    assert len(drawn.rows) == 1
    assert "**Left out**: " in card(drawn)
    (tmp_path / "20260101T000000-hold-with/samples.mcap").unlink()
    with pytest.raises((OSError, ValueError)):
        draw_figures(list_runs(tmp_path), tmp_path / "f", False, ProgressSender(lambda m: None))


def test_both_controllers_are_run_where_the_protocol_asks_for_both():
    def methods(name: str, choice: str) -> tuple[str, ...]:
        return shipped_plan(name, choice, 1).methods

    assert methods("free-release", BOTH) == ("without", "with")
    assert methods("servo-squares", BOTH) == ("without",)
    assert [methods("servo-squares", one) for one in METHODS][1:] == [("with",), ("without",)]


def test_the_whole_study_runs_its_protocols_in_turn_and_knows_what_is_left():
    """Runs of different lengths: the share and the time left are of seconds, not of runs."""
    runs = planned_runs(*(replace(shipped_plan(name, BOTH, 1), speed=2.0) for name in STUDY))
    names = list(dict.fromkeys(run.plan.protocol.name for run in runs))
    assert names == list(STUDY)
    assert [run.number for run in runs] == list(range(1, runs[0].of + 1))
    all_s = sum(run.plan.run_s for run in runs)
    last = SessionStatus("running", "", runs[-1], runs[-1].plan.run_s)
    assert (last.share, last.remaining_s) == pytest.approx((1.0, 0.0))
    second = SessionStatus("running", "", runs[1], 4.0)
    assert second.share == pytest.approx((runs[0].plan.run_s + 4.0) / all_s)
    assert second.remaining_s == pytest.approx((all_s - runs[0].plan.run_s - 4.0) / 2.0)


def test_runs_of_one_name_have_labels_of_their_own(tmp_path: Path):
    """A dropdown with two equal lines takes the whole page down."""
    start = {"source": "simulated", "arm": "with", "seed": 1, "protocol": {"name": "hold"}}
    log = Log.from_columns({"t_s": np.arange(5) / 200})
    for name in ("20260101T000000-hold-with", "20260101T000000-hold-with-copy"):
        write_run(tmp_path / name, start, log, [], outcome="completed")
    labels = [row.label for row in list_runs(tmp_path)]
    assert len(set(labels)) == 2
    assert all("[20260101T000000-hold-with" in label for label in labels)


def test_a_protocols_name_leads_out_of_no_folder():
    for name in ("../runs/R", "/home/me/x", "..", ".", "", ".hidden", "a/b\\c"):
        made = Path("figures") / file_name(name)
        assert made.parent == Path("figures")
        assert made.name == file_name(name) not in ("", ".", "..")
    assert file_name("free-release") == "free-release"


def test_a_word_beyond_all_measure_is_sent_to_no_page(tmp_path: Path):
    start = {
        "source": "simulated",
        "arm": "w" * 10**6,
        "seed": 1,
        "protocol": {"name": "h" * 10**6},
    }
    log = Log.from_columns({"t_s": np.arange(5) / 200})
    write_run(tmp_path / "20260101T000000-a", start, log, [], outcome="completed")
    (row,) = list_runs(tmp_path)
    assert len(row.label) < 300


def test_the_list_of_runs_does_not_count_what_it_has_not_read():
    row = RunSummary(Path("run"), "hold", "with", 1, "completed")
    assert "28 more in the lists; older runs are in the folder" in table([row] * MOST_LISTED, {})
    assert "27 more in the folder." in table([row] * (MOST_LISTED - 1), {})
