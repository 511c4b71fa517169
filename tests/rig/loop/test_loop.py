"""The loop: the same bits as the batch kernel, commands, endings."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from experiments.runs.assemble import known, load_rig
from rig.control.controllers import COMPENSATORS
from rig.course import Course
from rig.log import INDEX
from rig.loop.commands import Command, CommandSlot, Push, SetGains, Stop, Target
from rig.loop.job import warm_up
from rig.loop.loop import Ending, Loop
from rig.operator import Operator
from rig.parameters import Rig
from rig.simulation.operator import PushingOperator, SimulatedOperator
from rig.simulation.simulate import draw, simulate
from rig.simulation.simulator import SimulatedTable

TABLE = load_rig(None)


def course(seconds: float, *, start=(-0.13, 0.13), hold_s: float = 0.3) -> Course:
    n = round(seconds * 500)
    pushes = np.zeros((n, 2))
    pushes[n // 2 : n // 2 + 40] = (2.0, 1.0)
    return Course(np.zeros((n, 2)), pushes, start, hold_s)


def run(
    rig: Rig,
    arm: str,
    way: Course,
    *,
    seed: int = 3,
    operator: type = SimulatedOperator,
    **settings_,
):
    table = SimulatedTable(
        rig, np.random.default_rng(seed), start_m=way.start_m, held=way.hold_s > 0
    )
    rows: list[np.ndarray] = []
    keep = settings_.pop("keep", lambda row: None)

    def both(row: np.ndarray) -> None:
        rows.append(row.copy())
        keep(row)

    with table:
        loop = Loop(
            table,
            known(rig),
            COMPENSATORS[arm],
            way,
            operator=operator(table, way.hold_s),
            keep=both,
            **settings_,
        )
        ending = loop.run()
    assert table.volts_V == (0.0, 0.0)
    return ending, np.array(rows)


@pytest.mark.parametrize("arm", ["without", "with"])
def test_the_loop_and_the_batch_kernel_give_the_same_bits(arm: str):
    way = course(6.0)
    ending, rows = run(TABLE, arm, way)
    seen = known(TABLE)
    batch = simulate(TABLE, seen, COMPENSATORS[arm], way, draw(np.random.default_rng(3), seen, way))
    assert ending.outcome == batch.outcome == "completed"
    assert np.array_equal(rows, batch.log.rows, equal_nan=True)


def test_a_ball_that_rolls_off_ends_as_lost_in_loop_and_batch_alike():
    way = course(6.0, start=(-0.136, 0.0), hold_s=0.0)
    way.pushes_m_s2[100:140] = (-8.0, 0.0)
    ending, rows = run(TABLE, "with", way)
    seen = known(TABLE)
    batch = simulate(
        TABLE, seen, COMPENSATORS["with"], way, draw(np.random.default_rng(3), seen, way)
    )
    assert ending.outcome == batch.outcome == "ball lost"
    assert np.array_equal(rows, batch.log.rows, equal_nan=True)
    assert len(rows) < 3000


def test_stop_ends_the_run_with_its_reason():
    slot = CommandSlot()

    def keep(row: np.ndarray) -> None:
        if row[0] > 1.0:
            slot.put(Push((1.0, 0.0)))
            slot.put(Stop("operator"))

    ending, rows = run(TABLE, "without", course(6.0), commands=slot, keep=keep)
    assert ending == Ending("aborted", "operator")
    assert rows[-1, 0] == pytest.approx(1.002, abs=1e-6)


def test_target_and_gains_and_push_are_obeyed_within_limits():
    slot, events = CommandSlot(), []
    slot.put(Target((0.03, -0.02)))
    slot.put(SetGains(1e9, float("nan"), 2.0))
    way = course(6.0, start=(0.0, 0.0), hold_s=0.0)
    table = SimulatedTable(TABLE, np.random.default_rng(0))
    loop = Loop(
        table, known(TABLE), 0, way, operator=SimulatedOperator(table, 0.0), commands=slot,
        event=lambda t, text: events.append(text),
    )  # fmt: skip
    loop._tick(table.read())
    gains = loop._q["control"]
    assert (gains["kp"], gains["ki"], gains["kd"]) == (20.0, 0.0, 2.0)
    assert loop._row[9] == 0.03
    assert len(events) == 2


def test_the_papers_hand_pushes_a_ball_that_rests_at_the_centre():
    way = replace(course(12.0, start=(0.0, 0.0), hold_s=0.0), pushes_m_s2=np.zeros((6000, 2)))

    class Papers(PushingOperator):
        def __init__(self, table: SimulatedTable, hold_s: float) -> None:
            rng = np.random.default_rng(1)
            super().__init__(table, hold_s, speed_m_s=0.2, seconds=0.08, rng=rng)

    _, rows = run(TABLE, "with", way, operator=Papers)
    pushed = rows[:, 11] > 0
    starts = np.flatnonzero(np.diff(pushed.astype(int)) > 0)
    assert 2 <= len(starts) <= 20
    far = np.nanmax(
        np.hypot(rows[starts[0] : starts[0] + 400, 5], rows[starts[0] : starts[0] + 400, 6])
    )
    assert far > 0.02


def test_a_ball_never_let_go_ends_as_not_released():
    way = course(2.0)

    class Stubborn(SimulatedOperator):
        def act(self, reading, wanted_m_s2):
            self._table.held = True
            return (0.0, 0.0)

    ending, rows = run(TABLE, "with", way, operator=Stubborn)
    assert ending.outcome == "not released"
    assert np.all(rows[:, INDEX["phase"]] == 1)


commands = st.lists(
    st.one_of(
        st.builds(Stop, st.text(max_size=3)),
        st.builds(Push, st.tuples(st.floats(-1, 1), st.floats(-1, 1))),
        st.just(Target(None)),
    ),
    max_size=200,
)


@given(commands)
@settings(max_examples=50)
def test_the_slot_never_loses_a_stop_and_the_first_one_wins(given_: list[Command]):
    slot = CommandSlot()
    for command in given_:
        slot.put(command)
    taken, stops = slot.take(), [c for c in given_ if isinstance(c, Stop)]
    if stops:
        assert taken == [stops[0]]
        assert slot.take() == [stops[0]]
    else:
        assert taken == given_[-64:]
        assert slot.take() == []


def test_a_person_is_asked_step_by_step_and_waited_for():
    """The ball first lies elsewhere, then at its start, then is let go: PLACE, HOLD, RUN."""
    n = 1500
    pushes = np.zeros((n, 2))
    pushes[700:740] = (2.0, 0.0)
    steps = ("place", "hold", "release", "push")
    way = Course(np.zeros((n, 2)), pushes, (-0.06, 0.05), 0.4, operator=steps)
    table = SimulatedTable(TABLE, np.random.default_rng(1), start_m=(0.03, 0.0), held=True)
    told, events, phases = [], [], []

    class Person(Operator):
        def act(self, reading, wanted_m_s2):
            if reading.t_s > 1.0 and phases[-1] == 0:
                table.place((-0.055, 0.052))
            if told[-1] == "let it go":
                table.release()
            table.push(wanted_m_s2)
            return wanted_m_s2

    def keep(row: np.ndarray) -> None:
        phases.append(int(row[INDEX["phase"]]))

    phases.append(0)
    with table:
        ending = Loop(
            table, known(TABLE), COMPENSATORS["with"], way, operator=Person(told.append), keep=keep,
            event=lambda t, text: events.append(text),
        ).run()  # fmt: skip
    assert ending.outcome == "completed"
    assert told == [
        "place the ball at x = -6.0 cm, y = 5.0 cm", "hold it there", "let it go",
        "push the ball now",
    ]  # fmt: skip
    assert phases == sorted(phases)
    assert phases.count(0) > 700  # a second elsewhere, half a second at its place
    assert 200 <= phases.count(1) < 600
    assert phases.count(2) == n
    assert {"placed", "released"} <= set(events)


def test_a_rehearsal_that_a_signal_leaves_asks_its_table_nothing_more(monkeypatch):
    """What it asks would be compiled, for half a minute, before the program ends."""
    reads = []

    def read(table: SimulatedTable):
        reads.append(table)
        raise KeyboardInterrupt

    monkeypatch.setattr(SimulatedTable, "read", read)
    course = Course(np.zeros((100, 2)), np.zeros((100, 2)))
    with pytest.raises(KeyboardInterrupt):
        warm_up(Rig(), COMPENSATORS["with"], course)
    assert len(reads) == 1
