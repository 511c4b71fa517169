"""The session's states with a loop that does what the test says: no process, no table, no clock."""

import random
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from queue import Queue
from types import SimpleNamespace

import numpy as np
import pytest

from experiments.dashboard.session.plan import RunPlan
from experiments.dashboard.session.session import MOST_FAILURES, QUICK_S, Session
from experiments.runs.protocol import parse
from rig.log import COLUMNS
from rig.loop.commands import Push, SetGains, Stop, Target
from rig.loop.loop import Ending
from rig.parameters import Rig
from tests.support.waiting import wait_for

pytestmark = pytest.mark.realtime

PATIENCE_S = 5.0
PROTOCOL = parse({"title": "short", "duration_s": 10.0}, label="short", name="short")
HELD = parse(
    {"title": "held", "duration_s": 10.0, "start": {"hold_s": 2.0}}, label="held", name="held"
)
SERVOS_ALONE = parse(
    {
        "title": "servos",
        "duration_s": 10.0,
        "servo_only": True,
        "reference": {"shape": "squares", "amplitude": 0.1, "period_s": 1.0},
        "start": {"hold_s": 0.0},
    },
    label="servos",
    name="servos",
)
DONE = Ending("completed")


def derived() -> dict[str, float]:
    """What the tests are more impatient with: mutants, most of which die as something never comes
    that else takes milliseconds."""
    return {"PATIENCE_S": 2.0}


class ScriptedLoop:
    """Stands for a loop process: hands on what the test says, ends when told or stopped."""

    def __init__(self, job: object) -> None:
        self.job, self.got, self.at_rest, self.notes = job, [], False, {"loop": job}
        self.killed = False
        self._said: Queue = Queue()

    def put(self, command: object) -> None:
        self.got.append(command)
        if isinstance(command, Stop):
            self.end(Ending(command.outcome, command.reason))

    def kill(self) -> None:
        self.killed = True
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

    def __init__(self, *, real: bool = False, balance: bool | None = False) -> None:
        self.stopped = False  # since what is asked for was asked for
        self.loops: list[ScriptedLoop] = []
        self.recorded: list[tuple] = []
        self.events: list[tuple[float, str]] = []
        self.rows: list[float] = []
        self.balls: list[bool] = []  # by live run: has it a ball?
        self.confirmed: list[str] = []
        self.refuse: Exception | None = None  # of `check`
        self.fails: Exception | None = None  # of `ready`
        self.meanwhile = lambda: None  # between "run is on" and its loop's start
        table = SimpleNamespace(
            real=real, check=self._check, confirm=self.confirmed.append, ready=self._ready
        )
        live = SimpleNamespace(begin=self._begin, add=lambda row: self.rows.append(row[0]))
        self.session = Session(
            Rig(),
            table,  # pyright: ignore[reportArgumentType]
            live,  # pyright: ignore[reportArgumentType]
            on_recorded=lambda *what: self.recorded.append(what),
            on_event=lambda *what: self.events.append(what),
            still=self._still,
            **({} if balance is None else {"balance": balance}),
        )

    def _still(self) -> None:
        if self.stopped:
            raise PermissionError("STOP was pressed")

    def _begin(self, *, has_ball: bool = True) -> None:
        self.balls.append(has_ball)

    def _check(self, plan: RunPlan, rig: Rig) -> None:
        self.checked = plan, rig
        if self.refuse is not None:
            raise self.refuse

    @contextmanager
    def _ready(self, planned, rig):
        self.meanwhile()
        if self.fails is not None:
            raise self.fails
        request = SimpleNamespace(believed=planned.method)
        yield SimpleNamespace(folder=Path("run"), start={}, request=request, job=(planned, rig))

    def make(self, job: object) -> ScriptedLoop:
        loop = ScriptedLoop(job)
        if job[0] == "balancing":  # pyright: ignore[reportIndexIssue]
            self.meanwhile()
        self.loops.append(loop)
        return loop

    def record(self, job, recorder, *, started, watch) -> Ending:
        loop = self.make(job)
        started(loop)
        ending = loop.run(watch, recorder.event)
        recorder.at_end()
        return ending

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

    def note_pushes(self, believed: str) -> None:
        Notebook.events.append((-1.0, f"pushes noted for {believed}"))

    def check(self, row: np.ndarray) -> None: ...


