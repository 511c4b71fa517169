"""Every number that the gap workflow may turn, and the model that a setting of them gives.

A knob is one parameter of one effect on one axis (or the servo's K or tau). Values are absolute:
believed value (rig file) plus what the log adds. A periodic effect A sin(n theta + phi) is turned
by its sine and cosine parts, A cos(phi) and A sin(phi), in which the model is linear.
"""

from collections.abc import Callable, Iterable, Mapping
from copy import copy
from dataclasses import dataclass, replace
from math import atan2, cos, hypot, inf, sin

import numpy as np

from rig.effects import BY_NAME, CATALOGUE, Effect, values
from rig.parameters import Rig
from rig.plant_record import pack
from rig.unknown import Unknown
from rig.unknown import pack as pack_unknown

PERIODIC = {"cogging": "amplitude_V", "transmission_ripple": "amplitude_rad"}
SERVO, BALL = ("servo_x", "servo_y"), "ball"
CALIBRATED = {"gain_rad_s_V": 0.05, "time_constant_s": 0.10}  # always fitted; beyond: recalibrate
# Steps of difference quotients: as large as what matters, for play and friction have no derivative.
STEPS = {
    "friction_V": 0.01, "extra_V": 0.02, "speed_rad_s": 0.02, "half_width_V": 0.01,
    "positive_V": 0.01, "negative_V": 0.01, "fraction": 0.005, "offset_V": 0.01, "limit_V": 0.05,
    "delay_s": 0.001, "sine": 0.01, "cosine": 0.01, "periods_per_turn": 0.3, "rate_1_s": 5e-4,
    "drop_1_V": 0.002, "play_rad": 0.002, "offset_rad": 0.001, "coast_s2_rad": 0.01,
    "coefficient_1_rad": 0.02,
    "coefficient_1_rad2": 0.1, "slope_rad": 2e-4, "rate_rad_s": 1e-5, "stiffness_1_s2": 0.02,
    "deceleration_m_s2": 0.001, "extra_s": 0.001, "angle_rad": 0.003, "k1_1_m2": 0.1,
    "height_m": 0.002,
}  # fmt: skip
SLOWEST_STRIBECK_RAD_S = 0.04  # below, an encoder's counts cannot tell it from how friction sets in
OWN_STEPS = {"transmission_ripple.sine": 0.001, "transmission_ripple.cosine": 0.001,
             "viscous_drag.rate_1_s": 0.01}  # fmt: skip


# Sizes below which an effect without a box is no effect: it stands in for small faults elsewhere.
LEAST = {
    "stribeck_friction": 0.018, "cogging": 0.015, "gain_drift": 8e-4, "supply_sag": 0.0105,
    "gear_backlash": 0.0012, "transmission_ripple": 0.0015, "linkage_cubic": 0.25,
    "level_drift": 8e-6, "plate_bowl": 0.015, "viscous_drag": 0.014, "lens_distortion": 0.3,
}  # fmt: skip
# Other people's rigs: an H-bridge swallows half of the volts (these reach up to the supply), a ball
# in a groove rolls with half of 5/7 g, a web camera is 0.2 s late.
VOLTS = ("friction_V", "half_width_V", "positive_V", "negative_V")
FARTHER = {"camera_scale.fraction": (-0.5, 1.0), "camera_delay.extra_s": (-0.02, 0.3)}
# The gear's play has an inner shape: how far arm and plate coast in the gap (rig.plant_record).
COAST, LONGEST_COAST_S2_RAD = "coast_s2_rad", 0.5
# That of a scale: a ball higher than believed seems larger, and shifted as the plate tilts.
HEIGHT, HIGHEST_M = "height_m", 0.1
INNER = {"gear_backlash": [COAST], "camera_scale": [HEIGHT]}
IN_RECORD = {COAST: "gear_coast", HEIGHT: "camera_height"}  # of what no catalogue names
CLEARLY = 1.2  # times its tolerance: a name needs as much; at its edge anything may stand in
ASSUMED_FRICTION = 0.015  # share by which the assumed friction of arm and joints may err


