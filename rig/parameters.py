"""The numbers of one table: frozen, in SI units, each constant once with its source.

Sources: A = SRV02 user manual; B = Quanser's published 2 DOF Ball Balancer set-up files;
D = measured on real units, as published by their owners; "assumed" = nobody publishes it, ours.
Angles, speeds, torques and inertias of the drive are those at the servo's load shaft.
"""

from dataclasses import dataclass, field, replace
from math import pi
from typing import Annotated, Any, ClassVar, Literal

from annotated_types import Gt

from rig import effects, section
from rig.discrepancy import Discrepancy
from rig.effects import Effect
from rig.linkage import THREE_ARMS, Linkage
from rig.own_effects import OwnEffect, catalogue_of
from rig.section import Finite, Lag, Length, Mass, NotNegative, Positive, Section, Share, Size, Wait

GRAVITY_M_S2 = 9.81
SHAFT_MODELS = ("exact", "dead_zone", "none")
VOLTAGE, POSITION = "voltage", "position"
BUS_KINDS, PULSES, QUANSER = ("feetech", "dynamixel"), "pulses", "quanser"
ANGLE_KINDS = (*BUS_KINDS, PULSES)  # of tables whose servos are told an angle
VOLT_KINDS = ("serial", "usb", QUANSER, "remote")  # and of those whose motors are given volts
TABLE_KINDS = ("simulated", *VOLT_KINDS, *ANGLE_KINDS)
HIGHEST_ID = 252  # of a servo on either bus
USUAL = {  # by channel, as far as there are servos
    "ids": (1, 2, 3),
    "trim_rad": (0.0,) * 3,
    "pulse_us_per_rad": (2000 / pi,) * 3,  # 90 degrees for 1 ms
    "sign_volts": (1,) * 3,
    "sign_angle": (1,) * 3,
}
ANGLE_MARGIN_RAD = 0.08  # further beyond the angle limit is a runaway (the stop is at 0.086)

# SRV02 in high gear (A).
MOTOR_RESISTANCE_OHM = 2.6
MOTOR_TORQUE_CONSTANT_NM_A = 7.68e-3
MOTOR_EFFICIENCY = 0.69
GEARBOX_EFFICIENCY = 0.90
GEAR_RATIO_HIGH = 70.0
GEARS_INERTIA_HIGH_KG_M2 = 5.282e-5  # at the load shaft, computed from A


def torque_per_volt() -> float:
    """Stalled torque at the load shaft per motor volt: A = eta_g K_g eta_m k_t / R_m [N m/V]
    (A).
    """
    return (
        GEARBOX_EFFICIENCY
        * GEAR_RATIO_HIGH
        * MOTOR_EFFICIENCY
        * MOTOR_TORQUE_CONSTANT_NM_A
        / MOTOR_RESISTANCE_OHM
    )


@dataclass(frozen=True)
class Servo(Section):
    """The servos. "voltage": volts -> K/(tau s + 1) -> speed of the load shaft, both axes alike.

    K is gain_rad_s_V, tau is time_constant_s. Encoder counts are those of one turn of the load
    shaft after quadrature. "position": the servo takes an angle and holds it by itself
    (`rig.plant.position_servo`). It reads the command every period_s (0: at once) to the nearest
    quantum_rad (0: exactly), dead_time_s late; it follows with the lag lag_s by a motor that takes
    up speed with motor_lag_s, at most at rate_limit_rad_s and acceleration_limit_rad_s2, and stops
    dead_band_rad short. angle_measured: its angle is read back.
    """

    by_axis: ClassVar[tuple[str, ...]] = (
        *("lag_s", "dead_time_s", "motor_lag_s"),
        *("rate_limit_rad_s", "acceleration_limit_rad_s2"),
        *("dead_band_rad", "quantum_rad", "period_s"),
    )
    kind: Literal["voltage", "position"] = VOLTAGE
    gain_rad_s_V: Positive = 1.53
    time_constant_s: Lag = 0.025
    encoder_counts_per_rev: Annotated[int, Gt(0)] = 4096
    voltage_limit_V: section.Volts = 6.0
    angle_limit_rad: section.Turn = pi / 6  # B
    stop_rad: section.Turn = 0.61  # mechanical end stop: assumed; in a file at least the limit
    tachometer: bool = True
    tachometer_noise_rad_s: NotNegative = 0.005  # assumed (brush ripple), at the load shaft
    tachometer_scale: Finite = 0.0  # relative error of the plant's tachometer; A allows 2 %
    lag_s: Wait = 0.05  # RC servos of a lab table, by their owners: 0.046 and 0.066
    dead_time_s: Wait = 0.0
    motor_lag_s: Wait = 0.0
    rate_limit_rad_s: Positive = 8.7  # RC servos: 0.1 to 0.2 s for 60 degrees
    acceleration_limit_rad_s2: Positive = 1e4  # chosen: full rate after 1 ms, no limit of its own
    dead_band_rad: NotNegative = 0.0
    quantum_rad: NotNegative = 0.0
    period_s: Wait = 0.0
    angle_measured: bool = False
    x: dict[str, float] = field(default_factory=dict)
    y: dict[str, float] = field(default_factory=dict)

    @property
    def takes_angle(self) -> bool:
        """Whether the servos are told an angle, not volts."""
        return self.kind == POSITION

    @property
    def has_angle(self) -> bool:
        """Whether the servos' angles are measured."""
        return self.angle_measured or not self.takes_angle

    @property
    def torque_per_volt_nm(self) -> float:
        """Stalled torque at the load shaft per motor volt, A [N m/V]."""
        return torque_per_volt()

    @property
    def damping_nm_s(self) -> float:
        """Back EMF plus viscous friction at the load shaft, B = A/K [N m s/rad]."""
        return torque_per_volt() / self.gain_rad_s_V

    @property
    def inertia_kg_m2(self) -> float:
        """Inertia of everything that the motor turns, at the load shaft, J = tau B [kg m2]."""
        return self.time_constant_s * self.damping_nm_s

    @property
    def encoder_step_rad(self) -> float:
        """Angle of one encoder count [rad]."""
        return 2 * pi / self.encoder_counts_per_rev


