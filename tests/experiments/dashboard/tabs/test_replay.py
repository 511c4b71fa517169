"""The tab Replay before a worker that never ends: nothing is read in the thread of the queue."""

from pathlib import Path

import pytest

from experiments.dashboard.server.controls import ControlLock, Controls
from experiments.dashboard.server.server import open_server
from experiments.dashboard.session.tasks import RunSummary
from experiments.dashboard.session.worker_process import WorkItem
from experiments.dashboard.tabs.replay import ReplayTab
from experiments.gap.closed_loop_replay import table_motion
from rig.log import Log


class FakeWorker:
    """Takes work and does none."""

    def __init__(self):
        self.items: list[WorkItem] = []

    def put(self, item: WorkItem, *, instead: bool = False) -> None:
        assert instead
        self.items.append(item)


@pytest.fixture
def replay():
    server, _ = open_server("127.0.0.1", 0, "a-token-of-some-length-for-tests")
    controls, worker, shown = Controls(lambda *what: None, print), FakeWorker(), []
    controls.lock = ControlLock().joined(1)
    rows = [RunSummary(Path(f"out/run-{i}"), "hold", "with", 1, "completed") for i in (1, 2)]

    def show(playback):
        shown.append(playback)
        tab.on_playback(playback)

    tab = ReplayTab(server, controls, worker, lambda: rows, show)  # pyright: ignore[reportArgumentType]
    tab.refresh()
    yield tab, controls, worker, shown
    server.stop()


def motion():
    return table_motion(Log.from_columns({"t_s": [0.0, 0.002], "ball_x_m": [0.0, 0.0]}))


def test_of_two_runs_that_were_asked_for_the_newest_is_shown(replay):
    tab, controls, worker, shown = replay
    tab.show()
    tab._run.now = "run-2"
    tab.show()
    first, second = worker.items
    first.on_message("shown", ("run-1", motion()))  # it was on its way as the second was asked for
    second.on_message("shown", ("run-2", motion()))
    first.on_message("failed", "ended before it was done")
    second.on_message("progress", ("rendering the video", 1, 4))
    controls.queue.close()
    assert [playback.name for playback in shown] == ["run-2"]
    assert tab._about.content == "*rendering the video: 25 %*"


def test_a_run_that_is_still_read_does_not_replace_what_was_chosen_since(replay):
    tab, controls, worker, shown = replay
    tab.show()
    tab.on_playback(None)  # back to the live table
    worker.items[0].on_message("shown", ("run-1", motion()))
    controls.queue.close()
    assert shown == []
