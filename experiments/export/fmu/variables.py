"""The variables of a table's FMU: what is fed, what is read, and its numbers as parameters."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from math import isfinite
from typing import Any

import numpy as np

from rig import effects
from rig.linkage import THREE_ARMS
from rig.parameters import Rig, Servo
from rig.plant import plant

INPUT, OUTPUT, PARAMETER = "input", "output", "parameter"
FIRST_PARAMETER = 100  # value reference; chosen: inputs and outputs have those below
HELD, FALLEN = 90, 91  # value references of the truth values


@dataclass(frozen=True)
class Variable:
    """A real variable: name, causality, where it stands in the FMU's C (`place`), how many numbers
    in a row hold it, its unit ("" for none), start value, least and greatest value.
    """

    name: str
    causality: str
    place: str
    unit: str
    description: str
    start: float = 0.0
    count: int = 1
    low: float | None = None
    high: float | None = None


def inputs(rig: Rig) -> list[Variable]:
    """What drives the table: volts or angles within the rig's limits, pushes of the ball."""
    servo = rig.servo
    if servo.takes_angle:
        limit, name, unit = servo.angle_limit_rad, "command_{}_rad", "rad"
        what = "angle told to the servo" if rig.linkage.kind != THREE_ARMS else "tilt told"
    else:
        limit, name, unit, what = (
            servo.voltage_limit_V,
            "voltage_{}_V",
            "V",
            "at the motor, limited",
        )
    driven = [
        Variable(name.format(n), INPUT, f"drive[{a}]", unit, what, low=-limit, high=limit)
        for a, n in enumerate("xy")
    ]
    pushed = "acceleration of the ball by a hand"
    return driven + [
        Variable(f"push_{n}_m_s2", INPUT, f"push[{a}]", "m/s2", pushed) for a, n in enumerate("xy")
    ]


def outputs(rig: Rig) -> list[Variable]:
    """The table's true motion, at the end of the step."""
    rows = [
        ("theta_{}_rad", plant.ARM, "rad", "angle of the arm, where the encoder sits"),
        ("plate_{}_rad", plant.PLATE, "rad", "angle behind the joint, at the servo"),
        ("plate_speed_{}_rad_s", plant.PLATE_RATE, "rad/s", "its rate"),
        ("ball_{}_m", plant.BALL, "m", "ball's centre in the plate's frame"),
    ]
    if not rig.servo.takes_angle:
        rows += [
            ("motor_{}_rad", plant.MOTOR, "rad", "angle of the motor, at the load shaft"),
            ("motor_speed_{}_rad_s", plant.MOTOR_RATE, "rad/s", "its rate"),
        ]
    made = [
        Variable(name.format(n), OUTPUT, f"state[{2 * row + a}]", unit, what)
        for name, row, unit, what in rows
        for a, n in enumerate("xy")
    ]
    if rig.linkage.kind == THREE_ARMS:
        places = (2 * plant.MOTOR, 2 * plant.MOTOR + 1, 2 * plant.SERVO_THIRD)
        what = "angle of an arm, from level"
        made += [
            Variable(f"arm_{i}_rad", OUTPUT, f"state[{at}]", "rad", what)
            for i, at in enumerate(places)
        ]
    for name, first, unit, what in (
        ("tilt_sine_{}", plant.SEEN_SX, "", "sine of the plate's tilt"),
        ("ball_speed_{}_m_s", plant.SEEN_VX, "m/s", "ball's velocity in the plate's frame"),
    ):
        made += [
            Variable(name.format(n), OUTPUT, f"seen[{first + a}]", unit, what)
            for a, n in enumerate("xy")
        ]
    return made


def parameters(rig: Rig, record: np.record) -> list[Variable]:
    """The table's numbers under the names of the rig file, with this record's values (dtype PLANT).

    Kinds (of servos, linkage, shafts, walls) and the discrepancy are part of the C.
    """
    return [
        *_of_rig(rig, record),
        *_of_effects(rig, record),
        *(
            Variable(f"start.ball_{n}_m", PARAMETER, f"start[{a}]", "m", "where the ball starts")
            for a, n in enumerate("xy")
        ),
    ]


