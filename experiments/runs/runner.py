"""Run protocols: one recorded run at a time tick by tick, or many at once in compiled code."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from os import cpu_count
from pathlib import Path
from typing import TypeVar

import numpy as np

from experiments.analysis.push_detection import detect_pushes
from experiments.analysis.samples import run_part
from experiments.records.recording import Recorder, write_run
from experiments.records.run_folder import new_run_folder, write_truth
from experiments.runs.assemble import (
    camera_lookout,
    known,
    rendered_eye,
    simulated_operator,
    simulated_table,
)
from experiments.runs.protocol import OWN, Protocol, course
from rig.control.controllers import COMPENSATORS
from rig.control.user_controller import WatchedController, load_controller
from rig.log import CONTRACT, INDEX, Log
from rig.loop.commands import CommandSlot, Stop
from rig.loop.job import warm_up
from rig.loop.loop import Ending, Loop, run_controlled
from rig.loop.signals import StopSlot, stop_on_signals
from rig.parameters import Rig
from rig.plant.constants import LANES
from rig.rigfile import to_record
from rig.simulation.batch import simulate_many
from rig.simulation.simulate import Simulated, Task, draw, simulate

_T, _BALL, _PHASE, _PUSH = (INDEX[n] for n in ("t_s", "ball_x_m", "phase", "push"))
PROGRESS_EVERY = 250
T = TypeVar("T")


@dataclass(frozen=True)
class RunRequest:
    """One run to make: everything that decides it.

    rig: the plant; protocol, arm, seed: what is run; parent: folder that the run's folder is made
    in; bundle: path of a calibration, which switches the rendered camera on; kind: the rig as its
    rig file describes it (None: `rig`), of which controllers and estimators know all but the
    effects.
    """

    rig: Rig
    protocol: Protocol
    arm: str
    seed: int
    parent: Path
    bundle: Path | None = None
    kind: Rig | None = None

    @property
    def believed(self) -> Rig:
        """The rig as controllers and estimators know it."""
        return known(self.kind or self.rig)


@dataclass(frozen=True)
class FinishedRun:
    """A recorded run: its folder and how it ended.

    pairs (n, 5): of the rendered camera, exposure time [s], true x, y and measured x, y [m] of the
    ball; n = 0 without that camera.
    """

    folder: Path
    ending: Ending
    pairs: np.ndarray


def start_record(request: RunRequest) -> dict:
    """Start record of a run for run.json: rig as its controller knows it, protocol, arm, seed.

    Holds nothing that only the plant knows.
    """
    return {
        "source": "simulated",
        "protocol": request.protocol.model_dump(),
        "arm": request.arm,
        "seed": request.seed,
        "rig": to_record(request.believed),
        "calibration": str(request.bundle.name) if request.bundle else None,
        "camera": "frames" if request.bundle else "statistical",
    }


def truth_record(request: RunRequest) -> dict:
    """Record for truth.json, which only scorers open: the plant's rig and the seed."""
    return {"rig": to_record(request.rig), "seed": request.seed}


