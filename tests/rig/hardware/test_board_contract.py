"""One contract for every table: simulated, board without a chip, real firmware, USB."""

import sys
from dataclasses import dataclass
from pathlib import Path

import contract
import numpy as np
import pytest
from board_host import HostBoard
from board_world import World, WorldEye, WorldLink, table_on
from usb_fake import FakeUsb

from experiments.assemble import load_rig
from rig.hardware.board import BoardTable
from rig.hardware.link import LinkLost
from rig.hardware.usb_link import UsbLink
from rig.hardware.wiring import Wiring
from rig.parameters import Rig
from rig.simulator import SimulatedTable

sys.path.insert(0, str(Path(__file__).parents[2] / "engines"))
from simavr_chip import Chip  # pyright: ignore[reportMissingImports]

ODD = Wiring(swap=True, sign_volts=(-1, 1), sign_angle=(1, -1), zero_counts=(7, -4), crossed=True)


@dataclass
class Case:
    """A table under test and what only its plant knows."""

    table: SimulatedTable | BoardTable
    world: World | None = None
    link: WorldLink | None = None
    usb: FakeUsb | None = None

    def volts_V(self):
        return self.table.volts_V if self.world is None else self.world.volts

    def arms_rad(self):
        plant = self.table if self.world is None else self.world.plant
        return tuple(plant.truth()["arm_rad"])


def simulated(rig: Rig) -> Case:
    return Case(SimulatedTable(rig, np.random.default_rng(1)))


def lock_step(board, rig: Rig, wiring: Wiring | None = None) -> Case:
    world = World(board, rig, wiring=wiring)
    link = WorldLink(world)
    return Case(table_on(world, link), world, link)


def usb(rig: Rig) -> Case:
    world = World(HostBoard(), rig)
    fake, eye = FakeUsb(world), WorldEye(world)
    clock = WorldLink(world).clock
    eye.table = BoardTable(UsbLink(backend=fake, clock=clock), clock=clock, eye=eye)
    return Case(eye.table, world, usb=fake)


TABLES = {
    "simulated": simulated,
    "board": lambda rig: lock_step(HostBoard(), rig),
    "board-wired-odd": lambda rig: lock_step(HostBoard(), rig, ODD),
    "firmware": lambda rig: lock_step(Chip(), rig),
    "usb": usb,
}
EVERY = pytest.mark.parametrize("make", TABLES.values(), ids=TABLES.keys())
BOARDS = pytest.mark.parametrize("make", [*TABLES.values()][1:], ids=[*TABLES][1:])


def ready(case: Case):
    if isinstance(case.table, BoardTable):
        case.table.arm()
    return case.table


@EVERY
def test_time_strictly_increases(make):
    contract.time_strictly_increases(ready(make(Rig())))


@EVERY
def test_observations_follow_their_light(make):
    contract.observations_follow_their_light(ready(make(Rig())))


@EVERY
@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sign", [-1, 1])
def test_positive_volts_raise_the_angle(make, axis: int, sign: int):
    contract.positive_volts_raise_the_angle(ready(make(Rig())), axis, sign)


@EVERY
@pytest.mark.parametrize("fails", [False, True])
def test_leaving_gives_level_and_no_volts(make, fails: bool):
    case = make(load_rig(None))
    contract.leaving_gives_level_and_no_volts(case.table, case.volts_V, case.arms_rad, fails=fails)


@BOARDS
@pytest.mark.parametrize("how", ["unplugged", "hung"])
def test_a_dead_link_raises_by_name_and_the_board_levels(make, how: str):
    case = make(Rig())
    world = case.world

    def kill() -> None:
        if case.usb is not None:
            case.usb.plugged, case.usb.hung = how != "unplugged", how == "hung"
        elif how == "unplugged":
            case.link.cut = True
        else:  # the board's bytes do not arrive any more, nor do ours
            world.board.take, world.board.receive = lambda: b"", lambda data: None

    table = ready(case)
    contract.a_dead_link_raises_by_name(
        table, kill, lambda: world.now_s, LinkLost, r"board .* is lost"
    )
    table.close()
    world.run(0.7)
    assert world.volts == (0.0, 0.0)
    assert np.all(np.abs(world.arms_rad) < 0.03)
