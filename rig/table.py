"""The one seam between a loop and a table, real or simulated: read, drive, close."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from rig.signals import (
    R_BALL,
    R_EXPOSED,
    R_MOTOR,
    R_NEW,
    R_THETA,
    R_TIME,
    R_VARIANCE,
    blank_reading,
)
from vision.frames import Observation


@dataclass(frozen=True)
class Reading:
    """What one control tick brings.

    t_s tick time from the run's start; theta_rad encoder angles; motor_speed_rad_s tachometers at
    the load shaft's scale (None without); ball only when a new observation became usable.
    """

    t_s: float
    theta_rad: tuple[float, float]
    motor_speed_rad_s: tuple[float, float] | None = None
    ball: Observation | None = None

    def row(self) -> np.ndarray:
        """The reading as the compiled functions take it (see `signals`), shape (READING_SIZE,)."""
        row = blank_reading()
        row[R_TIME] = self.t_s
        row[R_THETA : R_THETA + 2] = self.theta_rad
        if self.motor_speed_rad_s is not None:
            row[R_MOTOR : R_MOTOR + 2] = self.motor_speed_rad_s
        if self.ball is not None:
            row[R_NEW] = 1.0
            row[R_BALL : R_BALL + 2] = self.ball.xy_m
            row[R_EXPOSED] = self.ball.exposed_s
            xx, _, yy = self.ball.cov_m2
            row[R_VARIANCE] = xx if xx == yy else 0.5 * (xx + yy)
        return row


class Table(Protocol):
    """A table under control. It owns time: `read` waits for the next tick.

    Contract (one test for every table): t_s strictly increases; an observation is never usable
    before its exposure; a positive voltage raises the servo angle, a positive angle accelerates
    the ball towards +; leaving the context gives 0 V and level, even after an exception.
    """

    period_s: float
    voltage_limit_V: float

    def read(self) -> Reading: ...

    def drive(self, volts: tuple[float, float]) -> None:
        """Apply volts (x, y) at the motors' terminals from now to the next tick."""
        ...

    def close(self) -> None: ...
