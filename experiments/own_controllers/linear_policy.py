"""A learned controller on a table: volts that are linear in what is seen, axis by axis.

`rig run experiments/own_controllers/learned.toml`; the weights in linear_policy.json were found by
train.py. It is the same on a simulated table and on a real one.
"""

import json
from pathlib import Path

import numpy as np

from rig.control.agent import OBSERVED, AgentView
from rig.control.user_controller import Now
from rig.parameters import Rig

INPUTS = ("error_m", "velocity_m_s", "theta_rad", "rate_rad_s", "volts_V", "1")
_AT = {name: slice(2 * i, 2 * i + 2) for i, name in enumerate(OBSERVED)}


def actions(weights: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Return actions (..., 2) for weights (..., 2, 6) and observations (..., 12) of `AgentView`.

    a = w . (target - ball, velocity, theta, rate, volts applied last, 1), on x and on y.
    """
    ball, velocity, target, theta, rate, volts = (seen[..., _AT[name]] for name in OBSERVED)
    inputs = [target - ball, velocity, theta, rate, volts, np.ones_like(ball)]
    return (weights * np.stack(inputs, axis=-1)).sum(axis=-1)


class LinearPolicy:
    """The policy as a controller of `rig run`."""

    def start(self, rig: Rig, period_s: float) -> None:
        """Read the weights and take the rig's limits."""
        text = Path(__file__).with_name("linear_policy.json").read_text(encoding="utf-8")
        self._weights, self._view = np.array(json.loads(text)["weights"]), AgentView(rig)

    def control(self, now: Now) -> tuple[float, float]:
        """Return the volts of the tick."""
        return self._view.command(actions(self._weights, self._view.observation(now)))

    def end(self, outcome: str) -> None:
        """Nothing is to be done."""
