"""What happens at the table: balancing, runs of a plan, pauses, stops; one loop process at a time.

Pages speak to it through `Orders` alone. It has a thread of its own, in which it drains the loop
and records; the loop's process waits for neither.
"""

import os
import signal
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from experiments.dashboard import recipes
from experiments.dashboard.live import Live
from experiments.dashboard.plan import Leg, Plan, Status, legs
from experiments.dashboard.readying import RealTable, VirtualTable
from experiments.live_run import record_live
from experiments.recording import Recorder
from experiments.runner import Watch
from experiments.telling import Telling
from rig.commands import Command, SetGains, Stop
from rig.endings import Ending
from rig.loop_process import LoopProcess
from rig.parameters import Rig

KILL = getattr(signal, "SIGKILL", signal.SIGTERM)
QUICK_S, MOST_QUICK = 5.0, 3  # balancing that ends so soon so often is given up


class Session:
    """`rig`: the plant as it is set now (play, gains). `recorded` hears of every finished run,
    `said` of every event."""

    def __init__(
        self,
        rig: Rig,
        table: VirtualTable | RealTable,
        live: Live,
        *,
        recorded: Callable[[Leg, Path, Ending], None] = lambda leg, folder, ending: None,
        said: Callable[[float, str], None] = lambda t_s, text: None,
        balance: bool = True,
    ) -> None:
        self.rig, self.table, self.live = rig, table, live
        self._plan_rig = rig
        self._recorded, self._said = recorded, said
        self._wake = threading.Condition()
        self._legs: deque[Leg] = deque()
        self._balance = balance and not table.real  # a real table moves in runs alone
        self._waits = self._closed = False
        self._loop: LoopProcess | None = None
        self._stop: Stop | None = None  # asked for while a loop is being started
        self._busy = False
        self._notes: deque[str] = deque(maxlen=64)
        self._status = Status("starting", "the loop's process starts")
        self.last_notes: dict = {}  # of the last loop: jitter, real time
        self._thread = threading.Thread(target=self._serve, daemon=True, name="session")
        self._thread.start()

    # --- what a page may ask for, through the orders' thread ---
    @property
    def status(self) -> Status:
        return self._status

    def start(self, plan: Plan) -> None:
        """Run a plan; what was balancing ends. ValueError: a run is on, or it is impossible."""
        self.table.check(plan, self.rig)
        with self._wake:
            if self._legs or self._status.state in ("running", "pause"):
                raise ValueError("a run is on: stop it first")
            self._legs.extend(legs(plan))
            self._plan_rig = self.rig  # of all its runs, whatever is set meanwhile
            self._balance = not self.table.real
            self._end_loop(Stop("a run begins", "ended"))

    def go_on(self) -> None:
        """Leave the pause between two runs."""
        with self._wake:
            self._waits = False
            self._wake.notify_all()

    def stop(self, who: str) -> None:
        """End what moves, drop what was planned, leave the table at rest. For everybody."""
        with self._wake:
            self._legs.clear()
            self._balance = self._waits = False
            self._end_loop(Stop(f"stopped by {who}", "aborted"))

    def balance(self) -> None:
        """Let the virtual table balance again. ValueError: a real one moves in runs alone."""
        if self.table.real:
            raise ValueError("a real table moves in a run alone: arm it and press Start")
        with self._wake:
            self._balance = True
            self._wake.notify_all()

    def again(self, rig: Rig) -> None:
        """Another plant: what balances starts anew with it, a run that is on keeps its own."""
        with self._wake:
            self.rig = rig
            if self._status.state in ("balancing", "starting") and not self._legs:
                self._end_loop(Stop("another plant", "ended"))

    def set_gains(self, rig: Rig, gains: SetGains) -> None:
        """The rig with other gains: for what moves now, and for what is started from now on."""
        self.rig = rig
        if self._loop is not None:
            self._loop.put(gains)

    def put(self, command: Command) -> None:
        """A push, target or gains for the loop. ValueError: nothing moves."""
        loop = self._loop
        if loop is None:
            raise ValueError("nothing moves: press Balance or start a run")
        loop.put(command)

    def confirm(self) -> None:
        """The operator at the page has done what was asked for. ValueError: nothing was."""
        asked = self._status.asked
        if not asked:
            raise ValueError("nothing is asked of you just now")
        self.table.confirm(asked)
        self.note(f"confirmed: {asked}")
        if not asked.startswith("hold"):
            self._status = replace(self._status, asked="")

    def note(self, text: str) -> None:
        """A line in the present run's events."""
        self._notes.append(text)
        self._said(self._status.t_s, text)

    def close(self) -> None:
        """End in order: level, 0 V, recording finished."""
        with self._wake:
            self._closed = True
            self._legs.clear()
            self._end_loop(Stop("the dashboard was closed", "interrupted"))
            loop = self._loop
        self._thread.join(5.0)
        if self._thread.is_alive() and loop is not None:  # still compiling: it has driven nothing
            with suppress(ProcessLookupError):
                os.kill(loop.pid, KILL)
            self._thread.join(5.0)

    # --- the session's thread ---
    def _end_loop(self, stop: Stop) -> None:
        if self._loop is not None:
            self._loop.put(stop)
        elif self._busy:
            self._stop = stop
        self._wake.notify_all()

    def _started(self, loop: LoopProcess) -> None:
        with self._wake:
            self._loop, stop = loop, self._stop
            self._stop = None
        if stop is not None:
            loop.put(stop)

    def _serve(self) -> None:
        quick = 0
        while True:
            leg = self._next()
            if self._closed:
                return
            try:
                ending, lasted_s = self._record(leg) if leg else self._balancing()
            except Exception as error:
                self._said(0.0, f"{type(error).__name__}: {error}")
                ending, lasted_s = Ending("aborted", str(error)), 0.0
            finally:
                with self._wake:
                    self._loop, self._busy, self._stop = None, False, None
            odd = ending.outcome not in ("ended", "completed")
            if odd:
                self._said(lasted_s, f"{ending.outcome}: {ending.reason}".rstrip(": "))
            quick = quick + 1 if odd and lasted_s < QUICK_S and leg is None else 0
            if quick >= MOST_QUICK:
                quick, self._balance = 0, False
                self._said(0.0, "balancing failed again and again: the table rests")

    def _next(self) -> Leg | None:
        """Wait for something to do: the next leg, or None for balancing."""
        with self._wake:
            while not self._closed:
                if self._legs and not self._waits:
                    self._busy = True
                    return self._legs.popleft()
                if self._legs:
                    leg = self._legs[0]
                    words = f"run {leg.number} of {leg.of} is next ({leg.arm} the model)"
                    self._status = Status("pause", words, leg)
                elif self._balance:
                    self._busy = True
                    return None
                else:
                    self._status = Status("stopped", "the table rests at 0 V")
                self._wake.wait(1.0)
            return None

    def _balancing(self) -> tuple[Ending, float]:
        self._status = Status("starting", "the loop's process starts (a few seconds)")
        job = recipes.job(self.rig, "without", recipes.balancing(self.rig))
        self.live.begin()
        loop = LoopProcess(job)
        self._started(loop)
        last = [0.0]

        def keep(row: np.ndarray) -> None:
            last[0] = float(row[0])
            self.live.add(row)
            if self._status.state != "balancing":
                self._status = Status("balancing", "the virtual table balances its ball")

        ending = loop.run(keep, self._said)
        self.last_notes = loop.notes
        return ending, last[0]

    def _record(self, leg: Leg) -> tuple[Ending, float]:
        """One run of the plan, recorded."""
        plan = leg.plan
        self._status = Status("running", f"{leg.words}: starting", leg)
        self._notes.clear()
        self.live.begin()
        with self.table.ready(leg, self._plan_rig) as run:
            recorder = Telling(run.folder, run.start)
            watch = Watch(run.order, recorder, None)
            watch.stop_through(self)
            recorder.say = self._heard
            recorder.at_end = partial(watch.note_pushes, run.order.believed)
            look = partial(self._look, watch, recorder, leg)
            with recorder:
                ending = record_live(run.job, recorder, started=self._started, watch=look)
        with self._wake:
            self._waits = plan.pause and bool(self._legs)
        with suppress(Exception):
            self._recorded(leg, run.folder, ending)
        return ending, self._status.t_s

    def _look(self, watch: Watch, recorder: Recorder, leg: Leg, row: np.ndarray) -> None:
        watch.look(row)
        self.live.add(row)
        t_s = float(row[0])
        while self._notes:
            Recorder.event(recorder, t_s, self._notes.popleft())
        asked = self._status.asked if self._status.leg is leg else ""
        self._status = Status("running", leg.words, leg, t_s, asked)

    def _heard(self, t_s: float, text: str) -> None:
        if text.startswith("asked: "):
            self._status = replace(self._status, asked=text.removeprefix("asked: "))
        elif text in ("placed", "released"):
            self._status = replace(self._status, asked="")
        self._said(t_s, text)
