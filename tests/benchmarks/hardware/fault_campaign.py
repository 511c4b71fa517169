"""Faults on purpose in the chain of loop, driver, packets and real firmware, all from one seed.

    python tests/benchmarks/hardware/fault_campaign.py --faults 1000 --seed 1 [--levelling]
        [--board pulses]

Prints a table: per kind of fault its runs, how they ended, and what was unsafe (plate beyond its
limit, volts or pulses without a fresh command, a recorded row lost). Exit code 1 where any was.
With --levelling the faults begin in the last 0.05 s of the run or while the table is levelled.
"""

import argparse
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from experiments.records.recording import Recorder, read_run
from experiments.runs.assemble import known, load_rig
from rig.control.controllers import COMPENSATORS
from rig.course import Course
from rig.hardware.board import session as driver
from rig.hardware.board.board import BoardTable
from rig.hardware.board.link import LinkLost
from rig.hardware.board.pulse_servo import PulseServo
from rig.hardware.board.pulse_table import PulseTable
from rig.hardware.board.session import BoardStopped
from rig.loop.loop import Loop
from rig.parameters import Rig
from tests.support import ROOT
from tests.support.boards.chip import NEEDED, Chip, PulseChip
from tests.support.boards.chip_faults import (
    KINDS,
    Fault,
    FaultyLink,
    HostKilledError,
    draw,
)
from tests.support.boards.chip_oracle import Oracle
from tests.support.boards.pulse_oracle import PulseOracle
from tests.support.boards.world import PulseWorld, World, WorldLink, pulse_table_on, table_on
from tests.support.parts import missing

RUN_S = 0.6
LATER_S = 0.5  # of faults while the table is levelled, for 0.4 s from RUN_S on
LEVEL_RAD = 0.06  # friction and offset leave 0.026 (0.36 V); at 0 V the arm sinks in its play
AFTER_S = 0.85  # watchdog, levelling (with servos the way to level, too) and some more
HOBBY = ROOT / "experiments/rigs/hobby-two-servos.toml"
SERVOS = (PulseServo(1520.0), PulseServo(1475.0, -620.0))


class Volts:
    """A board with H-bridges, its plant and its host."""

    def __init__(self) -> None:
        self.rig: Rig = load_rig(None)

    def world(self, board, seed: int, start_m: tuple[float, float]) -> World:
        return World(board, self.rig, seed=seed, start_m=start_m)

    def judge(self, world) -> Oracle:
        return Oracle(world, self.rig)

    def table(self, world, link: WorldLink | None = None) -> BoardTable | PulseTable:
        """As a run opens it, after homing."""
        return table_on(world, link)

    def home(self, world) -> BoardTable | PulseTable:
        """As rig home leaves it."""
        return table_on(world, homed=False)

    def is_fresh(self, table) -> bool:
        """Its zero is lost: only to be homed."""
        return int(table.boot_id, 16) == 0

    def is_on(self, world) -> bool:
        return world.volts != (0.0, 0.0)


class Pulses(Volts):
    """A board with hobby servos, which have no zero to lose."""

    def __init__(self) -> None:
        self.rig = load_rig(HOBBY)

    def world(self, board, seed: int, start_m: tuple[float, float]) -> World:
        bare = replace(self.rig.servo, period_s=0.0, quantum_rad=0.0)  # the pulses' own here
        return PulseWorld(board, replace(self.rig, servo=bare), SERVOS, seed=seed, start_m=start_m)

    def judge(self, world) -> Oracle:
        return PulseOracle(world, self.rig)

    def table(self, world, link: WorldLink | None = None) -> BoardTable | PulseTable:
        return pulse_table_on(world, self.rig, link)

    def home(self, world) -> BoardTable | PulseTable:
        return self.table(world)

    def is_fresh(self, table) -> bool:
        return False

    def is_on(self, world) -> bool:
        return any(world.board.pulses_us())


BOARDS = {"volts": (Volts, Chip), "pulses": (Pulses, PulseChip)}


@dataclass(frozen=True)
class Result:
    """How one faulty run went: its outcome, what was unsafe, rows kept, the widest angle."""

    kind: str
    outcome: str
    unsafe: tuple[str, ...]
    rows: int
    worst_rad: float


