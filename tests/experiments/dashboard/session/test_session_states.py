"""The session's states with a loop that does what the test says: no process, no table, no clock."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from queue import Queue
from types import SimpleNamespace

import numpy as np
import pytest

from experiments.dashboard.session.plan import RunPlan
from experiments.dashboard.session.session import MOST_FAILURES, Session
from experiments.runs.protocol import parse
from rig.log import COLUMNS
from rig.loop.commands import Push, SetGains, Stop, Target
from rig.loop.loop import Ending
from rig.parameters import Rig
from tests.support.waiting import wait_for

PATIENCE_S = 5.0
PROTOCOL = parse({"title": "short", "duration_s": 10.0}, label="short", name="short")
HELD = parse(
    {"title": "held", "duration_s": 10.0, "start": {"hold_s": 2.0}}, label="held", name="held"
)
DONE = Ending("completed")


class ScriptedLoop:
    """Stands for a loop process: hands on what the test says, ends when told or stopped."""

    def __init__(self, job: object) -> None:
        self.job, self.got, self.at_rest, self.notes = job, [], False, {"loop": job}
        self._said: Queue = Queue()

    def put(self, command: object) -> None:
        self.got.append(command)
        if isinstance(command, Stop):
            self.end(Ending(command.outcome, command.reason))

    def kill(self) -> None:
        self.end(Ending("loop died"))

    def row(self, t_s: float) -> None:
        row = np.full(len(COLUMNS), np.nan)
        row[0] = t_s
        self._said.put(row)

    def say(self, t_s: float, text: str) -> None:
        self._said.put((t_s, text))

    def end(self, ending: Ending | Exception) -> None:
        self._said.put(ending)

    def run(self, keep, event) -> Ending:
        while True:
            said = self._said.get(timeout=60.0)
            if isinstance(said, Exception):
                raise said
            if isinstance(said, Ending):
                return said
            event(*said) if isinstance(said, tuple) else keep(said)


class Notebook:
    """Stands for the recorder: keeps the events of every run."""

    events: list[tuple[float, str]] = []  # noqa: RUF012  of all runs of a test

    def __init__(self, folder: Path, start: dict) -> None:
        self.say = self.at_end = lambda *words: None

    def __enter__(self) -> "Notebook":
        return self

    def __exit__(self, *error: object) -> None: ...

    def event(self, t_s: float, text: str) -> None:
        Notebook.events.append((t_s, text))
        self.say(t_s, text)


class Desk:
    """A session on scripted loops, and what it told."""

    def __init__(self, *, real: bool = False, balance: bool = False) -> None:
        self.loops: list[ScriptedLoop] = []
        self.recorded: list[tuple] = []
        self.events: list[tuple[float, str]] = []
        self.rows: list[float] = []
        self.confirmed: list[str] = []
        self.refuse: Exception | None = None  # of `check`
        self.fails: Exception | None = None  # of `ready`
        self.meanwhile = lambda: None  # between "run is on" and its loop's start
        table = SimpleNamespace(
            real=real, check=self._check, confirm=self.confirmed.append, ready=self._ready
        )
        live = SimpleNamespace(begin=lambda: None, add=lambda row: self.rows.append(row[0]))
        self.session = Session(
            Rig(),
            table,  # pyright: ignore[reportArgumentType]
            live,  # pyright: ignore[reportArgumentType]
            on_recorded=lambda *what: self.recorded.append(what),
            on_event=lambda *what: self.events.append(what),
            balance=balance,
        )

    def _check(self, plan: RunPlan, rig: Rig) -> None:
        self.checked = plan, rig
        if self.refuse is not None:
            raise self.refuse

    @contextmanager
    def _ready(self, planned, rig):
        self.meanwhile()
        if self.fails is not None:
            raise self.fails
        request = SimpleNamespace(believed=None)
        yield SimpleNamespace(folder=Path("run"), start={}, request=request, job=(planned, rig))

    def make(self, job: object) -> ScriptedLoop:
        loop = ScriptedLoop(job)
        self.loops.append(loop)
        return loop

    def record(self, job, recorder, *, started, watch) -> Ending:
        loop = self.make(job)
        started(loop)
        return loop.run(watch, recorder.event)

    def plan(self, methods=("without", "with"), *, protocol=PROTOCOL, **more) -> RunPlan:
        return RunPlan(protocol, methods, more.pop("repetitions", 1), 1, **more)

    def state(self, wanted: str) -> None:
        wait_for(wanted, lambda: self.session.status.state == wanted, PATIENCE_S)

    def loop(self, number: int) -> ScriptedLoop:
        """The loop with this number from 1, started, its first row taken."""
        wait_for(f"loop {number}", lambda: len(self.loops) >= number, PATIENCE_S)
        loop = self.loops[number - 1]
        count = len(self.rows)
        loop.row(0.5)
        wait_for("a row", lambda: len(self.rows) > count, PATIENCE_S)
        return loop


class Watching:
    """Stands for `Watch`."""

    def __init__(self, *given: object) -> None: ...

    def stop_through(self, session: object) -> None: ...

    def note_pushes(self, believed: object) -> None: ...

    def check(self, row: np.ndarray) -> None: ...


@contextmanager
def opened(**how) -> Iterator[Desk]:
    """A desk whose session's module uses the stand-ins."""
    module = vars(sys.modules[Session.__module__])
    names = "LoopProcess", "record_live", "AnnouncingRecorder", "Recorder", "Watch", "virtual_job"
    before = {name: module[name] for name in names}
    desk: list[Desk] = []
    jobs = SimpleNamespace(
        virtual_job=lambda rig, method, course: ("balancing", rig),
        balancing_course=lambda rig: None,
    )
    module.update(
        LoopProcess=lambda job: desk[0].make(job),
        record_live=lambda *a, **k: desk[0].record(*a, **k),
        AnnouncingRecorder=Notebook,
        Recorder=Notebook,
        Watch=Watching,
        virtual_job=jobs,
    )
    Notebook.events.clear()
    begin_balancing = how.pop("balance", False)
    try:
        desk.append(Desk(**how))
        if begin_balancing:
            desk[0].session.balance()
        yield desk[0]
    finally:
        for loop in desk[0].loops:
            loop.end(DONE)
        desk[0].session.close()
        module.update(before)
        assert not desk[0].session._thread.is_alive()


