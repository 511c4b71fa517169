"""The catalogue of effects: the one list that simulator, rig file, gap workflow and CLI read.

An effect is a named group of parameters whose null values leave the model unchanged. Its equation
is one compiled function in `effect_equations.py`; play is in `shaft.py`, delays are in `plant.py`
and `statistical_camera.py`, what befalls a commanded angle is in `position_servo.py`. On the way to
the motor volts meet, in this order: delay, saturation, sag, dead zone, asymmetry, drift, offset,
cogging, friction. A commanded angle meets dead time, scale, zero, dead band, lag, rate limit.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from math import inf, radians

import numpy as np

from rig.files import known_names

PER_AXIS = ("x", "y")
SHARED = ("xy",)
VOLTS, ANGLES = ("voltage",), ("position",)


@dataclass(frozen=True)
class Parameter:
    """One number of an effect: key in `rig.toml`, null value, unit, sensible range low to high.

    At its null value the parameter leaves the model unchanged.
    """

    key: str
    null: float
    unit: str
    low: float
    high: float


@dataclass(frozen=True)
class Effect:
    """One effect of the catalogue: its name in `rig.toml`, its parameters, a sentence about it.

    side: "servo", "ball" or "camera"; axes: the keys that it takes in `rig.toml`, ("x", "y") or,
    where one value holds for both axes, ("xy",); tolerance: size of the first
    parameter below which a well-kept rig counts as free of the effect, in that parameter's unit (0:
    none declared); servos: the kinds of servo that can have it.
    """

    name: str
    side: str  # servo, ball or camera: the residual channel in which it shows
    axes: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    tolerance: float  # of the first parameter: what a well-kept rig meets; 0 = none declared
    sentence: str
    servos: tuple[str, ...] = ("voltage", "position")

    def field(self, key: str) -> str:
        """Name of the parameter `key` in the plant's record: NAME_KEY."""
        return f"{self.name}_{key}"


def _p(key: str, unit: str, low: float, high: float, null: float = 0.0) -> Parameter:
    return Parameter(key, null, unit, low, high)


_TURN = (_p("phase_rad", "rad", -3.1416, 3.1416), _p("periods_per_turn", "1", 1, 100, 1.0))
_DEG = radians(1)

