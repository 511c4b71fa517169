"""How large a hidden effect is: one table, fixed before any trial.

A trial's amplitude is log-uniform from 1.5 to 6 times the larger of the effect's tolerance and its
smallest amplitude below, whatever the protocol, but never beyond the catalogue's sensible range.
"""

from math import radians

import numpy as np

from rig.effects import BY_NAME, PER_AXIS

FACTORS = (1.5, 6.0)
WEAK_FACTORS = (0.15, 1.5)  # the power curve's part below
# As strangers' tables have them: plays of 1.5 to 3 degrees, frictions of 0.09 to 0.18 V.
REAL_FACTORS = (6.0, 12.0)

# Of the first parameter (dead_zone: of the half width), SI. Published ones: what a prototype saw in
# 60 s of random steps. The others: what a lab would care about, with the reason.
SMALLEST: dict[str, float] = {
    "coulomb_friction": 0.0031,
    "stribeck_friction": 0.03,  # a fifth of the breakaway voltage of the table's own friction
    "dead_zone": 0.0035,
    "gain_asymmetry": 0.0013,
    "viscous_asymmetry": 0.02,  # 2 % of the motor's own brake, four times its gain's asymmetry
    "voltage_offset": 0.02,
    "saturation": 0.1,  # share by which the peaks are cut, see `saturation_limit`
    "input_delay": 0.0002,
    "cogging": 0.03,  # as stribeck_friction
    "gain_drift": 0.0015,  # 4.5 % in 30 s
    "supply_sag": 0.01,  # 2 % at 2 V
    "gear_backlash": radians(0.26),  # as joint_backlash
    "joint_backlash": radians(0.26),
    "transmission_ripple": radians(0.23),
    "linkage_quadratic": 0.09,
    "linkage_cubic": 1.0,  # 4 % of the angle at 0.2 rad
    "cross_coupling": 0.019,
    "level_offset": radians(0.015),
    "level_drift": 2.5e-5,  # 0.04 degree in 30 s: two level tolerances
    "plate_bowl": 0.05,  # at 5 cm as much as a level error of 0.024 degree
    "rolling_resistance": 0.003,
    "viscous_drag": 0.033,
    "camera_delay": 0.0034,
    "camera_scale": 0.014,
    "camera_yaw": radians(0.76),
    "lens_distortion": 1.5,  # 0.3 mm at 6 cm: the camera's noise
    # Of servos that take an angle: their tolerances, which nobody has published a better size for.
    "servo_lag": 0.005,
    "servo_dead_time": 0.003,
    "command_dead_band": radians(0.1),
    "angle_scale": 0.01,
    "angle_zero": radians(0.1),
}
POSITIVE = ("input_delay", "servo_lag", "camera_delay", "gain_drift", "supply_sag", "level_drift")

# The families with an inner shape: key, the usual value, and the others that trials draw from.
SHAPES: dict[str, tuple[str, float, tuple[float, float]]] = {
    "transmission_ripple": ("periods_per_turn", 10.0, (12.5, 30.0)),
    "cogging": ("periods_per_turn", 24.0, (30.0, 80.0)),
    "stribeck_friction": ("speed_rad_s", 0.1, (0.15, 0.4)),
    "dead_zone": ("asymmetry", 0.0, (0.3, 0.8)),
}


def smallest(name: str) -> float:
    """The amplitude that a factor of 1 stands for, SI unit of the effect's first parameter: the
    larger of the catalogue's tolerance and the entry in `SMALLEST`. KeyError: no such effect.
    """
    return max(SMALLEST[name], BY_NAME[name].tolerance)


def factor(
    rng: np.random.Generator, within: tuple[float, float] = FACTORS, most: float = np.inf
) -> float:
    """A log-uniform random factor, exp(U(ln low, ln high)), with low and high from `within`.

    most: upper limit of `high`, for an effect whose range ends earlier; the result is never below
    `low`.
    """
    low, high = within
    return float(np.exp(rng.uniform(np.log(low), np.log(max(min(high, most), low)))))


def saturation_limit(peak_V: float, times: float) -> float:
    """The voltage limit peak_V / (1 + 0.1 times) [V], which cuts the peaks of the volts in use.

    peak_V: the 99.5 % quantile of |V| without the limit [V]; times: the trial's factor.
    """
    return peak_V / (1 + SMALLEST["saturation"] * times)


def draw_axes(name: str, rng: np.random.Generator) -> tuple[str, ...]:
    """The axes that the effect `name` acts on: x, y (80 % together) or both for an effect with one
    value per axis; for any other effect the axes that the catalogue gives.
    """
    if BY_NAME[name].axes != PER_AXIS:
        return BY_NAME[name].axes
    return (("x",), ("x",), ("y",), ("y",), ("x", "y"))[rng.integers(5)]


def draw_effect(
    name: str,
    rng: np.random.Generator,
    *,
    within: tuple[float, float] = FACTORS,
    other_shape: bool = False,
) -> tuple[dict[str, dict[str, float]], float]:
    """Random parameters of the effect `name`, {axis: {key: value in SI}}, and the first axis's
    factor.

    within: lowest and highest factor over the smallest amplitude (log-uniform); other_shape: draw
    the inner shape (period, speed, asymmetry) from the range in `SHAPES` instead of its usual
    value. A saturation's `limit_V` holds the factor, which `saturation_limit` later turns into
    volts. Each axis has its own amplitude. Both axes of cross_coupling have one sign, because
    coupling with opposite signs is the same data as a turned camera.
    """
    by_axis: dict[str, dict[str, float]] = {}
    first = BY_NAME[name].parameters[0]
    common = -1.0 if rng.random() < 0.5 else 1.0
    factors = []
    most = np.inf if name == "saturation" else first.high / smallest(name)
    for axis in draw_axes(name, rng):
        times = factor(rng, within, most)
        sign = common if name == "cross_coupling" else (-1.0 if rng.random() < 0.5 else 1.0)
        if first.low >= 0 or name in POSITIVE:
            sign = 1.0
        value = times if name == "saturation" else sign * times * smallest(name)
        by_axis[axis] = _with_shape(name, first.key, value, rng, other_shape)
        factors.append(times)
    return by_axis, factors[0]


def _with_shape(
    name: str, key: str, value: float, rng: np.random.Generator, other: bool
) -> dict[str, float]:
    if name not in SHAPES:
        return {key: value}
    shape, usual, (low, high) = SHAPES[name]
    drawn = float(rng.uniform(low, high)) if other else usual
    if name == "dead_zone":
        skew = drawn if rng.random() < 0.5 else -drawn
        if not other:
            return {key: value}
        return {"positive_V": value * (1 + skew), "negative_V": value * (1 - skew)}
    values = {key: value, shape: drawn}
    if name in ("transmission_ripple", "cogging"):
        values["phase_rad"] = float(rng.uniform(-np.pi, np.pi))
    return values
