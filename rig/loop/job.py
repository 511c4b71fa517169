"""A run as it travels to the loop's process, and what that process does with it.

It gets ready, asks for real time, waits for the program's word that the table may be opened, builds
it from a recipe and runs. When the program dies, it sees that at its next tick and ends at level
and 0 V.
"""

import os
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from typing import Protocol

import numpy as np

from rig.control.user_controller import WatchedController, load_controller
from rig.course import Course
from rig.log import INDEX
from rig.loop.child_process import leave_ctrl_c
from rig.loop.commands import Command, CommandSlot, Stop
from rig.loop.jitter import Jitter, Lateness
from rig.loop.loop import DONE, Ending, Loop, ending_of, run_controlled
from rig.loop.realtime import go_realtime
from rig.loop.shared_channel import (
    AT_REST,
    ENDING,
    READY,
    RUNNING,
    SharedChannel,
    take_commands,
    take_stop,
)
from rig.loop.signals import stop_on_signals
from rig.operator import Operator
from rig.parameters import Rig
from rig.safety.monitor import MonitorLimits
from rig.simulation.simulator import SimulatedTable
from rig.table import ArmingStoppedError, Table, watch_arming

PARENT_SILENT_S = 2.0  # a program that hangs for so long looks after nothing
CONTROL_SHARE = 0.8  # of the lateness at which a board gives up: so the loop levels the plate
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
    would: loading them takes half a second, compiling them a minute, in which no stop is seen. Left
    by a signal it compiles no more.
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
        Loop(table, known, compensator, course, operator=Operator()).until_done()


def work(job: Job, box: SharedChannel, parent: int, result: Connection) -> None:
    """The loop's process from its start to its end."""
    leave_ctrl_c()
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
    for line in (result, box):
        with suppress(OSError):  # a user's controller may have closed its file
            line.close()


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
    stops: list[Stop] = []

    def stopped() -> bool:
        if (stop := inbox.stop()) is not None:
            stops.append(stop)
        return bool(stops)

    watch_arming(table, stopped)
    try:
        if stopped():  # opening it may have taken seconds
            table.close()
            raise ArmingStoppedError
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
    except ArmingStoppedError:
        ending = Ending(stops[0].outcome, stops[0].reason)
    except OSError as error:
        if ending == DONE:
            raise
        lost = f"the plate may not be level: {error}"
        return replace(ending, reason="; ".join(filter(None, (ending.reason, lost))))
    box.beat("loop_s", AT_REST)
    return ending
