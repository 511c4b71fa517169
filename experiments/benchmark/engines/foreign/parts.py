"""What the foreign table is made of: plain records of numbers, read by its compiled loop."""

from math import pi
from typing import NamedTuple

import numpy as np


class Plant(NamedTuple):
    """What the table really is; arrays (2,) by axis, units as in the catalogue of effects."""

    gain: np.ndarray
    tau: np.ndarray
    friction: np.ndarray
    stribeck: np.ndarray
    stribeck_speed: np.ndarray
    dead_above: np.ndarray
    dead_below: np.ndarray
    asymmetry: np.ndarray
    lopsided: np.ndarray
    offset: np.ndarray
    limit: np.ndarray
    delay: np.ndarray
    cog: np.ndarray
    cog_phase: np.ndarray
    cog_turns: np.ndarray
    fading: np.ndarray
    gear: np.ndarray
    gear_middle: np.ndarray
    joint: np.ndarray
    joint_middle: np.ndarray
    ripple: np.ndarray
    ripple_phase: np.ndarray
    ripple_turns: np.ndarray
    quadratic: np.ndarray
    cubic: np.ndarray
    cross: np.ndarray
    slope: np.ndarray
    slope_rate: np.ndarray
    sag: float
    bowl: float
    rolling: float
    drag: float
    factor: float  # k: 3/5 hollow, 5/7 solid


class Eye(NamedTuple):
    """Camera: from exposure to use `delay` + `extra` [s], geometry, noise [m] is in the frames."""

    delay: float
    extra: float
    scale: float
    yaw: float
    k1: float


class Odd(NamedTuple):
    """What no catalogue describes; sizes 0 = absent. Vectors are arrays (2,) in the plate frame."""

    dent: float  # largest pull of a Gaussian well [m/s2], at `dent_width` from `dent_at`
    dent_at: np.ndarray
    dent_width: float
    shake: np.ndarray  # amplitude of a rhythmic acceleration [m/s2]
    shake_hz: float
    shake_phase: float
    bump: np.ndarray  # slope of the base between two times [rad]
    bump_from: float
    bump_to: float
    heavy: np.ndarray  # (3,) centre of mass off the ball's centre at the start [m]
    cable: np.ndarray  # pull beyond `cable_from` [V/rad]
    cable_from: np.ndarray  # signed angle [rad]; the sign is the side
    draught: float  # push of the jet on a ball at rest in its middle [m/s2]
    draught_at: float  # the jet blows along +x at this y [m]


class Course(NamedTuple):
    """What happens in a run of n ticks of `dt`, each in `sub` steps of the plant."""

    dt: float
    sub: int
    target: np.ndarray  # (n, 2) of the ball [m], or of the servos [rad] where there is no ball
    push: np.ndarray  # (n, 2) acceleration of the ball [m/s2]
    ball: np.ndarray  # (5,) x, y, x', y' and spin at the start
    has_ball: bool
    frames: np.ndarray  # (m, 4) time of exposure, noise x and y [m], 1 where the frame is lost
    volts_noise: np.ndarray  # (l, 2) [V], each held for VOLTS_HOLD_S
    kicks: np.ndarray  # (n sub, 2) of the ball's speed, one a step [m/s]
    left: np.ndarray  # (4,) where the plays were left, -1 to 1: gear x, y, joint x, y


class Pilot(NamedTuple):
    """PD and slow integral to an angle, P to volts."""

    p: float = 3.45
    d: float = 2.11
    i: float = 0.5
    inner: float = 14.0
    volts: float = 6.0
    angle: float = pi / 6
    windup: float = 0.1  # of the integral's angle [rad]


def packed(part: Plant | Eye | Odd | Pilot) -> np.record:
    """The same numbers as one record, which compiled functions hand on by its address."""
    dtype = np.dtype([(f, np.float64, np.shape(v)) for f, v in part._asdict().items()])
    record = np.zeros(1, dtype)
    for field, value in part._asdict().items():
        record[field] = value
    return record[0]  # type: ignore[return-value]
