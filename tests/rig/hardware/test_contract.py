"""One contract for every table, each by its name: simulated, protocol.c without a chip, the real
firmware, a real serial device, USB, the Quanser stand-in, a table on another machine; and those
whose servos take an angle, on pulses and on buses."""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from experiments.runs.assemble import load_rig
from rig.hardware.board.board import BoardTable
from rig.hardware.board.link import LinkLost
from rig.hardware.board.pulse_servo import PulseServo
from rig.hardware.board.serial_link import SerialLink
from rig.hardware.board.session import BoardSession
from rig.hardware.board.usb_link import UsbLink
from rig.hardware.quanser import quanser
from rig.hardware.wiring import Wiring
from rig.parameters import Rig, Servo
from rig.simulation.simulator import SimulatedTable
from tests.support import ROOT
from tests.support.boards.bus_world import BusWorld, bus_of
from tests.support.boards.bus_world import table_on as bus_table_on
from tests.support.boards.chip import MEGA, Chip, PulseChip
from tests.support.boards.host import HostBoard, HostPulseBoard
from tests.support.boards.pty import PtyBoard, SteppedLink
from tests.support.boards.usb_fake import FakeUsb
from tests.support.boards.world import (
    PulseWorld,
    World,
    WorldEye,
    WorldLink,
    pulse_table_on,
    table_on,
)
from tests.support.hardware import contract
from tests.support.hardware.quanser_card import Bench, install
from tests.support.hardware.remote_bench import Cable, realtime, served

pytestmark = pytest.mark.realtime

ODD = Wiring(
    order=(1, 0), sign_volts=(-1, 1), sign_angle=(1, -1), zero_counts=(7, -4), crossed=True
)
BUS_ODD = Wiring(order=(1, 0), sign_angle=(-1, 1), zero_counts=(2100, 1990))
ARMS_ODD = Wiring((2, 0, 1), (1, 1, 1), (-1, 1, -1), (2100, 1990, 2060))
# Plate and ball of two rods on three arms: a tilt of 0.1 rad leaves the ball on it for a second.
ARMS_MOST_RAD = 0.1
Pair = tuple[float, float]
ANGLE_RIG = Rig(servo=Servo(kind="position"))
ARMS_RIG = replace(
    load_rig(ROOT / "experiments/rigs/three-arms.toml"),
    servo=Servo(kind="position", angle_limit_rad=0.2, stop_rad=1.2),
    camera=Rig().camera,
    effects={},
)


@dataclass
class Case:
    """A table under test and what only its plant knows; `kill`: the ways in which its link dies;
    `later`: its plant goes on alone; jitter_s, slack_s: of a table in real time; most_rad: angle
    that its plate and its ball can stand."""

    table: Any
    plant: SimulatedTable
    volts_V: Callable[[], Pair]
    clock: Callable[[], float] = lambda: 0.0
    kill: dict[str, Callable[[], None]] = field(default_factory=dict)
    later: Callable[[float], None] = lambda seconds: None
    jitter_s: float = 0.0
    slack_s: float = 0.0
    most_rad: float = 0.5

    def arms_rad(self) -> Pair:
        x, y = self.plant.truth()["arm_rad"]
        return float(x), float(y)


Stack = tuple[ExitStack, pytest.MonkeyPatch]


def simulated(rig: Rig, stack: Stack) -> Case:
    table = SimulatedTable(rig, np.random.default_rng(1))
    return Case(table, table, lambda: table.volts_V)


def on_world(world: World, table: BoardSession, kill: dict[str, Callable[[], None]]) -> Case:
    """`hung`: the board's bytes do not arrive any more, nor do ours."""

    def hang() -> None:
        world.board.take, world.board.receive = lambda: b"", lambda data: None

    ways = {"hung": hang} | kill
    return Case(table, world.plant, lambda: world.volts, lambda: world.now_s, ways, world.run)


def lock_step(board, rig: Rig, wiring: Wiring | None = None) -> Case:
    world = World(board, rig, wiring=wiring)
    link = WorldLink(world)
    return on_world(world, table_on(world, link), {"unplugged": lambda: setattr(link, "cut", True)})


def serial(rig: Rig, stack: Stack) -> Case:
    world = World(HostBoard(), rig)
    peer = PtyBoard(world, thread=False)
    stack[0].callback(peer.close)
    eye, link = WorldEye(world), SteppedLink(peer, SerialLink(peer.port))
    eye.table = BoardTable(link, clock=link.clock, eye=eye)
    hung = {"hung": lambda: setattr(peer, "hung", True)}
    return on_world(world, eye.table, {"unplugged": peer.unplug} | hung)


