"""Long work in its own process: progress, printed lines, refusals, cancelling."""

import os
import signal
import time
from queue import Queue

import pytest

from experiments.dashboard.session.worker_process import WorkerProcess, WorkItem

pytestmark = pytest.mark.realtime


def good(progress):
    progress("halfway", 1, 2)
    print("a line", "of two words")
    return {"answer": 42}


def refused(progress):
    raise ValueError("the sheet is too small: print it again")


def broken(progress):
    raise RuntimeError("broken")


def endless(progress):
    progress("on", 0, 1)
    time.sleep(600)


@pytest.fixture
def worker():
    made = WorkerProcess()
    yield made
    made.close()


def on_message(worker: WorkerProcess, name: str, task, most: int = 9) -> list:
    """Everything that a piece of work says until it has ended."""
    words: Queue = Queue()
    worker.put(WorkItem(name, task, lambda kind, what: words.put((kind, what))))
    found = []
    while not found or found[-1][0] not in ("done", "failed"):
        found.append(words.get(timeout=120))
        assert len(found) < most
    return found


def test_progress_lines_and_answer_come_back_in_order(worker):
    assert on_message(worker, "good", good) == [
        ("progress", ("halfway", 1, 2)),
        ("line", "a line of two words"),
        ("done", {"answer": 42}),
    ]


def test_a_refusal_is_its_sentence_and_a_fault_its_name(worker):
    assert on_message(worker, "a", refused) == [
        ("failed", "the sheet is too small: print it again")
    ]
    assert on_message(worker, "b", broken) == [("failed", "RuntimeError: broken")]


def deaf(progress):
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    endless(progress)


@pytest.mark.parametrize("work", [endless, deaf])
def test_work_is_cancelled_and_the_next_piece_is_served(worker, work):
    words: Queue = Queue()
    worker.put(WorkItem("endless", work, lambda *what: words.put(what)))
    assert words.get(timeout=120) == ("progress", ("on", 0, 1))
    with pytest.raises(ValueError, match="endless is on already"):
        worker.put(WorkItem("endless", endless, lambda *what: None))
    worker.cancel("endless")
    assert words.get(timeout=120)[0] == "failed"
    assert on_message(worker, "good", good)[-1][0] == "done"


def test_who_waits_is_told_what_goes_before(worker):
    words: Queue = Queue()
    worker.put(WorkItem("endless", endless, lambda *what: words.put(what)))
    assert words.get(timeout=120) == ("progress", ("on", 0, 1))
    assert worker.goes_before("endless") == worker.goes_before("good") == ""
    worker.put(WorkItem("good", good, lambda *what: words.put(what)))
    assert worker.goes_before("good") == "endless"
    worker.cancel("endless")
    while words.get(timeout=120)[0] != "done":
        pass
    assert worker.goes_before("good") == ""


def test_new_work_takes_the_place_of_the_old_while_that_is_being_done(worker):
    words: Queue = Queue()
    worker.put(WorkItem("work", endless, lambda *what: words.put(what)))
    assert words.get(timeout=120) == ("progress", ("on", 0, 1))
    worker.put(WorkItem("work", good, lambda *what: words.put(what)), instead=True)
    found = [words.get(timeout=120) for _ in range(3)]
    assert found[0] == ("progress", ("halfway", 1, 2))  # of the old one no word, no failure
    assert found[-1] == ("done", {"answer": 42})


def test_who_hears_that_work_has_ended_can_put_it_again(worker):
    words: Queue = Queue()

    def again(kind: str, what) -> None:
        if kind == "done":
            worker.put(WorkItem("work", good, lambda *what: words.put(what)))

    worker.put(WorkItem("work", good, again))
    assert [words.get(timeout=120)[0] for _ in range(3)] == ["progress", "line", "done"]


def interrupted(progress):
    os.kill(os.getpid(), signal.SIGINT)  # Ctrl-C, which a terminal sends to every process
    time.sleep(0.1)
    return "still here"


def test_ctrl_c_is_left_to_the_program(worker):
    assert on_message(worker, "hears it", interrupted) == [("done", "still here")]


def test_work_that_is_cancelled_as_it_begins_is_not_done(worker, monkeypatch):
    begin = worker._worker

    def cancelled():
        worker.cancel("endless")
        return begin()

    for _ in range(2):  # without a process, then with one
        with monkeypatch.context() as patch:
            patch.setattr(worker, "_worker", cancelled)
            assert on_message(worker, "endless", endless) == [
                ("failed", "ended before it was done")
            ]
        assert on_message(worker, "good", good)[-1][0] == "done"