# A linkage's ranges end where the plate would turn back at 0.25 rad.
CATALOGUE: tuple[Effect, ...] = (
    Effect("coulomb_friction", "servo", PER_AXIS,
           (_p("friction_V", "V", 0, 1), _p("settling_s", "s", 0, 0.1),
            _p("softness_rad_s", "rad/s", 0, 1)), 0.015,
           "Dry friction: the motor needs this many volts before it moves, and loses them moving.",
           VOLTS),
    Effect("stribeck_friction", "servo", PER_AXIS,
           (_p("extra_V", "V", 0, 1), _p("speed_rad_s", "rad/s", 0.01, 2, 0.1)), 0.0,
           "Friction is higher near standstill and falls as the servo gets faster.", VOLTS),
    Effect("dead_zone", "servo", PER_AXIS,
           tuple(_p(key, "V", 0, 1) for key in ("half_width_V", "positive_V", "negative_V")), 0.01,
           "The amplifier gives nothing for small commands; larger ones arrive reduced.", VOLTS),
    Effect("gain_asymmetry", "servo", PER_AXIS, (_p("fraction", "1", -0.5, 0.5),), 0.005,
           "The drive is stronger in one direction than in the other.", VOLTS),
    Effect("viscous_asymmetry", "servo", PER_AXIS, (_p("fraction_1", "1", -0.8, 0.8),), 0.0,
           "Viscous friction brakes more in one direction than in the other.", VOLTS),
    Effect("voltage_offset", "servo", PER_AXIS, (_p("offset_V", "V", -1, 1),), 0.02,
           "A constant voltage is added to every command.", VOLTS),
    Effect("saturation", "servo", PER_AXIS, (_p("limit_V", "V", 0.5, 6, inf),), 0.0,
           "The supply cannot give the volts that the rig's limit allows.", VOLTS),
    Effect("input_delay", "servo", PER_AXIS, (_p("delay_s", "s", 0, 0.1),), 0.002,
           "Volts reach the motor later than they were commanded.", VOLTS),
    Effect("cogging", "servo", PER_AXIS, (_p("amplitude_V", "V", 0, 1), *_TURN), 0.0,
           "The motor pulls towards fixed angles, with a period along the turn.", VOLTS),
    Effect("gain_drift", "servo", PER_AXIS, (_p("rate_1_s", "1/s", -0.01, 0.01),), 0.0,
           "The drive gets weaker (or stronger) during the run, as from warming up.", VOLTS),
    Effect("supply_sag", "servo", SHARED, (_p("drop_1_V", "1/V", 0, 0.05),), 0.0,
           "The supply drops when both motors draw current at once.", VOLTS),
    Effect("gear_backlash", "servo", PER_AXIS,
           (_p("play_rad", "rad", 0, 0.1), _p("offset_rad", "rad", -0.05, 0.05)), 0.02 * _DEG,
           "Free play in the gears, between motor and encoder (full width).", VOLTS),
    Effect("servo_lag", "servo", PER_AXIS, (_p("lag_s", "s", -0.05, 0.5),), 0.005,
           "The servo follows its command with more lag than the rig file says.", ANGLES),
    Effect("servo_dead_time", "servo", PER_AXIS, (_p("delay_s", "s", 0, 0.2),), 0.003,
           "The servo answers a command later than the rig file says.", ANGLES),
    Effect("rate_limit", "servo", PER_AXIS, (_p("limit_rad_s", "rad/s", 0.1, 10, inf),), 0.0,
           "The servo cannot turn as fast as the rig file says.", ANGLES),
    Effect("command_dead_band", "servo", PER_AXIS, (_p("half_width_rad", "rad", 0, 0.1),),
           0.1 * _DEG, "The servo does not answer small changes, and stops short of its command.",
           ANGLES),
    Effect("angle_scale", "servo", PER_AXIS, (_p("fraction", "1", -0.5, 0.5),), 0.01,
           "The servo turns further, or less far, than it is told.", ANGLES),
    Effect("angle_zero", "servo", PER_AXIS, (_p("offset_rad", "rad", -0.2, 0.2),), 0.1 * _DEG,
           "The servo stands beside the angle that it is told.", ANGLES),
    Effect("joint_backlash", "ball", PER_AXIS,
           (_p("play_rad", "rad", 0, 0.1), _p("offset_rad", "rad", -0.05, 0.05)), 0.08 * _DEG,
           "Free play in the joints, between encoder and plate (full width); the ball shows it."),
    Effect("transmission_ripple", "ball", PER_AXIS, (_p("amplitude_rad", "rad", 0, 0.05), *_TURN),
           0.0, "The plate's angle errs with a period along the servo's turn (kinematic error)."),
    Effect("linkage_quadratic", "ball", PER_AXIS, (_p("coefficient_1_rad", "1/rad", -2, 2),), 0.01,
           "The linkage is bent: more tilt per angle on one side than on the other."),
    Effect("linkage_cubic", "ball", PER_AXIS, (_p("coefficient_1_rad2", "1/rad2", -5, 5),), 0.0,
           "The linkage's gain changes with the angle, alike on both sides."),
    Effect("cross_coupling", "ball", PER_AXIS, (_p("fraction", "1", -0.3, 0.3),), 0.003,
           "The other axis's servo also tilts the plate about this axis."),
    Effect("level_offset", "ball", PER_AXIS, (_p("slope_rad", "rad", -0.05, 0.05),), 0.02 * _DEG,
           "The plate is not level when the servo reads zero."),
    Effect("level_drift", "ball", PER_AXIS, (_p("rate_rad_s", "rad/s", -0.001, 0.001),), 0.0,
           "The level changes slowly during the run."),
    Effect("plate_bowl", "ball", SHARED, (_p("stiffness_1_s2", "1/s2", -10, 10),), 0.0,
           "The plate is curved like a bowl (or a hill, if negative)."),
    Effect("rolling_resistance", "ball", SHARED, (_p("deceleration_m_s2", "m/s2", 0, 0.5),), 0.0015,
           "The ball is slowed by a constant amount while it rolls and may stick at rest."),
    Effect("viscous_drag", "ball", SHARED, (_p("rate_1_s", "1/s", 0, 5),), 0.0,
           "The ball is slowed in proportion to its speed."),
    Effect("camera_delay", "camera", SHARED, (_p("extra_s", "s", -0.02, 0.4),), 0.002,
           "The camera's picture is older than the rig file says."),
    Effect("camera_scale", "camera", SHARED, (_p("fraction", "1", -0.5, 1),), 0.003,
           "The camera sees distances too long or too short."),
    Effect("camera_yaw", "camera", SHARED, (_p("angle_rad", "rad", -0.2, 0.2),), 0.15 * _DEG,
           "The camera is turned against the plate."),
    Effect("lens_distortion", "camera", SHARED, (_p("k1_1_m2", "1/m2", -5, 5),), 0.1,
           "The lens bends straight lines: errors grow towards the plate's edge."),
)  # fmt: skip

BY_NAME: dict[str, Effect] = {effect.name: effect for effect in CATALOGUE}


def effects_of(kind: str, known: Iterable[Effect] = CATALOGUE) -> tuple[Effect, ...]:
    """Return those of the `known` effects that a table with servos of this kind can have, in their
    order.
    """
    return tuple(effect for effect in known if kind in effect.servos)


def check_servos(names: Iterable[str], kind: str, known: Mapping[str, Effect] = BY_NAME) -> None:
    """Raise ValueError where servos of this kind cannot have an effect; names that are not `known`
    pass.
    """
    for name in names:
        effect = known.get(name)
        if effect is not None and kind not in effect.servos:
            have = ", ".join(one.name for one in effects_of(kind, known.values()))
            raise ValueError(f"effect '{name}' is not one of {kind} servos; known: {have}")


