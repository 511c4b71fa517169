"""What is hidden in a log: catalogue effects, small imperfections, and strangers; all from a seed.

The names and keys are those of the catalogue of effects, typed again.
"""

from collections.abc import Mapping
from math import inf, radians
from typing import Any

import numpy as np

from experiments.benchmark.engines.foreign.parts import Eye, Odd, Plant

Effects = Mapping[str, Mapping[str, Mapping[str, float]]]

PLANT_KEYS = {
    "coulomb_friction": {"friction_V": "friction"},
    "stribeck_friction": {"extra_V": "stribeck", "speed_rad_s": "stribeck_speed"},
    "dead_zone": {"positive_V": "dead_above", "negative_V": "dead_below"},
    "gain_asymmetry": {"fraction": "asymmetry"},
    "viscous_asymmetry": {"fraction_1": "lopsided"},
    "voltage_offset": {"offset_V": "offset"},
    "saturation": {"limit_V": "limit"},
    "input_delay": {"delay_s": "delay"},
    "cogging": {"amplitude_V": "cog", "phase_rad": "cog_phase", "periods_per_turn": "cog_turns"},
    "gain_drift": {"rate_1_s": "fading"},
    "supply_sag": {"drop_1_V": "sag"},
    "gear_backlash": {"play_rad": "gear", "offset_rad": "gear_middle"},
    "joint_backlash": {"play_rad": "joint", "offset_rad": "joint_middle"},
    "transmission_ripple": {
        "amplitude_rad": "ripple", "phase_rad": "ripple_phase", "periods_per_turn": "ripple_turns"
    },
    "linkage_quadratic": {"coefficient_1_rad": "quadratic"},
    "linkage_cubic": {"coefficient_1_rad2": "cubic"},
    "cross_coupling": {"fraction": "cross"},
    "level_offset": {"slope_rad": "slope"},
    "level_drift": {"rate_rad_s": "slope_rate"},
    "plate_bowl": {"stiffness_1_s2": "bowl"},
    "rolling_resistance": {"deceleration_m_s2": "rolling"},
    "viscous_drag": {"rate_1_s": "drag"},
}  # fmt: skip
EYE_KEYS = {
    "camera_delay": {"extra_s": "extra"},
    "camera_scale": {"fraction": "scale"},
    "camera_yaw": {"angle_rad": "yaw"},
    "lens_distortion": {"k1_1_m2": "k1"},
}
UNUSUAL_NULLS = {"limit": inf, "stribeck_speed": 0.1, "cog_turns": 1.0, "ripple_turns": 1.0}
ONE_FOR_BOTH = ("sag", "bowl", "rolling", "drag", "extra", "scale", "yaw", "k1")

DEG = radians(1)
BOXES = {  # what a well-kept table may have: (low, high) of one key
    "level_offset": ("slope_rad", -0.02 * DEG, 0.02 * DEG),
    "camera_yaw": ("angle_rad", -0.15 * DEG, 0.15 * DEG),
    "camera_scale": ("fraction", -0.003, 0.003),
    "lens_distortion": ("k1_1_m2", -0.1, 0.1),
    "camera_delay": ("extra_s", -0.002, 0.002),
    "cross_coupling": ("fraction", -0.003, 0.003),
    "gain_asymmetry": ("fraction", -0.005, 0.005),
    "coulomb_friction": ("friction_V", 0.0, 0.015),
    "dead_zone": ("half_width_V", 0.0, 0.01),
    "voltage_offset": ("offset_V", -0.02, 0.02),
    "input_delay": ("delay_s", 0.0, 0.002),
    "joint_backlash": ("play_rad", 0.0, 0.08 * DEG),
    "rolling_resistance": ("deceleration_m_s2", 0.0, 0.0015),
    "linkage_quadratic": ("coefficient_1_rad", -0.01, 0.01),
}
SERVO_SPREAD = 0.03  # K and tau of a unit differ by so much from their nominal values

STRANGERS = {  # name -> unit and a size that a lab would notice
    "dent": ("m/s2", 0.05),
    "rhythm": ("m/s2", 0.15),
    "bump": ("rad", 0.008),
    "unbalanced": ("m", 1e-4),
    "cable": ("V/rad", 1.5),
    "draught": ("m/s2", 0.05),
}


