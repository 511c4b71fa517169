"""The loop in a process of its own, so that nothing that the program does makes a tick late.

The program's side (`LoopProcess`) starts it, drains rows and events, sends commands and learns the
ending. The loop's side (`_work`) gets ready, asks for real time, waits for the program's word that
the table may be opened, builds it from a recipe and runs. A stop before that word ends the process
at once: no table was opened, no volts were given. When the program dies, the loop sees it at its
next tick and ends at level and 0 V.
"""

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from math import inf
from multiprocessing.connection import Connection
from typing import Protocol

import numpy as np

from rig.control.user_controller import END_S, START_S, WatchedController, load_controller
from rig.course import Course
from rig.log import INDEX
from rig.loop.commands import Command, CommandSlot, Stop
from rig.loop.jitter import Jitter, Lateness
from rig.loop.loop import DONE, Ending, Loop, ending_of, run_controlled
from rig.loop.realtime import go_realtime
from rig.loop.shared_channel import (
    AT_REST,
    ENDING,
    READY,
    RUNNING,
    STARTING,
    SharedChannel,
    SharedCommandSlot,
    take_commands,
    take_stop,
)
from rig.loop.signals import stop_on_signals
from rig.operator import Operator
from rig.parameters import Rig
from rig.safety.monitor import MonitorLimits
from rig.simulation.simulator import SimulatedTable
from rig.table import Table

PARENT_SILENT_S = 2.0  # a program that hangs for so long looks after nothing
LOOP_SILENT_S = 1.0  # a loop that hangs for so long is ended by force
# So long may a method of a user's controller be silent that cannot be interrupted from inside.
PATIENCE_S = {"start": START_S + 1.0, "control": LOOP_SILENT_S, "end": END_S + 1.0}
CONTROL_SHARE = 0.8  # of the lateness at which a board gives up: so the loop levels the plate
BEAT_S = 0.05
DRAIN_S = 0.01
WARM_TICKS = 25
WORD_S = 0.002  # a loop that is ready looks so often for the program's word
_THETA = INDEX["theta_x_rad"]


class AngleListener(Protocol):
    """Who is told the servo angles of every tick: a camera that needs them as a first guess."""

    def tell(self, theta_rad: tuple[float, float]) -> None:
        """Take the encoder angles theta_rad (x, y) of this tick."""
        ...


@dataclass(frozen=True, eq=False)
class Job:
    """A run as it travels to the loop's process: everything here can be pickled.

    table: makes the table (a context manager), called in that process; known, compensator, course:
    as of `Loop`; operator: makes the table's operator; limits: of the monitor; eye: what the table
    sees with, told the encoder angles; controller: a user's, FILE.py:ClassName, "" for the built-in
    one; realtime: ask the system for real time; trace: for how many ticks to keep the lateness
    itself, for a benchmark.
    """

    table: Callable[[], Table]
    known: Rig
    compensator: int
    course: Course
    operator: Callable[[Table], Operator] | None = None
    limits: MonitorLimits | None = None
    eye: AngleListener | None = None
    controller: str = ""
    realtime: bool = True
    trace: int = 0


# --- the loop's side ---
class _Inbox:
    """Commands as the loop takes them: the program's, the system's, and the program's death."""

    def __init__(self, box: SharedChannel, parent: int) -> None:
        self.signals = CommandSlot()
        self._box, self._parent = box, parent

    def take(self) -> list[Command]:
        lost = self._lost()
        return [lost] if lost else self.signals.take() or take_commands(self._box)

    def stop(self) -> Stop | None:
        """The stop that was put; other commands stay where they are."""
        for command in self.signals.take():
            if isinstance(command, Stop):
                return command
        return self._lost() or take_stop(self._box)

    def _lost(self) -> Stop | None:
        self._box.beat("loop_s")
        if os.getppid() != self._parent:
            return Stop("the program that started the loop has died", "program lost")
        if self._box.silent_s("parent_s") > PARENT_SILENT_S:
            return Stop(f"the program was silent for {PARENT_SILENT_S:g} s", "program lost")
        return None

    def put(self, command: Command) -> None:
        self.signals.put(command)