@contextmanager
def opened(**how) -> Iterator[Desk]:
    """A desk whose session's module uses the stand-ins."""
    module = vars(sys.modules[Session.__module__])
    names = "LoopProcess", "record_live", "AnnouncingRecorder", "Recorder", "Watch", "virtual_job"
    before = {name: module[name] for name in (*names, "CLOSE_S")}
    desk: list[Desk] = []

    def there() -> Desk:
        wait_for("the desk", lambda: desk, PATIENCE_S)
        return desk[0]

    jobs = SimpleNamespace(
        virtual_job=lambda rig, method, course: ("balancing", rig),
        balancing_course=lambda rig: None,
    )
    module.update(
        LoopProcess=lambda job: there().make(job),
        record_live=lambda *a, **k: there().record(*a, **k),
        AnnouncingRecorder=Notebook,
        Recorder=Notebook,
        Watch=Watching,
        virtual_job=jobs,
        CLOSE_S=how.pop("close_s", 1.0),
    )
    Notebook.events.clear()
    try:
        desk.append(Desk(**how))
        yield desk[0]
    finally:
        for loop in desk[0].loops:
            loop.end(DONE)
        desk[0].session.close()
        # A thread that lives on (of a mutant) keeps the stand-ins: it starts no process.
        assert not desk[0].session._thread.is_alive()
        module.update(before)


def test_the_runs_of_a_plan_follow_each_other_and_then_the_virtual_table_balances():
    with opened() as desk:
        desk.state("stopped")
        assert desk.session.status.words == "the table rests at 0 V"
        desk.session.start(desk.plan())
        wait_for("the first loop", lambda: desk.loops, PATIENCE_S)
        status = desk.session.status
        assert (status.state, status.t_s) == ("running", 0.0)
        assert status.words.endswith(": starting")
        assert status.shown == "run starting"
        first = desk.loop(1)
        status = desk.session.status
        assert status.shown == "running"
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
        assert desk.session.status.shown == "balancing"
        assert desk.session.status.words == "the virtual table balances its ball"
        noted = [text for _, text in Notebook.events if text.startswith("pushes")]
        assert noted == ["pushes noted for without", "pushes noted for with"]
        assert [planned.method for planned, *_ in desk.recorded] == ["without", "with"]
        assert desk.recorded[0][1:] == (Path("run"), DONE)
        assert desk.session.status.last == "Both runs are done: see the tab Results."
        assert not desk.session.may_repeat
        assert desk.events == []


def test_between_two_runs_it_is_said_that_the_second_one_starts():
    with opened() as desk:
        desk.session.start(desk.plan())
        desk.loop(1)
        desk.meanwhile = lambda: shown.append(desk.session.status.shown)
        shown: list[str] = []
        desk.loops[0].end(DONE)
        wait_for("run 2", lambda: shown, PATIENCE_S)
        assert shown == ["run starting"]
        desk.loop(2)
        assert desk.session.status.shown == "running"


def test_events_are_kept_behind_the_run_in_which_they_were():
    with opened() as desk:
        desk.session.start(desk.plan())
        first = desk.loop(1)
        first.say(0.3, "released")
        first.end(Ending("ball lost", "it fell"))
        desk.state("pause")
        desk.session.note("page 1 took over the controls")
        one = f"run 1 of 2: {PROTOCOL.name}, without play compensation"
        assert list(desk.session.events) == [
            (one, "0.3 s: released"),
            (one, "0.5 s: ball lost: it fell"),
            ("between runs", "0.0 s: page 1 took over the controls"),
        ]


def test_a_second_start_is_refused_while_the_first_run_has_only_left_the_plan():
    """It was accepted then, and ended the run that had just begun."""
    held, go = threading.Event(), threading.Event()
    with opened(real=True) as desk:
        record = desk.session._record

        def late(planned):
            held.set()
            assert go.wait(PATIENCE_S)
            return record(planned)

        desk.session._record = late
        desk.session.start(desk.plan(("with",)))
        assert held.wait(PATIENCE_S)
        try:
            with pytest.raises(ValueError, match="a run is on"):
                desk.session.start(desk.plan(("without",)))
        finally:
            go.set()
        first = desk.loop(1)
        assert first.got == []
        first.end(DONE)
        desk.state("stopped")
        assert len(desk.loops) == 1


