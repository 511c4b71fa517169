"""The simulated table as a Gymnasium environment (README.md), from the extra `gym`.

    import gymnasium, rig.gym
    env = gymnasium.make("BalancingTable-v0", rig="my.toml")
    envs = gymnasium.make_vec("BalancingTable-v0", num_envs=256, rig="my.toml")

ImportError (one line): gymnasium is not installed.
"""

from typing import TYPE_CHECKING

from vision.lazy import lazy_names

try:
    import gymnasium
except ImportError:
    raise ImportError("rig.gym needs gymnasium, the extra `gym`: uv sync --extra gym") from None

if TYPE_CHECKING:
    from rig.gym.env import BalancingTable
    from rig.gym.vector_env import BalancingTables

__all__ = ["ID", "BalancingTable", "BalancingTables"]

ID = "BalancingTable-v0"
if ID not in gymnasium.registry:
    gymnasium.register(
        ID,
        entry_point="rig.gym.env:BalancingTable",
        vector_entry_point="rig.gym.vector_env:BalancingTables",
    )

__getattr__ = lazy_names(__name__, {"env": "BalancingTable", "vector_env": "BalancingTables"})