@dataclass(frozen=True)
class Ball(Section):
    """The ball: radius, mass, mass distribution and colour.

    hollow: a thin spherical shell, else a solid sphere; colour: a name or "#rrggbb", for the
    tracker.
    """

    radius_m: Length = 0.019625
    mass_kg: Mass = 0.003
    hollow: bool = True
    colour: str = "orange"

    @property
    def rolling_factor(self) -> float:
        """k = m r^2/(m r^2 + J) [1]: 3/5 for a thin shell (J = 2/3 m r^2), 5/7 for a solid
        sphere.
        """
        return 3 / 5 if self.hollow else 5 / 7


@dataclass(frozen=True)
class CameraTiming(Section):
    """What the loop must know of the camera: parameters of the measurement, not of the physics.

    delay_s: from the exposure to the tick in which its observation is usable; noise_m: standard
    deviation of each coordinate; dropout: share of frames without an observation; ball_height_m:
    how much higher the ball's centre lies than the calibration takes it to be, which shifts its
    image by that height times the sine of the tilt.
    """

    rate_hz: Positive = 60.0
    delay_s: Wait = 0.012
    noise_m: Size = 0.0003
    dropout: Share = 0.0
    ball_height_m: Finite = 0.0


@dataclass(frozen=True)
class Drive(Section):
    """Shafts and friction of the two-mass drive (Fig. 1): all assumed, nobody publishes them.

    shaft_model: "exact" (Eqs. 4 to 6), "dead_zone" (Eqs. 7, 8; no damping) or "none" (no backlash,
    whatever the effects say). Friction acts against ground, not between the shaft's ends.
    """

    shaft_model: str = "exact"
    gear_stiffness_nm_rad: Positive = 30.0
    gear_damping_nm_s: NotNegative = 0.02
    joint_stiffness_nm_rad: Positive = 30.0
    joint_damping_nm_s: NotNegative = 0.02
    arm_friction_nm: NotNegative = 0.002  # bearing of the load shaft
    joint_friction_nm: NotNegative = 0.02  # plate against ground in its pivots, felt at the arm
    plate_inertia_kg_m2: Positive = 6.4e-5  # 0.3 kg plate seen through the linkage


@dataclass(frozen=True)
class Walls(Section):
    """An optional rim around the plate.

    restitution: speed of a ball that rolls without slip after the impact over its speed before [1].
    A real wall turns the speed but not the spin, so a ball on a rough plate keeps far less than it
    would in the air: at most 0.2 for a hollow ball.
    """

    present: bool = False
    restitution: Share = 0.2


@dataclass(frozen=True)
class Gains(Section):
    """Gains of the outer PID and the inner servo loop (B; the integral is the paper's), and
    filters.

    u = proportional e + integral (integral of e) - derivative v gives the servo's reference [rad]
    from the ball's error [m]; integral_limit_rad bounds the integral's part. V = servo_proportional
    (reference - theta) - servo_derivative omega. ball_filter_rad_s: bandwidth of the ball filter;
    torque_filter_s and observer_gain: tau and K of Eq. 9.
    """

    proportional_rad_m: NotNegative = 3.45
    derivative_rad_s_m: NotNegative = 2.11
    integral_rad_m_s: NotNegative = 1.0
    integral_limit_rad: NotNegative = 0.15
    servo_proportional_V_rad: NotNegative = 14.0
    servo_derivative_V_s_rad: NotNegative = 0.0
    ball_filter_rad_s: Positive = 25.0
    torque_filter_s: Lag = 0.02
    observer_gain: NotNegative = 1.0


