"""The tab Calibrate before a camera that is slow to be had: the queue of the pages never waits."""

import re
import threading
from contextlib import contextmanager
from datetime import UTC, datetime
from math import radians
from types import SimpleNamespace
from typing import Any

import pytest

from calibration.bundle import Draft
from calibration.records import BacklashAxis, BacklashRecord, TimingRecord, Value
from experiments.dashboard.server.controls import ControlLock, Controls
from experiments.dashboard.server.server import open_server
from experiments.dashboard.server.untrusted_text import measured
from experiments.dashboard.session.worker_process import WorkItem
from experiments.dashboard.tabs.calibrate import CalibrateTab
from rig.parameters import Rig
from rig.rigfile import write_rig
from tests.support.greyed import why
from tests.support.waiting import wait_for

ONE = radians(1.0)


class SlowCamera:
    """Is lent once `free` is set."""

    def __init__(self):
        self.free, self.lent = threading.Event(), 0

    def check_free(self) -> None:
        if self.lent:
            raise ValueError("lent")

    @contextmanager
    def lend(self):
        assert self.free.wait(30.0)
        self.lent += 1
        yield
        self.lent -= 1


class FakeWorker:
    def __init__(self):
        self.items: list[WorkItem] = []
        self.before = ""  # what is being done meanwhile

    def goes_before(self, name: str) -> str:
        return self.before

    def put(self, item: WorkItem) -> None:
        self.items.append(item)

    def check_free(self, name: str) -> None:
        pass

    def cancel(self, name: str) -> bool:
        return False


@pytest.fixture
def tab(tmp_path):
    server, _ = open_server("127.0.0.1", 0, "a-token-of-some-length-for-tests")
    controls = Controls(lambda *what: None, print)
    controls.lock = ControlLock().joined(1)
    camera, worker = SlowCamera(), FakeWorker()
    session = SimpleNamespace(rig=Rig(), status=SimpleNamespace(state="stopped"))
    words = (server, controls, worker, session, tmp_path, lambda page, path: None)
    one = CalibrateTab(*words, real=(tmp_path / "lab.toml", camera))  # pyright: ignore[reportArgumentType]
    yield one, camera, worker
    controls.queue.close()
    server.stop()


def test_a_step_begins_at_once_and_the_worker_as_soon_as_the_camera_is_free(tab):
    one, camera, worker = tab
    cancel = next(h for h, _ in one._controls.checks.values() if h.label == "Cancel")
    steps = [one._buttons["camera"], one._buttons["time"]]
    assert [why(one._controls, handle) for handle in (*steps, cancel)] == ["", "", "no step is on"]
    one.begin(("camera",))
    assert one._state["camera"] == "on"
    assert not worker.items
    on = "a step is on: wait, or cancel it"
    assert [why(one._controls, handle) for handle in (*steps, cancel)] == [on, on, ""]
    camera.free.set()
    wait_for("the worker", lambda: worker.items)
    assert camera.lent == 1
    worker.items[0].on_message("failed", "no sheet was seen")
    wait_for("the camera's return", lambda: camera.lent == 0)
    assert one._state["camera"] == "refused"
    assert why(one._controls, cancel) == "no step is on"
    one._session.status.state = "running"
    assert why(one._controls, steps[0]) == "a run is on: calibrate when it has ended"


def test_a_step_that_is_cancelled_while_the_camera_is_awaited_never_begins(tab):
    one, camera, worker = tab
    one.begin(("table",))
    one.stop("Cancel")
    assert one._state["table"] == "refused"
    camera.free.set()
    wait_for("the camera's return", lambda: threading.active_count() and camera.lent == 0)
    assert not worker.items


def test_a_step_that_is_refused_at_once_is_refused(tab):
    one, _, worker = tab
    one._controls.queue.put = lambda name, work: work()
    worker.put = lambda item: item.on_message("failed", "record one with the ball first")
    one.begin(("level",))
    assert one._state["level"] == "refused"
    assert "record one with the ball" in one._verdict.content


def test_a_step_that_is_begun_as_another_has_ended_is_the_only_one(tab):
    one, _, worker = tab
    one.begin(("time",))
    queued: list = []
    one._controls.queue.put = lambda name, work: queued.append(work)
    worker.items[0].on_message("done", ())
    queued.pop(0)()
    assert one._state["time"] == "accepted"
    assert queued
    one.begin(("level", "servo"))
    for work in queued:  # what was to follow the first
        work()
    assert [item.task.args[0].step for item in worker.items] == ["time", "level"]
    assert (one._state["level"], one._left) == ("on", ("servo",))


def test_a_step_uses_the_number_that_passed_its_checks_and_no_other(tab):
    one, camera, worker = tab
    camera.free.set()
    handle = next(
        handle
        for handle, _ in one._controls.checks.values()
        if getattr(handle, "label", "") == "Square as printed [mm]"
    )
    with pytest.raises(ValueError, match="no number"):
        one._controls.cleaned(1, handle, "wide")
    with pytest.raises(PermissionError):
        one._controls.cleaned(2, handle, 30.0)
    one._controls.use(1, handle, one._controls.cleaned(1, handle, 1e9))
    wait_for("the number", lambda: one._square_mm.now == 100.0)
    handle._impl.value = 7.0  # what a page might have got into the widget all the same
    one.begin(("camera",))
    wait_for("the worker", lambda: worker.items)
    assert one._square_mm.now == 100.0
    (request,) = worker.items[0].task.args
    assert request.square_mm == 100.0
    worker.items[0].on_message("failed", "no sheet was seen")
    wait_for("the camera's return", lambda: camera.lent == 0)