@dataclass(frozen=True)
class Knob:
    """One number: its effect ("" for K and tau), key, axis ("x", "y", "xy"), believed value and
    half width of its tolerance, the range that it may take, and the step of its differences.
    loads: the plate's friction loads the motors."""

    effect: str
    key: str
    axis: str
    believed: float
    tolerance: float
    low: float
    high: float
    step: float
    loads: bool = False

    @property
    def name(self) -> str:
        return f"{self.effect}.{self.key}.{self.axis}"

    @property
    def parts(self) -> tuple[str, ...]:
        """The parts of the evidence that feel it (a play in the joint frees the motor, too)."""
        if self.effect == "joint_backlash" and self.loads:
            return (f"servo_{self.axis}", BALL)
        if self.effect and BY_NAME[self.effect].side != "servo":
            return (BALL,)
        return SERVO if self.axis == "xy" else (f"servo_{self.axis}",)

    @property
    def box(self) -> tuple[float, float]:
        """Where a rig without faults may have it."""
        low, high = self.believed - self.tolerance, self.believed + self.tolerance
        return max(low, min(self.low, self.believed)), min(high, max(self.high, self.believed))

    @property
    def range(self) -> tuple[float, float]:
        """Where the named effect may have it."""
        return min(self.low, self.believed), max(self.high, self.believed)


def _range(effect: Effect, key: str) -> tuple[float, float]:
    if key == COAST:
        return 0.0, LONGEST_COAST_S2_RAD
    if key == HEIGHT:
        return -HIGHEST_M, HIGHEST_M
    if key in ("sine", "cosine"):
        high = next(p.high for p in effect.parameters if p.key == PERIODIC[effect.name])
        return -high, high
    parameter = next(p for p in effect.parameters if p.key == key)
    return FARTHER.get(f"{effect.name}.{key}", (parameter.low, parameter.high))


def _keys(effect: Effect) -> list[str]:
    if effect.name in PERIODIC:
        return ["sine", "cosine", "periods_per_turn"]
    return [p.key for p in effect.parameters] + INNER.get(effect.name, [])


