"""Effects of a lab's own in the simulator: closed forms, nulls, lanes, other processes."""

import multiprocessing
from dataclasses import replace
from math import asin, cos, exp, sin, sqrt
from pathlib import Path

import numpy as np
import pytest

from rig.control.controllers import WITH, WITHOUT
from rig.own_effects import read_effect
from rig.parameters import Rig, Servo
from rig.plant.own_equations import DivergedError
from rig.plant.plant import ARM, BALL
from rig.simulation.batch import simulate_many
from rig.simulation.simulate import Task, draw, simulate
from rig.simulation.simulator import SimulatedTable
from tests.support.gap.own_effects import example, written
from tests.support.simulated import (
    TICK_S,
    ball_state,
    constant_volts,
    moved,
    random_steps,
    realistic,
    run,
    smooth_rig,
    tilted,
)

ARM_OWN, CABLE_OWN = example("hanging_arm"), example("pulling_cable")


def hanging(weight_V: float, angle_rad: float = 0.0, **more) -> Rig:
    effects = {"hanging_arm": {"x": {"weight_V": weight_V, "angle_rad": angle_rad}}}
    return smooth_rig(effects=effects, own=(ARM_OWN,), **more)


def test_a_held_voltage_turns_a_hanging_arm_to_where_its_weight_balances_it():
    states = moved(hanging(2.0, 0.2), constant_volts(0.3, 0.3, 4.0), held=True)
    assert states[-1, ARM, 0] == pytest.approx(asin(0.3 / 2.0) - 0.2, abs=1e-4)
    assert states[-1, ARM, 1] > 0.6  # the other axis goes on to its stop


def test_a_hanging_arm_swings_with_the_frequency_of_its_equation():
    tau_s, first = 0.25, 0.02
    rig = hanging(2.0, servo=Servo(time_constant_s=tau_s))
    states = moved(rig, constant_volts(0, 0, 2.0), state=tilted(ball_state(), first, 0), held=True)
    t = TICK_S * np.arange(len(states))
    decay = 1 / (2 * tau_s)
    beat = sqrt(rig.servo.gain_rad_s_V * 2.0 / tau_s - decay**2)
    swing = [first * exp(-decay * s) * (cos(beat * s) + decay / beat * sin(beat * s)) for s in t]
    np.testing.assert_allclose(states[:, ARM, 0], swing, atol=0.005 * first)


def test_a_cable_holds_the_arm_where_it_balances_the_volts():
    cable = {"pulling_cable": {"x": {"stiffness_V_rad": 10.0, "slack_rad": 0.1}}}
    rig = smooth_rig(effects=cable, own=(ARM_OWN, CABLE_OWN))
    states = moved(rig, constant_volts(0.5, 0, 2.0), held=True)
    assert states[-1, ARM, 0] == pytest.approx(0.1 + 0.5 / 10.0, abs=1e-4)
    back = moved(rig, constant_volts(-0.2, 0, 1.0), held=True)
    free = moved(smooth_rig(), constant_volts(-0.2, 0, 1.0), held=True)
    np.testing.assert_array_equal(back, free)  # on the other side it hangs loose


def test_on_the_ball_it_is_the_bowl_of_the_catalogue(tmp_path: Path):
    own = read_effect(written(tmp_path, "dish", "-size_1_s2 * u", side="ball", key="size_1_s2"))
    dish = {"dish": {a: {"size_1_s2": 2.0} for a in "xy"}}
    bowl = {"plate_bowl": {"xy": {"stiffness_1_s2": 2.0}}}
    still = constant_volts(0, 0, 1.0)
    one, other = (
        moved(smooth_rig(effects=effects, own=(own,)), still, state=ball_state((0.05, -0.03)))
        for effects in (dish, bowl)
    )
    np.testing.assert_allclose(one[:, BALL], other[:, BALL], atol=1e-12)
    assert abs(one[-1, BALL, 0] - 0.05) > 0.02


