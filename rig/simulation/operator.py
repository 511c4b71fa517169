"""Who places, releases and pushes the ball: a person who is told, or a simulated hand."""

from collections.abc import Callable

import numpy as np

from rig.simulator import SimulatedTable
from rig.table import Reading

SAY = {
    "place": "place the ball at x = {x:.1f} cm, y = {y:.1f} cm",
    "hold": "hold it there",
    "release": "let it go",
    "push": "push the ball now",
}


class Hand:
    """Who places, releases and pushes the ball. This one is a person: told what to do, waited for.

    `tell` shows a sentence to that person; the loop sees from the ball that it was done.
    """

    is_person = True
    release_limit_s = 120.0

    def __init__(self, tell: Callable[[str], None] = lambda text: None) -> None:
        self.tell = tell

    def act(self, reading: Reading, wanted_m_s2: tuple[float, float]) -> tuple[float, float]:
        """Called every tick with the push that the course (or a command) wants now.

        Returns the push that the recording shall name.
        """
        return wanted_m_s2


class SimulatedHand(Hand):
    """Lets a simulated ball go after `hold_s` and pushes it."""

    is_person = False
    release_limit_s = 3.0

    def __init__(self, table: SimulatedTable, hold_s: float) -> None:
        super().__init__()
        self._table, self._hold_s = table, hold_s
        table.held = hold_s > 0

    def act(self, reading: Reading, wanted_m_s2: tuple[float, float]) -> tuple[float, float]:
        if reading.t_s >= self._hold_s:
            self._table.release()
        self._table.push(wanted_m_s2)
        return wanted_m_s2


class PushingHand(SimulatedHand):
    """Pushes the ball away whenever it has stayed near the centre: the paper's own way."""

    near_m, stays_s = 0.01, 0.5

    def __init__(
        self,
        table: SimulatedTable,
        hold_s: float,
        *,
        speed_m_s: float,
        seconds: float,
        rng: np.random.Generator,
    ) -> None:
        super().__init__(table, hold_s)
        self._acceleration, self._seconds, self._rng = speed_m_s / seconds, seconds, rng
        self._near_since: float | None = None
        self._until, self._now = -1.0, (0.0, 0.0)

    def act(self, reading: Reading, wanted_m_s2: tuple[float, float]) -> tuple[float, float]:
        t_s = reading.t_s
        if reading.ball is not None:
            near = float(np.hypot(*reading.ball.xy_m)) < self.near_m
            begin = t_s if self._near_since is None else self._near_since
            self._near_since = begin if near else None
        if self._near_since is not None and t_s - self._near_since > self.stays_s:
            angle = self._rng.uniform(0, 2 * np.pi)
            push = self._acceleration * np.array([np.cos(angle), np.sin(angle)])
            self._now, self._until = (float(push[0]), float(push[1])), t_s + self._seconds
            self._near_since = None
        return super().act(reading, self._now if t_s < self._until else wanted_m_s2)
