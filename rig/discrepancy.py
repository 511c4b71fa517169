"""Room for what has no name: a discrepancy on a fixed basis, so that it can join the model too.

Ball side, an acceleration [m/s2] per axis; servo side, what is added to the servo's input per axis:
volts, or where it takes an angle, an angle by which it is drawn off [rad]. Each is a sum of
  a map      Chebyshev products T_i(x/h) T_j(y/h), i, j < 4 (ball; h = half the plate's side), or
             T_1 .. T_4 of theta/(the servo's angle limit) (servo),
  a speed    tanh(u/u_0), u, u |u|, |u| of the own speed (ball: u_0 = 0.01 m/s; servo: 0.05 rad/s),
  a rhythm   s sin(2 pi f t) + c cos(2 pi f t),
  a segment  a constant between two times.
All zero leaves the model unchanged bit for bit.
"""

from dataclasses import dataclass, fields
from math import cos, isfinite, pi, sin, tanh

import numpy as np

from rig.compiled import compiled
from rig.section import Finite

BALL_SPEED_M_S, SERVO_SPEED_RAD_S, SERVO_ANGLE_RAD = 0.01, 0.05, pi / 6
ZERO = (0.0, 0.0)
ZERO_4 = (0.0,) * 4
ZERO_16 = (0.0,) * 16


@dataclass(frozen=True)
class Discrepancy:
    """Coefficients of the discrepancy on this module's basis, each tuple as long as its default.

    `ball_*` in m/s2, `servo_*` in V or rad (`*_speed` divided by the unit of its basis function),
    `*_hz` the frequency of the rhythm, `*_segment_s` begin and end [s] of the time in which
    `*_segment` acts. ValueError: a tuple of another length, a number that is not finite.
    """

    ball_map_x: tuple[Finite, ...] = ZERO_16  # row i * 4 + j of T_i(x/h) T_j(y/h)
    ball_map_y: tuple[Finite, ...] = ZERO_16
    ball_speed_x: tuple[Finite, ...] = ZERO_4
    ball_speed_y: tuple[Finite, ...] = ZERO_4
    ball_rhythm_x: tuple[Finite, ...] = ZERO  # sine, cosine
    ball_rhythm_y: tuple[Finite, ...] = ZERO
    ball_rhythm_hz: Finite = 0.0
    ball_segment: tuple[Finite, ...] = ZERO  # x, y
    ball_segment_s: tuple[Finite, ...] = ZERO  # from, to
    servo_map_x: tuple[Finite, ...] = ZERO_4
    servo_map_y: tuple[Finite, ...] = ZERO_4
    servo_speed_x: tuple[Finite, ...] = ZERO_4
    servo_speed_y: tuple[Finite, ...] = ZERO_4
    servo_rhythm_x: tuple[Finite, ...] = ZERO
    servo_rhythm_y: tuple[Finite, ...] = ZERO
    servo_rhythm_hz: Finite = 0.0
    servo_segment: tuple[Finite, ...] = ZERO
    servo_segment_s: tuple[Finite, ...] = ZERO

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            if isinstance(f.default, tuple) and len(value) != len(f.default):
                raise ValueError(
                    f"unknown.{f.name} has {len(value)} numbers; it needs {len(f.default)}"
                )
            if not all(map(isfinite, value if isinstance(value, tuple | list) else (value,))):
                raise ValueError(f"unknown.{f.name} = {value}: must be finite")


DISCREPANCY = np.dtype(
    [("on", np.int64)]
    + [
        (name, np.float64, shape)
        for side, shape in (("ball", (2, 16)), ("servo", (2, 4)))
        for name, shape in (
            (f"{side}_map", shape),
            (f"{side}_speed", (2, 4)),
            (f"{side}_rhythm", (2, 2)),
            (f"{side}_segment", (2,)),
            (f"{side}_segment_s", (2,)),
        )
    ]
    + [(name, np.float64) for name in ("ball_rhythm_hz", "servo_rhythm_hz", "servo_angle")]
)


def pack(unknown: Discrepancy, servo_angle_rad: float = SERVO_ANGLE_RAD) -> np.record:
    """Return the record (dtype DISCREPANCY) of a discrepancy, as the compiled functions take it.

    servo_angle_rad scales the servo's map: it is mapped to 1, so give the servo's angle limit.
    """
    u = np.zeros(1, DISCREPANCY)[0]
    for side in ("ball", "servo"):
        for part in ("map", "speed", "rhythm"):
            u[f"{side}_{part}"] = [getattr(unknown, f"{side}_{part}_{a}") for a in "xy"]
        u[f"{side}_segment"] = getattr(unknown, f"{side}_segment")
        u[f"{side}_segment_s"] = getattr(unknown, f"{side}_segment_s")
        u[f"{side}_rhythm_hz"] = getattr(unknown, f"{side}_rhythm_hz")
    u["servo_angle"] = servo_angle_rad
    u["on"] = int(unknown != Discrepancy())
    return u


@compiled
def _of_speed(c, speed, scale):
    """Sum over the basis of speed with coefficients c (4,)."""
    return c[0] * tanh(speed / scale) + c[1] * speed + c[2] * speed * abs(speed) + c[3] * abs(speed)


@compiled
def _of_time(rhythm, hz, constant, segment, t):
    """The rhythm (sine, cosine) and the segment's constant at time t."""
    phase = 2.0 * pi * hz * t
    inside = 1.0 if segment[0] <= t < segment[1] else 0.0
    return rhythm[0] * sin(phase) + rhythm[1] * cos(phase) + constant * inside


@compiled
def discrepancy_acceleration(u, a, x, y, speed, t):
    """Acceleration of the ball on axis `a` (0: x, 1: y) by the discrepancy term [m/s2].

    u: record of `pack`; x, y: the ball's position divided by half the plate's side [1]; speed: the
    ball's on axis `a` [m/s]; t: the run's time [s].
    """
    total = _of_speed(u.ball_speed[a], speed, BALL_SPEED_M_S) + _of_time(
        u.ball_rhythm[a], u.ball_rhythm_hz, u.ball_segment[a], u.ball_segment_s, t
    )
    t_x0, t_x1 = 1.0, x
    for i in range(4):
        t_y0, t_y1 = 1.0, y
        for j in range(4):
            total += u.ball_map[a, 4 * i + j] * t_x0 * t_y0
            t_y0, t_y1 = t_y1, 2.0 * y * t_y1 - t_y0
        t_x0, t_x1 = t_x1, 2.0 * x * t_x1 - t_x0
    return total


@compiled
def servo_discrepancy(u, a, theta, omega, t):
    """What the discrepancy term adds to the input of servo `a` (0: x, 1: y) [V, or rad].

    u: record of `pack`; theta [rad] and omega [rad/s]: angle and rate of the servo; t: the run's
    time [s].
    """
    total = _of_speed(u.servo_speed[a], omega, SERVO_SPEED_RAD_S) + _of_time(
        u.servo_rhythm[a], u.servo_rhythm_hz, u.servo_segment[a], u.servo_segment_s, t
    )
    z = theta / u.servo_angle
    t_0, t_1 = 1.0, z
    for i in range(4):
        total += u.servo_map[a, i] * t_1
        t_0, t_1 = t_1, 2.0 * z * t_1 - t_0
    return total