@pytest.fixture
def virtual(tmp_path):
    server, _ = open_server("127.0.0.1", 0, "a-token-of-some-length-for-tests")
    controls, worker = Controls(lambda *what: None, print), FakeWorker()
    session = SimpleNamespace(rig=Rig(), status=SimpleNamespace(state="stopped"))
    words = (server, controls, worker, session, tmp_path, lambda page, path: None)
    yield CalibrateTab(*words), worker  # pyright: ignore[reportArgumentType]
    controls.queue.close()
    server.stop()


@pytest.mark.parametrize(("width_rad", "said"), [(ONE, "agrees"), (2 * ONE, "differs")])
def test_the_answer_is_first_and_how_it_was_measured_is_folded(virtual, tmp_path, width_rad, said):
    folder = tmp_path / "calibration"
    folder.mkdir()
    write_rig(Rig(effects={"gear_backlash": {"x": {"play_rad": ONE}}}), folder / "table-play.toml")
    plays: dict[str, Any] = {"gear": {"x": BacklashAxis(width_rad=Value.around(width_rad, 0.001))}}
    record = BacklashRecord(plays=plays, not_seen={})
    Draft(made=datetime.now(UTC), source="simulated", play=record).save(folder / "calibration.json")
    one, worker = virtual
    one.begin(("play",))
    worker.items[0].on_message("line", "play x, gear (tachometer against encoder)")
    wait_for("the line", lambda: "tachometer" in one._verdict.content)
    assert not one._folded.visible
    worker.items[0].on_message("done", [])
    wait_for("the verdict", lambda: one._state["play"] == "accepted")
    first, answer, *_ = one._verdict.content.split("\n\n")
    assert first == "**play: accepted**"
    assert said in answer
    assert "truth" in answer
    assert "| 1&#46;00\u00a0deg |" in one._verdict.content  # the true one
    assert "tachometer" not in one._verdict.content
    assert "tachometer" in one._details.content
    assert one._folded.visible


def test_a_long_stage_goes_on_and_says_that_the_table_in_view_is_not_moved(virtual, monkeypatch):
    one, worker = virtual
    one.begin(("play",))
    worker.items[0].on_message("progress", ("leading the ball about", 3, 6))
    wait_for("the stage", lambda: "leading" in one._verdict.content)
    monkeypatch.setattr(one._elapsed, "changed", lambda: True)
    shares = []
    for _ in range(100):
        one.draw()
        shares.append(int(re.search(r"(\d+) %", one._verdict.content)[1]))
    assert shares == sorted(shares)
    assert shares[0] == 50
    assert 60 < shares[-1] <= 66  # the next stage is not there yet
    assert (
        "*On a copy of the table, not the one you see; up to two minutes.*" in one._verdict.content
    )
    worker.items[0].on_message("done", [])
    wait_for("the verdict", lambda: one._state["play"] == "accepted")
    one.draw()
    assert "copy" not in one._verdict.content


def test_verdicts_are_shown_again_after_a_restart(tab, tmp_path):
    one, _, worker = tab
    one.begin(("time",))
    worker.items[0].on_message("line", "delay 12.1 ms (limit 1 ms)")
    worker.items[0].on_message("line", "your rig file with what was measured: out/rig.toml")
    worker.items[0].on_message("line", "changed: camera.delay_s = 0.0121 (was 0.01)")
    worker.items[0].on_message("done", [])
    wait_for("the verdict", lambda: one._state["time"] == "accepted")
    delay = Value.around(0.0121, 0.0003)
    timing = TimingRecord(delay_s=delay, play_rad={"x": 0.0, "y": 0.0}, frames=9, source="ball")
    draft = Draft(made=datetime.now(UTC), source="measured", timing=timing)
    draft.save(tmp_path / "calibration" / "calibration.json")
    server, _ = open_server("127.0.0.1", 0, "a-token-of-some-length-for-tests")
    try:
        controls = Controls(lambda *what: None, print)
        words = (server, controls, worker, one._session, tmp_path, lambda page, path: None)
        again = CalibrateTab(*words, real=one._real)
        assert again._state["time"] == "accepted"
        assert again._kept["time"] == ["delay 12.1 ms (limit 1 ms)"]
        assert measured("12.1 [11.8, 12.4] ms") in again._found.content
        controls.queue.close()
    finally:
        server.stop()


def test_what_was_found_is_kept_over_no_link(tab, tmp_path):
    one, *_ = tab
    notes, kept = tmp_path / "notes.txt", tmp_path / "calibration/verdicts.json"
    notes.write_text("my notes")
    kept.parent.mkdir()
    kept.symlink_to(notes)
    one._keep("camera")
    assert notes.read_text() == "my notes"
    assert "camera" in kept.read_text()


def test_stop_ends_the_step_and_what_would_follow_and_says_who_ended_it(tab):
    one, camera, worker = tab
    camera.free.set()
    one.stop("STOP on a page")  # nothing is on
    one.begin(("camera", "table"))
    wait_for("the worker", lambda: worker.items)
    one.stop("STOP on a page")
    worker.items[0].on_message("failed", "ended before it was done")  # as the process ends
    wait_for("the end", lambda: one._state["camera"] == "refused")
    assert "camera: ended by STOP on a page" in one._verdict.content
    assert one._state["table"] == ""
    assert len(worker.items) == 1


def test_a_step_that_waits_for_an_analysis_says_so(virtual, monkeypatch):
    one, worker = virtual
    one.begin(("play",))
    monkeypatch.setattr(one._elapsed, "changed", lambda: True)
    worker.before = "gap"
    one.draw()
    assert "waits for the analysis in the tab Gap to end" in one._verdict.content
    worker.before = ""
    one.draw()
    assert "waits" not in one._verdict.content
