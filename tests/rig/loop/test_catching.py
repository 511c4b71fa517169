"""An axis whose encoder is lost gets 0 V at once; the other arm, in flight, is braked, and then at
0 V."""

from dataclasses import replace
from math import degrees, nan

import numpy as np
import pytest

from rig.course import Course
from rig.hardware.board.link import LinkLost
from rig.loop.loop import Ending, Loop
from rig.parameters import Gains, Rig, Servo
from rig.safety.levelling import LevelOnExit
from rig.simulation.simulator import SimulatedTable

FAULTS = {"encoder jump": 1.0, "no number": nan}


class Spoilt(LevelOnExit):
    """A simulated table whose encoder of `axis` shows `more` [rad] from spoilt_s on; it is lost at
    lost_s. driven: (t_s, x, y); widest_rad: by axis."""

    def __init__(self, rig: Rig, axis: int, spoilt_s: float, more: float, lost_s: float) -> None:
        self._inner = SimulatedTable(rig, np.random.default_rng(1), held=True)
        self.period_s, self.voltage_limit_V = self._inner.period_s, self._inner.voltage_limit_V
        self._axis, self._spoilt_s, self._more, self._lost_s = axis, spoilt_s, more, lost_s
        self.t_s, self.driven, self.widest_rad = 0.0, [], np.zeros(2)

    def read(self):
        reading = self._inner.read()
        self.t_s = reading.t_s
        self.widest_rad = np.maximum(self.widest_rad, np.abs(self._inner.truth()["arm_rad"]))
        if self.t_s > self._lost_s:
            raise self._end(LinkLost("pulled"))
        theta = list(reading.theta_rad)
        theta[self._axis] += self._more if self.t_s >= self._spoilt_s else 0.0
        return replace(reading, theta_rad=(theta[0], theta[1]))

    def drive(self, volts: tuple[float, float]) -> None:
        self.driven.append((self.t_s, *volts))
        self._inner.drive(volts)

    def close(self) -> None:
        self._inner.close()

    def coast(self) -> None:
        """What comes after the run."""
        self._lost_s, self._spoilt_s = 1e9, 1e9
        for _ in range(500):
            self.read()


def thrown(
    tau_s: float, axis: int, spoilt_s: float, more: float, lost_s: float = 1e9
) -> tuple[Spoilt, Ending, list[float]]:
    """A run in which full volts throw both arms from limit to limit from 0.4 s on, with a fault."""
    servo = Servo(gain_rad_s_V=1.735, time_constant_s=tau_s)
    rig = Rig(servo=servo, gains=Gains(servo_proportional_V_rad=1e3))
    wild = np.where(np.arange(600)[:, None] < 200, -30.0, 30.0) * np.ones((600, 2))
    table, times = Spoilt(rig, axis, spoilt_s, more, lost_s), []
    way = Course(wild, np.zeros((600, 2)), (0.0, 0.0), 0.0, True)
    with table:
        ending = Loop(table, rig, 0, way, keep=lambda row: times.append(float(row[0]))).run()
    return table, ending, times


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("tau_s", [0.025, 0.046, 0.1])
@pytest.mark.parametrize("axis", [0, 1])
def test_the_healthy_arm_is_braked_before_its_limit(fault: str, tau_s: float, axis: int):
    """Both at 0 V, it coasted up to its stop, 5 degrees beyond."""
    for k in range(5):
        table, ending, times = thrown(tau_s, axis, 0.46 + 0.04 * k, FAULTS[fault])
        assert (ending.outcome, ending.level) == (fault, False)
        table.coast()
        assert degrees(table.widest_rad[1 - axis] - np.pi / 6) < 0.5
        after = np.array([v for t, *v in table.driven if t >= 0.46 + 0.04 * k])
        assert not np.any(after[:, axis])
        assert table.driven[-1][1:] == (0.0, 0.0)
        assert np.all(np.diff(times) > 0)
        assert times[-1] < 0.46 + 0.04 * k + 5 * tau_s + 0.01


def test_a_link_that_is_lost_meanwhile_and_a_second_fault_end_it_by_the_first_name():
    for lost_s in (0.54, 1e9):
        table, ending, _ = thrown(0.1, 0, 0.52, 1.0, lost_s)
        assert ending.outcome == "encoder jump"
        assert table.driven[-1][1:] == (0.0, 0.0)
    table, _, times = thrown(0.1, 0, 0.52, 1.0)
    braked = [t for t, _, y in table.driven if t >= 0.52 and y]
    assert braked
    assert max(times) > 0.53