def _of_rig(rig: Rig, record: np.record) -> Iterator[Variable]:
    arms = rig.linkage.kind == THREE_ARMS
    rows: list[tuple[str, str, str]] = [
        ("servo.stop_rad", "stop_rad", "rad"),
        ("ball.radius_m", "radius", "m"),
        ("ball.mass_kg", "mass", "kg"),
        ("ball.rolling_factor", "factor", ""),
        ("drive.joint_stiffness_nm_rad", "joint_k", "N.m/rad"),
        ("drive.joint_damping_nm_s", "joint_c", "N.m.s/rad"),
        ("drive.joint_friction_nm", "joint_friction", "N.m"),
        ("drive.plate_inertia_kg_m2", "plate_inertia", "kg.m2"),
    ]
    if rig.servo.takes_angle:
        rows += [(f"servo.{key}", key, _unit(key)) for key in Servo.by_axis]
    else:
        rows += [
            ("servo.gain_rad_s_V", "gain", "rad/(s.V)"),
            ("servo.time_constant_s", "time_constant", "s"),
            ("drive.gear_stiffness_nm_rad", "gear_k", "N.m/rad"),
            ("drive.gear_damping_nm_s", "gear_c", "N.m.s/rad"),
            ("drive.arm_friction_nm", "arm_friction", "N.m"),
        ]
    if arms:
        rows += [
            ("linkage.base_radius_m", "base_radius", "m"),
            ("linkage.plate_radius_m", "plate_radius", "m"),
            ("linkage.arm_radius_m", "arm_length", "m"),
            ("linkage.rod_length_m", "rod_length", "m"),
            ("linkage.height_m", "height", "m"),
        ]
    else:
        rows += [("linkage.arm_radius_m", "arm_radius", "m")]
        rows += [("linkage.rod_length_m", "rod", "m")] if record["rod"].any() else []
    rows += [("linkage.plate_side_m", "plate_side", "m")]
    rows += [("walls.restitution", "wall_restitution", "")] if rig.walls.present else []
    for name, field, unit in rows:
        room, key = name.split(".")
        by_axis = key in getattr(getattr(rig, room), "by_axis", ()) and not (
            arms and room == "linkage"
        )
        yield from _of_field(name, field, unit, "", record[field], by_axis=by_axis)


def _unit(key: str) -> str:
    """Unit of a key of [servo] by its ending."""
    for ending, unit in (("_rad_s2", "rad/s2"), ("_rad_s", "rad/s"), ("_rad", "rad")):
        if key.endswith(ending):
            return unit
    return "s"


def _of_effects(rig: Rig, record: np.record) -> Iterator[Variable]:
    for field, effect, one in effects.fields():
        # the positive and the negative width hold the half width already
        if rig.servo.kind not in effect.servos or effect.side == "camera":
            continue
        if field == "dead_zone_half_width_V":
            continue
        unit = "" if one.unit == "1" else one.unit
        name = f"effects.{effect.name}.{one.key}"
        by_axis = effect.axes == effects.PER_AXIS
        yield from _of_field(name, field, unit, effect.sentence, record[field], by_axis=by_axis)


def _of_field(
    name: str, field: str, unit: str, what: str, value: Any, *, by_axis: bool
) -> Iterator[Variable]:
    """A parameter of one field: by axis as NAME with .x or .y before its last part."""
    numbers = np.atleast_1d(value)
    place = f"plant.{field}"
    if not by_axis:
        if name.startswith("effects."):
            name = ".xy.".join(name.rsplit(".", 1))
        yield Variable(name, PARAMETER, place, unit, what, float(numbers[0]), numbers.size)
        return
    for a, n in enumerate("xy"):
        at = f".{n}.".join(name.rsplit(".", 1))
        yield Variable(at, PARAMETER, f"{place}[{a}]", unit, what, float(numbers[a]))


def bounded(
    found: list[Variable], intervals: Mapping[str, tuple[float, float]]
) -> tuple[list[Variable], list[str]]:
    """The parameters with these intervals as least and greatest value, and the names that no
    parameter bears.

    ValueError: an interval without the parameter's own value.
    """
    made, left = [], dict(intervals)
    for one in found:
        ends = left.pop(one.name, None)
        if ends is not None:
            low, high = ends
            if not low <= one.start <= high or not isfinite(one.start):
                raise ValueError(
                    f"{one.name} = {one.start:g} in the rig file lies outside its interval "
                    f"{low:g} to {high:g}: give the rig file that `rig gap` wrote beside it"
                )
            one = replace(one, low=low, high=high)
        made.append(one)
    return made, list(left)
