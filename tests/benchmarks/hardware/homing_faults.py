"""Faults on purpose while a table is homed: in homing, driver, packets and the real firmware.

    python tests/benchmarks/hardware/homing_faults.py --faults 110 --seed 1

Prints a table: per kind of fault its runs, how they ended, and what was unsafe: volts that nobody
asked for, above what homing may give or at the end, a homing with a wrong zero, sign or order of
the cables. Exit code 1 where any was.
"""

import argparse
import sys
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from math import inf, sin

import numpy as np

from experiments.runs.assemble import load_rig
from rig.hardware.board import session as driver
from rig.hardware.board.link import LinkLost
from rig.hardware.board.session import BoardStopped
from rig.hardware.homing.home import Homing, home
from rig.hardware.homing.homed import power_up
from rig.hardware.homing.homing_moves import MOST_V, HomingRefused
from rig.hardware.wiring import Wiring, raw_wiring
from rig.parameters import Rig
from tests.benchmarks.hardware.fault_campaign import AFTER_S, why
from tests.support.boards.chip import NEEDED, Chip
from tests.support.boards.chip_faults import KINDS, FaultyLink, HostKilledError, draw
from tests.support.boards.chip_oracle import ROUGH_V, Oracle
from tests.support.boards.world import STEP_S, World, table_on
from tests.support.parts import missing

HOMING_S = 26.0  # that of the default table without a fault
COUNTS = 12  # of a zero that two stops gave, with the play of the gears


class HomingOracle(Oracle):
    """Judges the volts alone: homing has to go beyond any limit, up to the stops."""

    def __init__(self, world: World, rig: Rig) -> None:
        super().__init__(world, rig)
        self._limit = inf

    def asked(self, packet) -> tuple[float, float] | None:
        """Of what is asked a board that is not homed yet gives as much as homing may."""
        volts = super().asked(packet)
        return volts and tuple(min(max(v, -MOST_V), MOST_V) for v in volts)

    def look(self) -> None:
        super().look()
        if max(map(abs, self.world.volts)) > MOST_V + ROUGH_V:
            self._tell("more volts than homing may give")


@dataclass(frozen=True)
class Result:
    """How one faulty homing went: its outcome, what was unsafe, when the fault began [s]."""

    kind: str
    outcome: str
    unsafe: tuple[str, ...]
    begin_s: float


def one(kind: str, seed: int, make: Callable[[], object] = Chip) -> Result:
    """One homing of a board with one fault; the same answer for the same arguments."""
    rng = np.random.default_rng([seed, KINDS.index(kind), 1])
    fault = draw(kind, seed, later_s=rng.uniform(0.0, HOMING_S))
    signs = [(int(a), int(b)) for a, b in rng.choice([-1, 1], (2, 2))]
    zeros = tuple(int(n) for n in rng.integers(-2000, 2000, 2))
    wiring = Wiring((1, 0) if rng.random() < 0.5 else (0, 1), *signs, zeros)
    rig = load_rig(None)
    world = World(make(), rig, seed=seed, held=True, wiring=wiring)
    oracle, found, boot, outcome = HomingOracle(world, rig), None, None, "host killed"
    with suppress(HostKilledError):  # kill -9: no word of it
        found, boot, outcome = _homing(world, rig, FaultyLink(world, fault))
    world.run(AFTER_S)
    oracle.look()
    unsafe = [*oracle.unsafe]
    if world.volts != (0.0, 0.0):
        unsafe.append("volts at the end")
    world.watch = lambda: None
    if found is not None:
        unsafe += _wrong(world, found, boot)
    world.board.close()
    return Result(kind, outcome, tuple(unsafe), fault.begin_s)


def _homing(world: World, rig: Rig, link: FaultyLink) -> tuple[Homing | None, str | None, str]:
    """What homing found, of which power-up, and the named outcome; as `rig home` does it."""
    table = None
    try:
        table = table_on(world, link, wiring=raw_wiring(rig), homed=False)
        with table:
            found = home(table, rig, lambda t_s: _tilt(world, rig))
            return found, power_up(table), "homed"
    except HomingRefused as error:
        return None, None, f"refused: {error.name}"
    except BoardStopped as error:
        return None, None, f"board stopped: {why(error)}"
    except LinkLost as error:
        return None, None, f"link lost: {why(error)}" if table else "no link"


def _tilt(world: World, rig: Rig) -> tuple[float, float] | None:
    """(sin phi_x, sin phi_y) of the plate, sixty times a second, as its markers tell it."""
    if round(world.now_s / STEP_S) % 17:
        return None
    x, y = (rig.linkage.ratio * sin(angle) for angle in world.plant.truth()["plate_rad"])
    return x, y


def _wrong(world: World, found: Homing, boot: str | None) -> list[str]:
    """What a run would find that trusts the homing: angles that are not the true ones, or volts
    that drive another arm or the other way.
    """
    table = table_on(world, wiring=found.wiring)
    if power_up(table) != boot:
        return []  # a run refuses it
    wrong = []
    if found.wiring.to_board((1.0, 2.0)) != world.wiring.to_board((1.0, 2.0)):
        wrong.append("a homing that mistakes the motors' cables")
    with table:
        off_rad = np.abs(np.subtract(table.read().theta_rad, world.arms_rad)).max()
    off = off_rad / found.wiring.step_rad
    return [*wrong, f"a homing that is wrong by {off:.0f} counts"] if off > COUNTS else wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--faults", type=int, default=110)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    if lack := missing(*NEEDED):
        print(lack)
        return 2
    driver.ANSWER_S = 0.5  # a simulated board needs no boot loader's time
    begin, results = time.monotonic(), []
    for i in range(arguments.faults):
        results.append(one(KINDS[i % len(KINDS)], arguments.seed + i))
        print(f"seed {arguments.seed + i}: {results[-1]}", file=sys.stderr, flush=True)
    print("| fault | homings | unsafe | how they ended |\n|---|---|---|---|")
    for kind in KINDS:
        of = [r for r in results if r.kind == kind]
        ends = ", ".join(f"{name} {n}" for name, n in Counter(r.outcome for r in of).most_common())
        print(f"| {kind} | {len(of)} | {sum(bool(r.unsafe) for r in of)} | {ends} |")
    for result in results:
        if result.unsafe:
            print(f"UNSAFE: {result}")
    print(f"{time.monotonic() - begin:.0f} s")
    return int(any(r.unsafe for r in results))


if __name__ == "__main__":
    sys.exit(main())