class Believed:
    """The model as the rig file has it, and every knob on it.

    load_friction: whether the assumed friction of arm and joints loads the motors; wound up in the
    joint's shaft it also widens the play that the plate feels by 2 F/k. tolerances: name -> half
    width of the first key.
    """

    def __init__(
        self, rig: Rig, *, load_friction: bool, tolerances: Mapping[str, float] | None = None
    ) -> None:
        self.rig, self.load_friction = rig, load_friction
        self._record = pack(rig)
        drive = rig.drive
        self._wound = drive.joint_friction_nm / drive.joint_stiffness_nm_rad
        if not load_friction:
            self._record["arm_friction"] = self._record["joint_friction"] = self._wound = 0.0
        self._tolerances = {e.name: e.tolerance for e in CATALOGUE} | dict(tolerances or {})
        # What the motor's friction is taken for cannot be better than the assumed load's.
        held = rig.drive.joint_friction_nm + rig.drive.arm_friction_nm
        self.assumed_friction_V = held / rig.servo.torque_per_volt_nm if load_friction else 0.0
        self.friction_slack_V = ASSUMED_FRICTION * self.assumed_friction_V
        if load_friction and "coulomb_friction" not in (tolerances or {}):
            self._tolerances["coulomb_friction"] += self.friction_slack_V
        self._start = {name: tuple(pair) for name, pair in values(rig.effects).items()}
        self.knobs = {knob.name: knob for knob in self._all()}

    def _all(self) -> Iterable[Knob]:
        servo = self.rig.servo
        for key in CALIBRATED:
            nominal = getattr(servo, key)
            for axis in "xy":
                yield Knob("", key, axis, nominal, inf, nominal / 12, nominal * 12,
                           0.02 * nominal)  # fmt: skip
        for effect in CATALOGUE:
            for axis in effect.axes:
                for key in _keys(effect):
                    yield self._knob(effect, key, axis)

    def _knob(self, effect: Effect, key: str, axis: str) -> Knob:
        first = _keys(effect)[0] == key
        tolerance = self._tolerances[effect.name] if first and effect.name not in PERIODIC else 0.0
        gear = effect.name == "gear_backlash" and max(self._start["gear_backlash_play_rad"]) == 0.0
        if gear and self.load_friction:
            tolerance = 0.0  # below the encoder's count, beside winding shafts, it fits anything
        low, high = _range(effect, key)
        if key in VOLTS:
            high = max(high, self.rig.servo.voltage_limit_V)
        if key == "limit_V":
            high = inf
        if key == "speed_rad_s":
            low = SLOWEST_STRIBECK_RAD_S
        step = OWN_STEPS.get(f"{effect.name}.{key}", STEPS[key])
        believed = self._believed(effect.name, key, 1 if axis == "y" else 0)
        return Knob(
            effect.name, key, axis, believed, tolerance, low, high, step, self.load_friction
        )

    def _believed(self, name: str, key: str, a: int) -> float:
        if name in PERIODIC and key != "periods_per_turn":
            size, phase = (self._start[f"{name}_{k}"][a] for k in (PERIODIC[name], "phase_rad"))
            return size * (cos(phase) if key == "sine" else sin(phase))
        if key in IN_RECORD:
            return float(np.broadcast_to(self._record[IN_RECORD[key]], 2)[a])
        if name == "dead_zone" and key != "half_width_V":
            return self._start[f"{name}_{key}"][a] - self._start["dead_zone_half_width_V"][a]
        return float(self._start[f"{name}_{key}"][a])

    def beyond(self, name: str, axis: str, setting: Mapping[str, float]) -> bool:
        """Is the effect on this axis larger than what counts as no effect?"""
        size = [abs(setting.get(k.name, k.believed) - k.believed) for k in self.of(name, axis)]
        least = max(LEAST.get(name, 0.0), CLEARLY * self._tolerances[name])
        if name == "stribeck_friction":
            least += self.friction_slack_V
        if name == "dead_zone":
            return size[0] + max(size[1:]) >= least
        return (hypot(*size[:2]) if name in PERIODIC else size[0]) >= least

    def with_unknown(self, unknown: Unknown) -> "Believed":
        """The same with an unnamed term in the model."""
        other = copy(self)
        other.rig = replace(self.rig, unknown=unknown)
        other._record = self._record.copy()
        other._record["unknown"] = pack_unknown(unknown, self.rig.servo.angle_limit_rad)
        return other

    def of(self, name: str, axis: str | None = None) -> list[Knob]:
        """The knobs of an effect, all axes or one."""
        return [k for k in self.knobs.values() if k.effect == name and axis in (None, k.axis)]

    def model(self, setting: Mapping[str, float]) -> "Model":
        """The model with the given knobs (by name) away from their believed values."""
        p = self._record.copy()
        servo = self.rig.servo
        gain, tau = [servo.gain_rad_s_V] * 2, [servo.time_constant_s] * 2
        touched = {}
        for name, value in setting.items():
            knob = self.knobs[name]
            if not knob.effect:
                (gain if knob.key == "gain_rad_s_V" else tau)["xy".index(knob.axis)] = value
                continue
            for a in {"x": (0,), "y": (1,), "xy": (0, 1)}[knob.axis]:
                touched.setdefault((knob.effect, a), {})[knob.key] = value
        for (effect, a), given in touched.items():
            _set(p, effect, a, given, lambda key, e=effect, b=a: self._believed(e, key, b))
        for shaft, wound in (("gear", 0.0), ("joint", self._wound)):
            half = p[f"{shaft}_backlash_play_rad"] / 2 + wound
            centre = p[f"{shaft}_backlash_offset_rad"]
            p[f"{shaft}_1"], p[f"{shaft}_2"] = centre + half, centre - half
        return Model(p, (gain[0], gain[1]), (tau[0], tau[1]))


def _set(
    p: np.record, effect: str, a: int, given: dict[str, float], believed: Callable[[str], float]
) -> None:
    """Write an effect's knobs into the plant's record."""
    if effect in PERIODIC:
        sine, cosine = (given[k] if k in given else believed(k) for k in ("sine", "cosine"))
        p[f"{effect}_{PERIODIC[effect]}"][a] = hypot(sine, cosine)
        p[f"{effect}_phase_rad"][a] = atan2(cosine, sine)
        if "periods_per_turn" in given:
            p[f"{effect}_periods_per_turn"][a] = given["periods_per_turn"]
        return
    if effect == "dead_zone":
        both, plus, minus = (
            given[k] if k in given else believed(k)
            for k in ("half_width_V", "positive_V", "negative_V")
        )
        p["dead_zone_positive_V"][a], p["dead_zone_negative_V"][a] = both + plus, both + minus
        return
    for key, value in given.items():
        if key == HEIGHT:
            p["camera_height"] = value
        else:
            p[IN_RECORD.get(key, f"{effect}_{key}")][a] = value


@dataclass(frozen=True, eq=False)
class Model:
    """A model ready to predict: the plant's record, and K and tau of both axes."""

    record: np.record
    gain_rad_s_V: tuple[float, float]
    time_constant_s: tuple[float, float]
