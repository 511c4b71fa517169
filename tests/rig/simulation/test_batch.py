"""Many runs at once: every one has the bits that it has alone, whatever runs beside it."""

from dataclasses import replace
from math import radians

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rig.control.controllers import SHAM, WITH, WITHOUT
from rig.course import Course
from rig.discrepancy import Discrepancy
from rig.effects import BY_NAME, CATALOGUE, effects_of
from rig.parameters import CameraTiming, Drive, Rig, Servo, Walls
from rig.plant import plant, plant_record
from rig.plant.constants import COSTLY, LANES, PAIRS, SINGLES
from rig.simulation.batch import simulate_many
from rig.simulation.simulate import TICK_BUFFERS, Task, draw, simulate
from rig.simulation.vectorized_plants import (
    BALL,
    FALLEN,
    X,
    advance_block,
    block_of,
    is_costly,
    is_delayed,
)
from tests.support.simulated import (
    TICK_S,
    ball_state,
    constant_volts,
    free_release,
    moved,
    random_steps,
    realistic,
)


def alone(task: Task):
    return simulate(task.rig, task.known, task.compensator, task.course, task.draws)


def task_of(rig: Rig, course: Course, *, arm: int = WITH, seed: int = 0) -> Task:
    known = replace(rig, effects={}, unknown=Discrepancy())
    return Task(rig, known, arm, course, draw(np.random.default_rng(seed), rig, course))


def assert_same(tasks: list[Task]) -> None:
    for task, many in zip(tasks, simulate_many(tasks), strict=True):
        one = alone(task)
        assert many.outcome == one.outcome
        np.testing.assert_array_equal(many.log.rows, one.log.rows)


def random_rig(rng: np.random.Generator) -> Rig:
    """A table with a random handful of effects, each a random size within its sensible range."""
    effects: dict = {}
    for effect in rng.choice(
        np.array(effects_of("voltage"), object), rng.integers(0, 9), replace=False
    ):
        for axis in effect.axes:
            values = {p.key: float(rng.uniform(p.low, p.high) / 3) for p in effect.parameters}
            if "offset_rad" in values:
                values["offset_rad"] = float(rng.uniform(-0.4, 0.4) * values["play_rad"])
            if "speed_rad_s" in values:
                values["speed_rad_s"] += 0.05
            if "periods_per_turn" in values:
                values["periods_per_turn"] = float(rng.integers(1, 12))
            effects.setdefault(effect.name, {})[axis] = values
    camera = CameraTiming(
        rate_hz=float(rng.choice([30.0, 60.0, 200.0])), dropout=float(rng.choice([0.0, 0.3]))
    )
    drive = Drive(shaft_model=str(rng.choice(["exact", "exact", "exact", "dead_zone", "none"])))
    walls = Walls(present=bool(rng.random() < 0.2))
    return Rig(effects=effects, camera=camera, drive=drive, walls=walls)


