"""A table whose servos take an angle in the loop: the bits of the kernel, and its safety."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.runs.assemble import known
from rig.control.controllers import COMPENSATORS
from rig.course import Course
from rig.linkage import Linkage
from rig.loop.loop import Loop
from rig.loop.paced import Paced
from rig.parameters import Gains, Rig, Servo
from rig.safety.limits import limit_angle
from rig.simulation.operator import SimulatedOperator
from rig.simulation.simulate import draw, simulate
from rig.simulation.simulator import SimulatedTable
from rig.table import Reading

SERVO = Servo(
    kind="position", dead_time_s=0.0155, rate_limit_rad_s=5.0, dead_band_rad=0.0046,
    quantum_rad=0.0015, period_s=0.007, x={"lag_s": 0.066}, y={"lag_s": 0.046},
)  # fmt: skip
EFFECTS = {
    "joint_backlash": {"x": {"play_rad": 0.02}, "y": {"play_rad": 0.015}},
    "servo_dead_time": {"x": {"delay_s": 0.013}},
    "level_offset": {"y": {"slope_rad": 0.003}},
}
TWO = Rig(servo=SERVO, effects=EFFECTS)
ARMS = Rig(
    servo=replace(SERVO, x={}, y={}, angle_limit_rad=0.2, stop_rad=1.2),
    linkage=Linkage(kind="three-arms", arm_radius_m=0.05, rod_length_m=0.1, plate_side_m=0.25),
    gains=Gains(proportional_rad_m=0.6, derivative_rad_s_m=0.45, integral_rad_m_s=0.1),
    effects={"servo_lag": {"x": {"lag_s": 0.01}, "y": {"lag_s": 0.02}}},
)
RIGS = {"two rods": TWO, "read back": replace(TWO, servo=replace(SERVO, angle_measured=True)),
        "three arms": ARMS}  # fmt: skip


def course(seconds=4.0):
    n = round(seconds * 500)
    pushes = np.zeros((n, 2))
    pushes[n // 2 : n // 2 + 40] = (1.0, 0.6)
    return Course(np.zeros((n, 2)), pushes, (-0.05, 0.04), 0.3)


@pytest.mark.parametrize("arm", ["without", "with"])
@pytest.mark.parametrize("which", RIGS)
def test_the_loop_and_the_kernel_give_the_same_bits(which, arm):
    rig, way, rows = RIGS[which], course(), []
    table = SimulatedTable(rig, np.random.default_rng(3), start_m=way.start_m, held=True)
    with table:
        operator = SimulatedOperator(table, way.hold_s)
        number = COMPENSATORS[arm]
        loop = Loop(table, known(rig), number, way, operator=operator,
                    keep=lambda row: rows.append(row.copy()))  # fmt: skip
        ending = loop.run()
    batch = simulate(rig, known(rig), number, way, draw(np.random.default_rng(3), rig, way))
    assert ending.outcome == batch.outcome == "completed"
    assert np.array_equal(np.array(rows), batch.log.rows, equal_nan=True)
    log = batch.log
    assert log.has("command_x_rad", "command_y_rad", "desired_theta_x_rad")
    assert not log.has("voltage_x_V")
    assert not log.has("wanted_voltage_x_V")
    assert log.has("theta_x_rad") == (which == "read back")
    assert np.abs(log["command_x_rad"]).max() <= rig.servo.angle_limit_rad
    assert np.abs(log["ball_x_m"][~np.isnan(log["ball_x_m"])][-20:]).max() < 0.03  # it balances


def test_the_controllers_model_of_the_servos_follows_the_unmeasured_angles():
    """Told the truth about the servos, it stands for an encoder to a few milliradians."""
    truth = []
    rig, way = replace(TWO, effects={}), course()
    table = SimulatedTable(rig, np.random.default_rng(3), start_m=way.start_m, held=True)
    models = []

    def keep(row):
        truth.append(table.truth()["arm_rad"])
        models.append(loop.state["servo"]["angles"].copy())

    with table:
        operator = SimulatedOperator(table, way.hold_s)
        loop = Loop(table, known(rig), 0, way, operator=operator, keep=keep)
        loop.run()
    assert np.ptp(truth, axis=0).min() > 0.1
    assert np.abs(np.array(models) - truth).max() < 0.01
    assert np.sqrt(np.mean((np.array(models) - truth) ** 2)) < 2e-3


@pytest.mark.parametrize("take_angles", [True, False])
def test_a_table_that_takes_the_other_thing_is_refused(take_angles):
    table = SimulatedTable(TWO if take_angles else Rig(), np.random.default_rng(0))
    with pytest.raises(ValueError, match=r"servo.kind = .* servos take (volts|angles)"):
        Loop(Paced(table), Rig() if take_angles else known(TWO), 0, course())


def test_published_compensators_command_volts():
    with pytest.raises(ValueError, match=r"arm 'hybrid' commands volts.*use without, with"):
        Loop(SimulatedTable(TWO, np.random.default_rng(0)), TWO, COMPENSATORS["hybrid"], course())


def test_a_commanded_angle_is_limited_and_what_is_unclear_holds_the_last():
    nan = float("nan")
    assert limit_angle(0.3, 0.1, 0.5) == 0.3
    assert limit_angle(-0.9, 0.1, 0.5) == -0.5
    assert limit_angle(float("inf"), 0.1, 0.5) == 0.1
    assert limit_angle(nan, 0.1, 0.5) == 0.1
    assert limit_angle(nan, nan, 0.5) == 0.0
    assert limit_angle(nan, 0.9, 0.5) == 0.5
    assert limit_angle(0.3, 0.1, 0.5, 0.2) == 0.1  # a stale estimate


class Broken(SimulatedTable):
    """Its ball's estimate turns into no number."""

    def read(self) -> Reading:
        reading = super().read()
        return reading if reading.t_s < 1.0 else replace(reading, t_s=float("nan"))


def test_a_fault_levels_the_servos_on_the_way_out():
    way = course()
    table = Broken(TWO, np.random.default_rng(3), start_m=way.start_m)
    with table:
        ending = Loop(table, known(TWO), 0, way).run()
    assert ending.outcome == "no number"
    assert table.volts_V == (0.0, 0.0)


def test_leaving_the_context_levels_the_plate():
    table = SimulatedTable(TWO, np.random.default_rng(0))
    with table:
        for _ in range(200):
            table.read()
            table.drive((0.2, -0.2))
        assert np.abs(table.truth()["arm_rad"]).min() > 0.1
    assert np.abs(table.truth()["arm_rad"]).max() < 0.006  # the dead band
    with pytest.raises(ValueError, match="angles must be finite"):
        table.drive((float("nan"), 0.0))
