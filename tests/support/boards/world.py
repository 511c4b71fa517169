"""A board, its plant and its cable in lock step: deterministic, as fast as the machine goes.

`World` moves board and plant a millisecond at a time; `WorldLink` is the cable's end at the host,
whose waiting makes time pass. A board is anything with receive, run_ms, take, volts, reset.
"""

import random
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from rig.hardware.board.board import BoardTable
from rig.hardware.board.link import LinkLost
from rig.hardware.board.open_pulses import open_pulse_board
from rig.hardware.board.pulse_servo import PulseServo
from rig.hardware.board.pulse_table import PulseTable
from rig.hardware.wiring import Wiring
from rig.parameters import Rig
from rig.simulation.simulator import SimulatedTable
from vision.frames import Observation

STEP_S = 1e-3


class World:
    """The plant of `rig` under a board's volts, its arms on the board's encoders.

    `wiring`: how the cables really are. `pace`: the board's crystal against true time. `watch` is
    called after every millisecond.
    """

    def __init__(
        self,
        board,
        rig: Rig,
        *,
        seed: int = 1,
        start_m: tuple[float, float] = (0.0, 0.0),
        held: bool = False,
        wiring: Wiring | None = None,
        pace: float = 1.0,
        tachometer: bool = False,
    ) -> None:
        fine = replace(rig, control_rate_hz=1 / STEP_S)
        self.board, self.wiring, self.pace = board, wiring or Wiring(), pace
        self.plant = SimulatedTable(fine, np.random.default_rng(seed), start_m=start_m, held=held)
        self.watch: Callable[[], None] = lambda: None
        self.random = random.Random(seed)  # session numbers: the chip's cycles depend on bytes
        self.volts = (0.0, 0.0)  # at the axes' motors
        self.balls: list[Observation] = []
        self.powered = True  # the emergency stop cuts it
        self._tachometer, self._speeds = tachometer, (0.0, 0.0)
        self._ms = 0
        self.plant.read()

    @property
    def now_s(self) -> float:
        return self._ms * STEP_S

    @property
    def arms_rad(self) -> tuple[float, float]:
        x, y = self.plant.truth()["arm_rad"]
        return float(x), float(y)

    def step(self) -> None:
        """One millisecond of board and plant."""
        self._drive()
        self.plant.drive(self.volts)
        reading = self.plant.read()
        self._ms += 1
        self._speeds = reading.motor_speed_rad_s or (0.0, 0.0)
        if reading.ball is not None:
            self.balls.append(reading.ball)
        self.watch()

    def _drive(self) -> None:
        """Encoders to the board, its volts to the motors."""
        tachometer_V = self.wiring.to_board(self._speeds) if self._tachometer else (0.0, 0.0)
        self.board.run_ms(self.wiring.counts(self.arms_rad), tachometer_V, pace=self.pace)
        volts = self.wiring.from_board(self.board.volts())
        self.volts = volts if self.powered else (0.0, 0.0)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP_S)):
            self.step()


class PulseWorld(World):
    """The plant of `rig` under a pulse board: its servos (x and y, or the arms) hold what the last
    pulse told; order: by channel of the board, the servo on it."""

    def __init__(
        self,
        board,
        rig: Rig,
        servos: tuple[PulseServo, ...],
        *,
        order: tuple[int, ...] | None = None,
        **named,
    ) -> None:
        super().__init__(board, rig, **named)
        self.servos, self.order = servos, order or tuple(range(len(servos)))
        self.turned = (0.0,) * len(servos)
        self._linkage = rig.linkage

    def _drive(self) -> None:
        """Pulses to the servos; without one, a servo stays where it is. The plant is told the tilt
        at which they hold its plate."""
        self.board.run_ms(pace=self.pace)
        pulses, turned = self.board.pulses_us(), list(self.turned)
        for channel, servo in enumerate(self.order):
            if pulses[channel]:
                turned[servo] = self.servos[servo].angle_rad(pulses[channel])
        self.turned = tuple(turned)
        self.volts = self._linkage.table_angles(turned)  # of such servos: angles


class WorldLink:
    """The host's end of the cable: `wait` lets the world go on. `cut` unplugs it."""

    name = "board in lock step"

    def __init__(self, world: World) -> None:
        self.world, self.cut, self.closed = world, False, False
        self._arrived = bytearray()

    def clock(self) -> float:
        return self.world.now_s

    def send(self, data: bytes) -> None:
        if self.cut:
            raise LinkLost(5, f"{self.name} is lost: unplugged")
        self.world.board.receive(data)

    def receive(self) -> bytes:
        if self.cut:
            raise LinkLost(5, f"{self.name} is lost: unplugged")
        self._arrived += self.world.board.take()
        data = bytes(self._arrived)
        self._arrived.clear()
        return data

    def wait(self, timeout_s: float) -> bool:
        until = self.world.now_s + timeout_s
        while not self._arrived:
            self.world.step()
            self._arrived += self.world.board.take()
            if self.world.now_s >= until - 1e-9:
                break
        return bool(self._arrived)

    def close(self) -> None:
        self.closed = True


class WorldEye:
    """The plant's statistical camera: its stamps on the clock of the table's readings."""

    def __init__(self, world: Any) -> None:
        self._world = world
        self.table: Any = None

    def latest(self, after_s: float) -> Observation | None:
        if not self._world.balls or self.table is None:
            return None
        ball = self._world.balls[-1]
        ball = replace(ball, exposed_s=ball.exposed_s - self.table.zero_s)
        return ball if ball.exposed_s > max(after_s, 0.0) else None


def table_on(world: World, link: WorldLink | None = None, **settings) -> BoardTable:
    """A board table over a lock-step link, its eye the plant's camera."""
    eye, link = WorldEye(world), link or WorldLink(world)
    settings = {
        "wiring": world.wiring,
        "clock": link.clock,
        "random_below": world.random.randrange,
    } | settings
    table = BoardTable(link, eye=eye, **settings)
    eye.table = table
    return table


def pulse_table_on(world: PulseWorld, rig: Rig, link: WorldLink | None = None) -> PulseTable:
    """A pulse table over a lock-step link, its eye the plant's camera."""
    eye, link = WorldEye(world), link or WorldLink(world)
    table = open_pulse_board(
        link, rig, world.servos, eye, clock=link.clock, random_below=world.random.randrange
    )
    eye.table = table
    return table
