"""The parameters of the nominal model, and the model that a setting of them gives.

A `Parameter` is one number of one effect on one axis (or the servo's K or tau). Values are
absolute: the nominal value (rig file) plus what the log adds. A periodic effect
A sin(n theta + phi) is parametrised by A cos(phi) ("sine") and A sin(phi) ("cosine"), in which the
model is linear.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from math import cos, hypot, inf, sin

import numpy as np

from calibration.gap.decision_rule import (
    ASSUMED_FRICTION_ERROR,
    MIN_EFFECT_SIZE,
    MIN_TOLERANCE_RATIO,
)
from calibration.gap.model.nuisances import WAIT_KEY, nuisances
from calibration.gap.model.nuisances import write as write_nuisances
from calibration.gap.model.record import (
    COAST_KEY,
    FALL_KEY,
    HEIGHT_KEY,
    IN_RECORD,
    PERIODIC,
    copied,
    derive,
    fields_of,
    places,
)
from calibration.gap.model.seen_effects import IN_BOTH, TOLD_TWINS, effects_in, in_ball
from rig.discrepancy import Discrepancy
from rig.discrepancy import pack as pack_unknown
from rig.effects import Effect, values
from rig.linkage import THREE_ARMS
from rig.parameters import Drive, Rig
from rig.plant.plant_record import pack

SERVO, BALL = ("servo_x", "servo_y"), "ball"
CALIBRATED = {"gain_rad_s_V": 0.05, "time_constant_s": 0.10}  # always fitted; beyond: recalibrate
# Steps of difference quotients: about the tolerances, for backlash and friction have no derivative.
STEPS = {
    "friction_V": 0.01, "settling_s": 0.001, "softness_rad_s": 0.01,
    "extra_V": 0.02, "speed_rad_s": 0.02, "half_width_V": 0.01,
    "positive_V": 0.01, "negative_V": 0.01, "fraction": 0.005, "offset_V": 0.01, "limit_V": 0.05,
    "fraction_1": 0.01,
    "delay_s": 0.001, "sine": 0.01, "cosine": 0.01, "periods_per_turn": 0.3, "rate_1_s": 5e-4,
    "drop_1_V": 0.002, "play_rad": 0.002, "offset_rad": 0.001, "coast_s2_rad": 0.01,
    "coefficient_1_rad": 0.02, "coefficient_1_rad2": 0.1, "slope_rad": 2e-4, "rate_rad_s": 1e-5,
    "stiffness_1_s2": 0.02, "deceleration_m_s2": 0.001, "extra_s": 0.001, "angle_rad": 0.003,
    "k1_1_m2": 0.1, "height_m": 0.002, "lag_s": 0.002, "limit_rad_s": 0.05,
    "half_width_rad": 0.001, "fall_1": 1.0, "motor_lag_s": 0.001, "as_dead_time_1": 0.2,
    "felt_weight_1": 0.1, "period_begin_s": 0.001, "frame_wait_s": 0.001,
}  # fmt: skip
OWN_STEPS = {
    "transmission_ripple.sine": 0.001,
    "transmission_ripple.cosine": 0.001,
    "viscous_drag.rate_1_s": 0.01,
}
SHAPE_STEP_SHARE = 0.01  # of the range of what shapes a lab's own effect; chosen
SLOWEST_STRIBECK_RAD_S = 0.04  # below, encoder counts cannot tell it from how friction sets in
# Ranges beyond the catalogue's, up to the supply: an H-bridge takes half of the volts.
REACHES_SUPPLY = ("friction_V", "half_width_V", "positive_V", "negative_V")
LONGEST_COAST_S2_RAD = 0.5
# Dry friction has an inner shape: the time constant with which it stops a motor.
SETTLING_KEY = "settling_s"
INNER_SHAPE = {
    "gear_backlash": [COAST_KEY],
    "joint_backlash": [FALL_KEY],
    "camera_scale": [HEIGHT_KEY],
}
GUESSES = (0.2, 0.5, 1.0, 2.0, 5.0)  # of the nominal K and tau: starts of a fit far from them


@dataclass(frozen=True)
class Parameter:
    """One number of the model, in the SI unit of its key.

    `effect`: its name in the rig's catalogue, "" for K and tau; `axis`: "x", "y" or "xy" (one value
    for both); `nominal`: its value in the rig file; `tolerance`: half width of what a rig without
    faults may have; `lower`, `upper`: the range of the effect; `step`: of its difference quotients;
    `loads`: True where the friction of arm and joints loads the motors; `in_ball`: the effect shows
    in the ball (`in_ball`); `in_both`: its parameters of either axis show in both servos' outputs.
    """

    effect: str
    key: str
    axis: str
    nominal: float
    tolerance: float
    lower: float
    upper: float
    step: float
    loads: bool = False
    in_ball: bool = False
    in_both: bool = False

    @property
    def name(self) -> str:
        """ "effect.key.axis"; it begins with "." for K and tau."""
        return f"{self.effect}.{self.key}.{self.axis}"

    def beside(self, key: str) -> str:
        """Name of the parameter `key` of the same effect on the same axis."""
        return f"{self.effect}.{key}.{self.axis}"

    @property
    def outputs(self) -> tuple[str, ...]:
        """The outputs that depend on the parameter; backlash in a joint whose friction loads the
        motor also frees the motor, so it moves the servo's output, too."""
        if self.effect == "joint_backlash" and self.loads:
            return (f"servo_{self.axis}", BALL)
        if self.in_ball:
            return (BALL,)
        return SERVO if self.in_both or self.axis == "xy" else (f"servo_{self.axis}",)

    @property
    def box(self) -> tuple[float, float]:
        """(low, high) of a rig without faults: nominal -+ tolerance, cut to the effect's range."""
        low, high = self.nominal - self.tolerance, self.nominal + self.tolerance
        return max(low, min(self.lower, self.nominal)), min(high, max(self.upper, self.nominal))

    @property
    def range(self) -> tuple[float, float]:
        """(low, high) of a rig with the effect; always holds the nominal value."""
        return min(self.lower, self.nominal), max(self.upper, self.nominal)


