"""What is asked of a table in a run: targets, pushes, starts; functions of times and draws."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

PUSH_M_S, PUSH_S = 0.2, 0.1
SERVO_ONLY = ("squares",)


class Asked(NamedTuple):
    """Targets (n, 2) [m, or rad for servos alone], pushes (n, 2) [m/s2], start (2,) [m]."""

    target: np.ndarray
    push: np.ndarray
    start_m: np.ndarray


def _still(t_s: np.ndarray, target: np.ndarray, start_m=(0.0, 0.0)) -> Asked:
    return Asked(target, np.zeros((len(t_s), 2)), np.array(start_m, dtype=float))


def steps(t_s: np.ndarray, rng: np.random.Generator) -> Asked:
    """A new point within +-45 mm on both axes every 2 s."""
    which = (t_s / 2.0 + 1e-9).astype(int)
    return _still(t_s, rng.uniform(-0.045, 0.045, (which[-1] + 1, 2))[which])


def corner(t_s: np.ndarray, rng: np.random.Generator) -> Asked:
    """Let go in the far left corner, brought to the centre."""
    start = np.array([-0.13, 0.13]) + rng.uniform(-0.002, 0.002, 2)
    return _still(t_s, np.zeros((len(t_s), 2)), start)


def hold(t_s: np.ndarray, rng: np.random.Generator) -> Asked:
    """Kept at the centre, from wherever the ball was put down."""
    return _still(t_s, np.zeros((len(t_s), 2)), rng.uniform(-0.01, 0.01, 2))


def pushed(t_s: np.ndarray, rng: np.random.Generator) -> Asked:
    """Kept at the centre and pushed: 0.2 m/s within 0.1 s, in any direction, every 2 to 4 s."""
    asked = hold(t_s, rng)
    at = 1.0 + rng.uniform(0, 1)
    lasts = max(PUSH_S, t_s[1])
    while at < t_s[-1]:
        way = rng.uniform(0, 2 * np.pi)
        speed = PUSH_M_S * np.array([np.cos(way), np.sin(way)])
        asked.push[(t_s >= at) & (t_s < at + lasts)] = speed / lasts
        at += rng.uniform(2.0, 4.0)
    return asked


def sweep(t_s: np.ndarray, rng: np.random.Generator) -> Asked:
    """40 mm, from 0.05 to 0.6 Hz, the frequency growing evenly per octave; y a quarter behind."""
    low, high = 0.05, 0.6
    rate = np.log(high / low) / t_s[-1]
    turns = low * np.expm1(rate * t_s) / rate + rng.uniform()
    return _still(t_s, 0.04 * np.sin(2 * np.pi * np.column_stack([turns, turns - 0.25])))


def circle(t_s: np.ndarray, rng: np.random.Generator) -> Asked:
    """50 mm around the centre in 6 s, either way round."""
    angle = 2 * np.pi * (rng.uniform() + rng.choice([-1, 1]) * t_s / 6.0)
    return _still(t_s, 0.05 * np.column_stack([np.cos(angle), np.sin(angle)]))


def squares(t_s: np.ndarray, rng: np.random.Generator) -> Asked:
    """Servos alone: +-0.1 rad every second, y every second and a half."""
    beats = np.column_stack([t_s, t_s / 1.5]) + rng.uniform(0, 1, 2)
    return _still(t_s, np.where(beats % 1 < 0.5, 0.1, -0.1))


PROTOCOLS: dict[str, tuple[Callable[[np.ndarray, np.random.Generator], Asked], float]] = {
    "steps": (steps, 30.0),
    "corner": (corner, 8.0),
    "pushed": (pushed, 12.0),
    "sweep": (sweep, 30.0),
    "circle": (circle, 24.0),
    "hold": (hold, 30.0),
    "squares": (squares, 15.0),
}
"""Name -> (what is asked, usual length [s])."""


def ask(protocol: str, rng: np.random.Generator, rate_hz: float, duration_s: float | None):
    """The protocol's `Asked` at the control ticks. ValueError: no such protocol."""
    if protocol not in PROTOCOLS:
        raise ValueError(f"no protocol '{protocol}'; known: {', '.join(PROTOCOLS)}")
    make, usual_s = PROTOCOLS[protocol]
    n = max(round((duration_s or usual_s) * rate_hz), 2)
    return make(np.arange(n) / rate_hz, rng)
