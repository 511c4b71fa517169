"""Where the ball (or the servo) should be over time: one pure function a shape, (n, 2) arrays."""

from collections.abc import Callable
from math import pi

import numpy as np


def constant(t_s: np.ndarray, *, x: float = 0.0, y: float = 0.0) -> np.ndarray:
    """The point (x, y) [m] at every time of t_s (n,) [s]; returns (n, 2)."""
    return np.tile([x, y], (len(t_s), 1)).astype(float)


def steps(
    t_s: np.ndarray, *, rng: np.random.Generator, amplitude: float = 0.06, every_s: float = 2.0
) -> np.ndarray:
    """Random points, uniform within +-amplitude [m] on both axes, a new one every `every_s`.

    t_s (n,) [s], from 0 on and rising; returns (n, 2).
    """
    which = (t_s / every_s + 1e-9).astype(int)
    return rng.uniform(-amplitude, amplitude, (which[-1] + 1, 2))[which]


def circle(t_s: np.ndarray, *, radius: float = 0.05, period_s: float = 6.0) -> np.ndarray:
    """A circle of `radius` [m], counter-clockwise from (radius, 0), one turn every `period_s`.

    t_s (n,) [s]; returns (n, 2).
    """
    phase = 2 * pi * t_s / period_s
    return radius * np.column_stack([np.cos(phase), np.sin(phase)])


def square(t_s: np.ndarray, *, side: float = 0.1, period_s: float = 12.0) -> np.ndarray:
    """The corners of a square of length `side` [m], in turn, counter-clockwise from (+, +).

    Each corner is kept for a quarter of `period_s`. t_s (n,) [s]; returns (n, 2).
    """
    corners = 0.5 * side * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    return corners[(4 * t_s / period_s + 1e-9).astype(int) % 4]


def sine_sweep(
    t_s: np.ndarray, *, amplitude: float = 0.04, low_hz: float = 0.05, high_hz: float = 0.6
) -> np.ndarray:
    """Logarithmic sine sweep from low_hz to high_hz over all of t_s: x sin(p), y sin(p + pi/2).

    p = 2 pi low_hz T/ln(high_hz/low_hz) (e^(t ln(high_hz/low_hz)/T) - 1), T the last time of t_s.
    t_s (n,) [s], rising from 0; amplitude [m]; returns (n, 2).
    """
    duration = max(t_s[-1], 1e-9)
    ratio = np.log(high_hz / low_hz)
    if ratio:
        phase = 2 * pi * low_hz * duration / ratio * (np.exp(ratio * t_s / duration) - 1)
    else:
        phase = 2 * pi * low_hz * t_s  # the limit: one frequency
    return amplitude * np.column_stack([np.sin(phase), np.sin(phase + pi / 2)])


def triangle(t_s: np.ndarray, *, amplitude: float = 0.06, period_s: float = 16.0) -> np.ndarray:
    """Triangle waves between -amplitude and +amplitude [m]; y runs a quarter period ahead of x.

    x starts at 0 and rises. t_s (n,) [s]; returns (n, 2).
    """

    def wave(phase: np.ndarray) -> np.ndarray:
        return amplitude * (1 - 4 * np.abs((phase + 0.25) % 1 - 0.5))

    return np.column_stack([wave(t_s / period_s), wave(t_s / period_s + 0.25)])


def squares(t_s: np.ndarray, *, amplitude: float = 0.1, period_s: float = 1.0) -> np.ndarray:
    """Square waves +-amplitude [m], starting at +; the period of y is 1.5 times that of x.

    t_s (n,) [s]; period_s: of x; returns (n, 2).
    """
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