class Watch:
    """Checks every row of a run on its way to `recorder`.

    Stops a run with a wrong start; notes pushes and a moved camera as events; reports the progress
    every PROGRESS_EVERY rows. progress: None, or called with the run's time [s]; eye: the rendered
    camera, None without one. BundleError, a ValueError: the request's calibration cannot be used.
    """

    def __init__(self, request: RunRequest, recorder: Recorder, progress, eye=None) -> None:
        self._lookout = camera_lookout(eye, request.bundle)
        self._start, self._recorder = request.protocol.start, recorder
        self._slot: StopSlot | None = None
        self._progress, self._servo_only = progress, request.protocol.servo_only
        self._checked = self._servo_only
        self._pushed, self._rows = False, 0
        self._kept: list[np.ndarray] = []

    def stop_through(self, slot: StopSlot) -> None:
        """Set the slot that a stop is put into when the start is wrong."""
        self._slot = slot

    def keep(self, row: np.ndarray) -> None:
        """Record the row (len(COLUMNS),) of one tick, then `check` it. OSError: it could not be
        written.
        """
        self._recorder.append(row)
        self.check(row)

    def check(self, row: np.ndarray) -> None:
        """Check one row (len(COLUMNS),) for a wrong start, a push or a shifted camera."""
        self._kept.append(row.copy())
        self._rows += 1
        if not self._checked and row[_PHASE] > 0 and not np.isnan(row[_BALL]):
            self._checked = True
            self._check_start(row)
        if self._lookout is not None and (said := self._lookout(float(row[_T]))):
            self._recorder.event(float(row[_T]), said)
        if (row[_PUSH] > 0) != self._pushed:
            self._pushed = bool(row[_PUSH] > 0)
            if self._pushed:
                self._recorder.event(float(row[_T]), "pushed")
        if self._progress is not None and self._rows % PROGRESS_EVERY == 0:
            self._progress(float(row[_T]))

    def note_pushes(self, believed: Rig) -> None:
        """Record an event for every push detected in the ball's motion, asked for or not.

        believed: the rig that `detect_pushes` predicts the motion with. Nothing for servo-only
        runs.
        """
        if self._kept and not self._servo_only:
            log = Log.from_rows(np.array(self._kept))
            begin = run_part(log)["t_s"][:1]
            for t_s in detect_pushes(log, rig=believed):
                self._recorder.event(float(begin[0] + t_s), "push detected")

    def _check_start(self, row: np.ndarray) -> None:
        off = float(np.hypot(row[_BALL] - self._start.x_m, row[_BALL + 1] - self._start.y_m))
        if off > self._start.tolerance_m and self._slot is not None:
            self._slot.put(
                Stop(
                    f"the ball starts {1000 * off:.0f} mm from the protocol's start (limit "
                    f"{1000 * self._start.tolerance_m:.0f} mm): place it again"
                )
            )


def run(
    request: RunRequest,
    *,
    commands: CommandSlot | None = None,
    progress: Callable[[float], None] | None = None,
    begun: Callable[[Path], None] = lambda folder: None,
    called: Callable[[str], None] = lambda method: None,
) -> FinishedRun:
    """Run a request on its simulated table through the real loop, recorded tick by tick.

    commands: slot that a stop can be put into; progress: called with the run's time [s]; begun:
    with the run's folder; called: as of `WatchedController`, of a user's controller, which is
    loaded in a call of "start". ValueError: the protocol does not fit the rig (`course`), or a
    user's controller or the calibration cannot be used; OSError: a row cannot be written. What was
    recorded so far stays readable.
    """
    way = course(request.protocol, request.rig, request.seed)
    controller = None
    if request.arm == OWN:
        called("start")
        controller = WatchedController(load_controller(request.protocol.controller), called)
        called("")
    eye = rendered_eye(request.rig, request.bundle, request.seed) if request.bundle else None
    table = simulated_table(request.rig, way, request.seed, eye)
    slot = commands or CommandSlot()
    warm_up(request.believed, compensator_index(request.arm), way)
    folder = new_run_folder(request.parent, request.protocol.name, request.arm)
    write_truth(folder, truth_record(request))
    with stop_on_signals(slot), Recorder(folder, start_record(request)) as recorder:
        begun(folder)
        watch = Watch(request, recorder, progress, eye)
        watch.stop_through(slot)
        loop = Loop(
            table,
            request.believed,
            compensator_index(request.arm),
            way,
            operator=simulated_operator(table, request.protocol, way, request.seed),
            commands=slot,
            controller=controller,
            keep=watch.keep,
            event=recorder.event,
        )

        def on_table() -> Ending:
            with table:
                return loop.run()

        ending = run_controlled(controller, request.believed, on_table)
        watch.note_pushes(request.believed)
        recorder.finish(ending.outcome, ending.reason)
    return FinishedRun(folder, ending, np.array(eye.pairs if eye else []).reshape(-1, 5))


def compensator_index(arm: str) -> int:
    """Index of the arm's compensator; "own" (a user's controller) has that of "without".

    KeyError: an arm that COMPENSATORS lacks.
    """
    return COMPENSATORS["without" if arm == OWN else arm]