def test_the_runs_of_a_plan_follow_each_other_and_then_the_virtual_table_balances():
    with opened() as desk:
        desk.state("stopped")
        assert desk.session.status.words == "the table rests at 0 V"
        desk.session.start(desk.plan())
        first = desk.loop(1)
        status = desk.session.status
        assert (status.state, status.t_s, status.run.number, status.run.of) == (
            "running",
            0.5,
            1,
            2,
        )
        assert status.waited_s is None
        assert first.job[0].method == "without"
        with pytest.raises(ValueError, match="a run is on"):
            desk.session.start(desk.plan())
        first.end(DONE)
        second = desk.loop(2)
        assert second.job[0].method == "with"
        assert first.got == []
        second.end(DONE)
        desk.loop(3)
        desk.state("balancing")
        assert [planned.method for planned, *_ in desk.recorded] == ["without", "with"]
        assert desk.recorded[0][1:] == (Path("run"), DONE)
        assert desk.session.status.last == ""
        assert not desk.session.may_repeat
        assert desk.events == []


def test_a_plan_with_pauses_goes_on_when_told():
    with opened(real=True) as desk:
        desk.session.start(desk.plan(pause=True))
        desk.loop(1).end(DONE)
        desk.state("pause")
        status = desk.session.status
        assert status.words == "run 2 of 2 is next (with play compensation)"
        with pytest.raises(ValueError, match="a run is on"):
            desk.session.start(desk.plan())
        desk.session.go_on()
        desk.loop(2).end(DONE)
        desk.state("stopped")  # a real table rests, and the last run has no pause behind it
        assert len(desk.loops) == 2


