"""A table to an agent that knows numbers alone: what it sees and does as plain arrays.

The same on every way: in `rig.gym`, and in a controller of a lab's own on `rig run`
(`user_controller`), on a simulated table or a real one.

    class Mine:
        def start(self, rig, period_s): self.view = AgentView(rig)
        def control(self, now): return self.view.command(policy(self.view.observation(now)))
"""

from math import sqrt

import numpy as np

from rig.control.seen import COLUMN
from rig.control.user_controller import Now
from rig.effects import BY_NAME
from rig.parameters import Rig

OBSERVED = ("ball_m", "velocity_m_s", "target_m", "theta_rad", "rate_rad_s", "volts_V")
PLAYS = ("gear_play_rad", "joint_play_rad")
BEYOND = 2.0  # chosen: filters overshoot and noise adds to what a table can do


class AgentView:
    """What an agent sees of the table `rig` and how it commands it; the rig's effects are not used.

    An observation is (n,) float32 in SI units: x and y of each of `names`, clipped to +-`high`
    (n,). They are those of `user_controller.Now`: ball and velocity as the rig's filter has them
    from the camera's delayed and noisy frames, angles and rates from the encoders, volts applied
    since the last tick (angles where the servos take them). play: with the estimated widths of the
    backlash. An action is (2,) from -1 to 1 in shares of `limit`, of the volts [V] or the angles
    [rad].
    """

    def __init__(self, rig: Rig, *, play: bool = False) -> None:
        self.names = OBSERVED + (PLAYS if play else ())
        self._columns = np.array([COLUMN[name] + a for name in self.names for a in range(2)])
        self.limit = (
            rig.servo.angle_limit_rad if rig.servo.takes_angle else rig.servo.voltage_limit_V
        )
        self.high = np.array([v for name in self.names for v in _reach(rig, name)], np.float32)

    def observation(self, now: Now) -> np.ndarray:
        """Return what the agent sees of the tick `now`, (n,) float32."""
        pairs = [v for name in self.names for v in getattr(now, name)]
        return self._shown(np.array(pairs))

    def observations(self, seen: np.ndarray) -> np.ndarray:
        """Return what it sees of rows (m, SEEN_SIZE) of `seen.fill_seen`, (m, n) float32."""
        return self._shown(seen[:, self._columns])

    def _shown(self, numbers: np.ndarray) -> np.ndarray:
        return np.minimum(np.maximum(numbers.astype(np.float32), -self.high), self.high)

    def commands(self, actions: np.ndarray) -> np.ndarray:
        """Return the volts or angles that actions (..., 2) ask for; beyond 1 counts as 1."""
        return self.limit * np.minimum(np.maximum(np.asarray(actions, float), -1.0), 1.0)

    def command(self, action: np.ndarray) -> tuple[float, float]:
        """Return the same of one action (2,), as `UserController.control` does."""
        x, y = self.commands(action)
        return float(x), float(y)


def _reach(rig: Rig, name: str) -> tuple[float, float]:
    """How far x and y of an observed pair can be from 0."""
    servo, sides = rig.servo, [2 * half for half in rig.linkage.half_sides_m]
    if name == "ball_m":
        return sides[0], sides[1]
    if name == "target_m":
        return 0.5 * sides[0], 0.5 * sides[1]
    if name == "velocity_m_s":  # of a ball that has rolled down the whole plate at its steepest
        steepest = rig.ball_gain_m_s2 * servo.angle_limit_rad
        x, y = (BEYOND * sqrt(2 * steepest * side) for side in sides)
        return x, y
    if name == "volts_V":
        one = servo.angle_limit_rad if servo.takes_angle else servo.voltage_limit_V
        return one, one
    if name == "theta_rad":
        return servo.stop_rad, servo.stop_rad
    if name == "rate_rad_s":
        top = servo.gain_rad_s_V * servo.voltage_limit_V
        x, y = servo.pair("rate_limit_rad_s") if servo.takes_angle else (top, top)
        return BEYOND * x, BEYOND * y
    wide = BY_NAME[name.removesuffix("_play_rad") + "_backlash"].parameters[0].high
    return wide, wide
