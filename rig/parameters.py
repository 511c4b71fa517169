"""The numbers of one table: frozen, in SI units, each constant once with its source.

Sources: A = SRV02 user manual; B = Quanser's published 2 DOF Ball Balancer set-up files;
D = measured on real units, as published by their owners; "assumed" = nobody publishes it, ours.
Angles, speeds, torques and inertias of the drive are those at the servo's load shaft.
"""

from dataclasses import dataclass, field
from math import pi

from rig.known_play import KnownPlay
from rig.unknown import Unknown

GRAVITY_M_S2 = 9.81
SHAFT_MODELS = ("exact", "dead_zone", "none")
TABLE_KINDS = ("simulated", "serial", "usb", "quanser", "remote")
ANGLE_MARGIN_RAD = 0.08  # further beyond the angle limit is a runaway (the stop is at 0.086)

# SRV02 in high gear (A).
MOTOR_RESISTANCE_OHM = 2.6
MOTOR_TORQUE_CONSTANT_NM_A = 7.68e-3
MOTOR_BACK_EMF_V_S = 7.68e-3
MOTOR_EFFICIENCY = 0.69
GEARBOX_EFFICIENCY = 0.90
GEAR_RATIO_HIGH = 70.0
GEARS_INERTIA_HIGH_KG_M2 = 5.282e-5  # at the load shaft, computed from A


def torque_per_volt() -> float:
    """Stalled torque at the load shaft per motor volt: eta_g K_g eta_m k_t / R_m  [N m/V] (A)."""
    return (
        GEARBOX_EFFICIENCY
        * GEAR_RATIO_HIGH
        * MOTOR_EFFICIENCY
        * MOTOR_TORQUE_CONSTANT_NM_A
        / MOTOR_RESISTANCE_OHM
    )


def nominal_servo(
    *, rotor_kg_m2: float = 3.90e-7, tachometer_kg_m2: float = 7.06e-8, viscous_nm_s: float = 0.015
) -> tuple[float, float]:
    """Gain K [rad/s/V] and time constant tau [s] of the SRV02 in high gear from A's constants.

    J_eq = eta_g K_g^2 J_m + J_gears; B = B_eq + (eta_g eta_m K_g^2 k_t k_m)/R_m;
    K = A/B and tau = J_eq/B with A = `torque_per_volt()`.
    """
    per_volt = torque_per_volt()
    inertia = (
        GEARBOX_EFFICIENCY * GEAR_RATIO_HIGH**2 * (rotor_kg_m2 + tachometer_kg_m2)
        + GEARS_INERTIA_HIGH_KG_M2
    )
    damping = viscous_nm_s + per_volt * GEAR_RATIO_HIGH * MOTOR_BACK_EMF_V_S
    return per_volt / damping, inertia / damping


@dataclass(frozen=True)
class Servo:
    """One servo unit (both axes are alike): V -> K/(tau s + 1) -> load-shaft speed."""

    gain_rad_s_V: float = 1.53
    time_constant_s: float = 0.025
    encoder_counts_per_rev: int = 4096
    voltage_limit_V: float = 6.0
    angle_limit_rad: float = pi / 6  # B
    stop_rad: float = 0.61  # mechanical end stop: assumed
    tachometer: bool = True
    tachometer_noise_rad_s: float = 0.005  # assumed (brush ripple), at the load shaft
    tachometer_scale: float = 0.0  # relative error of the plant's tachometer; A allows 2 %

    @property
    def torque_per_volt_nm(self) -> float:
        return torque_per_volt()

    @property
    def damping_nm_s(self) -> float:
        """Back EMF plus viscous friction, B = A/K [N m s/rad]."""
        return torque_per_volt() / self.gain_rad_s_V

    @property
    def inertia_kg_m2(self) -> float:
        """Everything that the motor turns, J = tau B [kg m2]."""
        return self.time_constant_s * self.damping_nm_s

    @property
    def encoder_step_rad(self) -> float:
        return 2 * pi / self.encoder_counts_per_rev