@dataclass(frozen=True)
class KnownBacklash(Section):
    """Backlash as `rig calibrate play` finds it, full width at the servo; 0: observers estimate it.

    factor: share of the known backlash that a controller compensates [1]; other than 1 only where
    the harm of a wrong estimate is studied.
    """

    gear_x_rad: NotNegative = 0.0
    gear_y_rad: NotNegative = 0.0
    joint_x_rad: NotNegative = 0.0
    joint_y_rad: NotNegative = 0.0
    factor: NotNegative = 1.0


@dataclass(frozen=True)
class TableChoice:
    """Which table is driven and how it is reached; none of these keys changes the model.

    kind: one of TABLE_KINDS; port, baud: of the serial board or bus; address: "host:port" of a
    remote table, number of a Quanser card or "vendor:product" of a USB board; token_file: the
    remote table's secret; camera: an address for `vision.open_source`; calibration: the camera's
    bundle. amplifier_gain: motor volts per output volt of the Quanser card; card_options: handed to
    its driver. swap, crossed and the signs by channel: the wiring (`rig.hardware.wiring`); what
    homing finds overrides these and trim_rad. Of servos that take an angle, by channel: ids on a
    bus; trim_rad, where one holds the plate level, from its own middle; pulse_us_per_rad of those
    on pulses. A list that is left out is that of `by_channel`. pulse_range_us: the range that no
    servo on pulses leaves, whose middle is that of its turn [us].
    """

    kind: str = "simulated"
    port: str = ""
    baud: int = 500_000
    address: str = ""
    token_file: str = ""
    camera: str = ""
    calibration: str = ""
    amplifier_gain: Finite = 1.0
    card_options: str = ""
    ids: tuple[int, ...] = ()
    trim_rad: tuple[Finite, ...] = ()
    pulse_us_per_rad: tuple[Finite, ...] = ()
    pulse_range_us: tuple[Finite, Finite] = (1000.0, 2000.0)
    swap: bool = False
    crossed: bool = False
    sign_volts: tuple[int, ...] = ()
    sign_angle: tuple[int, ...] = ()

    def by_channel(self, key: str, servos: int) -> tuple[Any, ...]:
        """Return what `key` lists for so many servos; a list that the file leaves out is usual."""
        return getattr(self, key) or USUAL[key][:servos]

    def check(self, servos: int) -> None:
        """Raise ValueError (one line) where a key has no valid value or a needed key is missing.

        servos: how many the linkage has.
        """
        if self.kind not in TABLE_KINDS:
            raise ValueError(f"table.kind = '{self.kind}'; known: {', '.join(TABLE_KINDS)}")
        needed = {"remote": ("address", "token_file")}
        needed |= dict.fromkeys(("serial", *ANGLE_KINDS), ("port",))
        for key in needed.get(self.kind, ()):
            if not getattr(self, key):
                raise ValueError(f"table.kind = '{self.kind}' needs table.{key}: add it to [table]")
        for key in ("sign_volts", "sign_angle"):
            if any(sign not in (-1, 1) for sign in getattr(self, key)):
                raise ValueError(f"table.{key} = {list(getattr(self, key))}: each must be 1 or -1")
        for key in USUAL:
            if len(self.by_channel(key, servos)) != servos:
                raise ValueError(
                    f"table.{key} = {list(getattr(self, key))}: the linkage has {servos} servos, "
                    "list one value for each"
                )
        if self.swap and servos != 2:
            raise ValueError("table.swap: 3 servos have no x and y to swap: order their plugs")
        differ = len({*self.ids}) == len(self.ids)
        if not (differ and all(0 <= one <= HIGHEST_ID for one in self.ids)):
            raise ValueError(
                f"table.ids = {list(self.ids)}: must be {servos} different numbers from 0 to "
                f"{HIGHEST_ID}; give each servo its own with its maker's tool"
            )
        if not all(abs(trim) <= pi for trim in self.trim_rad):
            raise ValueError(f"table.trim_rad = {list(self.trim_rad)}: each must be -3.14 to 3.14")
        if not 0.1 <= self.amplifier_gain <= 10:
            gain = f"table.amplifier_gain = {self.amplifier_gain:g}"
            raise ValueError(f"{gain}: must be 0.1 to 10 (usual: 1, 3)")
        if not 1200 <= self.baud <= 4_000_000:
            raise ValueError(f"table.baud = {self.baud}: must be 1200 to 4000000")
        if self.camera and not self.calibration:
            raise ValueError(
                "table.camera needs table.calibration: the bundle that rig calibrate makes"
            )


