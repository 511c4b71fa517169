"""Values that arrive from the browser are untrusted: convert, clamp, and check choices."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

from rig.loop.loop import HIGHEST_GAINS

MOST_NAMED = 10  # options in a refusal; chosen: as many as a message shows


@dataclass(frozen=True)
class Range:
    """Lowest and highest value of an input and the step of its slider, in the unit of the input."""

    low: float
    high: float
    step: float

    def clamp(self, value: Any) -> float:
        """The value, clamped to the range. ValueError: it is no finite number."""
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if not number or not abs(value) < inf:
            raise ValueError(f"{type(value).__name__} is no number")
        return float(min(max(value, self.low), self.high))


KP = Range(0.0, HIGHEST_GAINS[0], 0.05)  # rad/m
KI = Range(0.0, HIGHEST_GAINS[1], 0.05)  # rad/(m s)
KD = Range(0.0, HIGHEST_GAINS[2], 0.05)  # rad s/m
BACKLASH_DEG = Range(0.0, 3.0, 0.1)  # full width at the servo
REPETITIONS = Range(1, 100, 1)
PRINTED_MM = Range(5.0, 100.0, 0.1)  # squares of the sheet, markers of the plate
PAUSE_S = Range(0, 600, 1)
PUSH_M_S = Range(0.0, 0.4, 0.01)
SPEED = Range(0.1, 8.0, 0.1)


def flag(value: Any) -> bool:
    """The value, if it is a truth value. ValueError: it is none."""
    if not isinstance(value, bool):
        raise ValueError(f"{type(value).__name__} is neither yes nor no")
    return value


def choice(value: Any, options: Sequence[str]) -> str:
    """The value, if it is one of the options. ValueError: it is none of them."""
    if not isinstance(value, str) or value not in options:
        more = ", ..." if len(options) > MOST_NAMED else ""
        raise ValueError(f"that is none of {', '.join(options[:MOST_NAMED])}{more}")
    return value


def on_plate(xy_m: Sequence[float], side_m: float, margin_m: float) -> tuple[float, float]:
    """A point (x, y) [m] clamped to the plate, at least `margin_m` from its edges.

    ValueError: a coordinate is no finite number.
    """
    reach = Range(-(side_m / 2 - margin_m), side_m / 2 - margin_m, 0.001)
    return reach.clamp(xy_m[0]), reach.clamp(xy_m[1])
