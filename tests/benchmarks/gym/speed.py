"""Steps a second of `rig.gym` beside MuJoCo.

`uv run --group dev python tests/benchmarks/gym/speed.py` prints the table of rig/gym/README.md: one
step is one control tick (2 ms, 0.1 ms inside) of one table. MuJoCo has the same table from `rig
export-model` in the plainest environment that there is: volts in, its positions out, no camera, no
observers, no reward. Contenders in turn, CPU time of one thread each; ratios are taken round by
round. Two minutes.
"""

import argparse
import importlib
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import rig.gym
from experiments.export.export_model import export_model
from experiments.runs.assemble import load_rig
from rig.parameters import Rig
from tests.benchmarks.plant.speed import in_turn

DEFAULT = load_rig(None)
STEPS = 5000  # 10 s
TABLES = (1, 16, 256)


class PlainMujoco(gymnasium.Env):
    """The table in MuJoCo, one control tick a step."""

    def __init__(self, rig: Rig) -> None:
        self._mujoco: Any = importlib.import_module("mujoco")
        with tempfile.TemporaryDirectory() as folder:
            export_model(rig, "table", "mjcf", Path(folder) / "table.xml")
            self._model = self._mujoco.MjModel.from_xml_path(f"{folder}/table.xml")
        self._data = self._mujoco.MjData(self._model)
        self._steps = round(1 / rig.control_rate_hz / self._model.opt.timestep)
        self._limit = rig.servo.voltage_limit_V
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,))
        reach = np.full(self._model.nq, 10.0, np.float32)
        self.observation_space = gymnasium.spaces.Box(-reach, reach)

    def reset(self, *, seed: int | None = None, options: dict | None = None):
        super().reset(seed=seed)
        self._mujoco.mj_resetData(self._model, self._data)
        return self._data.qpos.astype(np.float32), {}

    def step(self, action: np.ndarray):
        self._data.ctrl[:] = self._limit * action
        self._mujoco.mj_step(self._model, self._data, self._steps)
        return self._data.qpos.astype(np.float32), 0.0, False, False, {}


def stepping(env: gymnasium.Env) -> Callable[[], object]:
    """STEPS steps of one table without volts, reset where its ball has rolled off."""

    def work() -> None:
        env.reset(seed=0)
        for _ in range(STEPS):
            _, _, terminated, truncated, _ = env.step(np.zeros(2, np.float32))
            if terminated or truncated:
                env.reset()

    return work


def stepping_many(envs: gymnasium.vector.VectorEnv, steps: int) -> Callable[[], object]:
    """The same of many, which reset themselves."""

    def work() -> None:
        envs.reset(seed=0)
        for _ in range(steps):
            envs.step(np.zeros((envs.num_envs, 2), np.float32))

    return work


def contenders(rig: Rig) -> dict[str, tuple[Callable[[], object], float]]:
    """What is compared: name -> (work, steps of tables in it). Without the checks of `make`."""
    one = gymnasium.make("BalancingTable-v0", rig=rig).unwrapped
    found: dict[str, tuple[Callable[[], object], float]] = {
        "`BalancingTable`": (stepping(one), STEPS)
    }
    for n in TABLES:
        envs = gymnasium.make_vec("BalancingTable-v0", num_envs=n, rig=rig)
        found[f"`BalancingTables`, n = {n}"] = (stepping_many(envs, STEPS), n * STEPS)
    found["MuJoCo"] = (stepping(PlainMujoco(rig)), STEPS)
    sync = gymnasium.vector.SyncVectorEnv([lambda: PlainMujoco(rig)] * 16)
    found["MuJoCo, `SyncVectorEnv`, n = 16"] = (
        stepping_many(sync, STEPS // 16),
        16 * (STEPS // 16),
    )
    return found


def main() -> None:
    argparse.ArgumentParser(description=__doc__).parse_args()
    assert rig.gym.ID in gymnasium.registry
    speeds = in_turn(contenders(DEFAULT))
    print("| environment | steps a second, median (least to most) | over MuJoCo's |")
    print("|---|---|---|")
    for name, found in speeds.items():
        ratios = found / speeds["MuJoCo"]
        print(
            f"| {name} | {np.median(found):,.0f} ({found.min():,.0f} to {found.max():,.0f}) | "
            f"{np.median(ratios):.3g} ({ratios.min():.3g} to {ratios.max():.3g}) |"
        )


if __name__ == "__main__":
    main()