def _task(request: RunRequest) -> Task:
    """The request as the simulator takes it, with the numbers that `run` would draw."""
    if request.arm == OWN:
        raise ValueError("a lab's own controller runs tick by tick alone: use rig run")
    if request.protocol.pushes.kind == "at-centre":
        raise ValueError("pushes at-centre answer to the ball: run them tick by tick (rig run)")
    way = course(request.protocol, request.rig, request.seed)
    numbers = draw(np.random.default_rng([request.seed, 3]), request.rig, way)
    return Task(request.rig, request.believed, compensator_index(request.arm), way, numbers)


def simulate_run(request: RunRequest) -> Simulated:
    """Simulate a request in compiled code, in memory alone, with the statistical camera.

    The result is that of `run`. ValueError: a user's own controller, pushes "at-centre", or a
    protocol that does not fit the rig.
    """
    task = _task(request)
    return simulate(task.rig, task.known, task.compensator, task.course, task.draws)


def simulate_runs(
    requests: Sequence[RunRequest],
    work: Callable[[RunRequest, Simulated], T],
    done=lambda count: None,
) -> list[T]:
    """Results of work(request, simulated run) for every request, in the order of the requests.

    Blocks of runs are simulated on all cores; each run is the one that `simulate_run` makes. done:
    called with the number of requests finished. ValueError as in `simulate_run`.
    """
    blocks = [requests[i : i + LANES] for i in range(0, len(requests), LANES)]

    def some(block: Sequence[RunRequest]) -> list[T]:
        runs = simulate_many([_task(request) for request in block])
        return [work(request, run) for request, run in zip(block, runs, strict=True)]

    found: list[T] = []
    with ThreadPoolExecutor(cpu_count() or 1) as pool:  # the kernels hold no lock
        for part in pool.map(some, blocks):
            found += part
            done(len(found))
    return found


def simulate_in_blocks(
    requests: Sequence[RunRequest], work: Callable[[RunRequest, Simulated], T]
) -> list[T]:
    """Results of work(request, simulated run) for every request, computed on this core alone.

    One block of runs is in memory at a time: for studies that run in several processes. ValueError
    as in `simulate_run`.
    """
    found: list[T] = []
    for i in range(0, len(requests), LANES):
        block = requests[i : i + LANES]
        runs = simulate_many([_task(request) for request in block])
        found += [work(request, run) for request, run in zip(block, runs, strict=True)]
    return found


def keep_simulated(request: RunRequest, result: Simulated, *, truth: bool = True) -> Path:
    """Record a run of `simulate_run` as a run folder, and return the folder; `truth`: with what the
    table really was, for scorers.

    Its events are derived from the log's columns. OSError: the folder cannot be written.
    """
    folder = new_run_folder(request.parent, request.protocol.name, request.arm)
    if truth:
        write_truth(folder, truth_record(request))
    write_run(folder, start_record(request), result.log, events(result.log), result.outcome)
    return folder


def events(log: Log) -> list[dict]:
    """Release and pushes of a simulated log as events {"t_s", "text"}, in the order of time."""
    t, found = log["t_s"], []
    released = np.flatnonzero((log["phase"][1:] > 1) & (log["phase"][:-1] == 1))
    found += [{"t_s": float(t[i + 1]), "text": "released"} for i in released]
    pushed = np.flatnonzero(np.diff(log["push"], prepend=0.0) > 0)
    found += [{"t_s": float(t[i]), "text": "pushed"} for i in pushed]
    return sorted(found, key=lambda event: event["t_s"])


def contract_columns(log: Log) -> Log:
    """The log with only the columns needed to recompute a report's numbers; the rest is NaN."""
    kept = [i for name, i in INDEX.items() if name in CONTRACT or "desired" in name]
    rows = np.full_like(log.rows, np.nan)
    rows[:, [*kept, _PHASE]] = log.rows[:, [*kept, _PHASE]]
    return Log.from_rows(rows)