def test_a_repeat_is_refused_where_the_next_run_began_while_it_was_checked():
    """Else it would end that run."""
    with opened(real=True) as desk:
        desk.session.start(desk.plan())
        desk.loop(1).end(Ending("ball lost", "it fell"))
        desk.state("pause")

        def meanwhile(plan, rig):
            desk.session.go_on()
            desk.loop(2)

        desk.session.table.check = meanwhile
        with pytest.raises(ValueError, match="none to repeat"):
            desk.session.repeat()
        assert desk.loops[1].got == []


def test_the_live_view_has_a_ball_unless_the_protocol_is_of_the_servos_alone():
    with opened() as desk:
        for protocol, has_ball in ((PROTOCOL, True), (SERVOS_ALONE, False)):
            desk.session.start(desk.plan(("with",), protocol=protocol))
            desk.loop(len(desk.loops) + 1).end(DONE)
            desk.loop(len(desk.loops) + 1)
            assert desk.balls[-2:] == [has_ball, True]  # the virtual table balances its ball then
            desk.session.stop("tests")
            desk.state("stopped")


def test_a_plan_with_pauses_goes_on_when_told():
    with opened(real=True) as desk:
        desk.session.start(desk.plan(pause=True, repetitions=2))
        desk.loop(1).end(DONE)
        desk.state("pause")
        status = desk.session.status
        assert status.words == "run 2 of 4 is next (with play compensation)"
        desk.session.go_on()
        desk.loop(2).end(DONE)
        wait_for("run 3", lambda: "run 3" in desk.session.status.words, PATIENCE_S)
        desk.session.go_on()
        desk.loop(3).end(DONE)
        wait_for("run 4", lambda: "run 4" in desk.session.status.words, PATIENCE_S)
        with pytest.raises(ValueError, match="a run is on"):
            desk.session.start(desk.plan())
        desk.session.go_on()
        desk.loop(4).end(DONE)
        desk.state("stopped")  # a real table rests, and the last run has no pause behind it
        assert len(desk.loops) == 4


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


@pytest.mark.parametrize("real", [True, False])
def test_a_run_that_ends_in_an_error_is_waited_after(real: bool):
    """A full disk, a camera that cannot be opened: the next run of a real table would move its
    motors without anybody having armed it."""
    with opened(real=real) as desk:
        desk.session.start(desk.plan(pause=real))
        desk.loop(1).end(OSError("No space left on device"))
        desk.state("pause")
        assert desk.session.status.words == "run 2 of 2 is next (with play compensation)"
        assert desk.session.may_repeat
        desk.fails = OSError("the camera is gone")
        desk.session.go_on()
        wait_for("its words", lambda: "camera" in desk.session.status.last, PATIENCE_S)
        desk.fails = None
        runs = [loop.job[0] for loop in desk.loops if loop.job[0] != "balancing"]
        assert [run.number for run in runs] == [1]
        if real:
            desk.state("stopped")
            desk.session.start(desk.plan())  # nothing of it waits
            desk.loop(2).end(DONE)


def test_an_error_of_balancing_lets_a_plan_begin():
    with opened(balance=True) as desk:
        loop = desk.loop(1)
        loop.put = lambda command: loop.end(OSError("the loop's process is gone"))
        desk.session.start(desk.plan())
        assert desk.loop(2).job[0].number == 1


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
        desk.meanwhile = lambda: None
        desk.session.start(desk.plan(("with",)))
        assert desk.loop(2).got == []  # that stop was for the run before


def test_stop_before_balancing_has_started_reaches_it_all_the_same():
    with opened() as desk:
        desk.state("stopped")
        desk.meanwhile = lambda: desk.session.stop("page 7")
        desk.session.balance()
        wait_for("the loop", lambda: desk.loops and desk.loops[0].got, PATIENCE_S)
        assert desk.loops[0].got == [Stop("stopped by page 7", "aborted")]
        desk.state("stopped")