def _range(effect: Effect, key: str) -> tuple[float, float]:
    if key == COAST_KEY:
        return 0.0, LONGEST_COAST_S2_RAD
    if key == FALL_KEY:
        return 0.0, 1.0
    if key in ("sine", "cosine"):
        high = next(p.high for p in effect.parameters if p.key == PERIODIC[effect.name])
        return -high, high
    parameter = next(p for p in effect.parameters if p.key == key)
    return parameter.low, parameter.high


def _keys(effect: Effect) -> list[str]:
    if effect.name in PERIODIC:
        return ["sine", "cosine", "periods_per_turn"]
    return [p.key for p in effect.parameters] + INNER_SHAPE.get(effect.name, [])


def held_nm(drive: Drive) -> float:
    """Dry friction of arm and joint [N m]."""
    return drive.joint_friction_nm + drive.arm_friction_nm


class NominalModel:
    """The model as the rig file has it, and all its parameters by name ("effect.key.axis").

    `load_friction`: whether the assumed friction F [N m] of arm and joints loads the motors;
    through the joint's stiffness k [N m/rad] F also widens the backlash that the plate feels by 2
    F/k. `coasts`: whether arm and plate, where F does not load the motors, coast through the gap of
    the gears with nothing that brakes them, or stay where the teeth leave them. `tolerances`:
    effect -> half width of its first key, in place of the catalogue's. `row_s`: to how much frames
    are dated [s] (`clock.dated_to_s`). It cannot be pickled (see `Model`).
    """

    def __init__(
        self,
        rig: Rig,
        *,
        load_friction: bool,
        coasts: bool = True,
        tolerances: Mapping[str, float] | None = None,
        row_s: float = 0.0,
    ) -> None:
        self.rig, self.load_friction, self.row_s = rig, load_friction, row_s
        self.given_tolerances = tolerances
        self._record = pack(rig)
        drive = rig.drive
        self._wound = drive.joint_friction_nm / drive.joint_stiffness_nm_rad
        if not load_friction:
            self._record["arm_friction"] = self._wound = 0.0
            self._record["gear_coast"] = inf if coasts else 0.0
            # Of a servo that holds its angle, it holds the plate in its play.
            self._record["joint_friction"] *= float(rig.servo.takes_angle)
        self._places = places(self._record.dtype)
        self._record["period_begin_s"] = 0.5 * self._record["period_s"]
        self._record["frame_wait_s"] = 0.5 * row_s
        self.coasts = bool(np.any(self._record["gear_coast"]))
        self.plate_may_fall = not (self._record["joint_friction"] or rig.servo.takes_angle)
        self.effects = effects_in(rig)
        self.catalogue = {**rig.catalogue, **{effect.name: effect for effect in self.effects}}
        self._own = {one.effect.name: slot for slot, one in enumerate(rig.own)}
        known = self.catalogue.values()
        self._tolerances = {e.name: e.tolerance for e in known} | dict(tolerances or {})
        # The motor's own friction is known no better than that of its load. Where the logs refute
        # that one, what a rig file tells of it may be the motor's; what nobody told may not.
        held_V = held_nm(rig.drive) / rig.servo.torque_per_volt_nm
        told_V = 0.0 if held_nm(rig.drive) == held_nm(Drive()) else held_V
        self.assumed_friction_V = held_V if load_friction else 0.0
        self.friction_slack_V = ASSUMED_FRICTION_ERROR * self.assumed_friction_V
        if "coulomb_friction" not in (tolerances or {}):
            more_V = self.friction_slack_V or told_V
            self._tolerances["coulomb_friction"] += more_V
        self._start = {name: tuple(pair) for name, pair in values(rig.effects, known).items()}
        self.parameters = {parameter.name: parameter for parameter in self._all()}

    def __reduce__(self) -> str:
        raise TypeError("a NominalModel stays in its process: send the rig instead")

    def _all(self) -> Iterable[Parameter]:
        servo = self.rig.servo
        for key in () if servo.takes_angle else CALIBRATED:
            nominal = getattr(servo, key)
            for axis in "xy":
                yield Parameter(
                    "", key, axis, nominal, inf, nominal / 12, nominal * 12, 0.02 * nominal
                )
        both = self.rig.linkage.kind == THREE_ARMS
        for key, axis, nominal, tolerance, ends in nuisances(self.rig, self.row_s):
            seen = key == WAIT_KEY or not servo.has_angle
            shown = {"in_ball": seen, "in_both": both}
            yield Parameter("", key, axis, nominal, tolerance, *ends, STEPS[key], **shown)
        for effect in self.effects:
            for axis in effect.axes:
                for key in _keys(effect):
                    yield self._parameter(effect, key, axis)

    def is_own(self, name: str) -> bool:
        """Whether an effect is one of a lab's own (`rig.own_effects`)."""
        return name in self._own

    def _own_parameter(self, effect: Effect, key: str, axis: str) -> Parameter:
        """A parameter of a lab's own effect. The first is its size, whose step is the tolerance;
        the others are its shape, whose steps are SHAPE_STEP_SHARE of their range.

        Without a size in the rig file its shape is not known: it is free only where it is released,
        and a file that is named changes nothing of the baseline.
        """
        first = effect.parameters[0].key == key
        low, high = _range(effect, key)
        nominal = self._nominal(effect.name, key, 1 if axis == "y" else 0)
        known = first and nominal != effect.parameters[0].null
        tolerance = self._tolerances[effect.name] if known else 0.0
        step = effect.tolerance if first else SHAPE_STEP_SHARE * (high - low)
        return Parameter(
            effect.name, key, axis, nominal, tolerance, low, high, step, in_ball=in_ball(effect)
        )

    def _parameter(self, effect: Effect, key: str, axis: str) -> Parameter:
        if self.is_own(effect.name):
            return self._own_parameter(effect, key, axis)
        first = _keys(effect)[0] == key
        sized = first and effect.name not in PERIODIC
        tolerance = self.tolerance(effect.name, axis) if sized else 0.0
        gear = effect.name == "gear_backlash" and max(self._start["gear_backlash_play_rad"]) == 0.0
        if gear and self.load_friction:
            tolerance = 0.0  # below one count, beside shafts that wind up, it is not identifiable
        if key == HEIGHT_KEY:  # the diameter, as where the ball's lowest point or its top is told
            high = 2.0 * self.rig.ball.radius_m
            low = -high
        else:
            low, high = _range(effect, key)
        if key in REACHES_SUPPLY:
            high = max(high, self.rig.servo.voltage_limit_V)
        if key in ("limit_V", "limit_rad_s"):
            low, high = STEPS[key], inf
        if key == "speed_rad_s":
            low = SLOWEST_STRIBECK_RAD_S
        step = OWN_STEPS.get(f"{effect.name}.{key}", STEPS[key])
        nominal = self._nominal(effect.name, key, 1 if axis == "y" else 0)
        shown = self.load_friction, in_ball(effect), effect.side == IN_BOTH
        return Parameter(effect.name, key, axis, nominal, tolerance, low, high, step, *shown)

    def _nominal(self, name: str, key: str, a: int) -> float:
        if name in PERIODIC and key != "periods_per_turn":
            size, phase = (self._start[f"{name}_{k}"][a] for k in (PERIODIC[name], "phase_rad"))
            return size * (cos(phase) if key == "sine" else sin(phase))
        if key in IN_RECORD:
            return float(np.broadcast_to(self._record[IN_RECORD[key]], 2)[a])
        if name == "dead_zone" and key != "half_width_V":
            return self._start[f"{name}_{key}"][a] - self._start["dead_zone_half_width_V"][a]
        return float(self._start[f"{name}_{key}"][a])

    def tolerance(self, name: str, axis: str) -> float:
        """Half width of what a rig without faults may have of an effect on an axis [unit of its
        first key].

        Of twins (TOLD_TWINS) one is tried, so it has what all of them may have together; a zero of
        the servo tilts the plate by the lever 2 r/L of it. Tolerances learned from logs hold it.
        """
        own = self._tolerances[name]
        if (
            name in (self.given_tolerances or ())
            or self.rig.servo.has_angle
            or name not in TOLD_TWINS
        ):
            return own
        lever = self.rig.linkage.ratios["xy".index(axis)] if name == "level_offset" else 1.0
        return own + lever * sum(self._tolerances.get(twin, 0.0) for twin in TOLD_TWINS[name])

    def exceeds_minimum(self, name: str, axis: str, setting: Mapping[str, float]) -> bool:
        """Whether the effect on this axis departs from nominal in `setting` by at least the
        decision rule's minimum: the larger of MIN_EFFECT_SIZE and MIN_TOLERANCE_RATIO times the
        tolerance. A servo's fastest rate is its K times its volts: the rig file's is known no
        better than a K."""
        if name == "rate_limit":
            known = self.rig.servo.on(axis).rate_limit_rad_s
            limit = setting.get(f"{name}.limit_rad_s.{axis}", inf)
            return limit < (1.0 - CALIBRATED["gain_rad_s_V"]) * known
        size = [abs(setting.get(k.name, k.nominal) - k.nominal) for k in self.of(name, axis)]
        tolerance = self.tolerance(name, axis)
        least = max(MIN_EFFECT_SIZE.get(name, 0.0), MIN_TOLERANCE_RATIO * tolerance)
        if name == "stribeck_friction":
            least += self.friction_slack_V
        if name == "dead_zone":
            return size[0] + max(size[1:]) >= least
        return (hypot(*size[:2]) if name in PERIODIC else size[0]) >= least

    def with_unknown(self, unknown: Discrepancy) -> "NominalModel":
        """A copy of the model with an unnamed term in it."""
        other = object.__new__(NominalModel)
        other.__dict__.update(self.__dict__)
        other.rig = replace(self.rig, unknown=unknown)
        other._record = self._record.copy()
        other._record["unknown"] = pack_unknown(unknown, self.rig.servo.angle_limit_rad)
        return other

    def of(self, name: str, axis: str | None = None) -> list[Parameter]:
        """The parameters of the effect `name`, on all axes (None) or one."""
        return [k for k in self.parameters.values() if k.effect == name and axis in (None, k.axis)]

    def model(self, setting: Mapping[str, float]) -> "Model":
        """The model at `setting` (parameter name -> value); parameters that are not in it keep
        their nominal value. `KeyError`: no such parameter."""
        record, numbers = copied(self._record)
        servo = self.rig.servo
        gain, tau = [servo.gain_rad_s_V] * 2, [servo.time_constant_s] * 2
        touched, calibrated = {}, {}
        for name, value in setting.items():
            parameter = self.parameters[name]
            if not parameter.effect:
                calibrated.setdefault("xy".index(parameter.axis), {})[parameter.key] = value
                continue
            for a in {"x": (0,), "y": (1,), "xy": (0, 1)}[parameter.axis]:
                touched.setdefault((parameter.effect, a), {})[parameter.key] = value
        for a, given in calibrated.items():
            gain[a] = given.get("gain_rad_s_V", gain[a])
            tau[a] = given.get("time_constant_s", tau[a])
            write_nuisances(numbers, self._places, a, given)
        for (effect, a), given in touched.items():
            if self.is_own(effect):
                self._set_own(record, effect, a, given)
                continue
            for field, value in fields_of(effect, given, partial(self._nominal, effect, a=a)):
                numbers[self._places[field][a]] = value
        derive(numbers, self._places, self._wound)
        return Model(record, (gain[0], gain[1]), (tau[0], tau[1]))

    def _set_own(self, p: np.record, name: str, a: int, given: Mapping[str, float]) -> None:
        """Write the parameters of a lab's own effect into the plant's record."""
        for i, parameter in enumerate(self.catalogue[name].parameters):
            if parameter.key in given:
                p["own"]["values"][a, self._own[name], i] = given[parameter.key]


@dataclass(frozen=True, eq=False)
class Model:
    """A model ready to predict: the plant's record, and K and tau of the axes x and y. It cannot be
    pickled: a record may hold addresses of this process (`rig.plant.own_equations`)."""

    record: np.record
    gain_rad_s_V: tuple[float, float]
    time_constant_s: tuple[float, float]

    def __reduce__(self) -> str:
        raise TypeError("a Model stays in its process: send the rig and the setting instead")


def released(
    effect: Effect, axis: str, nominal: NominalModel, setting: Mapping[str, float]
) -> list[Parameter]:
    """The parameters that become free when the effect is tried on an axis: all of a periodic,
    of Stribeck friction or of a lab's own effect, the first of any other, and those of the inner
    shape where `setting` (parameter name -> value) has already departed from zero there."""
    parameters = nominal.of(effect.name, axis)
    if effect.name in (*PERIODIC, "stribeck_friction") or nominal.is_own(effect.name):
        return parameters
    for key in (COAST_KEY, HEIGHT_KEY, SETTLING_KEY):
        if setting.get(f"{effect.name}.{key}.{axis}"):
            return [parameters[0], *(k for k in parameters if k.key == key)]
    return parameters[:1]