def usb(rig: Rig, stack: Stack) -> Case:
    world = World(HostBoard(), rig)
    fake, eye = FakeUsb(world), WorldEye(world)
    clock = WorldLink(world).clock
    eye.table = BoardTable(UsbLink(backend=fake, clock=clock), clock=clock, eye=eye)
    ways = {
        "unplugged": lambda: setattr(fake, "plugged", False),
        "hung": lambda: setattr(fake, "hung", True),
    }
    return on_world(world, eye.table, ways)


def quanser_card(rig: Rig, stack: Stack) -> Case:
    """The card's own watchdog gives 0 V; it knows no level."""
    stack[1].setattr(quanser, "PATIENCE_S", 5.0)  # the stand-in takes no time, a machine may
    plant = SimulatedTable(rig, np.random.default_rng(1))
    one = install(stack[1], Bench(plant))
    table = quanser.QuanserTable(rig, Wiring(), eye=one, clock=one.clock)
    ways = {"unplugged": lambda: one.fails.update(task_read="Quanser card q2_usb 0 is lost")}
    return Case(
        table, plant, lambda: (float(one.outputs[0]), float(one.outputs[1])), one.clock, ways
    )


def remote(rig: Rig, stack: Stack) -> Case:
    import time

    stack[0].enter_context(realtime())
    one = stack[0].enter_context(served(rig))
    cable = stack[0].enter_context(Cable(one.server.port))
    ways = {"unplugged": cable.cut, "hung": one.stopped.set}

    def later(seconds: float) -> None:
        one.stopped.clear()
        time.sleep(seconds)

    table, clock = one.open(port=cable.port), time.monotonic
    return Case(table, one.table, lambda: one.table.volts_V, clock, ways, later, 2e-4, 0.03)


def pulses(board, rig: Rig, *third: PulseServo) -> Case:
    world = PulseWorld(board, rig, (PulseServo(), PulseServo(1440.0, -500.0), *third))
    link = WorldLink(world)
    table = pulse_table_on(world, rig, link)
    return on_world(world, table, {"unplugged": lambda: setattr(link, "cut", True)})


def pulses_of_arms(board) -> Case:
    return replace(pulses(board, ARMS_RIG, PulseServo(1530.0, -600.0)), most_rad=ARMS_MOST_RAD)


def bus_of_arms(kind: str) -> Case:
    return replace(bus(kind, ARMS_RIG, ARMS_ODD), most_rad=ARMS_MOST_RAD)


def bus(kind: str, rig: Rig, wiring: Wiring = BUS_ODD) -> Case:
    """Silent, these servos hold their goal (Feetech) or stop (Dynamixel); neither knows level."""
    kept = {name: found for name, found in rig.effects.items() if name == "joint_backlash"}
    world = BusWorld(bus_of(kind, wiring.zero_counts), replace(rig, effects=kept), wiring=wiring)
    peer = PtyBoard(world, thread=False)
    eye = WorldEye(world)
    link = SteppedLink(peer, SerialLink(peer.port, 1_000_000, "servo bus"))
    limit = rig.servo.angle_limit_rad
    eye.table = bus_table_on(world, link, kind, eye=eye, angle_limit_rad=limit)
    ways = {"unplugged": peer.unplug, "hung": lambda: setattr(peer, "hung", True)}

    def told() -> Pair:
        address, length = (42, 2) if kind == "feetech" else (116, 4)
        counts = [servo.get(address, length) for servo in world.board.servos.values()]
        return world.linkage.table_angles(world.wiring.angles(counts))

    return Case(eye.table, world.plant, told, lambda: world.now_s, ways, world.run)