def test_time_and_speed_reach_the_equation(tmp_path: Path):
    own = read_effect(written(tmp_path, "late_drag", "-size_V * v * (t_s > 0.5)"))
    rig = smooth_rig(effects={"late_drag": {"x": {"size_V": 1.0}}}, own=(own,))
    states = moved(rig, constant_volts(0.2, 0.2, 1.0), held=True)
    speed = np.diff(states[:, ARM], axis=0) / TICK_S
    k = rig.servo.gain_rad_s_V
    np.testing.assert_allclose(speed[240], 0.2 * k, rtol=1e-3)
    assert speed[-1, 0] == pytest.approx(0.2 * k / (1 + k), rel=1e-3)  # V = omega/K + omega


def test_at_its_null_value_it_changes_no_bit():
    course = random_steps(np.random.default_rng(1), 1.0, every_s=0.2)
    plain, null = realistic(), {"hanging_arm": {"x": {"weight_V": 0.0, "angle_rad": 0.7}}}
    with_files = replace(plain, own=(ARM_OWN, CABLE_OWN))
    set_to_null = replace(with_files, effects=plain.effects | null)
    known = replace(plain, effects={})
    rows = [run(rig, WITH, course, 1, known).log.rows for rig in (plain, with_files, set_to_null)]
    np.testing.assert_array_equal(rows[1], rows[0])
    np.testing.assert_array_equal(rows[2], rows[0])


def tasks(own: tuple) -> list[Task]:
    """Runs with and without effects of one's own that act, side by side."""
    course = random_steps(np.random.default_rng(3), 0.6, every_s=0.2)
    more = (
        {},
        {"hanging_arm": {"x": {"weight_V": 0.4, "angle_rad": 0.3}}},
        {},
        {"pulling_cable": {"y": {"stiffness_V_rad": 5.0, "slack_rad": -0.02}}},
    )
    found = []
    for i, effects in enumerate(more):
        rig = replace(realistic(), own=own)
        rig = replace(rig, effects=rig.effects | effects)
        draws = draw(np.random.default_rng(i), rig, course)
        found.append(Task(rig, replace(rig, effects={}), WITHOUT, course, draws))
    return found


def test_side_by_side_they_have_the_bits_that_they_have_alone():
    known = tasks((ARM_OWN, CABLE_OWN))
    rows = []
    for task, many in zip(known, simulate_many(known), strict=True):
        one = simulate(task.rig, task.known, task.compensator, task.course, task.draws)
        np.testing.assert_array_equal(many.log.rows, one.log.rows)
        rows.append(one.log.rows)
    assert not np.array_equal(rows[0], rows[1])


def final_angle(rig: Rig) -> float:
    return float(moved(rig, constant_volts(0.3, 0.0, 0.5), held=True)[-1, ARM, 0])


@pytest.mark.slow
def test_a_spawned_process_compiles_it_anew(tmp_path: Path):
    file = written(tmp_path, "away", "-size_V * u")
    rig = smooth_rig(effects={"away": {"x": {"size_V": 2.0}}}, own=(read_effect(file),))
    file.unlink()
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.apply(final_angle, (rig,)) == final_angle(rig)


@pytest.mark.parametrize("side", ["servo", "ball"])
def test_one_that_gives_no_number_on_the_way_is_named_with_its_file(tmp_path: Path, side: str):
    """Infinite volts threw the arm, and the run blamed the encoder's cable."""
    formula = "size_V * (1e200 if 0.25 < t_s < 9.0 else 0.0) ** 2"  # tried at 0 and 100 s alone
    file = written(tmp_path, "broken", formula, side=side)
    rig = smooth_rig(effects={"broken": {"x": {"size_V": 1.0}}}, own=(read_effect(file),))
    with pytest.raises(DivergedError, match=f"^effect file {file}: equation gave no finite number"):
        run(rig, WITHOUT, random_steps(np.random.default_rng(1), 0.6, every_s=0.2), 1, rig.known)
    table = SimulatedTable(rig, np.random.default_rng(1))
    with pytest.raises(DivergedError, match=f"^effect file {file}: equation gave no finite number"):
        [table.read() for _ in range(400)]