def test_a_virtual_table_balances_from_the_start_and_a_real_one_rests():
    with opened(balance=None) as desk:
        wait_for("the loop", lambda: desk.loops, PATIENCE_S)
        wait_for("its start", lambda: desk.session.status.state == "starting", PATIENCE_S)
        assert desk.session.status.words == "the loop's process starts (a few seconds)"
        desk.loop(1)
        desk.state("balancing")
    with opened(balance=None, real=True) as desk:
        desk.state("stopped")
        assert desk.loops == []


@pytest.mark.parametrize("act", ["start", "repeat"])
def test_what_was_asked_before_a_stop_does_not_begin_after_it(act: str):
    with opened(real=True) as desk:
        desk.session.start(desk.plan(("with",)))
        desk.loop(1).end(Ending("limit", "too far"))
        desk.state("stopped")
        table = desk.session.table
        table.check = lambda plan, rig: setattr(desk, "stopped", True)  # pyright: ignore
        with pytest.raises(PermissionError, match="STOP was pressed"):
            desk.session.start(desk.plan()) if act == "start" else desk.session.repeat()
        assert len(desk.loops) == 1
        assert desk.session.may_repeat


def test_balancing_that_was_asked_for_before_a_stop_does_not_begin_after_it():
    with opened() as desk:
        desk.state("stopped")
        desk.stopped = True
        with pytest.raises(PermissionError, match="STOP was pressed"):
            desk.session.balance()
        desk.stopped = False
        desk.session.start(desk.plan(("with",)))
        assert desk.loop(1).job[0] != "balancing"


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
        with pytest.raises(ValueError, match="a run is on"):
            desk.session.start(desk.plan())
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


@pytest.mark.parametrize("hold_s", [0.0, 0.5])
def test_a_ball_that_is_only_placed_starts_the_clock_there_one_that_is_held_when_let_go(hold_s):
    start = {"title": "short", "duration_s": 10.0, "start": {"hold_s": hold_s}}
    with opened() as desk:
        protocol = parse(start, label="short", name="short")
        desk.session.start(desk.plan(("with",), protocol=protocol))
        loop = desk.loop(1)
        loop.say(0.5, "asked: place the ball")
        loop.say(6.0, "placed")
        loop.row(6.75)
        if hold_s:
            wait_for("the hold", lambda: desk.session.status.waited_s == 6.75, PATIENCE_S)
            loop.say(7.0, "released")
            loop.row(7.25)
        wait_for("the run", lambda: desk.session.status.t_s == 0.75, PATIENCE_S)
        assert desk.session.status.operator_step == ""
        assert desk.session.status.waited_s is None


def test_a_run_that_was_broken_off_while_it_waited_leaves_no_wait_behind():
    with opened(real=True) as desk:
        desk.session.start(desk.plan(protocol=HELD))
        loop = desk.loop(1)
        loop.say(0.5, "asked: place the ball")
        loop.row(3.0)
        wait_for("the step", lambda: desk.session.status.waited_s == 3.0, PATIENCE_S)
        loop.end(Ending("aborted", "enough"))
        desk.state("pause")
        assert "enough" in desk.session.status.last
        desk.session.go_on()
        desk.loop(2)
        status = desk.session.status
        assert (status.waited_s, status.t_s, status.last) == (None, 0.5, "")


def test_a_run_repeated_on_the_virtual_table_ends_in_balancing():
    with opened() as desk:
        desk.session.start(desk.plan(("with",)))
        desk.loop(1).end(Ending("ball lost", "it fell"))
        desk.loop(2)
        desk.state("balancing")
        desk.session.repeat()
        assert desk.loops[1].got == [Stop("a run begins", "ended")]
        desk.loop(3).end(DONE)
        desk.loop(4)
        desk.state("balancing")


def fails(desk: Desk, *numbers: int, t_s: float = 0.5) -> None:
    """Let the loops with these numbers end at t_s, as balancing that fails does."""
    for number in numbers:
        loop = desk.loop(number)
        loop.row(t_s)
        loop.end(Ending("limit", "too far"))


GIVEN_UP = (0.0, "balancing failed again and again: the table rests")