def random_task(seed: int) -> Task:
    rng = np.random.default_rng([seed, 9])
    rig, n = random_rig(rng), int(rng.integers(50, 900))
    course = random_steps(rng, n * TICK_S, reach_m=0.1, every_s=0.4)
    pushes = np.zeros_like(course.targets_m)
    pushes[n // 2 : n // 2 + 40] = rng.uniform(-9, 9, 2)
    start = rng.uniform(-0.136, 0.136, 2)
    hold_s = float(rng.choice([0.0, 0.2]))
    servo_only = bool(rng.random() < 0.1)
    course = Course(
        course.targets_m, pushes, (float(start[0]), float(start[1])), hold_s, servo_only
    )
    return task_of(rig, course, arm=int(rng.choice([WITHOUT, WITH, SHAM])), seed=seed)


@settings(max_examples=6, suppress_health_check=[HealthCheck.too_slow])
@given(st.integers(0, 10**6))
def test_random_tables_courses_and_endings_give_the_bits_they_have_alone(seed):
    assert_same([random_task(seed + i) for i in range(11)])


def test_those_random_runs_are_of_many_kinds():
    runs = [random_task(i) for i in range(60)]
    packed = [plant_record.pack(task.rig) for task in runs]
    assert {"completed", "ball lost"} <= {run.outcome for run in simulate_many(runs)}
    assert 5 < sum(map(is_costly, packed)) < 55
    assert 0 < sum(map(is_delayed, packed)) < 60
    assert len({int(p["shaft_model"]) for p in packed}) == 3


@pytest.mark.parametrize("name", sorted(BY_NAME))
def test_each_effect_in_a_lane_is_the_effect_of_a_run_alone(name):
    effect = BY_NAME[name]
    values = {p.key: 0.6 * p.high for p in effect.parameters} | {
        k: v for k, v in {"offset_rad": 0.01, "play_rad": 0.04}.items() if "backlash" in name
    }
    servo = Servo(kind=effect.servos[0])
    rig = Rig(servo=servo, effects={name: dict.fromkeys(effect.axes, values)})
    course = random_steps(np.random.default_rng(0), 0.6, every_s=0.2)
    assert_same([task_of(rig, course), task_of(Rig(), course), task_of(realistic(), course)])


def test_a_lane_does_not_see_its_neighbours():
    course = random_steps(np.random.default_rng(3), 1.0)
    one = task_of(realistic(), course)
    wild = Rig(effects={"cogging": {"x": {"amplitude_V": 0.5, "periods_per_turn": 9.0}}})
    for beside in (realistic(2.0, 2.0), wild, replace(Rig(), walls=Walls(present=True))):
        others = [task_of(beside, course, seed=i) for i in range(LANES)]
        rows = simulate_many([*others[:3], one, *others[3:]])[3].log.rows
        np.testing.assert_array_equal(rows, alone(one).log.rows)


def test_an_unnamed_term_runs_alone_and_in_its_place():
    course = random_steps(np.random.default_rng(3), 0.5)
    odd = Rig(unknown=Discrepancy(ball_speed_x=(0.1, 0.0, 0.0, 0.0)))
    assert_same([task_of(Rig(), course), task_of(odd, course), task_of(realistic(), course)])


def test_different_control_rates_and_lengths_go_together():
    slow = replace(Rig(), control_rate_hz=250.0)
    short, long = free_release(0.3, (0.05, 0.02)), free_release(1.5, (0.05, 0.02))
    assert_same([task_of(Rig(), long), task_of(slow, short), task_of(Rig(), short)])
    assert simulate_many([]) == []


def test_bad_tasks_are_refused_as_one_alone_is():
    course = free_release(0.2)
    task = task_of(Rig(), course)
    other = replace(task.known, control_rate_hz=250.0)
    with pytest.raises(ValueError, match="same control_rate_hz"):
        simulate_many([task, replace(task, known=other)])


def test_open_loop_block_moves_as_the_plant_alone():
    """Given volts: a block of plants against `plant.advance`, tick by tick, state by state."""
    rigs = [realistic(0.3 * i, 0.2 * i) for i in range(LANES)]
    rigs[3] = replace(rigs[3], effects={"input_delay": {"x": {"delay_s": 0.0031}}})
    plants = np.array([plant_record.pack(rig) for rig in rigs])
    b = block_of(plants, [(0.01 * i, 0.0) for i in range(LANES)])
    history, buffers = np.zeros((LANES, 4, 2)), np.zeros(LANES, TICK_BUFFERS)
    volts = constant_volts(0.7, -0.4, 0.1)
    for k, pair in enumerate(volts):
        history[:, 1:] = history[:, :-1].copy()
        history[:, 0] = pair
        never = np.full(LANES, np.inf)
        now = np.full(LANES, k * TICK_S)
        advance_block(b, plants, history, False, True, now, TICK_S, never, buffers)
    found = b.reshape(-1, LANES)
    for i, rig in enumerate(rigs):
        want = moved(rig, volts, state=ball_state((0.01 * i, 0.0)))[-1]
        np.testing.assert_array_equal(found[X : X + 8, i], want[:8, 0])
        np.testing.assert_array_equal(found[X + 8 : X + 16, i], want[:8, 1])
        np.testing.assert_array_equal(found[BALL : BALL + 2, i], want[plant.BALL])
    assert not found[FALLEN].any()


def test_the_block_knows_every_number_that_a_step_reads():
    """A number missing from `constants` would be an attribute error; a costly one has a null."""
    names = plant_record.PLANT.names or ()
    assert set(PAIRS) | set(SINGLES) <= set(names)
    nulls = {e.field(p.key): p.null for e in CATALOGUE for p in e.parameters}
    assert all(nulls[name] == 0.0 for name in COSTLY)
    swaying = Rig(effects={"cogging": {"y": {"amplitude_V": 0.1}}})
    assert is_costly(plant_record.pack(swaying))
    assert not is_costly(plant_record.pack(realistic(radians(1))))
