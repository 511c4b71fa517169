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

    wiring: how the servos really stand to those of the linkage, and where they hold the plate
    level.
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
        reach = {key: getattr(rig.servo, key) for key in ("angle_limit_rad", "stop_rad")}
        fine = replace(rig, servo=replace(AT_ONCE, **reach), control_rate_hz=1 / STEP_S)
        self.board, self.wiring, self.linkage = board, wiring, rig.linkage
        self.plant = SimulatedTable(fine, np.random.default_rng(1), start_m=start_m, held=held)
        self.balls: list[Observation] = []
        self.watch = lambda: None
        self._ms = 0
        self.plant.read()

    @property
    def now_s(self) -> float:
        return self._ms * STEP_S

    @property
    def turned_rad(self) -> tuple[float, ...]:
        """Where the servos are, by servo of the linkage."""
        return self.wiring.angles([servo.counts for servo in self.board.servos.values()])

    @property
    def shafts_rad(self) -> tuple[float, float]:
        """Where the servos hold the table (x, y)."""
        return self.linkage.table_angles(self.turned_rad)

    @property
    def volts(self) -> tuple[float, float]:
        return 0.0, 0.0

    def step(self) -> None:
        self.board.step()
        held = self.shafts_rad
        if np.isfinite(held).all():  # else three arms hold the plate nowhere: it stays
            self.plant.drive(held)
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


def bus_of(kind: str, counts: tuple[float, ...] = (2048.0, 2048.0)) -> Bus:
    """Servos 1, 2 (and 3) of a maker, their shafts at first at these counts."""
    return VENDORS[kind][1](dict(enumerate(counts, start=1)))


def table_on(
    world: BusWorld, link, kind: str, *, wiring: Wiring | None = None, **settings: Any
) -> BusTable:
    """The driver over a link whose time is the world's."""
    servos = {"ids": tuple(world.board.servos), "clock": lambda: world.now_s}
    settings = servos | {"sleep_until": world.until} | settings
    return BusTable(link, VENDORS[kind][0](), wiring or world.wiring, world.linkage, **settings)
