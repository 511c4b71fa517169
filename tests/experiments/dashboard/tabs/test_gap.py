"""The tab Gap: runs are ticked, what they lack is said, and an answer survives the program."""

import json
import re
from dataclasses import asdict, replace
from functools import partial
from math import nan
from pathlib import Path

import numpy as np
import pytest

from experiments.dashboard.server.controls import ControlLock, Controls
from experiments.dashboard.server.server import open_server
from experiments.dashboard.server.untrusted_text import plain
from experiments.dashboard.session.gap_tasks import (
    ANSWER,
    GapAnswer,
    ShortAnswer,
    clue,
    newest_answer,
)
from experiments.dashboard.session.tasks import RunSummary, list_runs
from experiments.dashboard.session.worker_process import WorkItem
from experiments.dashboard.tabs.gap import (
    OWN_TABLE,
    GapTab,
    beside_list,
    good_runs,
    time_words,
)
from experiments.dashboard.tabs.guess import digits
from experiments.gap.demo import demo_runs
from experiments.records.recording import write_run
from rig.log import Log
from tests.support.greyed import why


class FakeWorker:
    def __init__(self):
        self.items: list[WorkItem] = []
        self.before = ""  # what is being done meanwhile

    def goes_before(self, name: str) -> str:
        return self.before

    def put(self, item: WorkItem) -> None:
        self.items.append(item)


def summary(number: int, protocol: str, outcome: str = "completed", by_hand=()) -> RunSummary:
    folder = Path(f"out/2026112{number}T05460{number}-{protocol}-with")
    return RunSummary(folder, protocol, "with", 1, outcome, by_hand=tuple(by_hand))


@pytest.fixture
def gap(tmp_path):
    server, _ = open_server("127.0.0.1", 0, "a-token-of-some-length-for-tests")
    controls, worker = Controls(lambda *what: None, print), FakeWorker()
    controls.lock = ControlLock().joined(1)
    rows = [
        summary(4, "steps", by_hand=["2.0 s: push to the left"]),
        summary(3, "free-release"),
        summary(2, "servo-squares", outcome="aborted"),
        summary(1, "free-release"),
    ]
    shown = []

    def tab():
        return GapTab(
            server, controls, worker, tmp_path, lambda: rows,
            shown.append, lambda page, film: None, lambda page, path: None,
        )  # pyright: ignore[reportArgumentType] # fmt: skip

    yield tab, worker, rows, tmp_path
    controls.queue.close()
    server.stop()


def test_with_no_run_ticked_there_is_nothing_to_analyse(gap):
    make, _, _, _ = gap
    tab = make()
    (analyse,) = (h for h, _ in tab._controls.checks.values() if h.label.startswith("Analyse"))
    assert why(tab._controls, analyse).startswith("No run is ticked")
    tab.draw()
    assert "No run is ticked" in tab._advice.content
    tab.refresh()
    assert why(tab._controls, analyse) == ""


def test_undisturbed_completed_runs_are_ticked_and_what_they_lack_is_said(gap):
    make, _, rows, _ = gap
    tab = make()
    tab.refresh()
    tab.draw()
    assert [f.name[-20:] for f in tab._chosen()] == [r.folder.name[-20:] for r in rows[1::2]]
    assert "run steps and servo&#45;squares first&#44; 45 s" in tab._advice.content
    handle, kept = next(iter(tab._boxes.values()))
    assert handle.label == rows[0].label
    kept.now = True
    tab._tick(rows[0].folder, True)
    rows.insert(0, summary(5, "servo-squares"))
    tab.refresh()  # what was ticked stays so
    tab.draw()
    assert {row.protocol for row in tab._ticked()} == {"servo-squares", "steps", "free-release"}
    assert tab._advice.content == ""
    for _, box in tab._boxes.values():
        box.now = False
    with pytest.raises(ValueError, match="No run is ticked"):
        tab._chosen()
    for _, box in tab._boxes.values():
        box.now = True
    rows[0] = replace(rows[0], table=1)
    with pytest.raises(ValueError, match="of several tables"):
        tab._chosen()


