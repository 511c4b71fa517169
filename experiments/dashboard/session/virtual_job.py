"""What travels to the loop's process: how to make the virtual table and its operator's hand."""

import time
from dataclasses import replace
from functools import partial
from math import inf

import numpy as np

from experiments.assemble import known, simulated_hand, simulated_table
from experiments.protocol import Protocol
from rig.controllers import ARMS
from rig.guard import GuardLimits
from rig.hands import Hand
from rig.loop_process import Job
from rig.paced import Paced
from rig.parameters import Rig
from rig.shared_ring import SharedArray
from rig.simulate import Course
from rig.simulator import SimulatedTable
from rig.table import Reading, Table

AWAY_M = (1.0, 1.0)  # beside the plate: the ball is still in somebody's hand
BALANCE_FROM_M = (0.06, 0.045)
DAY_S = 86400
PLACE, RELEASE = range(2)


class Endless:
    """Rows of zeros (n, 2) that take no room, in a course without an end."""

    def __init__(self, rows: int) -> None:
        self._rows = rows

    def __len__(self) -> int:
        return self._rows

    def __getitem__(self, at: int | slice) -> np.ndarray:
        if isinstance(at, slice):
            return np.zeros((len(range(*at.indices(self._rows))), 2))
        return np.zeros(2)


def balancing(rig: Rig) -> Course:
    """Keep the ball in the middle for a day."""
    rest = Endless(round(DAY_S * rig.control_rate_hz))
    return Course(rest, rest, BALANCE_FROM_M, 0.0)  # pyright: ignore[reportArgumentType]


def virtual_table(rig: Rig, course: Course, seed: int, speed: float, away: bool) -> Table:
    """The rig's plant held to the wall clock, `speed` times as fast."""
    if away:
        course = replace(course, start_m=AWAY_M)
    table = simulated_table(rig, course, seed, None)
    if speed == 1.0:
        return Paced(table)
    return Paced(
        table,
        clock=lambda: speed * time.monotonic(),
        sleep=lambda left_s: time.sleep(max(left_s, 0.0) / speed),
    )


class PageHand(Hand):
    """A person at the page is the hand: `words` (2,) says that the ball was placed, was let go."""

    def __init__(self, table: SimulatedTable, start_m: tuple[float, float], words: SharedArray):
        super().__init__()
        self._table, self._start_m, self._words = table, start_m, words
        self._placed = self._let_go = False

    def act(self, reading: Reading, wanted_m_s2: tuple[float, float]) -> tuple[float, float]:
        if not self._placed and self._words.array[PLACE]:
            self._placed = True
            self._table.place(self._start_m)
        if self._placed and not self._let_go and self._words.array[RELEASE]:
            self._let_go = True
            self._table.release()
        self._table.push(wanted_m_s2)
        return wanted_m_s2


def page_hand(start_m: tuple[float, float], words: SharedArray, table: Paced) -> Hand:
    return PageHand(table.table, start_m, words)


def virtual_hand(protocol: Protocol, course: Course, seed: int, table: Paced) -> Hand:
    return simulated_hand(table.table, protocol, course, seed)


FREE = Protocol(title="Balancing", duration_s=DAY_S / 24)


def job(
    rig: Rig,
    arm: str,
    course: Course,
    *,
    protocol: Protocol = FREE,
    seed: int = 1,
    speed: float = 1.0,
    words: SharedArray | None = None,
) -> Job:
    """A run of the virtual table for a loop process; with `words` a person at the page is the hand.

    A busy machine makes a virtual table late, never unsafe: the guard does not end it for that.
    """
    if words is None:
        hand = partial(virtual_hand, protocol, course, seed)
        course = replace(course, operator=())
    else:
        hand = partial(page_hand, course.start_m, words)
    table = partial(virtual_table, rig, course, seed, speed, words is not None)
    limits = replace(GuardLimits.of_rig(rig), late_s=inf, late_ticks=inf)
    return Job(table, known(rig), ARMS[arm], course, hand=hand, limits=limits)  # pyright: ignore[reportArgumentType]