ANGLE_TABLES: dict[str, Callable[[Rig, Stack], Case]] = {
    "simulated angles": simulated,
    "pulses.c": lambda rig, stack: pulses(HostPulseBoard(), rig),
    "pulse firmware": lambda rig, stack: pulses(PulseChip(), rig),
    "feetech": lambda rig, stack: bus("feetech", rig),
    "dynamixel": lambda rig, stack: bus("dynamixel", rig),
    "three arms, pulses.c": lambda rig, stack: pulses_of_arms(HostPulseBoard(servos=3)),
    "three arms, pulse firmware": lambda rig, stack: pulses_of_arms(PulseChip(MEGA)),
    "three arms, feetech": lambda rig, stack: bus_of_arms("feetech"),
    "three arms, dynamixel": lambda rig, stack: bus_of_arms("dynamixel"),
}
TABLES: dict[str, Callable[[Rig, Stack], Case]] = {
    "simulated": simulated,
    "protocol.c": lambda rig, stack: lock_step(HostBoard(), rig),
    "protocol.c wired odd": lambda rig, stack: lock_step(HostBoard(), rig, ODD),
    "firmware": lambda rig, stack: lock_step(Chip(), rig),
    "serial": serial,
    "usb": usb,
    "quanser stand-in": quanser_card,
    "remote": remote,
}
# What watches them alone knows no level.
NO_LEVEL = (
    "quanser stand-in", "feetech", "dynamixel", "three arms, feetech", "three arms, dynamixel",
)  # fmt: skip
VOLTS = pytest.mark.parametrize("name", TABLES)
ANGLES = pytest.mark.parametrize("name", ANGLE_TABLES)
EVERY = pytest.mark.parametrize("name", [*TABLES, *ANGLE_TABLES])


@pytest.fixture
def make(monkeypatch: pytest.MonkeyPatch):
    """Opens a table by name, armed where that can be done without entering its context."""
    with ExitStack() as stack:

        def one(name: str, rig: Rig | None = None, *, armed: bool = True) -> Case:
            usual = ANGLE_RIG if name in ANGLE_TABLES else Rig()
            case = (TABLES | ANGLE_TABLES)[name](rig or usual, (stack, monkeypatch))
            if name not in ("quanser stand-in", "simulated", "simulated angles"):
                stack.callback(case.table.close)
            if armed and hasattr(case.table, "arm"):
                case.table.arm()
            return case

        yield one


@EVERY
def test_time_strictly_increases(make, name: str):
    case = make(name)
    in_real_time = case.clock if case.jitter_s else None
    contract.time_strictly_increases(case.table, clock=in_real_time, jitter_s=case.jitter_s)


@EVERY
def test_observations_follow_their_light(make, name: str):
    contract.observations_follow_their_light(make(name).table)


@VOLTS
@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sign", [-1, 1])
def test_positive_volts_raise_the_angle(make, name: str, axis: int, sign: int):
    contract.positive_volts_raise_the_angle(make(name).table, axis, sign)


@ANGLES
@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sign", [-1, 1])
def test_a_positive_angle_turns_its_arm(make, name: str, axis: int, sign: int):
    case = make(name)
    contract.a_positive_angle_turns_its_arm(case.table, axis, sign, case.arms_rad, case.most_rad)


@ANGLES
@pytest.mark.parametrize("fails", [False, True])
def test_leaving_levels_servos_that_take_an_angle(make, name: str, fails: bool):
    case = make(name, armed=False)
    contract.leaving_levels_servos_that_take_an_angle(
        case.table, case.volts_V, case.arms_rad, case.most_rad, fails=fails
    )


@VOLTS
@pytest.mark.parametrize("fails", [False, True])
def test_leaving_gives_level_and_no_volts(make, name: str, fails: bool):
    case = make(name, load_rig(None), armed=False)

    def volts_V() -> Pair:
        case.later(0.05)  # a goodbye takes its way
        return case.volts_V()

    contract.leaving_gives_level_and_no_volts(case.table, volts_V, case.arms_rad, fails=fails)


# A call into the card that hangs is given up by the wall clock: test_quanser.py.
DEATHS = [
    (name, how)
    for name in (*TABLES, *ANGLE_TABLES)
    for how in ("unplugged", "hung")
    if not name.startswith("simulated") and (name, how) != ("quanser stand-in", "hung")
]


@pytest.mark.parametrize(("name", "how"), DEATHS)
def test_a_dead_link_raises_by_name_and_the_table_levels(make, name: str, how: str):
    case = make(name)
    contract.a_dead_link_raises_by_name(
        case.table, case.kill[how], case.clock, LinkLost,
        "board on|board in|remote|Quanser|servo bus on", slack_s=case.slack_s,
    )  # fmt: skip
    case.table.close()
    if name in NO_LEVEL:
        return
    case.later(0.7)
    assert case.volts_V() == pytest.approx((0.0, 0.0), abs=0.001 * (name in ANGLE_TABLES))
    assert np.all(np.abs(case.arms_rad()) < 0.03)