def test_the_demo_gives_a_clue_and_compares_the_guess_with_the_truth(gap):
    """From three runs of known length on: the picture, the words, two fields; then the truth."""
    make, _, _, out = gap
    tab = make()
    tab.begin(None, None)
    assert not any(one.visible for one in tab._guess._shown)
    tab._on_message("shown", clue(demo_runs(out, seed=3), out, 3))
    assert all(one.visible for one in tab._guess._shown)
    assert all(one.order < tab._stages.order for one in tab._guess._shown)  # without scrolling
    said = tab._guess._words.content
    assert "Guess before it ends" in said
    assert len(re.findall(r"degrees(:|&#58;) by ", said)) == 4  # of known plays
    assert [one.label for one in tab._gallery._images] == ["The demo's ball, let go"]
    for axis, degrees in (("x", "1,5"), ("y", "1.")):
        tab._guess._values[axis].now = degrees
    short = ShortAnswer(["Missing: play in the joints."], [], truth="Hidden in the demo: 2.01")
    tab._end(GapAnswer(short, out / "gap.html", [], None, None))
    assert not any(one.visible for one in tab._guess._shown)
    line = "**Your guess**: x 1.5, hidden 2.0; y 1.0, hidden 1.1 degrees."
    assert line in tab._words.content
    tab._hide(True)
    assert "hidden 2.0" not in tab._words.content


def test_a_field_that_nobody_filled_is_no_guess_and_no_play_is_one(gap):
    make, *_ = gap
    guess, hidden = make()._guess, {"x": 0.0, "y": 0.02}
    assert [one.now for one in guess._values.values()] == ["", ""]
    assert guess.against(hidden) == ""
    guess._values["x"].now = "0"
    said = "**Your guess**: x 0.0, hidden 0.0; y not guessed, hidden 1.1 degrees."
    assert guess.against(hidden) == said
    for typed in ("1.", "0,25", "", "."):
        assert digits(typed) == typed  # somebody is still typing
    for wrong in ("-1", "1e3", "nan", "2 deg", "1" * 9, 1.5, None):
        with pytest.raises(ValueError, match="a number of degrees"):
            digits(wrong)


def test_runs_that_tell_the_effects_apart_are_ticked_alone():
    rows = [summary(6, "free-release"), summary(5, "steps"), summary(3, "free-release")]
    assert good_runs(rows) == [row.folder for row in rows]
    squares = [summary(n, "servo-squares") for n in (4, 2)]
    assert good_runs([*rows, *squares]) == [rows[1].folder, *(row.folder for row in squares)]
    disturbed = [summary(7, "servo-squares", by_hand=["2.0 s: push"]), *rows]
    assert good_runs(disturbed) == [row.folder for row in rows]
    rows[1:] = [replace(row, table=1) for row in rows[1:]]
    assert good_runs(rows) == [rows[0].folder]
    assert rows[1].label.endswith(", another table")


def test_runs_of_a_virtual_table_with_other_play_are_of_another_table(tmp_path: Path):
    for n, play in enumerate((0.01, 0.02, 0.02, 0.01), 1):
        folder = tmp_path / f"2026010{n}T000000-hold-with"
        start = {"source": "simulated", "arm": "with", "seed": n, "protocol": {"name": "hold"}}
        log = Log.from_columns({"t_s": np.arange(5) / 200})
        write_run(folder, {**start, "rig": {"gains": {}}}, log, [], outcome="completed")
        truth = {"rig": {"effects": {"gear_backlash": {"x": {"play_rad": play}}}}}
        (folder / "truth.json").write_text(json.dumps(truth), "utf-8")
    assert [row.table for row in list_runs(tmp_path)] == [0, 1, 1, 0]


def test_an_answer_is_shown_again_after_a_restart(gap):
    make, _, _, out = gap
    assert newest_answer(out) is None
    for number, name in ((2, "a<b>play"), (10, "the newest")):
        folder = out / f"gap-{number}"
        folder.mkdir()
        short = ShortAnswer([f"Missing: {name}.", "Next: steps."], [["play", "x", "1", "", "", ""]])
        (folder / ANSWER).write_text(json.dumps(asdict(short)))
    (out / "gap-11").mkdir()
    (out / "gap-11" / ANSWER).write_text('{"table": 3}')  # of a program that died
    tab = make()
    assert isinstance(tab.answer, GapAnswer)
    assert "gap&#45;10" in tab._words.content
    assert "**Missing&#58; the newest&#46;**" in tab._words.content
    assert "- **play, x**: 1" in tab._words.content
    assert tab._report.visible
    assert not tab._film.visible


def test_an_analysis_takes_the_place_of_no_other(gap):
    make, worker, _, out = gap
    tab = make()

    def begun() -> partial:
        tab.begin(None, None)
        task = worker.items[-1].task
        assert isinstance(task, partial)
        return task

    assert begun().args[1] == out / "gap-1"
    for name in ("gap-2", "gap-3", "gap-report"):  # the first was deleted
        (out / name).mkdir()
    task = begun()
    assert task.args[1:3] == (out / "gap-4", 4)
    task.args[1].mkdir()  # by another program meanwhile
    with pytest.raises(FileExistsError):
        task(progress=print)


