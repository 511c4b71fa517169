"""Where the ball (or the servo) should be over time: one pure function a shape, (n, 2) arrays."""

from collections.abc import Callable
from math import pi

import numpy as np


def constant(t_s: np.ndarray, *, x: float = 0.0, y: float = 0.0) -> np.ndarray:
    """The same point all the time, shape (n, 2)."""
    return np.tile([x, y], (len(t_s), 1)).astype(float)


def steps(
    t_s: np.ndarray, *, rng: np.random.Generator, amplitude: float = 0.06, every_s: float = 2.0
) -> np.ndarray:
    """Random points within +-amplitude on both axes, a new one every `every_s`."""
    which = (t_s / every_s + 1e-9).astype(int)
    return rng.uniform(-amplitude, amplitude, (which[-1] + 1, 2))[which]


def circle(t_s: np.ndarray, *, radius: float = 0.05, period_s: float = 6.0) -> np.ndarray:
    phase = 2 * pi * t_s / period_s
    return radius * np.column_stack([np.cos(phase), np.sin(phase)])


def square(t_s: np.ndarray, *, side: float = 0.1, period_s: float = 12.0) -> np.ndarray:
    """The corners of a square in turn, counter-clockwise from (+, +)."""
    corners = 0.5 * side * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    return corners[(4 * t_s / period_s + 1e-9).astype(int) % 4]


def sine_sweep(
    t_s: np.ndarray, *, amplitude: float = 0.04, low_hz: float = 0.05, high_hz: float = 0.6
) -> np.ndarray:
    """A logarithmic sweep on x, the same a quarter period later on y."""
    duration = max(t_s[-1], 1e-9)
    ratio = np.log(high_hz / low_hz)
    phase = 2 * pi * low_hz * duration / ratio * (np.exp(ratio * t_s / duration) - 1)
    return amplitude * np.column_stack([np.sin(phase), np.sin(phase + pi / 2)])


def triangle(t_s: np.ndarray, *, amplitude: float = 0.06, period_s: float = 16.0) -> np.ndarray:
    """A slow ramp up and down on x, a quarter period later on y."""

    def wave(phase: np.ndarray) -> np.ndarray:
        return amplitude * (1 - 4 * np.abs((phase + 0.25) % 1 - 0.5))

    return np.column_stack([wave(t_s / period_s), wave(t_s / period_s + 0.25)])


def squares(t_s: np.ndarray, *, amplitude: float = 0.1, period_s: float = 1.0) -> np.ndarray:
    """Square waves on both axes, y at two thirds of the frequency of x."""
    phase = np.column_stack([t_s / period_s, t_s / (1.5 * period_s)])
    return np.where(phase % 1 < 0.5, amplitude, -amplitude)


SHAPES: dict[str, Callable[..., np.ndarray]] = {
    "constant": constant,
    "steps": steps,
    "circle": circle,
    "square": square,
    "sine-sweep": sine_sweep,
    "triangle": triangle,
    "squares": squares,
}