@dataclass(frozen=True)
class Linkage:
    """Servo arm to plate edge: sin(phi) = 2 R_d sin(theta)/L (paper Eq. 14)."""

    arm_radius_m: float = 0.0254
    plate_side_m: float = 0.275

    @property
    def ratio(self) -> float:
        """2 R_d / L, dimensionless."""
        return 2 * self.arm_radius_m / self.plate_side_m


@dataclass(frozen=True)
class Ball:
    radius_m: float = 0.019625
    mass_kg: float = 0.003
    hollow: bool = True
    colour: str = "orange"  # a name or #rrggbb: what the tracker looks for

    @property
    def rolling_factor(self) -> float:
        """m r^2/(m r^2 + J): 3/5 for a thin shell (J = 2/3 m r^2), 5/7 for a solid sphere."""
        return 3 / 5 if self.hollow else 5 / 7


@dataclass(frozen=True)
class CameraTiming:
    """What the loop must know of the camera: measurement parameters, no physics."""

    rate_hz: float = 60.0
    delay_s: float = 0.012  # from exposure to the tick in which the observation is usable
    noise_m: float = 0.0003
    dropout: float = 0.0  # share of frames without an observation
    ball_height_m: float = 0.0  # higher than it is taken for: seen shifted by so much of the sine


@dataclass(frozen=True)
class Drive:
    """Shafts and friction of the two-mass drive (Fig. 1): all assumed, nobody publishes them.

    shaft_model: exact (Eqs. 4-6), dead_zone (7, 8; no damping), or none (no play, whatever the
    effects say). Friction acts against ground, not between the shaft's ends.
    """

    shaft_model: str = "exact"
    gear_stiffness_nm_rad: float = 30.0
    gear_damping_nm_s: float = 0.02
    joint_stiffness_nm_rad: float = 30.0
    joint_damping_nm_s: float = 0.02
    arm_friction_nm: float = 0.002  # bearing of the load shaft
    joint_friction_nm: float = 0.02  # plate against ground in its pivots, felt at the arm
    plate_inertia_kg_m2: float = 6.4e-5  # 0.3 kg plate seen through the linkage


@dataclass(frozen=True)
class Walls:
    """An optional rim. restitution: rolling speed after over before, for a ball that never slips.

    A real wall turns the speed but not the spin, so a ball on a rough plate keeps far less: at
    most 0.2 of it for a hollow ball.
    """

    present: bool = False
    restitution: float = 0.2


@dataclass(frozen=True)
class Gains:
    """The controller's published numbers (B), plus an integral: the paper's PID."""

    proportional_rad_m: float = 3.45
    derivative_rad_s_m: float = 2.11
    integral_rad_m_s: float = 1.0
    integral_limit_rad: float = 0.15
    servo_proportional_V_rad: float = 14.0
    servo_derivative_V_s_rad: float = 0.0
    ball_filter_rad_s: float = 25.0
    torque_filter_s: float = 0.02  # tau of Eq. 9
    observer_gain: float = 1.0  # K of Eq. 9


