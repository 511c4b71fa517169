"""An unnamed term in a lab's words."""

from collections.abc import Callable

import numpy as np

from calibration.gap.knobs import BALL
from calibration.gap.unknown import Shape
from rig.unknown import Unknown


def describe(shape: Shape) -> str:
    """The shape in a lab's words."""
    u, side = shape.unknown, "ball" if shape.part == BALL else "servo"
    unit = "m/s2" if side == "ball" else "V"
    words: dict[str, Callable[[], str]] = {
        "map": lambda: _map_words(shape),
        "speed": lambda: f"a {'force' if side == 'ball' else 'voltage'} that depends on speed",
        "rhythm": lambda: (
            f"a rhythm of {getattr(u, f'{side}_rhythm_hz'):.2f} Hz, "
            f"{_largest(u, side, 'rhythm'):.2g} {unit}"
        ),
        "turning": lambda: "a force that turns with the ball, as of one that is heavier on a side",
        "segment": lambda: (
            f"from {getattr(u, f'{side}_segment_s')[0]:.1f} to "
            f"{getattr(u, f'{side}_segment_s')[1]:.1f} s only, "
            f"{max(abs(v) for v in getattr(u, f'{side}_segment')):.2g} {unit}"
        ),
    }
    return words[shape.kind]()


def _largest(u: Unknown, side: str, part: str) -> float:
    return max(float(np.hypot(*getattr(u, f"{side}_{part}_{a}"))) for a in "xy")


def _map_words(shape: Shape) -> str:
    if shape.part != BALL:
        return f"volts on {shape.part[-1]} that depend on the servo's angle"
    return "a force that depends on the place on the plate"