def test_who_guesses_sees_no_truth_until_the_tick_is_taken_away(gap):
    make, _, _, _ = gap
    tab = make()
    rows = [
        ["play", "x", "1.0", "", "1.1", "agrees"],
        ["cogging", "y", "", "", "0.2", "not named"],
    ]
    said = ShortAnswer(["Missing: play."], rows, ["Next: steps."], "Hidden: joint play of 1.1.")
    tab._hide(True)
    tab._end(GapAnswer(said, Path("gap.html"), [], None, None))
    assert "**Missing" in tab._words.content
    assert "1.0" in tab._words.content.replace("&#46;", ".")
    for told in ("1.1", "agrees", "cogging", "truth 1"):
        assert told not in tab._words.content.replace("&#46;", ".")
    tab._hide(False)
    for told in ("Hidden", "1.1", "agrees", "cogging", "truth 1"):
        assert told in tab._words.content.replace("&#46;", ".")
    assert tab._words.content.startswith("**Missing")  # the answer, then what was hidden
    tab._ask(True)
    tab._hide(True)
    assert (tab._advice.visible, tab._words.visible) == (True, False)  # it is still asked for


def test_what_is_known_otherwise_stands_below_what_was_found():
    assert beside_list([]) == ""
    rows = [["play", "x", "1", "", "2", "agrees"], ["drag", "both", "", "3", "", ""]]
    assert beside_list([*rows, ["bowl", "x", "4", "", "", ""]]).split("\n") == [
        "- **play, x**: 1  ",
        "  truth 2 · agrees",
        "- **drag, both**: not found  ",
        "  Calibrate 3",
        "- **bowl, x**: 4",
    ]


def test_what_is_found_stands_in_place_of_what_can_be_asked(gap):
    make, worker, _, _ = gap
    tab = make()
    tab.refresh()

    def seen(*handles) -> set[bool]:
        return {handle.visible for handle in handles}

    asks = (tab._folder, tab._advice)
    answers = (tab._words, tab._stages)
    assert seen(*asks) == {True}
    assert seen(*answers, tab._bar, tab._cancel_button, tab._again, tab._report) == {False}
    tab.begin(None, None)
    assert seen(*asks, tab._again, tab._report) == {False}
    assert seen(*answers, tab._bar, tab._cancel_button) == {True}
    tab.refresh()  # a run was recorded meanwhile
    assert not tab._folder.visible
    tab._on_message("progress", ("name: what else could <b> be?", 1, 5))
    assert "what else" in tab._does
    assert "<" not in tab._does
    told = tab._bar.value
    assert 15 < told < 75
    for _ in range(500):  # seconds in which nothing is told
        tab._elapsed.begin()
        tab.draw()
    assert told < tab._bar.value < 75
    tab._on_message("failed", "the logs say nothing")
    assert seen(*answers, tab._again) == {True}
    assert seen(tab._bar, tab._cancel_button, tab._report, *asks) == {False}
    tab._ask(True)
    assert seen(*asks) == {True}
    assert seen(*answers, tab._again) == {False}
    assert len(worker.items) == 1


def test_how_long_the_one_before_took_is_told_in_place_of_a_forecast(gap):
    assert (
        time_words(125, nan)
        == "2:05 so far; it takes some minutes, more with every effect that is found"
    )
    assert time_words(125, 310.2) == "2:05 so far; the one before took 5:10"
    make, _, _, out = gap
    demo = {"took_s": 310.2, "truth": "hidden: 2 degrees"}
    # 2: of recorded runs, which take another time; 3: as earlier versions wrote it
    for number, kept in ((1, demo), (2, {"took_s": 310.2}), (3, {})):
        (out / f"gap-{number}").mkdir()
        said = {"sentences": ["Missing: play."], "table": []}
        (out / f"gap-{number}" / ANSWER).write_text(json.dumps({**said, **kept}))
        tab = make()
        tab.begin(None, None)
        tab.draw()
        assert ("the one before took 5:10" in tab._words.content) == (number == 1)


def test_an_analysis_that_waits_for_a_calibration_says_so(gap, monkeypatch):
    make, worker, _, _ = gap
    tab = make()
    tab.begin(None, None)
    monkeypatch.setattr(tab._elapsed, "changed", lambda: True)
    worker.before = "calibration"
    tab.draw()
    assert tab._words.content.startswith("*waits for the step in the tab Calibrate to end")
    worker.before = ""
    tab.draw()
    assert tab._words.content.startswith("*starting")


def test_what_is_being_analysed_is_said(gap):
    make, _, rows, _ = gap
    tab = make()
    for logs, said in (([rows[1].folder, rows[3].folder], True), (None, False)):
        tab.begin(logs, None)
        tab.draw()
        labels = f"{rows[1].label}; {rows[3].label}"
        assert (f"*Analysed: {plain(labels)}*" in tab._words.content) == said
        assert (OWN_TABLE in tab._words.content) != said
