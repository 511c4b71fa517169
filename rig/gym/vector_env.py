"""Many tables as a `gymnasium.vector.VectorEnv`, all stepped in one compiled call."""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from rig.gym.task import Task, spaces_of
from rig.parameters import Rig
from rig.simulation.simulate import ENDINGS
from rig.simulation.stepped import COMPLETED, GOING


class BalancingTables(VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """num_envs tables, each as a `BalancingTable` of its own: table i of `reset(seed=s)` is the one
    of `reset(seed=s + i)`, bit for bit.

    Further keyword arguments are those of `Task.of`. `infos`: "t_s" (n,), "true_ball_m" (n, 2) and
    "outcome" (n,) with their masks. autoreset_mode: as of `SyncVectorEnv`. Step and draws in the
    compiled kernel and numpy; tables are reset one by one.
    """

    def __init__(
        self,
        num_envs: int = 1,
        rig: Any = None,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        **words: Any,
    ) -> None:
        if num_envs < 1:
            raise ValueError(f"num_envs = {num_envs}: must be 1 or more")
        self._mode = AutoresetMode(autoreset_mode)
        self.metadata = {"render_modes": [], "autoreset_mode": self._mode}
        self.num_envs, self._task = num_envs, Task.of(rig, **words)
        self._view, self._tables = self._task.view, self._task.tables(num_envs)
        self.single_observation_space, self.single_action_space = spaces_of(self._view)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._rngs: list[np.random.Generator] = []
        self.true_rigs: list[Rig] = [self._task.rig] * num_envs  # of this episode, with effects
        self._left = np.zeros(num_envs, np.int64)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Draw every table anew, or those of options["reset_mask"] (n,) bool; seed: of the first,
        or a list. options["start_m"]: as of `BalancingTable`. ValueError: one of them is no good.
        """
        options, n = dict(options or {}), self.num_envs
        mask = np.asarray(options.pop("reset_mask", np.full(n, True)))
        if mask.shape != (n,) or mask.dtype != np.bool_:
            raise ValueError(f"reset_mask, {mask.dtype} {mask.shape}: must be bool ({n},)")
        seeds = _seeds(seed, n)
        if len(seeds) != n:
            raise ValueError(f"{len(seeds)} seeds for {n} tables: give one each")
        self._rngs = self._rngs or [seeding.np_random()[0] for _ in range(n)]
        for i in np.flatnonzero(mask).tolist():
            if seeds[i] is not None:
                self._rngs[i] = seeding.np_random(seeds[i])[0]
        self._begin(mask, options)
        return self._observations(), self._infos(mask)

    def step(
        self, actions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Apply actions (n, 2) for one control tick; a table whose episode was over begins anew as
        the mode says. gymnasium.error.ResetNeeded: one is over and the mode is DISABLED, or none
        has begun. ValueError: not (n, 2) numbers.
        """
        if np.shape(actions) != (self.num_envs, 2):
            raise ValueError(f"actions of shape {np.shape(actions)}: must be ({self.num_envs}, 2)")
        over = self._left == 0
        if over.any() and (self._mode is not AutoresetMode.NEXT_STEP or not self._rngs):
            raise gymnasium.error.ResetNeeded("an episode is over: call reset()")
        tables = self._tables
        tables.step(self._view.commands(actions))
        rewards = np.where(over, 0.0, self._task.rewards(tables))
        terminated = ~over & (tables.endings != GOING)
        self._left[~over] -= 1
        truncated = ~over & ~terminated & (self._left == 0)
        self._left[terminated], tables.endings[truncated] = 0, COMPLETED
        done = terminated | truncated
        infos: dict[str, Any] = {}
        if done.any():
            outcomes = np.full(self.num_envs, None, object)
            outcomes[done] = [ENDINGS[ending] for ending in tables.endings[done]]
            infos = {"outcome": outcomes, "_outcome": done}
        if self._mode is AutoresetMode.SAME_STEP and done.any():
            infos = self._final(done, infos)
            self._begin(done, {})
        elif self._mode is AutoresetMode.NEXT_STEP and over.any():
            self._begin(over, {})
        infos |= self._infos(np.full(self.num_envs, True))
        return self._observations(), rewards, terminated, truncated, infos

    def _final(self, done: np.ndarray, infos: dict[str, Any]) -> dict[str, Any]:
        """The last observation and information of episodes that begin anew in the same step."""
        last = np.full(self.num_envs, None, object)
        seen = self._observations()
        for i in np.flatnonzero(done):
            last[i] = seen[i]
        told = self._infos(done) | infos
        return {"final_obs": last, "_final_obs": done, "final_info": told, "_final_info": done}

    def _begin(self, mask: np.ndarray, options: dict[str, Any]) -> None:
        for i in np.flatnonzero(mask).tolist():
            start = self._task.start(self._rngs[i], options)
            self._tables.reset(i, start)
            self.true_rigs[i], self._left[i] = start.rig, self._task.steps

    def _observations(self) -> np.ndarray:
        return self._view.observations(self._tables.seen)

    def _infos(self, mask: np.ndarray) -> dict[str, Any]:
        t_s, balls_m = self._tables.seen[:, 0].copy(), self._tables.balls_m
        return {"t_s": t_s, "_t_s": mask, "true_ball_m": balls_m, "_true_ball_m": mask}


def _seeds(seed: int | Sequence[int | None] | None, n: int) -> Sequence[int | None]:
    """A seed for each of n tables."""
    if seed is None:
        return [None] * n
    return [seed + i for i in range(n)] if isinstance(seed, int) else seed
