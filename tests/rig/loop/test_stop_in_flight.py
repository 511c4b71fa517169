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


class Failing(Watched):
    """Its camera fails at `fail_s`, once, as an `ObservationFeed` tells it."""

    fail_s = np.inf

    def read(self):
        found = super().read()
        if found.t_s >= self.fail_s:
            self.fail_s = np.inf
            raise OSError(REASON)
        return found


class Boom:
    """A user's controller that throws the arms and raises at `fail_s`."""

    def __init__(self, fail_s: float) -> None:
        self.fail_s = fail_s

    def control(self, now: object) -> tuple[float, float]:
        t_s = now.t_s  # pyright: ignore[reportAttributeAccessIssue]
        if t_s >= self.fail_s:
            raise RuntimeError(REASON)
        return (-1e3, -1e3) if t_s < 0.4 else (1e3, 1e3)


def beyond_deg(tau_s: float, stop_s: float, friction: bool, how: str = "stop") -> float:
    """How far [degrees] beyond its limit an arm goes that full volts throw from one limit to the
    other from 0.4 s on, in a run that ends at `stop_s` by a stop or by something that raises."""
    rig = Rig(servo=Servo(time_constant_s=tau_s), gains=Gains(servo_proportional_V_rad=1e3))
    if not friction:
        rig = replace(rig, drive=Drive(arm_friction_nm=0.0, joint_friction_nm=0.0))
    wild = np.where(np.arange(600)[:, None] < 200, -30.0, 30.0) * np.ones((600, 2))
    slot, table = CommandSlot(), Failing(rig)
    table.fail_s = stop_s if how == "camera" else np.inf

    def keep(row: np.ndarray) -> None:
        if row[0] >= stop_s and how == "stop":
            slot.put(Stop(REASON))
        if row[0] >= stop_s and how == "keep":
            raise FloatingPointError(REASON)

    own = {"controller": Boom(stop_s)} if how == "controller" else {}
    way = Course(np.zeros((600, 2)) if own else wild, np.zeros((600, 2)), (0.0, 0.0), 0.0, not own)
    loop = Loop(table, rig, 0, way, commands=slot, keep=keep, **own)  # pyright: ignore
    with table:
        if how in ("camera", "keep"):
            with pytest.raises((OSError, FloatingPointError), match=REASON):
                loop.run()
        else:
            assert REASON in loop.run().reason
    return degrees(table.widest_rad - rig.servo.angle_limit_rad)


@pytest.mark.parametrize("tau_s", [0.025, 0.06, 0.1])
@pytest.mark.parametrize("friction", [True, False])
def test_a_stop_at_the_worst_moment_holds_the_limit(tau_s: float, friction: bool):
    worst = max(beyond_deg(tau_s, 0.46 + 0.02 * k, friction) for k in range(8))
    assert worst < 0.5


@pytest.mark.parametrize("tau_s", [0.05, 0.2, 0.5])
@pytest.mark.parametrize("how", ["camera", "keep", "controller"])
def test_whatever_is_raised_while_an_arm_flies_it_is_braked(tau_s: float, how: str):
    """At 0 V, and levelled, it flew into its stop, 5 degrees beyond."""
    for friction in (True, False):
        worst = max(beyond_deg(tau_s, 0.42 + 0.05 * k, friction, how) for k in range(8))
        assert worst < 0.5


class Late(Watched):
    """Every `every`th tick comes `missed` ticks late from `late_s` on; the volts stay meanwhile."""

    missed, every, late_s = 0, 1, np.inf

    def __init__(self, rig: Rig) -> None:
        super().__init__(rig)
        self._volts, self._n = (0.0, 0.0), 0

    def read(self):
        found = super().read()
        if found.t_s >= self.late_s:
            self._n += 1
            for _ in range(self.missed if self._n % self.every == 0 else 0):
                self._inner.drive(self._volts)
                found = super().read()
        return found

    def drive(self, volts: tuple[float, float]) -> None:
        self._volts = volts
        super().drive(volts)


@pytest.mark.parametrize("tau_s", [0.025, 0.046, 0.1])
@pytest.mark.parametrize(
    ("missed", "every"), [(4, 1), (6, 1), (8, 1), (6, 2), (8, 2), (6, 4), (8, 4)]
)
def test_a_loop_whose_ticks_come_late_again_and_again_holds_the_limit(
    tau_s: float, missed: int, every: int
):
    """Ticks of 10 to 18 ms at full volts: an arm flew into its stop, 5 degrees beyond."""
    rig = Rig(servo=Servo(time_constant_s=tau_s), gains=Gains(servo_proportional_V_rad=1e3))
    wild = np.where(np.arange(600)[:, None] < 200, -30.0, 30.0) * np.ones((600, 2))
    way = Course(wild, np.zeros((600, 2)), (0.0, 0.0), 0.0, True)
    for k in range(6):
        table = Late(rig)
        table.missed, table.every, table.late_s = missed, every, 0.4 + 0.03 * k
        with table:
            Loop(table, rig, 0, way).run()
        assert degrees(table.widest_rad - rig.servo.angle_limit_rad) < 0.6