@dataclass(frozen=True)
class TableChoice:
    """Which table is driven and how it is reached; nothing of it changes the model.

    port, baud: the serial board's; address: "host:port" of a remote table, number of a Quanser
    card, "vendor:product" of a USB board; token_file: the remote table's secret; camera: an address
    for `vision.sources`, calibration: its bundle. amplifier_gain: motor volts per output volt of
    the card; card_options: handed to its driver. swap, crossed and the signs by channel (see
    `rig.hardware.wiring`): what homing finds goes before them.
    """

    kind: str = "simulated"
    port: str = ""
    baud: int = 500_000
    address: str = ""
    token_file: str = ""
    camera: str = ""
    calibration: str = ""
    amplifier_gain: float = 1.0
    card_options: str = ""
    swap: bool = False
    crossed: bool = False
    sign_volts: tuple[int, int] = (1, 1)
    sign_angle: tuple[int, int] = (1, 1)

    def check(self) -> None:
        """ValueError, one line, where the keys do not make a table."""
        if self.kind not in TABLE_KINDS:
            raise ValueError(f"table.kind = '{self.kind}'; known: {', '.join(TABLE_KINDS)}")
        needed = {"serial": ["port"], "remote": ["address", "token_file"]}.get(self.kind, [])
        for key in needed:
            if not getattr(self, key):
                raise ValueError(f"table.kind = '{self.kind}' needs table.{key}: add it to [table]")
        for key in ("sign_volts", "sign_angle"):
            if any(sign not in (-1, 1) for sign in getattr(self, key)):
                raise ValueError(f"table.{key} = {list(getattr(self, key))}: each must be 1 or -1")
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
    """Everything a controller or estimator may know of a table; `effects` only the model's user.

    `unknown` is the unnamed term of the model, if any. `effects` maps a catalogue name to
    {"x" | "y" | "xy": {key: value}} (see `rig.effects`); `tolerances` a name to the half width of
    its first parameter that counts as nothing missing on this table; `floors` a channel (CHANNELS)
    to the RMS innovation of clean runs [rad or m].
    """

    servo: Servo = field(default_factory=Servo)
    linkage: Linkage = field(default_factory=Linkage)
    ball: Ball = field(default_factory=Ball)
    camera: CameraTiming = field(default_factory=CameraTiming)
    drive: Drive = field(default_factory=Drive)
    walls: Walls = field(default_factory=Walls)
    gains: Gains = field(default_factory=Gains)
    play: KnownPlay = field(default_factory=KnownPlay)
    unknown: Unknown = field(default_factory=Unknown)
    table: TableChoice = field(default_factory=TableChoice)
    control_rate_hz: float = 500.0
    effects: dict[str, dict[str, dict[str, float]]] = field(default_factory=dict)
    tolerances: dict[str, float] = field(default_factory=dict)
    floors: dict[str, float] = field(default_factory=dict)

    @property
    def ball_gain_m_s2(self) -> float:
        """Eq. 15: acceleration of the ball per servo angle, k g 2 R_d/L [m/s2/rad]."""
        return self.ball.rolling_factor * GRAVITY_M_S2 * self.linkage.ratio

    def __post_init__(self) -> None:
        half = self.linkage.plate_side_m / 2
        if self.ball.radius_m >= half:
            raise ValueError(
                f"ball.radius_m = {self.ball.radius_m:g} is not below half the plate's side "
                f"({half:g} m): the ball does not fit on the plate; correct [ball] or [linkage]"
            )
        if self.linkage.arm_radius_m > half:  # equal: the angle is the plate's own
            raise ValueError(
                f"linkage.arm_radius_m = {self.linkage.arm_radius_m:g} is above half the "
                f"plate's side ({half:g} m): the plate would stand upright; correct [linkage]"
            )
        if self.drive.shaft_model not in SHAFT_MODELS:
            raise ValueError(
                f"drive.shaft_model = '{self.drive.shaft_model}'; known: {', '.join(SHAFT_MODELS)}"
            )
        if self.camera.rate_hz > self.control_rate_hz:
            raise ValueError(
                f"camera.rate_hz = {self.camera.rate_hz:g} is above control_rate_hz = "
                f"{self.control_rate_hz:g}: the loop takes one frame a tick; lower the camera's"
            )
        self.table.check()
        load = GEARS_INERTIA_HIGH_KG_M2 + self.drive.plate_inertia_kg_m2
        if self.servo.inertia_kg_m2 <= load:
            raise ValueError(
                f"servo.time_constant_s = {self.servo.time_constant_s:g} gives an inertia of "
                f"{self.servo.inertia_kg_m2:.2e} kg m2, below that of gears and plate "
                f"({load:.2e}); raise time_constant_s or lower drive.plate_inertia_kg_m2"
            )