def one(
    kind: str,
    seed: int,
    make: Callable[[], object] | None = None,
    board: str = "volts",
    *,
    later_s: float = 0.0,
) -> Result:
    """One run with one fault; the same answer for the same arguments."""
    of, usual = BOARDS[board]
    fault, subject = draw(kind, seed, later_s), of()
    start = fault.rng.uniform(-0.1, 0.1, 2)
    world = subject.world((make or usual)(), seed, (float(start[0]), float(start[1])))
    oracle, rows = subject.judge(world), []
    with tempfile.TemporaryDirectory() as folder:
        recorder = Recorder(Path(folder) / "run", {"source": "simulated", "seed": seed})

        def keep(row: np.ndarray) -> None:
            recorder.append(row)
            rows.append(row.copy())

        outcome = _run(subject, world, fault, keep)
        if outcome != "host killed":  # else nobody is left to finish it
            recorder.finish(outcome)
        world.run(AFTER_S)
        oracle.look()
        unsafe = [*oracle.unsafe, *_lost(Path(folder) / "run", rows)]
    if subject.is_on(world):
        unsafe.append("volts at the end")
    if kind != "board reset" and max(map(abs, world.arms_rad)) > LEVEL_RAD:
        unsafe.append("not level at the end")
    if kind != "baud mismatch":
        outcome += _again(subject, world)
    world.board.close()
    return Result(kind, outcome, tuple(unsafe), len(rows), oracle.worst_rad)


def _run(subject: Volts, world: World, fault: Fault, keep) -> str:
    """The run itself; its named outcome."""
    rig = subject.rig
    n = round(RUN_S * rig.control_rate_hz)
    way = Course(np.zeros((n, 2)), np.zeros((n, 2)))
    table = None
    homing = subject.home(world)
    homing.arm()  # which names the homing
    homing.close()
    try:
        table = subject.table(world, FaultyLink(world, fault))
        with table:
            table.level_s = 0.4
            ending = Loop(table, known(rig), COMPENSATORS["with"], way, keep=keep).run()
        return ending.outcome
    except HostKilledError:
        return "host killed"
    except BoardStopped as error:
        return f"board stopped: {why(error)}"
    except LinkLost as error:
        return f"link lost: {why(error)}" if table else "no link"


def why(error: OSError) -> str:
    text = str(error.strerror).partition(":" if ":" in str(error.strerror) else "does")[2]
    return text.strip().split(" for ")[0].split(" (")[0]


def _lost(folder: Path, rows: list[np.ndarray]) -> list[str]:
    """Is every row that was handed over in the recording, bit for bit?"""
    if not rows:
        return []
    found = read_run(folder).log.rows
    same = found.shape == np.shape(rows) and np.array_equal(found, rows, equal_nan=True)
    return [] if same else ["recorded rows lost"]


def _again(subject: Volts, world: World) -> str:
    """Can a host connect and arm again afterwards, the cable being whole?"""
    world.watch = lambda: None
    try:
        table = subject.table(world)
        fresh, homed = subject.is_fresh(table), table
        if fresh:
            homed = subject.home(world)
        homed.arm()
        for _ in range(20):
            homed.read()
            homed.drive((0.1, 0.1))
        homed.close()
    except OSError as error:
        return f" (NOT AGAIN: {error})"
    return " (to be homed)" if fresh else ""


def campaign(
    faults: int,
    seed: int,
    progress=lambda result: None,
    board: str = "volts",
    *,
    later_s: float = 0.0,
) -> list[Result]:
    """`faults` runs, the kinds in turn."""
    driver.ANSWER_S = 0.5  # a simulated board needs no boot loader's time
    results = []
    for i in range(faults):
        results.append(one(KINDS[i % len(KINDS)], seed + i, board=board, later_s=later_s))
        progress(results[-1])
    return results


def table(results: list[Result]) -> str:
    """The figures, a line a kind."""
    lines = [f"{'fault':20} {'runs':>4} {'unsafe':>6} {'widest':>7}  outcomes"]
    for kind in KINDS:
        of = [r for r in results if r.kind == kind]
        if not of:
            continue
        counted = Counter(r.outcome for r in of).most_common()
        outcomes = ", ".join(f"{name} {n}" for name, n in counted)
        widest = np.degrees(max(r.worst_rad for r in of))
        unsafe = sum(bool(r.unsafe) for r in of)
        lines.append(f"{kind:20} {len(of):4} {unsafe:6} {widest:6.1f}°  {outcomes}")
    bad = Counter(what for r in results for what in r.unsafe)
    lines.append(f"{'all':20} {len(results):4} {sum(bool(r.unsafe) for r in results):6}")
    lines += [f"UNSAFE: {what}: {n} runs" for what, n in bad.items()]
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--faults", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--board", choices=BOARDS, default="volts")
    parser.add_argument("--levelling", action="store_true", help="faults while it is levelled")
    arguments = parser.parse_args()
    if lack := missing(*NEEDED):
        print(lack)
        return 2
    begin, numbers = time.monotonic(), iter(range(10**9))

    def progress(result: Result) -> None:
        n = next(numbers)
        if result.unsafe:
            print(f"seed {arguments.seed + n}: {result}", flush=True)

    later_s = LATER_S if arguments.levelling else 0.0
    results = campaign(arguments.faults, arguments.seed, progress, arguments.board, later_s=later_s)
    print(table(results))
    rows = sum(r.rows for r in results)
    print(f"{rows} rows recorded and read back; {time.monotonic() - begin:.0f} s")
    return int(any(r.unsafe or "NOT AGAIN" in r.outcome for r in results))


if __name__ == "__main__":
    sys.exit(main())