def test_a_run_that_fails_waits_and_may_be_repeated_on_the_rig_of_its_plan():
    with opened(real=True) as desk:
        with pytest.raises(ValueError, match="none to repeat"):
            desk.session.repeat()
        rig = desk.session.rig
        desk.session.start(desk.plan())
        assert desk.checked[1] is rig
        desk.session.set_plant(other := Rig())
        loop = desk.loop(1)
        assert not desk.session.may_repeat
        with pytest.raises(ValueError, match="none to repeat"):
            desk.session.repeat()
        loop.end(Ending("ball lost", "it fell"))
        desk.state("pause")
        assert desk.session.may_repeat
        assert "it fell" in desk.session.status.last
        assert desk.events[-1] == (0.5, "ball lost: it fell")
        desk.session.repeat()
        again = desk.loop(2)
        assert desk.checked[1] is rig
        assert again.job[0].method == "without"
        assert again.job[1] is rig
        assert desk.session.rig is other
        again.end(DONE)
        assert desk.loop(3).job[0].method == "with"  # the rest follows without a pause
        assert desk.session.status.last == ""
        assert not desk.session.may_repeat


def test_stop_ends_the_run_for_good_and_says_what_happens():
    with opened() as desk:
        desk.session.start(desk.plan(repetitions=2))
        loop = desk.loop(1)
        halt = loop.end
        loop.end = lambda ending: None  # the plate takes its time
        desk.session.stop("page 7")
        assert loop.got == [Stop("stopped by page 7", "aborted")]
        assert desk.session.status.state == "stopping"
        loop.at_rest = True
        assert desk.session.status.state == "at rest"
        halt(Ending("aborted", "stopped by page 7"))
        desk.state("stopped")
        assert len(desk.loops) == 1
        assert desk.recorded[0][2].outcome == "aborted"
        assert "stopped by page 7" in desk.session.status.last
        assert desk.session.may_repeat
        desk.session.stop("page 8")  # nothing moves
        assert desk.session.status.state == "stopped"
        desk.session.balance()
        assert desk.loop(2).job[0] == "balancing"
        desk.state("balancing")


def test_stop_before_the_loop_has_started_reaches_it_all_the_same():
    with opened() as desk:
        seen = []

        def stop() -> None:
            desk.session.stop("page 7")
            seen.append(desk.session.status.state)

        desk.meanwhile = stop
        desk.session.start(desk.plan())
        wait_for("the end", lambda: desk.recorded, PATIENCE_S)
        desk.state("stopped")
        assert seen == ["at rest"]  # no table was opened
        assert desk.loops[0].got == [Stop("stopped by page 7", "aborted")]
        assert len(desk.loops) == 1


@pytest.mark.parametrize("act", ["start", "repeat"])
def test_what_was_asked_before_a_stop_does_not_begin_after_it(act: str):
    with opened(real=True) as desk:
        desk.session.start(desk.plan(("with",)))
        desk.loop(1).end(Ending("limit", "too far"))
        desk.state("stopped")
        table = desk.session.table
        table.check = lambda plan, rig: desk.session.stop("page 2")  # pyright: ignore
        with pytest.raises(ValueError, match="STOP was pressed"):
            desk.session.start(desk.plan()) if act == "start" else desk.session.repeat()
        assert len(desk.loops) == 1


def test_a_run_ends_balancing_and_what_is_refused_does_not():
    with opened(balance=True) as desk:
        loop = desk.loop(1)
        desk.state("balancing")
        desk.refuse = ValueError("no camera")
        with pytest.raises(ValueError, match="no camera"):
            desk.session.start(desk.plan())
        assert loop.got == []
        desk.refuse = None
        desk.session.start(desk.plan(("with",)))
        assert loop.got == [Stop("a run begins", "ended")]
        assert desk.loop(2).job[0].method == "with"
        assert desk.session.last_notes == {"loop": loop.job}
        assert desk.events == []


def test_another_plant_restarts_balancing_and_leaves_a_run_alone():
    with opened(balance=True) as desk:
        loop, plant = desk.loop(1), Rig()
        desk.session.set_plant(plant)
        assert loop.got == [Stop("another plant", "ended")]
        second = desk.loop(2)
        assert second.job == ("balancing", plant)
        desk.session.start(desk.plan(("with",)))
        run = desk.loop(3)
        desk.session.set_plant(Rig())
        assert run.got == []


