"""Six disturbances that occur in labs and that no entry of the catalogue describes.

Sizes are fixed beforehand like those of `sizes.py`: the smallest is what a lab would care about, a
trial draws 1.5 to 6 times that. All are given as an acceleration of the ball (volts for the cable).
"""

from math import pi, sqrt

import numpy as np

from experiments.blind import engine
from rig.parameters import GRAVITY_M_S2

# What `size` is, its smallest value worth naming, and the channel's side in which it shows.
SMALLEST_SIZE: dict[str, tuple[str, float, str]] = {
    "dent": ("steepest pull [m/s2]", 0.02, "ball"),
    "rhythm": ("amplitude [m/s2]", 0.01, "ball"),
    "once": ("acceleration [m/s2]", 0.01, "ball"),  # 0.1 degree of a hollow ball's slope
    "unbalanced_ball": ("offset over radius [1]", 0.003, "ball"),
    "cable": ("stiffness [V/rad]", 1.0, "servo"),
    "draught": ("push of the wind [m/s2]", 0.01, "ball"),
}
NAMES = tuple(SMALLEST_SIZE)
_KINDS = dict(
    zip(
        NAMES,
        (engine.DENT, engine.RHYTHM, engine.ONCE, engine.UNBALANCED, engine.CABLE, engine.DRAUGHT),
        strict=True,
    )
)
AIR_DRAG_1_M = 0.07  # 1/2 rho c_d A k/m of the 3 g ball: 0.5 1.2 0.47 1.21e-3 0.6/0.003


def draw(name: str, factor: float, rng: np.random.Generator, *, seconds: float) -> dict:
    """The parameters of an uncatalogued effect of `factor` times its smallest size, as JSON types.

    name: one of `NAMES`; seconds: duration of the shortest log [s]. Keys: "kind" (the name) and the
    fields of `engine.STRANGER` in SI units. Places lie within 25 mm of the centre on each axis,
    where the shipped protocols move the ball, and the times within the shortest log. KeyError: an
    unknown name.
    """
    angle, length = rng.uniform(0, 2 * pi), rng.uniform(0.15, 0.3) * seconds
    begin = rng.uniform(0.2, 0.9) * (seconds - length)
    heavy = rng.standard_normal(3)
    size = factor * SMALLEST_SIZE[name][1]
    if name == "draught":
        size = sqrt(size / AIR_DRAG_1_M)  # m/s of wind
    hz = float(np.exp(rng.uniform(np.log(0.8), np.log(4.0))))
    if name == "rhythm":  # but never less than moves the ball by a third of the camera's noise
        size = max(size, factor * 1e-4 * (2 * pi * hz) ** 2)
    if name == "once":
        size = min(size, 0.02 * GRAVITY_M_S2)
    return {
        "kind": name,
        "size": size,
        "axis": int(rng.integers(2)),
        "width_m": float(rng.uniform(0.012, 0.03)),
        "hz": hz,
        "phase_rad": float(rng.uniform(0, 2 * pi)),
        "from_s": float(begin),
        "to_s": float(begin + length),
        "bend_rad": float(rng.uniform(-0.02, 0.02)),
        "drag_1_m": AIR_DRAG_1_M,
        "place_m": [float(v) for v in rng.uniform(-0.025, 0.025, 2)],
        "direction": _direction(name, angle),
        "heavy_side": [float(v) for v in heavy / np.linalg.norm(heavy)],
    }


def _direction(name: str, angle: float) -> list[float]:
    """A unit vector; of a cable the signs of the angles at which it is tight."""
    c, s = float(np.cos(angle)), float(np.sin(angle))
    return [float(np.copysign(1, c)), float(np.copysign(1, s))] if name == "cable" else [c, s]


def disturbance_record(stranger: dict | None) -> np.record:
    """The `engine.STRANGER` record that the compiled run takes; stranger: the parameters that
    `draw` returns, None: no uncatalogued effect acts.
    """
    g = engine.no_stranger()
    for key, value in (stranger or {}).items():
        g[key] = _KINDS[value] if key == "kind" else value
    return g
