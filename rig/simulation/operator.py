"""Simulated operators: who lets the ball go and pushes it where no person stands at the table."""

import numpy as np

from rig.operator import Operator
from rig.simulation.simulator import SimulatedTable
from rig.table import Reading


class SimulatedOperator(Operator):
    """Operator of a simulated table: lets the ball go after `hold_s` and pushes it."""

    is_person = False
    release_limit_s = 3.0

    def __init__(self, table: SimulatedTable, hold_s: float) -> None:
        super().__init__()
        self._table, self._hold_s = table, hold_s
        table.held = hold_s > 0

    def act(self, reading: Reading, wanted_m_s2: tuple[float, float]) -> tuple[float, float]:
        """Release the ball when it is due, push it with wanted_m_s2 [m/s2] and return that push."""
        if reading.t_s >= self._hold_s:
            self._table.release()
        self._table.push(wanted_m_s2)
        return wanted_m_s2


class PushingOperator(SimulatedOperator):
    """Operator that pushes the ball away when it has stayed near the centre, as in the paper.

    Near is within near_m of the centre for longer than stays_s. A push lasts `seconds`, in a
    direction drawn from `rng`, and gives a freely rolling ball about `speed_m_s`.
    """

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
        """Push the ball with its own push while one lasts, else with wanted_m_s2; return that
        push [m/s2].
        """
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
