"""One table as a `gymnasium.Env`."""

from typing import Any

import gymnasium
import numpy as np

from rig.gym.task import Task, spaces_of
from rig.parameters import Rig
from rig.simulation.simulate import ENDINGS
from rig.simulation.stepped import COMPLETED, GOING


class BalancingTable(gymnasium.Env[np.ndarray, np.ndarray]):
    """The simulated table, one control tick a step: "BalancingTable-v0".

    Keyword arguments are those of `rig.gym.task.Task.of`: rig, seconds, start_m, reference,
    randomise, play. Observation (12,), with play (16,): what a controller on the table sees, see
    `rig.control.agent.AgentView`. Action (2,): volts, or the angle of servos that take one, over
    the limit. Reward: `Task.rewards`,

        r = 1 - |p - p*| / (sqrt(2) L) - 0.05 (u_x^2 + u_y^2) / 2.

    Terminated: the ball leaves the plate, is not seen for a second, or an arm passes its limit;
    truncated: after `seconds`. `info`: "t_s" by the table's clock, "true_ball_m" (2,), which no
    observation holds, and at the end "outcome", one of `simulate.ENDINGS`.
    """

    def __init__(self, rig: Any = None, *, render_mode: None = None, **words: Any) -> None:
        if render_mode is not None:
            raise ValueError(f"render_mode = {render_mode!r}: nothing is drawn; leave it out")
        self._task = Task.of(rig, **words)
        self._view, self._tables = self._task.view, self._task.tables(1)
        self.observation_space, self.action_space = spaces_of(self._view)
        self._left, self._rig = 0, self._task.rig

    @property
    def true_rig(self) -> Rig:
        """The table of this episode as it is, effects included."""
        return self._rig

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Draw a table and put the ball on it, at options["start_m"] (x, y) if given; the plate is
        level until the camera has seen the ball. ValueError: `Task.start`.
        """
        super().reset(seed=seed)
        start = self._task.start(self.np_random, options)
        self._tables.reset(0, start)
        self._left, self._rig = self._task.steps, start.rig
        return self._observation(), self._info()

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Apply an action (2,) from -1 to 1 for one control tick.

        gymnasium.error.ResetNeeded: the episode is over. ValueError: not two numbers.
        """
        if self._left == 0:
            raise gymnasium.error.ResetNeeded("the episode is over: call reset()")
        if np.shape(action) != (2,):
            raise ValueError(f"action of shape {np.shape(action)}: must be (2,), x and y")
        self._tables.step(self._view.commands(action))
        ended = self._tables.endings[0] != GOING
        self._left = 0 if ended else self._left - 1
        reward = float(self._task.rewards(self._tables)[0])
        info = self._info()
        if self._left == 0:
            info["outcome"] = ENDINGS[self._tables.endings[0] if ended else COMPLETED]
        return self._observation(), reward, bool(ended), self._left == 0 and not ended, info

    def _observation(self) -> np.ndarray:
        return self._view.observations(self._tables.seen)[0]

    def _info(self) -> dict[str, Any]:
        return {"t_s": float(self._tables.seen[0, 0]), "true_ball_m": self._tables.balls_m[0]}