def fields(known: Iterable[Effect] = CATALOGUE) -> Iterator[tuple[str, Effect, Parameter]]:
    """Yield every parameter as (field name, effect, parameter), in the order of the effects."""
    for effect in known:
        for parameter in effect.parameters:
            yield effect.field(parameter.key), effect, parameter


def check(
    effects: Mapping[str, Mapping[str, Mapping[str, float]]],
    known: Mapping[str, Effect] = BY_NAME,
) -> None:
    """Raise ValueError unless `effects` {name: {axis: {key: value}}} fits the `known` ones.

    ValueError: a name, axis or key that is not known (the message lists the known ones), a value
    that is not finite, has the wrong sign or lies far outside its sensible range, or an
    `offset_rad` beyond half of its `play_rad`.
    """
    for name, by_axis in effects.items():
        effect = known.get(name)
        if effect is None:
            raise ValueError(f"unknown effect '{name}'; {known_names(name, known)}")
        keys = [p.key for p in effect.parameters]
        for axis, values in by_axis.items():
            if axis not in effect.axes:
                axes = ", ".join(effect.axes)
                raise ValueError(f"effect '{name}' has no axis '{axis}'; known: {axes}")
            for key, value in values.items():
                if key not in keys:
                    raise ValueError(
                        f"effect '{name}' has no key '{key}'; {known_names(key, keys)}"
                    )
                _check_number(effect, axis, key, value)
        if name in BY_NAME:
            _check_play(name, by_axis)


# An estimate of these may come out below zero though no sensible value does: a wind that drives the
# ball, a supply that rises under load.
_EITHER_SIGN = ("supply_sag_drop_1_V", "viscous_drag_rate_1_s")
LONGEST_DELAY_S = {"input_delay": 0.1, "servo_dead_time": 0.5}
GROSS = 30  # so many times beyond the sensible range is a slip of units or of the point


def _check_number(effect: Effect, axis: str, key: str, value: float) -> None:
    """One value of an effect: finite unless its null value is not, of the sign of its sensible
    range, zero only where the range or the null value is.
    """
    name, label = effect.name, f"effect '{effect.name}', {axis}.{key} = {value:g}"
    parameter = next(p for p in effect.parameters if p.key == key)
    if value != value or (abs(value) == inf and parameter.null != inf):
        raise ValueError(f"{label}: must be finite")
    if value <= 0 < parameter.low and parameter.null != 0:
        raise ValueError(f"{label}: must be above 0")
    if value < 0 <= parameter.low and effect.field(key) not in _EITHER_SIGN:
        raise ValueError(f"{label}: must be >= 0")
    most = GROSS * max(abs(parameter.low), abs(parameter.high))
    if most < abs(value) < inf and key != "phase_rad":
        sensible = f"{parameter.low:g} to {parameter.high:g} {parameter.unit}"
        raise ValueError(f"{label}: no table is like that (sensible: {sensible})")
    if value > LONGEST_DELAY_S.get(name, inf):
        raise ValueError(f"{label}: must be at most {LONGEST_DELAY_S[name]:g} s")
    if name == "cross_coupling" and abs(value) >= 1:
        raise ValueError(f"{label}: must lie between -1 and 1")


def _check_play(name: str, by_axis: Mapping[str, Mapping[str, float]]) -> None:
    """The middle of a play may lie off zero, but zero stays inside: else the shaft is twisted."""
    for axis, pairs in by_axis.items():
        if not any(p.key == "play_rad" for p in BY_NAME[name].parameters):
            continue
        offset, width = pairs.get("offset_rad", 0.0), pairs.get("play_rad", 0.0)
        if abs(offset) > width / 2:
            raise ValueError(
                f"effect '{name}', {axis}.offset_rad = {offset:g}: must be at most half of "
                f"play_rad ({width / 2:g})"
            )


def values(
    effects: Mapping[str, Mapping[str, Mapping[str, float]]], known: Iterable[Effect] = CATALOGUE
) -> dict[str, np.ndarray]:
    """Return field name -> values of both axes (2,), from effects {name: {axis: {key: value}}} of
    the `known` ones.

    A field that `effects` does not name holds its null value. `dead_zone_half_width_V` is added to
    both `dead_zone_positive_V` and `dead_zone_negative_V`. ValueError: as `check` raises it.
    """
    by_name = {effect.name: effect for effect in known}
    check(effects, by_name)
    table = {name: np.full(2, parameter.null) for name, _, parameter in fields(by_name.values())}
    for name, by_axis in effects.items():
        effect = by_name[name]
        for axis, pairs in by_axis.items():
            where = {"x": 0, "y": 1}.get(axis, slice(None))
            for key, value in pairs.items():
                table[effect.field(key)][where] = value
    both_sides = table["dead_zone_half_width_V"]
    table["dead_zone_positive_V"] += both_sides
    table["dead_zone_negative_V"] += both_sides
    return table
