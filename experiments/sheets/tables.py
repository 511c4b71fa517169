"""The virtual table of a student: drawn from sheet and name, so that every student has another.

The rig file that is handed out and the recorded runs hold nothing of what is drawn; nor is it kept
in any file. `rig check` draws it again from the name.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import radians

import numpy as np

from rig.parameters import Rig

# Effects that sheet "missing" hides one of, with the sizes between which it is drawn: beyond what
# one run of each of the sheet's protocols tells for certain (`experiments.blind.sizes`), chosen.
MISSING: Mapping[str, tuple[str, float, float]] = {
    "dead_zone": ("half_width_V", 0.10, 0.25),
    "coulomb_friction": ("friction_V", 0.08, 0.20),
    "gain_asymmetry": ("fraction", 0.04, 0.10),
    "joint_backlash": ("play_rad", radians(1.0), radians(2.5)),
    "cross_coupling": ("fraction", 0.06, 0.15),
    "plate_bowl": ("stiffness_1_s2", 0.4, 1.2),
    "camera_delay": ("extra_s", 0.02, 0.05),
}
CAMERA = {
    "scale": ("camera_scale", "fraction", 0.03, 0.08),
    "yaw": ("camera_yaw", "angle_rad", radians(2.0), radians(5.0)),
    "delay": ("camera_delay", "extra_s", 0.02, 0.04),
}
LONGEST_NAME = 200  # characters; chosen


@dataclass(frozen=True)
class HiddenTable:
    """A student's table: the rig as it is, as its rig file says it is, the seed of its runs, and
    the truth by key of the sheet's questions, in their units."""

    plant: Rig
    known: Rig
    seed: int
    truth: dict[str, float | str]


def seed_of(sheet: str, student: str) -> int:
    """The seed of a student's table: of the name without outer blanks and capitals.

    ValueError: an empty name, one over LONGEST_NAME characters, or one that cannot be printed.
    """
    name = " ".join(student.split()).casefold()
    if not name or len(name) > LONGEST_NAME or not name.isprintable():
        raise ValueError(
            f"--student: 1 to {LONGEST_NAME} printable characters, such as a name or a number"
        )
    return int.from_bytes(hashlib.sha256(f"{sheet}|{name}".encode()).digest()[:4], "big")


def play_table(seed: int) -> HiddenTable:
    """Joint plays of 0.8 to 2.2 degrees, at least 0.4 degrees apart."""
    rng = np.random.default_rng([seed, 1])
    low = rng.uniform(0.8, 1.7)
    pair = [low, low + rng.uniform(0.4, 2.2 - low)]
    x, y = rng.permutation(pair)
    plays = {a: {"play_rad": radians(v)} for a, v in (("x", x), ("y", y))}
    truth = {"play_x_deg": float(x), "play_y_deg": float(y), "wider": "x" if x > y else "y"}
    return HiddenTable(Rig(effects={"joint_backlash": plays}), Rig(), seed, truth)


def servo_table(seed: int) -> HiddenTable:
    """K 15 to 30 % off the rig file's, tau 20 to 60 % above it, dry friction of 0.05 to 0.15 V on
    x."""
    rng, known = np.random.default_rng([seed, 2]), Rig()
    gain = known.servo.gain_rad_s_V * (1.0 + rng.choice([-1, 1]) * rng.uniform(0.15, 0.30))
    tau = known.servo.time_constant_s * rng.uniform(1.2, 1.6)
    friction = rng.uniform(0.05, 0.15)
    servo = replace(known.servo, gain_rad_s_V=float(gain), time_constant_s=float(tau))
    effects = {"coulomb_friction": {"x": {"friction_V": float(friction)}}}
    truth = {"gain_rad_s_V": gain, "time_constant_ms": 1000.0 * tau, "friction_x_V": friction}
    found = {key: float(value) for key, value in truth.items()}
    return HiddenTable(replace(known, servo=servo, effects=effects), known, seed, {**found})


def camera_table(seed: int) -> HiddenTable:
    """Two of the camera's errors: scale, yaw, delay; the third is not there."""
    rng = np.random.default_rng([seed, 3])
    absent = str(rng.choice(list(CAMERA)))
    effects, truth = {}, {"scale_percent": 0.0, "yaw_deg": 0.0, "delay_ms": 0.0, "absent": absent}
    units = {"scale": ("scale_percent", 100.0), "yaw": ("yaw_deg", np.degrees(1.0))}
    units["delay"] = ("delay_ms", 1000.0)
    for name, (effect, key, low, high) in CAMERA.items():
        size = float(rng.uniform(low, high)) * (1 if name == "delay" else int(rng.choice([-1, 1])))
        if name != absent:
            effects[effect] = {"xy": {key: size}}
            truth[units[name][0]] = size * float(units[name][1])
    return HiddenTable(Rig(effects=effects), Rig(), seed, truth)


def missing_table(seed: int) -> HiddenTable:
    """One of the effects of MISSING, on one axis where it has axes."""
    rng = np.random.default_rng([seed, 4])
    name = str(rng.choice(list(MISSING)))
    key, low, high = MISSING[name]
    axis = "xy" if name in ("plate_bowl", "camera_delay") else str(rng.choice(["x", "y"]))
    size = float(rng.uniform(low, high))
    truth: dict[str, float | str] = {"effect": name, "axis": axis, "size": size}
    return HiddenTable(Rig(effects={name: {axis: {key: size}}}), Rig(), seed, truth)
