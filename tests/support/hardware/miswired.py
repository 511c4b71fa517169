"""A simulated table behind cables in any order, seen by its markers, with faults to choose."""

from math import sin

import numpy as np

from rig.parameters import Rig
from rig.safety.levelling import LevelOnExit
from rig.simulation.simulator import SimulatedTable
from rig.table import Reading

STEP_RAD = 2 * np.pi / 4096
EVERY_S = 1 / 60


class Miswired(LevelOnExit):
    """Channels as the cables make them: the truth that homing has to find.

    swap, crossed, volt_signs, count_signs and zeros (counts at level) by channel, as in `Wiring`.
    """

    level_s = 0.0

    def __init__(
        self, rig: Rig, *, swap=False, crossed=False, volt_signs=(1, 1), count_signs=(1, 1),
        zeros=(0, 0), seed=1,
    ) -> None:  # fmt: skip
        self.plant = SimulatedTable(rig, np.random.default_rng(seed), start_m=(1.0, 1.0))
        self.period_s, self.voltage_limit_V = self.plant.period_s, self.plant.voltage_limit_V
        self.rig, self.swap, self.crossed = rig, swap, crossed
        self.volt_signs, self.count_signs, self.zeros = volt_signs, count_signs, zeros
        self.dead_motor: int | None = None  # an axis
        self.dead_encoder: int | None = None  # a channel
        self.blocked_rad: tuple[float, float] | None = None  # the x arm's way
        self.tachometer = True
        self.volts: list[tuple[float, float]] = []
        self._rng = np.random.default_rng(seed + 1)
        self._next_s = 0.0

    def read(self) -> Reading:
        reading = self.plant.read()
        angles = np.array(reading.theta_rad[::-1] if self.swap else reading.theta_rad)
        raw = np.array(self.count_signs) * angles + np.array(self.zeros) * STEP_RAD
        if self.dead_encoder is not None:
            raw[self.dead_encoder] = 0.3
        speeds = None
        if self.tachometer and reading.motor_speed_rad_s is not None:
            by_motor = reading.motor_speed_rad_s[:: -1 if self.swap != self.crossed else 1]
            first, second = np.array(self.volt_signs) * np.array(by_motor)
            speeds = (float(first), float(second))
        return Reading(reading.t_s, (float(raw[0]), float(raw[1])), speeds)

    def drive(self, volts: tuple[float, float]) -> None:
        self.volts.append(volts)
        turned = np.array(self.volt_signs) * np.array(volts)
        xy = turned[::-1].copy() if self.swap != self.crossed else turned
        if self.dead_motor is not None:
            xy[self.dead_motor] = 0.0
        if self.blocked_rad is not None:  # a hand in the way takes what the motor gives
            x = self.plant.truth()["arm_rad"][0]
            low, high = self.blocked_rad
            if (x > high and xy[0] > 0) or (x < low and xy[0] < 0):
                xy[0] = 0.0
        self.plant.drive((float(xy[0]), float(xy[1])))

    def close(self) -> None:
        self.plant.close()

    def tilt(self, t_s: float) -> tuple[float, float] | None:
        """The plate's sines as markers in a new picture show them (0.05 degrees of noise)."""
        if t_s < self._next_s:
            return None
        self._next_s += EVERY_S
        a, b = (self.rig.linkage.ratio * sin(p) for p in self.plant.truth()["plate_rad"])
        noise = 1e-3 * self._rng.standard_normal(2)
        return float(a + noise[0]), float(b + noise[1])