CHANNELS = ("servo_x", "servo_y", "ball_x", "ball_y")  # of what a model predicts


@dataclass(frozen=True)
class Rig:
    """Everything that a controller may know of a table, and `effects`, which it may not.

    unknown: the discrepancy term of the model, zero by default. effects: {name of the catalogue:
    {"x" | "y" | "xy": {key: value}}} (see `rig.effects`), which only the simulator and the gap
    workflow read. own: effects of a lab's own, which `effects` may name, too, as far as they are in
    `catalogue`. tolerances: effect's name -> half width of its first parameter within which the
    effect counts as absent on this table. floors: channel (CHANNELS) -> RMS innovation of clean
    runs [rad or m]. ValueError: sections that contradict each other, such as a ball wider than the
    plate or a camera faster than the loop.
    """

    servo: Servo = field(default_factory=Servo)
    linkage: Linkage = field(default_factory=Linkage)
    ball: Ball = field(default_factory=Ball)
    camera: CameraTiming = field(default_factory=CameraTiming)
    drive: Drive = field(default_factory=Drive)
    walls: Walls = field(default_factory=Walls)
    gains: Gains = field(default_factory=Gains)
    play: KnownBacklash = field(default_factory=KnownBacklash)
    unknown: Discrepancy = field(default_factory=Discrepancy)
    table: TableChoice = field(default_factory=TableChoice)
    control_rate_hz: float = 500.0
    effects: dict[str, dict[str, dict[str, float]]] = field(default_factory=dict)
    own: tuple[OwnEffect, ...] = ()
    tolerances: dict[str, float] = field(default_factory=dict)
    floors: dict[str, float] = field(default_factory=dict)

    @property
    def ball_gain_m_s2(self) -> float:
        """Eq. 15: acceleration of the ball per servo angle, k g 2 R_d/L [m/s2/rad]."""
        return self.ball.rolling_factor * GRAVITY_M_S2 * self.linkage.ratio

    @property
    def known(self) -> "Rig":
        """The rig as controllers and estimators may know it.

        Without its effects, its unknown term and its tachometer's scale error.
        """
        servo = replace(self.servo, tachometer_scale=0.0)
        return replace(self, servo=servo, effects={}, unknown=Discrepancy())

    @property
    def catalogue(self) -> dict[str, Effect]:
        """Every effect that this rig knows, by name: the catalogue's, then its own."""
        return catalogue_of(self.own)

    def __post_init__(self) -> None:
        servo, linkage = self.servo, self.linkage
        effects.check_servos(self.effects, servo.kind, self.catalogue)
        limit, travel = servo.angle_limit_rad, servo.stop_rad
        if not servo.takes_angle:
            if linkage.kind == THREE_ARMS or any(linkage.pair("rod_length_m")):
                key = "kind" if linkage.kind == THREE_ARMS else "rod_length_m"
                raise ValueError(
                    f"linkage.{key} = '{getattr(linkage, key)}' needs servos that take an angle "
                    "(servo.kind = 'position'): leave it out"
                )
            if servo.x or servo.y:
                raise ValueError("servo.x and servo.y need servo.kind = 'position': leave them out")
        linkage.check(limit, travel, self.ball.radius_m)
        if self.drive.shaft_model not in SHAFT_MODELS:
            raise ValueError(
                f"drive.shaft_model = '{self.drive.shaft_model}'; known: {', '.join(SHAFT_MODELS)}"
            )
        if self.camera.rate_hz > self.control_rate_hz:
            raise ValueError(
                f"camera.rate_hz = {self.camera.rate_hz:g} is above control_rate_hz = "
                f"{self.control_rate_hz:g}: the loop takes one frame a tick; lower the camera's"
            )
        self.table.check(linkage.servos)
        load = GEARS_INERTIA_HIGH_KG_M2 + self.drive.plate_inertia_kg_m2
        if not servo.takes_angle and servo.inertia_kg_m2 <= load:
            raise ValueError(
                f"servo.time_constant_s = {servo.time_constant_s:g} gives an inertia of "
                f"{servo.inertia_kg_m2:.2e} kg m2, below that of gears and plate "
                f"({load:.2e}); raise time_constant_s or lower drive.plate_inertia_kg_m2"
            )
