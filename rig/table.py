"""The one seam between a loop and a table, real or simulated: read, drive, close."""

from collections.abc import Callable
from dataclasses import dataclass
from math import nan
from typing import Protocol

import numpy as np

from vision.frames import Observation

# Columns of a reading as a flat row, which the compiled functions take: tick time [s], encoder
# angles [rad], motor speeds at the load shaft [rad/s] (NaN without a tachometer), 1.0 when a new
# observation came, ball centre [m], its exposure time [s], variance of each coordinate [m2].
R_TIME, R_THETA, R_MOTOR, R_NEW, R_BALL, R_EXPOSED, R_VARIANCE = 0, 1, 3, 5, 6, 8, 9
READING_SIZE = 10


def blank_reading() -> np.ndarray:
    """Return a row (READING_SIZE,) without an observation: R_NEW is 0, every other column NaN."""
    row = np.full(READING_SIZE, nan)
    row[R_NEW] = 0.0
    return row


@dataclass(frozen=True)
class Reading:
    """What one control tick brings, in the plate's axes x, y.

    t_s: time of the tick from the run's start; theta_rad: encoder angles (NaN where nobody measures
    them: servos that take an angle); motor_speed_rad_s:
    tachometers at the load shaft's scale (None without any); ball: the observation that became
    usable since the last tick, else None; lost: why the table is about to be lost, "" where it is
    not: until then its arms can be brought to rest.
    """

    t_s: float
    theta_rad: tuple[float, float]
    motor_speed_rad_s: tuple[float, float] | None = None
    ball: Observation | None = None
    lost: str = ""

    def row(self) -> np.ndarray:
        """Return the reading as the compiled functions take it: (READING_SIZE,), columns R_*.

        R_VARIANCE is the mean of the observation's variances in x and y; their covariance is left
        out.
        """
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
    Where its servos take an angle, `drive` takes angles [rad] in place of volts (`takes_angle`).
    """

    period_s: float
    voltage_limit_V: float

    def read(self) -> Reading:
        """Wait for the next tick and return its reading. OSError: the table or its camera is
        lost.
        """
        ...

    def drive(self, volts: tuple[float, float]) -> None:
        """Apply volts (x, y) at the motors' terminals, or angles where the servos take them, from
        now to the next tick.

        ValueError: they are not finite. OSError: the table is lost.
        """
        ...

    def close(self) -> None:
        """Set 0 V, or the angle 0, and free the table. A second call does nothing."""
        ...


def takes_angle(table: Table) -> bool:
    """Whether the table's servos take an angle: its attribute of this name, where it has one."""
    return bool(getattr(table, "takes_angle", False))


class ArmingStoppedError(Exception):
    """A stop was asked for while a table was armed; its arms stay where they were then."""


def watch_arming(table: Table, stopped: Callable[[], bool]) -> None:
    """Have a table that moves while it is armed ask at every tick whether it is to stop: one that
    has the attribute `stop_asked`; it then raises `ArmingStoppedError`.
    """
    if hasattr(table, "stop_asked"):
        table.stop_asked = stopped  # pyright: ignore[reportAttributeAccessIssue]
