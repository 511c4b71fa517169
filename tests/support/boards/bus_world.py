"""A plant whose arms are the shafts of bus servos, and the driver's table on it."""

from dataclasses import replace
from typing import Any

import numpy as np

from rig.hardware.bus.bus import BusTable
from rig.hardware.bus.dynamixel import Dynamixel
from rig.hardware.bus.feetech import Feetech
from rig.hardware.wiring import Wiring
from rig.parameters import POSITION, Rig, Servo
from rig.simulation.simulator import SimulatedTable
from tests.support.boards.bus_servos import Bus, DynamixelBus, FeetechBus
from tests.support.boards.world import STEP_S
from vision.frames import Observation

LEVEL = Wiring(zero_counts=(2048, 2048))
VENDORS = {"feetech": (Feetech, FeetechBus), "dynamixel": (Dynamixel, DynamixelBus)}
SERVO = Servo(kind=POSITION, rate_limit_rad_s=4.7, angle_measured=True)
# The servos turn by themselves here; the plant's own do at once what they are told.
AT_ONCE = replace(SERVO, lag_s=0.0, rate_limit_rad_s=1e4, acceleration_limit_rad_s2=1e8)


class BusWorld:
    """Servos and plant, a millisecond at a time; `board` takes and gives the bus's bytes.

    wiring: how the servos really stand to the axes, and where they hold the plate level; counts:
    where their shafts are at first (channel 0, 1).
    """

    def __init__(
        self,
        board: Bus,
        rig: Rig,
        *,
        wiring: Wiring = LEVEL,
        start_m: tuple[float, float] = (0.0, 0.0),
        held: bool = False,
    ) -> None:
        fine = replace(rig, servo=AT_ONCE, control_rate_hz=1 / STEP_S)
        self.board, self.wiring = board, wiring
        self.plant = SimulatedTable(fine, np.random.default_rng(1), start_m=start_m, held=held)
        self.balls: list[Observation] = []
        self.watch = lambda: None
        self._ms = 0
        self.plant.read()

    @property
    def now_s(self) -> float:
        return self._ms * STEP_S

    @property
    def shafts_rad(self) -> tuple[float, float]:
        """Where the servos hold the arms (x, y)."""
        a, b = (servo.counts for servo in self.board.servos.values())
        return self.wiring.angles((a, b))  # pyright: ignore[reportArgumentType]

    @property
    def volts(self) -> tuple[float, float]:
        return 0.0, 0.0

    def step(self) -> None:
        self.board.step()
        self.plant.drive(self.shafts_rad)
        reading = self.plant.read()
        self._ms += 1
        if reading.ball is not None:
            self.balls.append(reading.ball)
        self.watch()

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP_S)):
            self.step()

    def until(self, due_s: float) -> None:
        """Stands for sleeping until then."""
        while self.now_s < due_s - 1e-9:
            self.step()


def bus_of(kind: str, counts: tuple[float, float] = (2048.0, 2048.0)) -> Bus:
    """Servos 1 and 2 of a maker."""
    return VENDORS[kind][1]({1: counts[0], 2: counts[1]})


def table_on(
    world: BusWorld, link, kind: str, *, wiring: Wiring | None = None, **settings: Any
) -> BusTable:
    """The driver over a link whose time is the world's."""
    return BusTable(
        link, VENDORS[kind][0](), wiring or world.wiring,
        clock=lambda: world.now_s, sleep_until=world.until, **settings,
    )  # fmt: skip
