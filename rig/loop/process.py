"""The loop in a process of its own, so that nothing that the program does makes a tick late.

`LoopProcess` starts it, drains rows and events, sends commands and learns the ending; what is done
there is in `job`. A stop before the program's word that the table may be opened ends the process at
once: no table was opened, no volts were given.
"""

import multiprocessing
import os
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from math import inf

import numpy as np

from rig.control.user_controller import END_S, START_S
from rig.loop.child_process import signals_held, start
from rig.loop.commands import Command, Stop
from rig.loop.job import Job, work
from rig.loop.loop import Ending, ending_of
from rig.loop.shared_channel import (
    AT_REST,
    ENDING,
    READY,
    RUNNING,
    STARTING,
    SharedChannel,
    SharedCommandSlot,
)

LOOP_SILENT_S = 1.0  # a loop that hangs for so long is ended by force
# So long may a method of a user's controller be silent that cannot be interrupted from inside.
PATIENCE_S = {"start": START_S + 1.0, "control": LOOP_SILENT_S, "end": END_S + 1.0}
# So long may a table take silently; chosen: twice what a driver of ours waits, and 20 times what
# levelling takes. Opening ends sooner after a stop.
OPEN_S, CLOSE_S, STOPPED_OPEN_S = 20.0, 10.0, 5.0
BEAT_S = 0.05
DRAIN_S = 0.01


class LoopProcess:
    """A run in its own process, which is started at once. `put` takes commands from any thread.

    at_rest: whether the table is at 0 V for good, as it was left or is never opened. After `run`:
    notes (as run.json keeps them: jitter, realtime, lost_rows, lost_events) and late_us (lateness
    of the first `Job.trace` ticks).
    """

    def __init__(self, job: Job) -> None:
        with signals_held():
            self._box, self._over = SharedChannel(), threading.Event()
        self._commands = SharedCommandSlot(self._box)
        self._controller, self._hung = job.controller.rpartition(":")[2], ""
        self._lock = threading.RLock()  # a signal's handler may put while its own thread does
        self._word_given, self._stop, self.at_rest = False, None, False
        self.notes: dict = {}
        self.late_us: list[float] = []
        context = multiprocessing.get_context("spawn")
        self._result, there = context.Pipe(duplex=False)
        self._box.beat("parent_s", STARTING)
        self._box.beat("loop_s")
        arguments = (job, self._box, os.getpid(), there)
        self._process = context.Process(target=work, args=arguments, name="loop", daemon=True)
        self._pulse = threading.Thread(target=self._beat, daemon=True, name="pulse")
        start(self._process)
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
            if isinstance(command, Stop):
                self._stop = self._stop or command
                self.at_rest = self.at_rest or self._refused is not None

    @property
    def _refused(self) -> Stop | None:
        """The stop that came before the word."""
        return None if self._word_given else self._stop

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
        what, patience_s = self._patience()
        if self._box.silent_s("loop_s") > patience_s:
            self._process.kill()
            self._process.join()
            if what:
                self._hung = f"{what} within {patience_s:g} s"
            return True
        return False

    def _patience(self) -> tuple[str, float]:
        """What did not happen, should the loop now be silent for longer than this [s]."""
        method, state = self._box.called, self._box.state
        if method:
            return f"{self._called(method)} did not return", PATIENCE_S[method]
        if state == READY and self._word_given:
            patience_s = OPEN_S if self._stop is None else STOPPED_OPEN_S
            return "the table was not open, nor armed,", patience_s
        if state == ENDING:
            return "the table was not level and closed", CLOSE_S
        return "", LOOP_SILENT_S if state == RUNNING else inf

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
        asked = self._stop.reason if self._stop is not None else ""
        return Ending("loop died", "; ".join(filter(None, (asked, self._hung or died))))

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
