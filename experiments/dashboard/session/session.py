"""Session of the table: balancing, planned runs, pauses, stops; one loop process at a time.

Pages reach it through the `ControlPanelQueue`, and `stop` directly. Its own thread reads the rows
of the loop process and records them; the loop process waits for neither.
"""

import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from experiments.dashboard.server.untrusted_text import words_of
from experiments.dashboard.session import virtual_job
from experiments.dashboard.session.live import LiveBuffer
from experiments.dashboard.session.plan import (
    METHOD_WORDS,
    PlannedRun,
    RunPlan,
    SessionStatus,
    planned_runs,
)
from experiments.dashboard.session.run_setup import RealRunSetup, VirtualRunSetup
from experiments.records.recording import Recorder
from experiments.runs.live_run import AnnouncingRecorder, record_live
from experiments.runs.runner import Watch
from rig.loop.commands import Command, SetGains, Stop
from rig.loop.loop import Ending
from rig.loop.process import LoopProcess
from rig.parameters import Rig

CLOSE_S = 5.0  # of levelling, and of writing the recording's end; chosen
EVENTS_KEPT = 4  # chosen: what is seen at a glance
QUICK_S, MOST_FAILURES = 5.0, 3  # balancing that ends so soon so often is given up; chosen


class Session:
    """Runs the table: balances, works off plans of runs and records them, one loop process at a
    time.

    rig: the plant, whose backlash and gains may be set meanwhile; table: prepares its runs; live:
    is given every row. on_recorded(run, folder, ending) is called after every recorded run,
    on_event(t_s, text) with every event, both from the session's thread. balance: begin by
    balancing (virtual table only). still() raises where a stop came after what is asked for just
    now: then nothing begins. `events`: the newest ones, each behind what was on then
    (`SessionStatus.heading`). `last_notes`: jitter and real-time rights of the last loop.
    """

    def __init__(
        self,
        rig: Rig,
        table: VirtualRunSetup | RealRunSetup,
        live: LiveBuffer,
        *,
        on_recorded: Callable[[PlannedRun, Path, Ending], None] = lambda planned, folder, ending: (
            None
        ),
        on_event: Callable[[float, str], None] = lambda t_s, text: None,
        balance: bool = True,
        still: Callable[[], None] = lambda: None,
    ) -> None:
        self.rig, self.table, self.live = rig, table, live
        self._plan_rig = rig
        self._on_recorded, self._on_told, self._still = on_recorded, on_event, still
        self.events: deque[tuple[str, str]] = deque(maxlen=EVENTS_KEPT)
        self._wake = threading.Condition()
        self._planned: deque[PlannedRun] = deque()
        self._balance = balance and not table.real  # a real table moves in runs alone
        self._waits = self._closed = False
        self._loop: LoopProcess | None = None
        self._stop: Stop | None = None  # asked for while a loop is being started
        self._stopping = False  # what moves was told to end, and has not ended yet
        self._busy = False
        self._notes: deque[str] = deque(maxlen=64)
        self._status = SessionStatus("starting", "the loop's process starts")
        self._last = ""  # how the last run ended
        self._failed: PlannedRun | None = None  # the one that may be repeated
        self._asked, self._begun_s = False, 0.0  # a person is asked; when the run's clock began
        self.last_notes: dict = {}  # of the last loop: jitter, real time
        self._thread = threading.Thread(target=self._serve, daemon=True, name="session")
        self._thread.start()

    # --- called from the thread of the control panel queue ---
    @property
    def status(self) -> SessionStatus:
        """What the session does just now."""
        status, loop = self._status, self._loop
        if not self._stopping:
            return status
        at_rest = loop is None or loop.at_rest  # no loop: no table was opened
        return replace(status, state="at rest" if at_rest else "stopping")

    def start(self, *plans: RunPlan) -> None:
        """Begin these plans, one after the other; balancing ends.

        ValueError: a run is on; ValueError, OSError: the table cannot run a plan (`check` of the
        run's set-up); and what `still` raises.
        """
        for plan in plans:
            self.table.check(plan, self.rig)
        with self._wake:
            self._still()
            if self._planned or self._status.state in ("running", "pause"):
                raise ValueError("a run is on: stop it first")
            self._planned.extend(planned_runs(*plans))
            self._plan_rig = self.rig  # of all its runs, whatever is set meanwhile
            self._balance = not self.table.real
            self._end_loop(Stop("a run begins", "ended"))

    @property
    def may_repeat(self) -> bool:
        """Whether the last run was not completed and can be made again."""
        return self._failed is not None and self._status.state != "running"

    def repeat(self) -> None:
        """Make the last run again, which was not completed; the rest of the plan follows.

        ValueError: there is none; ValueError, OSError: the table cannot run it; and what `still`
        raises.
        """
        self.table.check(self._to_repeat().plan, self._plan_rig)
        with self._wake:
            self._still()
            failed = self._to_repeat()  # the next run may have begun since
            self._failed, self._waits, self._balance = None, False, not self.table.real
            self._planned.appendleft(failed)
            self._end_loop(Stop("a run begins", "ended"))

    def _to_repeat(self) -> PlannedRun:
        """The run that may be repeated. ValueError: there is none."""
        if self._failed is None or not self.may_repeat:
            raise ValueError("no run has failed: there is none to repeat")
        return self._failed

    def go_on(self) -> None:
        """Leave the pause between two runs."""
        with self._wake:
            self._waits = False
            self._wake.notify_all()

    def stop(self, who: str) -> None:
        """End what moves, drop the plan, leave the table level at 0 V; from any thread, for any
        page. who: is named in the recording.
        """
        with self._wake:
            self._planned.clear()
            self._balance = self._waits = False
            self._stopping = self._busy
            self._end_loop(Stop(f"stopped by {who}", "aborted"))

    def balance(self) -> None:
        """Balance the virtual table again. ValueError: a real table moves in runs alone; and what
        `still` raises.
        """
        if self.table.real:
            raise ValueError("a real table moves in a run alone: arm it and press Start")
        with self._wake:
            self._still()
            self._balance = True
            self._wake.notify_all()

    def set_plant(self, rig: Rig) -> None:
        """Use another plant: balancing starts anew with it, a run that is on keeps its own."""
        with self._wake:
            self.rig = rig
            if self._status.state in ("balancing", "starting") and not self._planned:
                self._end_loop(Stop("another plant", "ended"))

    def set_gains(self, rig: Rig, gains: SetGains) -> None:
        """Use other gains: `gains` at once in a loop that is on, `rig` with them in the runs
        started from now on.
        """
        self.rig = rig
        if self._loop is not None:
            self._loop.put(gains)

    def put(self, command: Command) -> None:
        """Send a push, target or gains to the loop. ValueError: nothing moves."""
        self.check_moves().put(command)

    def check_moves(self) -> LoopProcess:
        """The loop that takes commands. ValueError: nothing moves."""
        loop = self._loop
        if loop is None:
            raise ValueError("nothing moves: press Balance or start a run")
        return loop

    def confirm(self) -> None:
        """Note that the operator at the page did the present step. ValueError: none is asked for,
        or the table is real.
        """
        operator_step = self._status.operator_step
        if not operator_step:
            raise ValueError("nothing is asked of you just now")
        self.table.confirm(operator_step)
        self.note(f"confirmed: {operator_step}")
        if not operator_step.startswith("hold"):
            self._status = replace(self._status, operator_step="")

    def note(self, text: str) -> None:
        """Add the line `text` to the events of the present run; from any thread."""
        self._notes.append(text)
        self._announce(self._status.t_s, text)

    def close(self) -> None:
        """End in order: table level at 0 V, recording finished, thread ended
        (at most 2 CLOSE_S)."""
        with self._wake:
            self._closed = True
            self._planned.clear()
            self._end_loop(Stop("the dashboard was closed", "interrupted"))
            loop = self._loop
        self._thread.join(CLOSE_S)
        if self._thread.is_alive() and loop is not None:  # still compiling: it has driven nothing
            loop.kill()
            self._thread.join(CLOSE_S)

    def _announce(self, t_s: float, text: str) -> None:
        """Keep and tell an event at t_s [s] of what is on; from any thread."""
        self.events.append((self._status.heading, f"{t_s:.1f} s: {text}"))
        self._on_told(t_s, text)

    # --- the session's thread ---
    def _end_loop(self, stop: Stop) -> None:
        """Stop the loop, or as soon as it has started. The caller holds `_wake`."""
        if self._loop is not None:
            self._loop.put(stop)
        elif self._busy:
            self._stop = stop
        self._wake.notify_all()

    def _started(self, loop: LoopProcess) -> None:
        with self._wake:
            self._loop, stop = loop, self._stop
        if stop is not None:
            loop.put(stop)

    def _serve(self) -> None:
        failures = 0  # of balancing, one right after the other
        while True:
            planned = self._next()
            if self._closed:
                return
            try:
                ending, lasted_s = self._record(planned) if planned else self._balancing()
            except Exception as error:
                self._announce(0.0, f"failed: {words_of(error)}")
                ending, lasted_s = Ending("aborted", str(error)), 0.0
                self._last = planned.ended("aborted", str(error), 0.0) if planned else ""
                with self._wake:
                    self._waits = planned is not None and bool(self._planned)
            finally:
                with self._wake:
                    self._loop, self._busy, self._stop = None, False, None
            odd = ending.outcome not in ("ended", "completed")
            if odd:
                self._announce(lasted_s, f"{ending.outcome}: {ending.reason}".rstrip(": "))
            failed = odd and lasted_s < QUICK_S and planned is None
            failures = failures + 1 if failed else 0
            if failures >= MOST_FAILURES:
                failures, self._balance = 0, False
                self._announce(0.0, "balancing failed again and again: the table rests")

    def _next(self) -> PlannedRun | None:
        """Wait for something to do: the next planned run, or None for balancing."""
        with self._wake:
            while not self._closed:
                if self._planned and not self._waits:
                    self._busy, self._stopping = True, False
                    planned = self._planned.popleft()
                    # With it off the plan, the state alone refuses another start.
                    words = f"{planned.words}: starting"
                    self._status = SessionStatus("running", words, planned, begun=False)
                    return planned
                if self._planned:
                    planned = self._planned[0]
                    how = METHOD_WORDS[planned.method]
                    words = f"run {planned.number} of {planned.of} is next ({how})"
                    self._status = SessionStatus("pause", words, planned, last=self._last)
                elif self._balance:
                    self._busy, self._stopping = True, False
                    return None
                else:
                    self._status = SessionStatus(
                        "stopped", "the table rests at 0 V", last=self._last
                    )
                self._stopping = False
                self._wake.wait(1.0)
            return None

    def _balancing(self) -> tuple[Ending, float]:
        words = "the loop's process starts (a few seconds)"
        self._status = SessionStatus("starting", words, last=self._last)
        job = virtual_job.virtual_job(self.rig, "without", virtual_job.balancing_course(self.rig))
        self.live.begin()
        loop = LoopProcess(job)
        self._started(loop)
        last = [0.0]

        def keep(row: np.ndarray) -> None:
            last[0] = float(row[0])
            self.live.add(row)
            if self._status.state != "balancing":
                words = "the virtual table balances its ball"
                self._status = SessionStatus("balancing", words, last=self._last)

        ending = loop.run(keep, self._announce)
        self.last_notes = loop.notes
        return ending, last[0]

    def _record(self, planned: PlannedRun) -> tuple[Ending, float]:
        """One run of the plan, recorded."""
        plan = planned.plan
        self._last, self._failed, self._asked, self._begun_s = "", planned, False, 0.0
        self._notes.clear()
        self.live.begin(has_ball=not plan.protocol.servo_only)
        with self.table.ready(planned, self._plan_rig) as run:
            recorder = AnnouncingRecorder(run.folder, run.start)
            watch = Watch(run.request, recorder, None)
            watch.stop_through(self)
            recorder.say = partial(self._on_event, planned)
            recorder.at_end = partial(watch.note_pushes, run.request.believed)
            look = partial(self._on_row, watch, recorder, planned)
            with recorder:
                ending = record_live(run.job, recorder, started=self._started, watch=look)
        completed = ending.outcome == "completed"
        with self._wake:
            self._waits = (plan.pause or not completed) and bool(self._planned)
            self._failed = None if completed else planned
            self._last = planned.ended(ending.outcome, ending.reason, self._status.t_s)
        with suppress(Exception):
            self._on_recorded(planned, run.folder, ending)
        return ending, self._status.t_s

    def _on_row(
        self, watch: Watch, recorder: Recorder, planned: PlannedRun, row: np.ndarray
    ) -> None:
        watch.check(row)
        self.live.add(row)
        t_s = float(row[0])
        while self._notes:
            Recorder.event(recorder, t_s, self._notes.popleft())
        operator_step = self._status.operator_step if self._status.run is planned else ""
        waited_s = t_s if self._asked else None
        clock_s = 0.0 if self._asked else t_s - self._begun_s
        self._status = SessionStatus(
            "running", planned.words, planned, clock_s, operator_step, waited_s
        )

    def _on_event(self, planned: PlannedRun, t_s: float, text: str) -> None:
        hold_s = planned.plan.protocol.start.hold_s
        if text.startswith("asked: "):
            self._asked = self._asked or text.startswith("asked: place")
            self._status = replace(self._status, operator_step=text.removeprefix("asked: "))
        elif text in ("placed", "released"):
            self._status = replace(self._status, operator_step="")
        if self._asked and text == ("released" if hold_s > 0 else "placed"):
            self._asked, self._begun_s = False, t_s - hold_s
        self._announce(t_s, text)