def test_balancing_that_fails_again_and_again_is_given_up():
    with opened(balance=True) as desk:
        early, late = (0.5, "limit: too far"), (QUICK_S, "limit: too far")
        for first in (1, 4):
            fails(desk, first, first + 1, first + 2)
            desk.state("stopped")
            assert desk.events == [early, early, early, GIVEN_UP]
            assert len(desk.loops) == first + 2
            desk.events.clear()
            desk.session.balance()
        fails(desk, 7, 8)
        fails(desk, 9, t_s=QUICK_S)  # that was not quick
        fails(desk, 10, 11)
        desk.loop(12)  # only two in a row
        assert desk.events == [early, early, late, early, early]
        fails(desk, 12)
        desk.state("stopped")
        assert len(desk.loops) == 12
        assert desk.events[-1] == GIVEN_UP
        assert MOST_FAILURES == 3


def test_runs_that_fail_quickly_are_no_failures_of_balancing():
    with opened() as desk:
        for number in (1, 3, 5):
            desk.session.start(desk.plan(("with",)))
            desk.loop(number).end(Ending("limit", "too far"))
            desk.loop(number + 1)
            desk.state("balancing")
        assert GIVEN_UP not in desk.events


def test_a_loop_that_ends_before_its_first_row_ended_at_0_s():
    with opened(balance=True) as desk:
        wait_for("the loop", lambda: desk.loops, PATIENCE_S)
        desk.loops[0].end(Ending("loop died", ""))
        wait_for("the words", lambda: desk.events, PATIENCE_S)
        assert desk.events[0] == (0.0, "loop died")


def test_what_fails_is_told_and_the_session_lives():
    with opened(real=True) as desk:
        desk.fails = OSError("the disk is full")
        desk.session.start(desk.plan(("with",)))
        wait_for("the words", lambda: len(desk.events) == 2, PATIENCE_S)
        assert desk.events == [
            (0.0, "failed: the disk is full"),
            (0.0, "aborted: the disk is full"),
        ]
        desk.state("stopped")
        assert "failed after 0.0 s and does not count: the disk is full" in desk.session.status.last
        desk.fails = None
        desk.session.start(desk.plan(("with",)))
        desk.loop(1).end(RuntimeError("in the loop"))
        desk.state("stopped")
        assert desk.events[-1][1] == "aborted: in the loop"


def test_closing_kills_a_loop_that_does_not_end():
    with opened(close_s=0.2) as desk:
        desk.session.start(desk.plan(("with",)))
        loop = desk.loop(1)
        loop.put = loop.got.append  # it does not listen
        desk.session.close()
        assert len(loop.got) == 1
        assert loop.killed
        assert not desk.session._thread.is_alive()
        desk.state("running")  # its last word; nothing begins any more


def test_closing_ends_what_moves_and_drops_the_plan():
    with opened() as desk:
        desk.session.start(desk.plan())
        loop = desk.loop(1)
        desk.session.close()
        assert loop.got == [Stop("the dashboard was closed", "interrupted")]
        assert not loop.killed
        assert len(desk.loops) == 1
        assert not desk.session._thread.is_alive()


def test_a_real_table_moves_in_runs_alone():
    with opened(real=True) as desk, pytest.raises(ValueError, match="in a run alone"):
        desk.session.balance()


@pytest.mark.parametrize("seed", range(3))
def test_whatever_races_with_a_stop_nothing_moves_after_it(seed: int):
    """Start, repeat, balance, next run and stops of two pages at once; the last word is a stop."""
    rng = random.Random(seed)
    with opened() as desk:
        session, over = desk.session, threading.Event()

        def press(*acts) -> None:
            while not over.is_set():
                with suppress(ValueError):
                    rng.choice(acts)()
                time.sleep(rng.uniform(0.0, 0.002))

        acts = (lambda: session.start(desk.plan()), session.repeat, session.balance, session.go_on)
        threads = [threading.Thread(target=press, args=acts) for _ in range(2)]
        threads.append(threading.Thread(target=press, args=(lambda: session.stop("page 2"),)))
        for thread in threads:
            thread.start()
        time.sleep(0.5)
        over.set()
        for thread in threads:
            thread.join(PATIENCE_S)
        session.stop("page 1")
        told = len(desk.loops)
        desk.state("stopped")
        time.sleep(0.05)
        assert len(desk.loops) - told <= 1  # one that was being started is given the stop
        assert all(any(isinstance(one, Stop) for one in loop.got) for loop in desk.loops)
        assert session.status.state == "stopped"
        assert told > 3
