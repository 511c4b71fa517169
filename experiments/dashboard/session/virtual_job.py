"""Job of a loop process that simulates the virtual table and the operator who handles the ball.

The functions here build table and operator inside the loop process, so they can be pickled.
"""

import time
from dataclasses import replace
from functools import partial
from math import inf

import numpy as np

from experiments.runs.assemble import known, simulated_operator, simulated_table
from experiments.runs.protocol import Protocol
from rig.control.controllers import COMPENSATORS
from rig.course import Course
from rig.loop.job import Job
from rig.loop.paced import Paced
from rig.operator import Operator
from rig.parameters import Rig
from rig.safety.monitor import MonitorLimits
from rig.shared_memory import SharedArray
from rig.simulation.simulator import SimulatedTable
from rig.table import Reading, Table

AWAY_M = (1.0, 1.0)  # beside the plate: the operator still holds the ball
BALANCE_FROM_M = (0.06, 0.045)  # start of the ball; chosen: one sees it being caught
DAY_S = 86400
PLACE, RELEASE = range(2)  # entries of the shared steps (2,), 1.0: done at the page


class EndlessZeros:
    """Stands for zeros (`rows`, 2) without taking memory: targets and pushes of a course of a whole
    day.
    """

    def __init__(self, rows: int) -> None:
        self._rows = rows

    def __len__(self) -> int:
        return self._rows

    def __getitem__(self, at: int | slice) -> np.ndarray:
        if isinstance(at, slice):
            return np.zeros((len(range(*at.indices(self._rows))), 2))
        return np.zeros(2)


def balancing_course(rig: Rig) -> Course:
    """The course that keeps the ball in the middle for a day."""
    rest = EndlessZeros(round(DAY_S * rig.control_rate_hz))
    return Course(rest, rest, BALANCE_FROM_M, 0.0)  # pyright: ignore[reportArgumentType]


def virtual_table(rig: Rig, course: Course, seed: int, speed: float, away: bool) -> Table:
    """The simulated table of a course, at `speed` times the wall clock; seed: of its random
    numbers; away: the operator still holds the ball beside the plate.
    """
    if away:
        course = replace(course, start_m=AWAY_M)
    table = simulated_table(rig, course, seed, None)
    if speed == 1.0:
        return Paced(table)
    return Paced(
        table,
        clock=lambda: speed * time.monotonic(),
        sleep=lambda remaining_s: time.sleep(max(remaining_s, 0.0) / speed),
    )


class PageOperator(Operator):
    """The operator at the page, who places the ball at start_m and lets it go.

    steps (2,), shared with the page's process: nonzero once the ball was placed (PLACE), let go
    (RELEASE).
    """

    def __init__(self, table: SimulatedTable, start_m: tuple[float, float], steps: SharedArray):
        super().__init__()
        self._table, self._start_m, self._steps = table, start_m, steps
        self._placed = self._let_go = False

    def act(self, reading: Reading, wanted_m_s2: tuple[float, float]) -> tuple[float, float]:
        """Place or release the ball as the page says, push it with wanted_m_s2 and return that push
        [m/s2].
        """
        if not self._placed and self._steps.array[PLACE]:
            self._placed = True
            self._table.place(self._start_m)
        if self._placed and not self._let_go and self._steps.array[RELEASE]:
            self._let_go = True
            self._table.release()
        self._table.push(wanted_m_s2)
        return wanted_m_s2


def page_operator(start_m: tuple[float, float], steps: SharedArray, table: Paced) -> Operator:
    """A `PageOperator` for the table inside `table`; arguments as of that class."""
    return PageOperator(table.table, start_m, steps)


def virtual_operator(protocol: Protocol, course: Course, seed: int, table: Paced) -> Operator:
    """The simulated operator of a protocol for the table inside `table`; seed: of its pushes."""
    return simulated_operator(table.table, protocol, course, seed)


BALANCING = Protocol(title="Balancing", duration_s=DAY_S / 24)


def virtual_job(
    rig: Rig,
    method: str,
    course: Course,
    *,
    protocol: Protocol = BALANCING,
    seed: int = 1,
    speed: float = 1.0,
    steps: SharedArray | None = None,
) -> Job:
    """The loop process's job for one run on the virtual table.

    method: name of the compensator; seed: of the random numbers; speed: of the table's time against
    the wall clock; steps (2,): the operator at the page handles the ball (see `PageOperator`);
    None: a simulated operator does. Late ticks never end the run: a busy machine makes a virtual
    table late, not unsafe. KeyError: no such compensator.
    """
    if steps is None:
        operator = partial(virtual_operator, protocol, course, seed)
        course = replace(course, operator=())
    else:
        operator = partial(page_operator, course.start_m, steps)
    table = partial(virtual_table, rig, course, seed, speed, steps is not None)
    limits = replace(MonitorLimits.of_rig(rig), late_s=inf, late_ticks=inf)
    return Job(table, known(rig), COMPENSATORS[method], course, operator=operator, limits=limits)  # pyright: ignore[reportArgumentType]
