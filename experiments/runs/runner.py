"""Run protocols: one recorded run at a time tick by tick, or many at once in compiled code."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from os import cpu_count
from pathlib import Path
from typing import Protocol as Protocol_
from typing import TypeVar

import numpy as np

from experiments.assemble import (
    camera_lookout,
    known,
    rendered_eye,
    simulated_hand,
    simulated_table,
)
from experiments.protocol import OWN, Protocol, course
from experiments.push_detection import detect_pushes
from experiments.recording import Recorder, write_run
from experiments.run_folder import new_run_folder, write_truth
from experiments.samples import run_part
from rig.batch import simulate_many
from rig.commands import Command, CommandSlot, Stop
from rig.constants import LANES
from rig.controllers import ARMS
from rig.log import INDEX, Log
from rig.loop import Ending, Loop
from rig.own_file import load_controller
from rig.parameters import Rig
from rig.rigfile import to_dict
from rig.simulate import Simulated, Task, draw, simulate
from rig.stopping import stop_on_signals

_T, _BALL, _PHASE, _PUSH = (INDEX[n] for n in ("t_s", "ball_x_m", "phase", "push"))
PROGRESS_EVERY = 250
T = TypeVar("T")


@dataclass(frozen=True)
class Order:
    """One run to make: everything that decides it. `bundle` switches the rendered camera on.

    rig: the plant; kind: what the rig file says of it (the plant itself where nothing else is
    said), of which controllers and estimators see all but the effects.
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
class Done:
    """A recorded run: its folder, how it ended, and the camera's (true, measured) pairs if any."""

    folder: Path
    ending: Ending
    pairs: np.ndarray


def start_record(order: Order) -> dict:
    """What is known before the run: the rig as the controller knows it, never the truth."""
    return {
        "source": "simulated",
        "protocol": order.protocol.model_dump(),
        "arm": order.arm,
        "seed": order.seed,
        "rig": to_dict(order.believed),
        "calibration": str(order.bundle.name) if order.bundle else None,
        "camera": "frames" if order.bundle else "statistical",
    }


def truth_record(order: Order) -> dict:
    """What the plant really was: truth.json, which only scorers open."""
    return {"rig": to_dict(order.rig), "seed": order.seed}


class Slot(Protocol_):
    """Where a stop may be put: a `CommandSlot`, or a loop in its own process."""

    def put(self, command: Command) -> None: ...


class Watch:
    """Looks at every row on its way to the recording: a wrong start, pushes, progress, a knock."""

    def __init__(self, order: Order, recorder: Recorder, progress, eye=None) -> None:
        self._lookout = camera_lookout(eye, order.bundle)
        self._start, self._recorder = order.protocol.start, recorder
        self._slot: Slot | None = None
        self._progress, self._servo_only = progress, order.protocol.servo_only
        self._checked = self._servo_only
        self._pushed, self._rows = False, 0
        self._kept: list[np.ndarray] = []

    def stop_through(self, slot: Slot) -> None:
        """Where to put a stop when the start is wrong."""
        self._slot = slot

    def keep(self, row: np.ndarray) -> None:
        self._recorder.append(row)
        self.look(row)

    def look(self, row: np.ndarray) -> None:
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
        """Add the pushes that the ball itself shows, asked for or not."""
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
    order: Order,
    *,
    commands: CommandSlot | None = None,
    progress: Callable[[float], None] | None = None,
) -> Done:
    """Run an order on its simulated table through the real loop, recorded tick by tick.

    Raises what the recorder or the vision chain raises; what was recorded so far stays readable.
    """
    way = course(order.protocol, order.rig, order.seed)
    controller = load_controller(order.protocol.controller) if order.arm == OWN else None
    eye = rendered_eye(order.rig, order.bundle, order.seed) if order.bundle else None
    table = simulated_table(order.rig, way, order.seed, eye)
    slot = commands or CommandSlot()
    folder = new_run_folder(order.parent, order.protocol.name, order.arm)
    write_truth(folder, truth_record(order))
    with stop_on_signals(slot), Recorder(folder, start_record(order)) as recorder:
        watch = Watch(order, recorder, progress, eye)
        watch.stop_through(slot)
        with table:
            ending = Loop(
                table,
                order.believed,
                arm_number(order.arm),
                way,
                hand=simulated_hand(table, order.protocol, way, order.seed),
                commands=slot,
                controller=controller,
                keep=watch.keep,
                event=recorder.event,
            ).run()
        watch.note_pushes(order.believed)
        recorder.finish(ending.outcome, ending.reason)
    return Done(folder, ending, np.array(eye.pairs if eye else []).reshape(-1, 5))