def test_commands_reach_the_loop_that_is_on_alone():
    with opened() as desk:
        desk.state("stopped")
        gains, rig = SetGains(1.0, 2.0, 3.0), Rig()
        desk.session.set_gains(rig, gains)
        assert desk.session.rig is rig
        with pytest.raises(ValueError, match="nothing moves"):
            desk.session.put(Target(None))
        desk.session.start(desk.plan(("with",)))
        loop = desk.loop(1)
        assert loop.job[1] is rig
        desk.session.put(Push((1.0, 0.0)))
        desk.session.set_gains(rig, gains)
        assert loop.got == [Push((1.0, 0.0)), gains]


def test_the_operator_is_waited_for_and_confirms():
    with opened() as desk:
        desk.session.start(desk.plan(("with",), protocol=HELD))
        loop = desk.loop(1)
        with pytest.raises(ValueError, match="nothing is asked"):
            desk.session.confirm()
        loop.say(0.5, "asked: place the ball")
        loop.row(3.0)
        wait_for("the step", lambda: desk.session.status.waited_s == 3.0, PATIENCE_S)
        status = desk.session.status
        assert (status.operator_step, status.t_s) == ("place the ball", 0.0)
        desk.session.confirm()
        assert desk.confirmed == ["place the ball"]
        assert desk.session.status.operator_step == ""
        assert desk.events[-1] == (0.0, "confirmed: place the ball")
        loop.say(4.0, "placed")
        loop.say(4.0, "asked: hold it there")
        loop.row(5.0)
        wait_for("the hold", lambda: desk.session.status.waited_s == 5.0, PATIENCE_S)
        assert (5.0, "confirmed: place the ball") in Notebook.events
        desk.session.confirm()
        assert desk.session.status.operator_step == "hold it there"  # until it is let go
        loop.say(7.0, "released")
        loop.row(8.0)
        wait_for("the run", lambda: desk.session.status.waited_s is None, PATIENCE_S)
        status = desk.session.status
        assert (status.t_s, status.operator_step) == (3.0, "")  # from 2 s of hold before 7 s


def test_a_ball_that_is_only_placed_starts_the_clock_there():
    with opened() as desk:
        desk.session.start(desk.plan(("with",)))
        loop = desk.loop(1)
        loop.say(0.5, "asked: place the ball")
        loop.say(6.0, "placed")
        loop.row(6.5)
        wait_for("the run", lambda: desk.session.status.t_s == 0.5, PATIENCE_S)
        assert desk.session.status.operator_step == ""


def test_balancing_that_fails_again_and_again_is_given_up():
    with opened(balance=True) as desk:
        for number in range(1, MOST_FAILURES + 1):
            desk.loop(number).end(Ending("limit", "too far"))
        desk.state("stopped")
        assert len(desk.loops) == MOST_FAILURES
        assert [text for _, text in desk.events] == ["limit: too far"] * MOST_FAILURES + [
            "balancing failed again and again: the table rests"
        ]


def test_what_fails_is_told_and_the_session_lives():
    with opened(real=True) as desk:
        desk.fails = OSError("the disk is full")
        desk.session.start(desk.plan(("with",)))
        wait_for("the words", lambda: len(desk.events) == 2, PATIENCE_S)
        assert [text for _, text in desk.events] == [
            "OSError: the disk is full",
            "aborted: the disk is full",
        ]
        desk.state("stopped")
        assert "the disk is full" in desk.session.status.last
        desk.fails = None
        desk.session.start(desk.plan(("with",)))
        desk.loop(1).end(RuntimeError("in the loop"))
        desk.state("stopped")
        assert desk.events[-1][1] == "aborted: in the loop"


def test_closing_ends_what_moves_and_drops_the_plan():
    with opened() as desk:
        desk.session.start(desk.plan())
        loop = desk.loop(1)
        desk.session.close()
        assert loop.got == [Stop("the dashboard was closed", "interrupted")]
        assert len(desk.loops) == 1
        assert not desk.session._thread.is_alive()


def test_a_real_table_moves_in_runs_alone():
    with opened(real=True) as desk, pytest.raises(ValueError, match="in a run alone"):
        desk.session.balance()
