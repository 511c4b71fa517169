"""The tab Replay before a worker that never ends: nothing is read in the thread of the queue."""

import time
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from experiments.dashboard.server.controls import ControlLock, Controls
from experiments.dashboard.server.pages import Pages
from experiments.dashboard.server.server import open_server
from experiments.dashboard.session.live import LiveBuffer
from experiments.dashboard.session.playback import Playback, run_film
from experiments.dashboard.session.tasks import RunSummary
from experiments.dashboard.session.worker_process import WorkItem
from experiments.dashboard.tabs.replay import LIVE, ReplayTab, event_lines, partner
from experiments.dashboard.view.distance_chart import distances_cm, scale_cm
from experiments.records.recording import Run
from rig.log import INDEX, Log
from tests.support.greyed import why


class FakeWorker:
    """Takes work and does none."""

    def __init__(self):
        self.items: list[WorkItem] = []
        self.cancelled: list[str] = []

    def put(self, item: WorkItem, *, instead: bool = False) -> None:
        assert instead
        self.items.append(item)

    def cancel(self, name: str) -> bool:
        self.cancelled.append(name)
        return False


@pytest.fixture
def replay():
    server, _ = open_server("127.0.0.1", 0, "a-token-of-some-length-for-tests")
    controls, worker, shown = Controls(lambda *what: None, print), FakeWorker(), []
    controls.lock = ControlLock().joined(1)
    rows = [RunSummary(Path(f"out/run-{i}"), "hold", "with", 1, "completed") for i in (1, 2)]

    def show(page, playback):
        shown.append((page, playback.name))
        tab.on_playback(page, playback)

    tab = ReplayTab(server, controls, Pages(), worker, lambda: rows, show)  # pyright: ignore[reportArgumentType]
    tab.refresh()
    yield tab, controls, worker, shown
    server.stop()


def test_what_needs_a_film_is_greyed_until_the_page_has_one(replay):
    tab, controls, worker, _ = replay
    of_film = (tab._play, tab._scrub, tab._fast)
    buttons = {getattr(one, "label", ""): one for one, _ in controls.checks.values()}
    show, back = buttons["Show"], buttons["Back to the live table"]
    first = "choose a run and press Show first"
    assert [why(controls, one) for one in (show, back, *of_film)] == ["", *[first] * 4]
    tab.show(1)
    assert [why(controls, one) for one in (back, *of_film)] == ["", *[first] * 3]
    worker.items[0].on_message("shown", film("run-1"))
    controls.queue.close()
    for page, need in ((1, ""), (2, first)):  # of each page's own
        assert [why(controls, one, page) for one in (back, *of_film)] == [need] * 4
    tab._set_both(1, True)
    assert "no run of the other controller" in why(controls, show)
    tab._rows = list
    assert why(controls, show) == "no such run: make one in the tab Run"


def test_why_no_replay_can_be_shown_is_said_without_a_mouse(replay):
    tab, controls, worker, _ = replay
    told: dict = {}
    tab._pages.tell = lambda page, handle, **what: told.update({id(handle): what})
    tab._pick(1, tab._picked.value)

    def words() -> str:
        tab.draw()
        return told[id(tab._words)]["_markdown"]

    assert words() == LIVE
    tab._set_both(1, True)
    said = "**Show** is greyed: no run of the other controller with this protocol and seed."
    assert words() == f"{LIVE} {said}"
    tab._set_both(1, False)
    tab.show(1)
    worker.items[0].on_message("shown", film("run-1"))
    controls.queue.close()
    tab._set_both(1, True)
    assert "**Replay** of" in words()  # of another choice than the one that is shown
    assert said in words()


def recorded(seconds=30.0, arm="with", begin_s=0.0):
    """A run whose ball moves to the right at 1 cm/s, seen every tenth tick, with two events."""
    t = begin_s + np.arange(round(seconds * 500)) / 500
    ball = np.where(np.arange(len(t)) % 10 == 0, 0.01 * (t - begin_s), np.nan)
    log = Log.from_columns({"t_s": t, "ball_x_m": ball, "ball_y_m": 0 * ball, "phase": 2 + 0 * t})
    events = [{"t_s": begin_s, "text": "released"}, {"t_s": begin_s + 9.0, "text": "by hand: push"}]
    return Run(Path("run"), {"arm": arm}, log, events)


