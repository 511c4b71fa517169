"""A stop while an arm flies: levelling pulls with 3 V at most, and yet the angle limit holds."""

from dataclasses import replace
from math import degrees

import numpy as np
import pytest

from rig.course import Course
from rig.loop.commands import CommandSlot, Stop
from rig.loop.loop import Loop
from rig.parameters import Drive, Gains, Rig, Servo
from rig.safety.levelling import LevelOnExit
from rig.simulation.simulator import SimulatedTable

REASON = "the operator's button"


class Watched(LevelOnExit):
    """A simulated table; widest_rad: how far an arm went either way."""

    def __init__(self, rig: Rig) -> None:
        self._inner = SimulatedTable(rig, np.random.default_rng(1), held=True)
        self.period_s, self.voltage_limit_V = self._inner.period_s, self._inner.voltage_limit_V
        self.widest_rad = 0.0

    def read(self):
        found = self._inner.read()
        self.widest_rad = max(self.widest_rad, *np.abs(self._inner.truth()["arm_rad"]))
        return found

    def drive(self, volts: tuple[float, float]) -> None:
        self._inner.drive(volts)

    def close(self) -> None:
        self._inner.close()


def beyond_deg(tau_s: float, stop_s: float, friction: bool) -> float:
    """How far [degrees] beyond its limit an arm goes that full volts throw from one limit to the
    other from 0.4 s on, stopped at `stop_s`."""
    rig = Rig(servo=Servo(time_constant_s=tau_s), gains=Gains(servo_proportional_V_rad=1e3))
    if not friction:
        rig = replace(rig, drive=Drive(arm_friction_nm=0.0, joint_friction_nm=0.0))
    wild = np.where(np.arange(600)[:, None] < 200, -30.0, 30.0) * np.ones((600, 2))
    slot, table = CommandSlot(), Watched(rig)

    def keep(row: np.ndarray) -> None:
        if row[0] >= stop_s:
            slot.put(Stop(REASON))

    way = Course(wild, np.zeros((600, 2)), (0.0, 0.0), 0.0, True)
    with table:
        ending = Loop(table, rig, 0, way, commands=slot, keep=keep).run()
    assert ending.reason == REASON
    return degrees(table.widest_rad - rig.servo.angle_limit_rad)


@pytest.mark.parametrize("tau_s", [0.025, 0.06, 0.1])
@pytest.mark.parametrize("friction", [True, False])
def test_a_stop_at_the_worst_moment_holds_the_limit(tau_s: float, friction: bool):
    worst = max(beyond_deg(tau_s, 0.46 + 0.02 * k, friction) for k in range(8))
    assert worst < 0.5
