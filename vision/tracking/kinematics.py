"""Where the ball can be in the next frame: constant velocity, disturbed by a bounded push."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

# In ball radii: a 20 mm ball on a plate tilted by 18 degrees, or nudged by a finger, gains 3 m/s^2.
PUSH_RADII_S2 = 150.0
START_SPEED_RADII_S = 25.0
GATE_SIGMAS = 4.0


@dataclass(frozen=True, eq=False)
class Motion:
    """Kalman state of both image axes: `place`, `speed` (2,) px and px/s; `cov` of either axis:
    (place, place and speed, speed)."""

    place: np.ndarray
    speed: np.ndarray
    cov: tuple[float, float, float]
    t_s: float

    @staticmethod
    def start(u_px: float, v_px: float, radius_px: float, sigma_px: float, t_s: float) -> Motion:
        """At rest as far as known."""
        cov = (sigma_px**2, 0.0, (START_SPEED_RADII_S * radius_px) ** 2)
        return Motion(np.array([u_px, v_px]), np.zeros(2), cov, t_s)

    def at(self, t_s: float, radius_px: float) -> Motion:
        """Predicted to t_s >= self.t_s: F P F' + Q, Q of white acceleration held over the step."""
        dt = max(t_s - self.t_s, 0.0)
        xx, xv, vv = self.cov
        g0, g1 = 0.5 * dt * dt, dt
        push = (PUSH_RADII_S2 * radius_px) ** 2
        cov = (
            xx + dt * (2.0 * xv + dt * vv) + push * g0 * g0,
            xv + dt * vv + push * g0 * g1,
            vv + push * g1 * g1,
        )
        return Motion(self.place + dt * self.speed, self.speed, cov, self.t_s + dt)

    def corrected(self, u_px: float, v_px: float, sigma_px: float) -> Motion:
        """With a measurement of this standard deviation per axis: P (I - K H)."""
        xx, xv, vv = self.cov
        whole = xx + sigma_px**2
        gain = xx / whole, xv / whole
        innovation = np.array([u_px, v_px]) - self.place
        cov = (xx - gain[0] * xx, xv - gain[0] * xv, vv - gain[1] * xv)
        return Motion(
            self.place + gain[0] * innovation, self.speed + gain[1] * innovation, cov, self.t_s
        )

    @property
    def sigma_px(self) -> float:
        """Standard deviation of the place per axis."""
        return math.sqrt(self.cov[0])


def gates(ahead: Motion, radius_px: float) -> tuple[float, float]:
    """How far (px) from the prediction a disc is believed, and one with nearly the whole outline.

    The far gate allows for kicks and for time stamps that jitter by a frame or two.
    """
    reach = GATE_SIGMAS * ahead.sigma_px
    near = min(reach, 2.0 * radius_px) + 0.3 * radius_px
    return near, min(reach, 4.0 * radius_px) + 2.0 * radius_px