def arm_number(arm: str) -> int:
    """The arm's number for the pilot; a lab's own controller stands where "without" would."""
    return ARMS["without" if arm == OWN else arm]


def _task(order: Order) -> Task:
    """The order as the simulator takes it, with the numbers that `run` would draw."""
    if order.arm == OWN:
        raise ValueError("a lab's own controller runs tick by tick alone: use rig run")
    if order.protocol.pushes.kind == "at-centre":
        raise ValueError("pushes at-centre answer to the ball: run them tick by tick (rig run)")
    way = course(order.protocol, order.rig, order.seed)
    numbers = draw(np.random.default_rng([order.seed, 3]), order.rig, way)
    return Task(order.rig, order.believed, arm_number(order.arm), way, numbers)


def simulate_order(order: Order) -> Simulated:
    """The same run as `run` with the statistical camera, in compiled code and memory alone."""
    task = _task(order)
    return simulate(task.rig, task.known, task.arm, task.course, task.draws)


def simulate_orders(
    orders: Sequence[Order], work: Callable[[Order, Simulated], T], done=lambda count: None
) -> list[T]:
    """`work` of every order and its run, in order: blocks of runs on all cores, the same runs as
    `simulate_order` makes. `done` is told how many are finished."""
    blocks = [orders[i : i + LANES] for i in range(0, len(orders), LANES)]

    def some(block: Sequence[Order]) -> list[T]:
        runs = simulate_many([_task(order) for order in block])
        return [work(order, run) for order, run in zip(block, runs, strict=True)]

    found: list[T] = []
    with ThreadPoolExecutor(cpu_count() or 1) as pool:  # the kernels hold no lock
        for part in pool.map(some, blocks):
            found += part
            done(len(found))
    return found


def simulate_in_blocks(orders: Sequence[Order], work: Callable[[Order, Simulated], T]) -> list[T]:
    """The same on this core alone, a block in memory at a time: for studies that use processes."""
    found: list[T] = []
    for i in range(0, len(orders), LANES):
        block = orders[i : i + LANES]
        runs = simulate_many([_task(order) for order in block])
        found += [work(order, run) for order, run in zip(block, runs, strict=True)]
    return found


def keep_simulated(order: Order, result: Simulated) -> Path:
    """Record a run of `simulate_order` as a run folder; its events are read off its columns."""
    folder = new_run_folder(order.parent, order.protocol.name, order.arm)
    write_truth(folder, truth_record(order))
    write_run(folder, start_record(order), result.log, events(result.log), result.outcome)
    return folder


def events(log: Log) -> list[dict]:
    """Release and pushes as a loop would have noted them."""
    t, found = log["t_s"], []
    released = np.flatnonzero((log["phase"][1:] > 1) & (log["phase"][:-1] == 1))
    found += [{"t_s": float(t[i + 1]), "text": "released"} for i in released]
    pushed = np.flatnonzero(np.diff(log["push"], prepend=0.0) > 0)
    found += [{"t_s": float(t[i]), "text": "pushed"} for i in pushed]
    return sorted(found, key=lambda event: event["t_s"])


def contract_columns(log: Log) -> Log:
    """The columns that anybody needs to recompute a report's numbers; the rest blank."""
    kept = [i for name, i in INDEX.items() if i <= INDEX["ball_exposed_s"] or "desired" in name]
    rows = np.full_like(log.rows, np.nan)
    rows[:, [*kept, _PHASE]] = log.rows[:, [*kept, _PHASE]]
    return Log.from_rows(rows)
