"""Files whose controller nobody wrote down are simulated again from each change of the target."""

from dataclasses import replace

import numpy as np
import pytest

from calibration.motion.recorded_law import command, started
from experiments.gap.closed_loop_proof import closed_loop_rows
from experiments.gap.input import GapInput
from experiments.gap.target_steps import (
    TargetStep,
    replay,
    simulated_numbers,
    step_numbers,
    target_steps,
)
from rig.linkage import Linkage
from rig.log import Log
from rig.parameters import CameraTiming, Rig, Servo
from rig.simulation.simulator import SimulatedTable

TICK_S = 0.02
LAW = np.array([4.0, 0.5, 2.6, 0.06, 1.0, np.inf, np.inf])
PLACES = np.array([[0.0, 0.0], [0.05, 0.03], [-0.02, -0.03], [0.03, -0.01]])
SECONDS = 6.0  # at each place
NOMINAL = Rig(
    servo=Servo(kind="position", lag_s=0.03, angle_measured=False),
    linkage=Linkage(arm_radius_m=0.025, plate_side_m=0.3),
    camera=CameraTiming(rate_hz=50.0, delay_s=0.0),
    control_rate_hz=50.0,
)
LATE = replace(NOMINAL, effects={"servo_dead_time": {a: {"delay_s": 0.1} for a in "xy"}})


@pytest.fixture(scope="module")
def recording() -> Log:
    """Steps of the target on the late table, as its owner's program would have written them."""
    table = SimulatedTable(LATE, np.random.default_rng(5))
    states = [started(0.0, 0.0) for _ in "xy"]
    each = round(SECONDS / TICK_S)
    targets = np.repeat(PLACES, each, axis=0)
    ball, rows = np.zeros(2), []
    for k, target in enumerate(targets):
        seen = table.read().ball
        ball = ball if seen is None else np.array(seen.xy_m)
        told = [float(command(LAW, states[a], target[a], ball[a], TICK_S)) for a in range(2)]
        table.drive((told[0], told[1]))
        rows.append([k * TICK_S, *told, *ball])
    names = ("t_s", "command_x_rad", "command_y_rad", "ball_x_m", "ball_y_m")
    return Log.from_columns(dict(zip(names, np.array(rows).T, strict=True)))


def as_input(log: Log) -> GapInput:
    nobody = (None,)
    return GapInput((log,), NOMINAL, (NOMINAL,), ("run.csv",), ("file",), nobody, nobody, nobody)


def test_the_late_model_settles_as_the_recording_and_the_nominal_one_does_not(recording: Log):
    rows = {r.quantity: r for r in closed_loop_rows(as_input(recording), NOMINAL, LATE)}
    assert set(rows) == {"settling time", "spread"}
    for row in rows.values():
        assert row.after == pytest.approx(row.measured, rel=0.1)
    assert rows["settling time"].before < 0.7 * rows["settling time"].measured


@pytest.fixture(scope="module")
def steps(recording: Log) -> list[TargetStep]:
    return target_steps(recording)


def test_each_change_is_begun_as_the_recording_stood(steps: list[TargetStep]):
    assert len(steps) == len(PLACES) - 1
    for step in steps:
        ball = replay(step, LATE, 0)
        assert ball.shape == step.ball_m.shape
        assert np.sqrt(np.mean((ball - step.ball_m) ** 2)) < 0.001


def test_a_push_of_the_recording_does_not_meet_the_steps(steps: list[TargetStep]):
    unknown = replace(LATE.unknown, ball_segment=(3.0, 3.0), ball_segment_s=(0.0, 3.0))
    step = steps[0]
    pushed = replay(step, replace(LATE, unknown=unknown), 0)
    np.testing.assert_array_equal(pushed, replay(step, LATE, 0))


def test_a_ball_that_falls_has_no_numbers(steps: list[TargetStep]):
    thrown = replace(NOMINAL, effects={"servo_dead_time": {a: {"delay_s": 0.2} for a in "xy"}})
    thrown = replace(thrown, linkage=replace(NOMINAL.linkage, plate_side_m=0.1))
    assert np.isnan(replay(steps[0], thrown, 0)[-1]).all()
    assert np.isnan(list(simulated_numbers(steps[:1], thrown, seeds=1).values())).all()
    assert np.isfinite(list(step_numbers(steps).values())).all()


def test_a_recording_whose_commands_tell_no_controller_has_no_rows(recording: Log):
    columns = {k: v.copy() for k, v in recording.columns.items()}
    rng = np.random.default_rng(1)
    for axis in "xy":
        columns[f"command_{axis}_rad"] = np.repeat(rng.standard_normal(120) * 0.1, 10)
    assert closed_loop_rows(as_input(Log.from_columns(columns)), NOMINAL, LATE) == ()