def warm_up(known: Rig, compensator: int, course: Course) -> None:
    """Run every compiled function once, on a simulated table, as the beginning of a `Loop` of these
    would: loading them takes half a second, compiling them a minute, in which no stop is seen.
    """
    course = replace(
        course,
        targets_m=course.targets_m[:WARM_TICKS],
        pushes_m_s2=course.pushes_m_s2[:WARM_TICKS],
        hold_s=0.0,
        operator=(),
    )
    table = SimulatedTable(known, np.random.default_rng(0), start_m=course.start_m)
    with table:
        Loop(table, known, compensator, course, operator=Operator()).run()


def _work(job: Job, box: SharedChannel, parent: int, result: Connection) -> None:
    """The loop's process from its start to its end."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the program hears it and stops the loop
    inbox, jitter, report = _Inbox(box, parent), Jitter(job.trace), {}

    def run() -> Ending:
        warm_up(job.known, job.compensator, job.course)
        report.update(go_realtime() if job.realtime else {})
        stop = _wait_for_word(box, inbox)
        if stop is not None:
            return Ending(stop.outcome, stop.reason)
        return _run(job, box, inbox, jitter, controller)

    def tell(ending: Ending) -> None:
        box.beat("loop_s")
        values = jitter.values_us[: jitter.ticks]
        with suppress(OSError):  # the program may be gone
            result.send((ending, {"jitter": jitter.record(), "realtime": report}, values))

    try:
        with stop_on_signals(inbox, leave=False):
            controller = _controller(job, box)
            ending = run_controlled(controller, job.known, run, tell)
    except BaseException as error:  # told to the program by name
        ending = ending_of(error)
    tell(ending)
    result.close()
    box.close()


def _wait_for_word(box: SharedChannel, inbox: _Inbox) -> Stop | None:
    """Wait until the program allows the table to be opened; a stop that came before, else None."""
    box.beat("loop_s", READY)
    while not box.may_open:
        stop = inbox.stop()
        if stop is not None:
            return stop
        time.sleep(WORD_S)
    return inbox.stop()  # one that crossed the word on its way


def _controller(job: Job, box: SharedChannel) -> WatchedController | None:
    if not job.controller:
        return None
    box.call("start")
    controller = load_controller(job.controller)
    box.call("")
    return WatchedController(controller, box.call)


def _keeper(box: SharedChannel, eye: AngleListener | None) -> Callable[[np.ndarray], None]:
    if eye is None:
        return box.rows.write

    def keep(row: np.ndarray) -> None:
        box.rows.write(row)
        eye.tell((row[_THETA], row[_THETA + 1]))

    return keep


def _run(
    job: Job,
    box: SharedChannel,
    inbox: _Inbox,
    jitter: Jitter,
    controller: WatchedController | None,
) -> Ending:
    """The run on its table. The first thing that went wrong names it: a table that is lost while
    a stopped run levels it is told in the reason; after a completed run it is raised.
    """
    limits = job.limits or MonitorLimits.of_rig(job.known)
    table, ending = job.table(), DONE
    try:
        with table:  # pyright: ignore[reportGeneralTypeIssues]
            operator = job.operator(table) if job.operator else Operator()
            box.beat("loop_s", RUNNING)
            loop = Loop(
                table,
                job.known,
                job.compensator,
                job.course,
                operator=operator,
                commands=inbox,
                keep=_keeper(box, job.eye),
                event=box.say,
                late_s=Lateness(table, jitter),
                limits=limits,
                controller=controller,
                control_s=CONTROL_SHARE * limits.late_s,
            )
            try:
                ending = loop.run()
            finally:
                box.beat("loop_s", ENDING)
    except OSError as error:
        if ending == DONE:
            raise
        lost = f"the plate may not be level: {error}"
        return replace(ending, reason="; ".join(filter(None, (ending.reason, lost))))
    box.beat("loop_s", AT_REST)
    return ending


# --- the program's side ---
class LoopProcess:
    """A run in its own process, which is started at once. `put` takes commands from any thread.

    at_rest: whether the table is at 0 V for good, as it was left or is never opened. After `run`:
    notes (as run.json keeps them: jitter, realtime, lost_rows, lost_events) and late_us (lateness
    of the first `Job.trace` ticks).
    """

    def __init__(self, job: Job) -> None:
        self._box, self._over = SharedChannel(), threading.Event()
        self._commands = SharedCommandSlot(self._box)
        self._controller, self._hung = job.controller.rpartition(":")[2], ""
        self._lock = threading.RLock()  # a signal's handler may put while its own thread does
        self._word_given, self._refused, self.at_rest = False, None, False
        self.notes: dict = {}
        self.late_us: list[float] = []
        context = multiprocessing.get_context("spawn")
        self._result, there = context.Pipe(duplex=False)
        self._box.beat("parent_s", STARTING)
        self._box.beat("loop_s")
        arguments = (job, self._box, os.getpid(), there)
        self._process = context.Process(target=_work, args=arguments, name="loop", daemon=True)
        self._pulse = threading.Thread(target=self._beat, daemon=True, name="pulse")
        self._process.start()
        there.close()
        self._pulse.start()

    @property
    def pid(self) -> int:
        """Number of the loop's process; 0 before it was started."""
        return self._process.pid or 0

    def put(self, command: Command) -> None:
        """Send a command to the loop; of several stops the first is kept. A stop before the table
        was opened keeps it closed. Nothing after the run. TypeError: no command.
        """
        with self._lock:
            if self._over.is_set():
                return
            self._commands.put(command)
            if isinstance(command, Stop) and not self._word_given:
                self._refused, self.at_rest = self._refused or command, True

    def kill(self) -> None:
        """End the loop's process by force: for one that has not opened its table, or hangs."""
        self._process.kill()

    def _give_word(self) -> None:
        """Allow a loop that is ready to open the table, unless a stop came before."""
        with self._lock:
            if self._refused is None and self._box.state == READY:
                self._word_given = True
                self._box.allow_to_open()

    def _beat(self) -> None:
        while not self._over.is_set():
            self._box.beat("parent_s")
            time.sleep(BEAT_S)  # waits of `threading` may go by the wall clock, which may be set

    def run(
        self,
        keep: Callable[[np.ndarray], None] = lambda row: None,
        event: Callable[[float, str], None] = lambda t_s, text: None,
    ) -> Ending:
        """Hand every row to `keep` and every event to `event` until the run ends; return its
        ending.

        What these two raise (a full disk, Ctrl-C) stops the loop first and is then raised again. A
        process that dies or hangs gives the outcome "loop died".
        """
        try:
            while not self._result.poll(DRAIN_S) and not self._dead():
                self._give_word()
                self._drain(keep, event)
            ending = self._ending()
            self._drain(keep, event)
            return ending
        except BaseException as error:
            told = ending_of(error)
            self.put(Stop(told.reason, told.outcome))
            self._ending()
            if isinstance(error, KeyboardInterrupt):
                self._drain(keep, event)
            raise
        finally:
            self._close()

    def _drain(self, keep, event) -> None:
        self.at_rest = self.at_rest or self._box.state == AT_REST
        for row in self._box.rows.read():
            keep(row)
        for t_s, text in self._box.take_events():
            event(t_s, text)

    def _dead(self) -> bool:
        """The loop's process is gone, or is ended: it hangs, or has nothing to do any more."""
        if not self._process.is_alive():
            return not self._result.poll()
        if self._refused is not None and not self._controller:  # a user's is told how it ended
            self._process.kill()
            self._process.join()
            return True
        method = self._box.called
        running = self._box.state == RUNNING
        patience_s = PATIENCE_S.get(method, LOOP_SILENT_S if running else inf)
        if self._box.silent_s("loop_s") > patience_s:
            self._process.kill()
            self._process.join()
            if method:
                self._hung = f"{self._called(method)} did not return within {patience_s:g} s"
            return True
        return False

    def _called(self, method: str) -> str:
        return f"controller {self._controller}.{method}"

    def _ending(self) -> Ending:
        """Wait for the loop's last word; without one it died, and the board's watchdog has it."""
        ending = None
        with suppress(EOFError):
            while self._result.poll(DRAIN_S) or not self._dead():
                if self._result.poll():
                    ending, self.notes, self.late_us = self._result.recv()
        if ending is not None:
            said = "; ".join(filter(None, (ending.reason, self._hung)))
            return replace(ending, reason=said)
        if self._refused is not None:
            return Ending(self._refused.outcome, self._refused.reason)
        self._process.join(1.0)
        died = f"its process ended with {self._process.exitcode}"
        method = self._box.called
        if method:
            died = f"{self._called(method)}: {died}"
        return Ending("loop died", self._hung or died)

    def _close(self) -> None:
        with self._lock:
            self._over.set()
        self._pulse.join()
        self._process.join(2.0)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        rows, events = self._box.rows.lost, self._box.events.lost
        self.notes = {**self.notes, "lost_rows": rows, "lost_events": events}
        self._result.close()
        self._box.close()
