"""A ball on a plate, written from the textbook: forward Euler at 1 kHz, one axis at a time.

    plate tilt = ratio * servo;   x'' = k g sin(tilt) - c x'   (k = 5/7: a solid ball that rolls)

A position servo is a dead time, a first-order lag and a rate limit; a motor is K / (tau s + 1) from
volts to speed. Nothing here is the product's.
"""

from dataclasses import dataclass
from math import cos, pi, sin

import numpy as np

G = 9.80665


@dataclass(frozen=True)
class Axis:
    """Signals of one axis, (n,) each, every control period; `seen` NaN without a new frame."""

    t: np.ndarray
    target: np.ndarray
    command: np.ndarray
    angle: np.ndarray
    volts: np.ndarray
    speed: np.ndarray
    seen: np.ndarray


def course(kind: str, t: float, axis: int) -> float:
    """Where the ball should be [m]."""
    if kind == "circle":
        return 0.05 * (cos(2 * pi * t / 6) if axis == 0 else sin(2 * pi * t / 6))
    if kind == "squares":
        return 0.05 * (1 if int(t / (3.1 + 1.3 * axis)) % 2 else -1)
    if kind == "wander":
        return 0.03 * (sin(2 * pi * t / 7.3 + axis) + sin(2 * pi * t / 2.9 + 2 * axis))
    return 0.0


def run(
    axis: int,
    *,
    seconds: float = 40.0,
    course_kind: str = "squares",
    motor: bool = False,
    ratio: float = 0.17,
    level: float = 0.0,
    lag: float = 0.05,
    dead: int = 15,
    control_hz: int = 100,
    frame_hz: float = 50.0,
    delay: float = 0.03,
    noise: float = 0.0003,
    seed: int = 0,
) -> Axis:
    """Play one axis under a PD controller; level [rad]: servo angle at which the plate is level."""
    rng = np.random.default_rng([seed, axis])
    step, ticks = 0.001, 1000 // control_hz
    x, v, angle, speed = 0.04 * rng.uniform(-1, 1), 0.0, level, 0.0
    asked, seen_before, seen, rate = [level] * (dead + 1), x, x, 0.0
    trail: list[float] = []
    rows = []
    next_frame, gain = 0.0, 5 / 7 * G * ratio
    wn = 2.2
    for i in range(int(seconds / step)):
        t = i * step
        trail.append(x)
        if i % ticks == 0:
            fresh = np.nan
            if t >= next_frame:
                next_frame += 1 / frame_hz
                fresh = trail[max(0, i - round(1000 * delay))] + noise * rng.standard_normal()
                rate += 0.25 * ((fresh - seen_before) * frame_hz - rate)
                seen_before = seen = fresh
            target = course(course_kind, t, axis)
            want = (wn**2 * (target - seen) - 1.6 * wn * rate) / gain + level
            want = min(max(want, -0.6), 0.6) + 0.01 * rng.standard_normal()
            volts = min(max(14 * (want - angle) - 0.3 * speed, -10), 10)
            rows.append((t, target, want, angle, volts, speed, fresh))
        asked.append(want)
        if motor:
            speed += step * (1.5 * volts - speed) / 0.03
        else:
            speed = min(max((asked[-1 - dead] - angle) / lag, -6.0), 6.0)
        angle += step * speed
        v += step * (5 / 7 * G * sin(ratio * sin(angle - level)) - 0.05 * v)
        x += step * v
    return Axis(*(np.array(column) for column in zip(*rows, strict=True)))