def film(name):
    return run_film(name, recorded(1.0))


def test_of_two_runs_that_were_asked_for_the_newest_is_shown(replay):
    tab, controls, worker, shown = replay
    tab.show(1)
    tab._pick(1, "hold, with, run-2")
    tab.show(1)
    first, second = worker.items
    first.on_message("shown", film("run-1"))  # it was on its way as the second was asked for
    second.on_message("shown", film("run-2"))
    first.on_message("failed", "ended before it was done")
    second.on_message("progress", ("rendering the video", 1, 4))
    controls.queue.close()
    assert shown == [(1, "run-2")]
    assert tab._of(1).about == "*rendering the video: 25 %*"


def test_a_run_is_called_by_protocol_controller_and_the_clock_on_the_wall(monkeypatch):
    monkeypatch.setenv("TZ", "Asia/Tokyo")
    time.tzset()
    try:
        now = datetime.now(UTC)
        today = RunSummary(Path(f"{now:%Y%m%dT%H%M%S}-hold-with-2"), "hold", "with", 1, "completed")
        there = now + timedelta(hours=9)
        assert today.label == f"hold, with, {there:%H:%M:%S} (2)"
        old = RunSummary(Path("20200131T230000-hold-with"), "hold", "with", 1, "completed")
        assert old.label == "hold, with, 2020-02-01 08:00:00"
    finally:
        monkeypatch.undo()
        time.tzset()


def test_a_run_of_the_servos_alone_has_no_target_on_the_plate():
    run = recorded(2.0)
    aims = run.log.rows.copy()
    aims[:, [INDEX["target_x_m"], INDEX["target_y_m"]]] = 0.1  # rad
    protocol = {"protocol": {"servo_only": True}}
    film = run_film("run", replace(run, log=Log.from_rows(aims), meta=run.meta | protocol))
    assert np.isnan(film.motion.target_m).all()
    assert np.isnan(film.rows[:, INDEX["target_x_m"]]).all()
    film = run_film("run", replace(run, log=Log.from_rows(aims)))
    assert (film.rows[:, INDEX["target_x_m"]] == 0.1).all()

    live = LiveBuffer(500.0)
    for has_ball in (False, True):
        live.begin(has_ball=has_ball)
        live.add(aims[0])
        row = live.now().row
        assert row is not None
        assert np.isnan(row[INDEX["target_x_m"]]) != has_ball


def test_events_stand_in_order_of_time_and_what_is_past_is_marked():
    """Pushes that were detected are written at the end of a recording."""
    run = recorded(20.0, begin_s=1.0)
    late = [{"t_s": 1.0 + t, "text": "push detected"} for t in (4.0, 12.0)]
    film = run_film("run", replace(run, events=[*run.events, *late]))
    assert [at_s for at_s, _ in film.events] == [0.0, 4.0, 9.0, 12.0]
    assert event_lines(film.events, 9.5).count("●") == 3
    assert event_lines(film.events, 9.5).splitlines()[-1].startswith("○ 12.0 s")
    assert film.since == "from the run's start"
    assert run_film("run", run, run).since == "from the release"


def test_a_run_that_is_still_read_does_not_replace_what_was_chosen_since(replay):
    tab, controls, worker, shown = replay
    tab.show(1)
    tab.on_playback(1, None)  # back to the live table
    worker.items[0].on_message("shown", film("run-1"))
    controls.queue.close()
    assert shown == []
    assert worker.cancelled == [worker.items[0].name]  # nobody waits for its video


def test_every_page_has_a_film_of_its_own_and_one_that_is_gone_none(replay):
    tab, controls, worker, shown = replay
    tab.show(1)
    tab._pick(2, "hold, with, run-2")  # a page that watches
    tab.show(2)
    first, second = worker.items
    assert first.name != second.name  # so that neither ends the other
    first.on_message("shown", film("run-1"))
    second.on_message("shown", film("run-2"))
    controls.queue.put("seek", lambda: tab._seek(2, 0.5))
    controls.queue.put("gone", lambda: tab.left(1))
    controls.queue.close()
    assert shown == [(1, "run-1"), (2, "run-2")]
    assert tab._need(2).clock.t_s == pytest.approx(0.5, abs=0.4)
    assert worker.cancelled == [first.name]
    with pytest.raises(ValueError, match="press Show first"):
        tab.toggle(1)