def axes_of(name: str) -> tuple[str, ...]:
    """The axes an effect carries values for: ("x", "y") or ("xy",)."""
    fields = {**PLANT_KEYS, **EYE_KEYS}.get(name, {}).values()
    return ("xy",) if set(fields) & set(ONE_FOR_BOTH) else ("x", "y")


def imperfections(rng: np.random.Generator) -> dict[str, dict[str, dict[str, float]]]:
    """Every parameter that has a tolerance, uniform inside it."""
    return {
        name: {axis: {key: float(rng.uniform(low, high))} for axis in axes_of(name)}
        for name, (key, low, high) in BOXES.items()
    }


def merged(small: Effects, hidden: Effects) -> dict[str, dict[str, dict[str, float]]]:
    """`hidden` in the place of the small imperfection of the same name and axis."""
    names = dict.fromkeys([*small, *hidden])
    return {
        name: {a: dict(v) for a, v in {**small.get(name, {}), **hidden.get(name, {})}.items()}
        for name in names
    }


def _fields(name: str, axis: str, key: str) -> list[str]:
    """The fields that an effect's key sets. ValueError: no such effect, axis or key."""
    keys = {**PLANT_KEYS, **EYE_KEYS}.get(name, {})
    if axis in axes_of(name):
        if name == "dead_zone" and key == "half_width_V":
            return list(keys.values())
        if key in keys:
            return [keys[key]]
    raise ValueError(f"no effect {name}.{axis}.{key} on this table")


def _flat(effects: Effects) -> dict[str, np.ndarray]:
    """Field -> values of both axes (2,), nulls where nothing is said."""
    fields = [field for keys in (PLANT_KEYS | EYE_KEYS).values() for field in keys.values()]
    table = {field: np.full(2, UNUSUAL_NULLS.get(field, 0.0)) for field in fields}
    for name, by_axis in effects.items():
        for axis, pairs in by_axis.items():
            where = {"x": 0, "y": 1}.get(axis, slice(None))
            for key, value in pairs.items():
                for field in _fields(name, axis, key):
                    table[field][where] = value
    return table


def plant_and_eye(
    effects: Effects, gain, tau, *, delay_s: float, factor: float
) -> tuple[Plant, Eye]:
    """The table with these effects and no others; `gain`, `tau` (2,) [rad/s/V, s]."""
    flat: dict[str, Any] = _flat(effects)
    flat |= {field: float(flat[field][0]) for field in ONE_FOR_BOTH}
    numbers = {field: flat[field] for keys in PLANT_KEYS.values() for field in keys.values()}
    seen = {field: flat[field] for keys in EYE_KEYS.values() for field in keys.values()}
    plant = Plant(gain=np.array(gain, float), tau=np.array(tau, float), factor=factor, **numbers)
    return plant, Eye(delay=delay_s, **seen)


def _way(rng: np.random.Generator) -> np.ndarray:
    angle = rng.uniform(0, 2 * np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


def strange(stranger: tuple[str, float] | None, rng: np.random.Generator, seconds: float) -> Odd:
    """A stranger of this size; where, when and which way is drawn. ValueError: no such stranger."""
    name, size = stranger or ("none", 0.0)
    if name != "none" and name not in STRANGERS:
        raise ValueError(f"no stranger '{name}'; known: {', '.join(STRANGERS)}")
    of = {known: size if known == name else 0.0 for known in STRANGERS}
    begin, width = rng.uniform(0.25, 0.5) * seconds, rng.uniform(0.2, 0.4) * seconds
    lever = rng.standard_normal(3)
    axis = np.eye(2)[rng.integers(2)]
    return Odd(
        dent=of["dent"],
        dent_at=rng.uniform(-0.03, 0.03, 2),
        dent_width=rng.uniform(0.012, 0.025),
        shake=of["rhythm"] * _way(rng),
        shake_hz=rng.uniform(0.7, 3.0),
        shake_phase=rng.uniform(0, 2 * np.pi),
        bump=of["bump"] * _way(rng),
        bump_from=begin,
        bump_to=begin + width,
        heavy=of["unbalanced"] * lever / np.linalg.norm(lever),
        cable=of["cable"] * axis,
        cable_from=rng.choice([-1, 1]) * rng.uniform(0.01, 0.05) * axis,
        draught=of["draught"],
        draught_at=rng.choice([-1, 1]) * rng.uniform(0.02, 0.05),
    )
