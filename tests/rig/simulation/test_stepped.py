"""Tables that are stepped from outside move as `rig run` moves them, bit for bit."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from experiments.runs.assemble import load_rig
from rig.control.agent import AgentView
from rig.control.seen import COLUMN, PAIRS, SEEN_SIZE
from rig.control.user_controller import Now
from rig.course import Course
from rig.discrepancy import Discrepancy
from rig.log import INDEX
from rig.loop.loop import Loop
from rig.parameters import CameraTiming, Rig
from rig.simulation.simulate import ENDINGS, draw
from rig.simulation.simulator import SimulatedTable
from rig.simulation.stepped import COMPLETED, GOING, Start, SteppedTables, most_ticks
from rig.simulation.vectorized_plants import LANES
from tests.support.simulated import random_steps

STEPS = 400
DEFAULT = load_rig(None)
SLOW_CAMERA = CameraTiming(rate_hz=30.0, dropout=0.5, noise_m=0.001)
LATE = {"input_delay": {"x": {"delay_s": 0.013}}, "gain_drift": {"y": {"rate_1_s": 0.01}}}
TABLES = {
    "default": DEFAULT,
    "without effects": Rig(),
    "blind at times": replace(DEFAULT, camera=SLOW_CAMERA),
    "late and drifting": Rig(effects=LATE),
    "cogging": Rig(effects={"cogging": {"x": {"amplitude_V": 0.1, "periods_per_turn": 30.0}}}),
    "unnamed": replace(DEFAULT, unknown=Discrepancy(ball_speed_x=(0.1, 0.0, 0.0, 0.0))),
    "servos that take an angle": load_rig(Path("bus-servos")),
    "three arms": load_rig(Path("three-arms")),
}


def start_of(rig: Rig, seed: int, steps: int = STEPS) -> Start:
    ticks = most_ticks(rig, steps)
    way = random_steps(np.random.default_rng(seed), 2 + ticks / rig.control_rate_hz, every_s=0.3)
    course = Course(way.targets_m[:ticks], way.pushes_m_s2[:ticks], (0.03, -0.01 * (seed % 5)))
    return Start(rig, course, draw(np.random.default_rng([seed, 7]), rig, course))


def actions_of(view: AgentView, shown: np.ndarray) -> np.ndarray:
    """A proportional-differential law on observations (..., 12), as good or bad as it is."""
    ball, velocity, target, theta = (shown[..., i : i + 2] for i in (0, 2, 4, 6))
    wanted = 3.45 * (target - ball) - 2.11 * velocity
    angle = view.limit < 1.0
    return (wanted if angle else 14.0 * (wanted - theta)) / view.limit


class Policy:
    """That law on `rig run`; keeps what it saw."""

    def __init__(self) -> None:
        self.seen: list[Now] = []

    def start(self, rig, period_s):
        self.view = AgentView(rig)

    def control(self, now):
        self.seen.append(now)
        return self.view.command(actions_of(self.view, self.view.observation(now)))

    def end(self, outcome):
        pass


def rows_of_loop(start: Start, seed: int, ticks: int) -> tuple[np.ndarray, Policy]:
    """Log rows of a `Loop` on the same table under that law."""
    policy, rows = Policy(), []
    policy.start(start.rig.known, 1 / start.rig.control_rate_hz)
    course = replace(start.course, targets_m=start.course.targets_m[:ticks])
    table = SimulatedTable(start.rig, np.random.default_rng([seed, 7]), start_m=course.start_m)
    keep = lambda row: rows.append(row.copy())  # noqa: E731
    with table:
        Loop(table, start.rig.known, 0, course, controller=policy, keep=keep).run()
    return np.array(rows), policy


@pytest.mark.parametrize("name", TABLES)
@pytest.mark.parametrize("n", [1, 5])
def test_a_table_is_the_one_of_a_run_to_the_bit(name: str, n: int):
    rig = TABLES[name]
    tables, view = SteppedTables(n, rig, STEPS), AgentView(rig.known)
    for i in range(n):
        tables.reset(i, start_of(rig, i))
    one = n - 1
    rows, policy = rows_of_loop(start_of(rig, one), one, int(tables.ticks[one]) + STEPS)
    volts = INDEX["command_x_rad" if rig.servo.takes_angle else "voltage_x_V"]
    for _ in range(STEPS):
        k = int(tables.ticks[one])
        assert tables.endings[one] == GOING
        np.testing.assert_array_equal(tables.seen[one, 0], rows[k, INDEX["t_s"]])
        tables.step(view.commands(actions_of(view, view.observations(tables.seen))))
        np.testing.assert_array_equal(tables.applied[one], rows[k, volts : volts + 2])
    seen = {now.t_s: now for now in policy.seen}
    last = rows[k, INDEX["t_s"]]
    assert len(policy.seen) > STEPS / 2
    assert last in seen or name == "blind at times"


def test_what_is_seen_is_what_a_user_controller_sees():
    tables, view = SteppedTables(1, DEFAULT, STEPS), AgentView(DEFAULT.known, play=True)
    tables.reset(0, start_of(DEFAULT, 3))
    first = int(tables.ticks[0])
    _, policy = rows_of_loop(start_of(DEFAULT, 3), 3, first + STEPS)
    plain = AgentView(DEFAULT.known)
    for now in policy.seen[:STEPS]:
        flat = [now.t_s, *(v for name in PAIRS for v in getattr(now, name))]
        np.testing.assert_array_equal(tables.seen[0], flat)
        np.testing.assert_array_equal(view.observation(now), view.observations(tables.seen)[0])
        tables.step(plain.commands(actions_of(plain, plain.observations(tables.seen))))
    assert view.observation(policy.seen[-1])[-1] > 0.0  # a play was found on the way
    assert len(flat) == SEEN_SIZE
    assert COLUMN["volts_V"] == SEEN_SIZE - 2


def test_lanes_with_clocks_of_their_own_are_tables_alone():
    rigs = [TABLES[name] for name in ("default", "without effects", "late and drifting", "cogging")]
    rng = np.random.default_rng(0)
    many = SteppedTables(LANES + 3, DEFAULT, STEPS)
    alone = [SteppedTables(1, DEFAULT, STEPS) for _ in range(many.n)]
    every = 40 + 23 * np.arange(many.n)
    for k in range(300):
        for i in np.flatnonzero(k % every == 7):
            start = start_of(rigs[(i + k) % len(rigs)], int(i + k))
            many.reset(int(i), start)
            alone[i].reset(0, start)
        volts = rng.uniform(-3, 3, (many.n, 2))
        many.step(volts)
        for i, one in enumerate(alone):
            one.step(volts[i : i + 1])
            np.testing.assert_array_equal(many.seen[i], one.seen[0])
            assert many.endings[i] == one.endings[0]
            if one.endings[0] == GOING:  # where it is over, what is under a lane means nothing
                np.testing.assert_array_equal(many.balls_m[i], one.balls_m[0])
    assert {int(v) for v in many.endings} <= {GOING, 1, 2}
    assert len(set(many.ticks.tolist())) > 5


@pytest.mark.parametrize("n", [1, 4])
def test_an_episode_ends_where_the_ball_leaves_the_plate(n: int):
    tables = SteppedTables(n, Rig(), 2000)
    for i in range(n):
        tables.reset(i, start_of(Rig(), i, 2000))
    assert all(tables.endings == GOING)
    for _ in range(1500):
        tables.step(np.full((n, 2), 1.0))
    assert [ENDINGS[e] for e in tables.endings] == ["ball lost"] * n
    assert np.all(np.abs(tables.balls_m).max(axis=1) > 0.1375)
    before = tables.seen.copy()
    tables.step(np.full((n, 2), 1.0))
    np.testing.assert_array_equal(tables.seen, before)  # it is over: nothing moves


def test_before_a_reset_nothing_moves():
    tables = SteppedTables(2, Rig(), 10)
    tables.step(np.ones((2, 2)))
    assert all(tables.endings == COMPLETED)
    assert all(tables.ticks == 0)


def test_starts_that_do_not_fit_are_one_line():
    tables = SteppedTables(1, Rig(), 100)
    short = start_of(Rig(), 0, 50)
    faster = replace(Rig(), control_rate_hz=1000.0)
    unseen = replace(Rig(), camera=CameraTiming(dropout=1.0))
    held = start_of(Rig(), 0, 100)
    held = replace(held, course=replace(held.course, hold_s=1.0))
    for start, said in [
        (short, "a course of"),
        (start_of(faster, 0, 500), "control_rate_hz"),
        (start_of(unseen, 0, 100), "not seen within 1 s: camera.dropout = 1"),
        (held, "hold_s"),
    ]:
        with pytest.raises(ValueError, match=said) as error:
            tables.reset(0, start)
        assert "\n" not in str(error.value)