def test_curves_ball_and_events_stand_at_one_time():
    one = run_film("run", recorded(begin_s=0.5))
    playback = Playback("run", one.motion, film=one, playing=False)
    playback.clock.seek(25.0)
    rows, curve = playback.past(), playback.curve()
    assert rows is not None
    assert curve is not None
    assert 24.8 < rows[-1, 0] <= 25.0
    assert 5.0 <= rows[0, 0] < 5.3  # the last 20 s
    assert curve[[0, -1], 0] == pytest.approx([10.0, 30.0], abs=0.15)  # of the film's end
    playback.clock.seek(12.0)
    middle = playback.curve()
    assert middle is not None
    assert middle[[0, -1], 0] == pytest.approx([2.0, 22.0], abs=0.15)
    ball_m = playback.motion.at(25.0)[1]
    assert rows[-1, INDEX["ball_x_m"]] == pytest.approx(ball_m[0], abs=0.002)
    assert np.isfinite(rows[:, INDEX["ball_x_m"]]).all()
    assert event_lines(one.events, 8.9) == "● 0.0 s: released  \n○ 9.0 s: by hand&#58; push"
    assert event_lines(one.events, 9.0).count("●") == 2


def test_both_controllers_start_at_one_release():
    one = run_film("run", recorded(begin_s=0.5), recorded(arm="without", begin_s=120.0))
    assert one.beside is not None
    assert (one.method, one.beside_method) == ("with", "without")
    assert one.of == "the run with play compensation"  # whose curves, values and swing are drawn
    assert run_film("run", recorded()).of == "run"
    assert one.motion.at(10.0)[1] == pytest.approx(one.beside.at(10.0)[1], abs=1e-3)


def test_the_run_beside_goes_along_up_to_the_same_moment():
    one = run_film("run", recorded(begin_s=0.5), recorded(arm="without", begin_s=120.0))
    playback = Playback("run", one.motion, film=one, playing=False)
    playback.clock.seek(12.0)
    own, other = playback.past(), playback.past_beside()
    assert own is not None
    assert other is not None
    assert other == pytest.approx(own, abs=1e-3, nan_ok=True)
    assert one.beside_of == "the run without play compensation"
    alone = run_film("run", recorded())
    assert Playback("run", alone.motion, film=alone).past_beside() is None


def test_a_film_is_called_as_the_run_in_the_list(replay):
    tab, controls, worker, _ = replay
    tab.show(1)
    controls.queue.close()
    assert worker.items[0].task.args[2] == tab._rows()[0].label


def test_two_runs_of_one_film_show_where_they_part():
    one = run_film("run", recorded(), recorded(arm="without", begin_s=120.0))
    times_s = np.array([0.0, 10.0, 20.0])
    target = np.zeros_like(one.motion.ball_m)
    motion = replace(one.motion, target_m=target)
    assert distances_cm(motion, times_s) == pytest.approx([0.0, 10.0, 20.0], abs=0.1)
    unseen = motion.ball_m.copy()
    unseen[: len(unseen) // 2] = np.nan  # as before it was seen first
    found = distances_cm(replace(motion, ball_m=unseen), times_s)
    assert found == pytest.approx([15.0, 15.0, 20.0], abs=0.2)


def test_the_way_to_the_target_does_not_set_the_scale_of_two_runs():
    times_s = np.linspace(0.0, 16.0, 160)
    far = np.where(times_s < 1.5, 20.0, 0.6)
    assert scale_cm(times_s, far, 0.3 + 0 * far) == pytest.approx((0.0, 0.63))
    assert scale_cm(np.array([0.0, 1.0]), np.array([9.0, 2.0])) == pytest.approx((0.0, 2.1))


def test_the_partner_is_the_nearest_completed_run_with_the_other_controller():
    def row(number, method, seed=1, outcome="completed"):
        return RunSummary(Path(f"2026010{number}-hold-{method}"), "hold", method, seed, outcome)

    rows = [row(8, "with"), row(7, "without"), row(5, "without", 2), row(3, "without")]
    assert partner(rows[0], rows) == rows[1].folder
    assert partner(rows[2], rows) is None
    assert partner(row(2, "with"), rows) == rows[3].folder
    assert partner(rows[0], [rows[0], row(7, "without", outcome="aborted")]) is None
