"""Where the ball can be in the next frame: constant velocity, disturbed by a bounded push."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# In ball radii: a 20 mm ball on a plate tilted by 18 degrees, or nudged by a finger, gains 3 m/s^2.
PUSH_RADII_S2 = 150.0
START_SPEED_RADII_S = 25.0


@dataclass(frozen=True, eq=False)
class Motion:
    """Kalman state of both image axes: `place`, `speed` (2,) px and px/s, `cov` (2, 2) per axis."""

    place: np.ndarray
    speed: np.ndarray
    cov: np.ndarray
    t_s: float

    @staticmethod
    def start(u_px: float, v_px: float, radius_px: float, sigma_px: float, t_s: float) -> Motion:
        """At rest as far as known."""
        cov = np.diag([sigma_px**2, (START_SPEED_RADII_S * radius_px) ** 2])
        return Motion(np.array([u_px, v_px]), np.zeros(2), cov, t_s)

    def at(self, t_s: float, radius_px: float) -> Motion:
        """Predicted to t_s >= self.t_s; Q of white acceleration held over the step."""
        dt = max(t_s - self.t_s, 0.0)
        F = np.array([[1.0, dt], [0.0, 1.0]])
        g = np.array([0.5 * dt * dt, dt])
        Q = (PUSH_RADII_S2 * radius_px) ** 2 * np.outer(g, g)
        return Motion(
            self.place + dt * self.speed, self.speed, F @ self.cov @ F.T + Q, self.t_s + dt
        )

    def corrected(self, u_px: float, v_px: float, sigma_px: float) -> Motion:
        """With a measurement of this standard deviation per axis: P (I - K H)."""
        gain = self.cov[:, 0] / (self.cov[0, 0] + sigma_px**2)
        innovation = np.array([u_px, v_px]) - self.place
        cov = self.cov - np.outer(gain, self.cov[0])
        return Motion(
            self.place + gain[0] * innovation, self.speed + gain[1] * innovation, cov, self.t_s
        )

    @property
    def sigma_px(self) -> float:
        """Standard deviation of the place per axis."""
        return float(np.sqrt(self.cov[0, 0]))
