"""Where can the ball be in the next frame? A Kalman filter in the image.

Constant velocity with a random acceleration, held over the step, of standard deviation
`PUSH_RADII_S2` radii/s^2; both axes share one covariance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

# In ball radii: a 20 mm ball on a plate tilted by 18 degrees, or nudged by a finger, gains 3 m/s^2.
PUSH_RADII_S2 = 150.0
START_SPEED_RADII_S = 25.0  # of a ball seen for the first time: 0.25 m/s for a radius of 10 mm
GATE_SIGMAS = 4.0


@dataclass(frozen=True, eq=False)
class ImageMotion:
    """Kalman state of both image axes: `place` (2,) [px], `speed` (2,) [px/s], at the time `t_s`.

    `cov` of either axis: variance of the place [px^2], covariance of place and speed [px^2/s],
    variance of the speed [px^2/s^2].
    """

    place: np.ndarray
    speed: np.ndarray
    cov: tuple[float, float, float]
    t_s: float

    @staticmethod
    def at_rest(
        u_px: float, v_px: float, radius_px: float, sigma_px: float, t_s: float
    ) -> ImageMotion:
        """The state of a ball seen once, at (u_px, v_px) at the time `t_s`: place +- `sigma_px`,
        speed 0 +- `START_SPEED_RADII_S` radii/s."""
        cov = (sigma_px**2, 0.0, (START_SPEED_RADII_S * radius_px) ** 2)
        return ImageMotion(np.array([u_px, v_px]), np.zeros(2), cov, t_s)

    def at(self, t_s: float, radius_px: float) -> ImageMotion:
        """The state predicted to `t_s`, at or after the state's own: F P F' + Q, with Q of white
        acceleration held over the step."""
        dt = max(t_s - self.t_s, 0.0)
        xx, xv, vv = self.cov
        g0, g1 = 0.5 * dt * dt, dt
        push = (PUSH_RADII_S2 * radius_px) ** 2
        cov = (
            xx + dt * (2.0 * xv + dt * vv) + push * g0 * g0,
            xv + dt * vv + push * g0 * g1,
            vv + push * g1 * g1,
        )
        return ImageMotion(self.place + dt * self.speed, self.speed, cov, self.t_s + dt)

    def corrected(self, u_px: float, v_px: float, sigma_px: float) -> ImageMotion:
        """The state after a measured place [px] of standard deviation `sigma_px` per axis: the
        Kalman update.

            K = P H' / (H P H' + sigma^2),   covariance (I - K H) P
        """
        xx, xv, vv = self.cov
        innovation_cov = xx + sigma_px**2
        gain = xx / innovation_cov, xv / innovation_cov
        innovation = np.array([u_px, v_px]) - self.place
        cov = (xx - gain[0] * xx, xv - gain[0] * xv, vv - gain[1] * xv)
        return ImageMotion(
            self.place + gain[0] * innovation, self.speed + gain[1] * innovation, cov, self.t_s
        )

    @property
    def sigma_px(self) -> float:
        """Standard deviation of the place per axis (px)."""
        return math.sqrt(self.cov[0])


def gate_radii(ahead: ImageMotion, radius_px: float) -> tuple[float, float]:
    """Near and far gate: distances [px] from the prediction within which a disc is accepted;
    `radius_px`: the ball's.

    Between the two nearly the whole outline must be seen. The far gate allows for kicks and for
    time stamps that jitter by a frame or two.
    """
    reach = GATE_SIGMAS * ahead.sigma_px
    near = min(reach, 2.0 * radius_px) + 0.3 * radius_px
    return near, min(reach, 4.0 * radius_px) + 2.0 * radius_px
