"""The plant's parameters as one flat record that the compiled functions take, made from a rig."""

from math import ceil, cos, inf

import numpy as np

from rig import discrepancy
from rig.discrepancy import DISCREPANCY
from rig.effects import fields, values
from rig.linkage import THREE_ARMS, Linkage
from rig.parameters import GEARS_INERTIA_HIGH_KG_M2, Rig, Servo
from rig.plant import own_equations, position_servo
from rig.plant.derived import derive
from rig.plant.shaft import DEAD_ZONE, EXACT, NONE
from rig.three_arms import AZIMUTHS

STEP_S = 1e-4
GROWTH_MARGIN = 1e-9  # of rounding, in the eigenvalue 1 of the drive's free turning

_MODELS = {"exact": EXACT, "dead_zone": DEAD_ZONE, "none": NONE}
_PER_AXIS = (
    "torque_per_volt motor_damping motor_inertia motor_per_torque motor_per_volt gear_k gear_c "
    "gear_decay gear_1 gear_2 gear_coast joint_k joint_c joint_decay joint_1 joint_2 joint_fall "
    "friction_held ratio weight felt_weight half_side plate_side arm_radius rod period_begin_s"
).split() + list(Servo.by_axis)
_SCALARS = (
    "step_s gain time_constant arm_inertia plate_inertia arm_friction joint_friction "
    "arm_per_torque plate_per_torque "
    "arm_stick plate_stick stop_rad radius mass factor "
    "base_radius plate_radius arm_length rod_length height level_arm "
    "wall_restitution encoder_step tachometer_scale tachometer_noise tachometer "
    "camera_delay camera_noise camera_dropout camera_height frame_wait_s"
).split()
PLANT = np.dtype(
    [(name, np.float64, (2,)) for name in _PER_AXIS]
    + [(name, np.float64, (2,)) for name, _, _ in fields()]
    + [(name, np.float64) for name in _SCALARS]
    + [(name, np.int64) for name in ("shaft_model", "walls", "position", "linkage", "has_angle")]
    + [("share_x", np.float64, (3,)), ("unknown", DISCREPANCY), ("own", own_equations.OWN)]
)


def pack(rig: Rig, *, step_s: float = STEP_S) -> np.record:
    """Return the plant's record (dtype PLANT) of a rig, effects and discrepancy included.

    The integration step is at most `step_s` and divides the rig's control tick evenly. ValueError:
    the rig's effects are not those of the catalogue, or its drive is too stiff or too light for the
    step (`step_growth`).
    """
    tick_s = 1 / rig.control_rate_hz
    step_s = tick_s / ceil(tick_s / step_s - 1e-9)
    p = np.zeros(1, PLANT)[0]
    servo, drive = rig.servo, rig.drive
    given = values(rig.effects, rig.catalogue.values())
    for name, _, _ in fields():
        p[name] = given[name]
    p["own"] = own_equations.pack(rig.own, given)
    p["gain"], p["time_constant"] = servo.gain_rad_s_V, servo.time_constant_s
    p["torque_per_volt"] = servo.torque_per_volt_nm
    p["plate_inertia"] = drive.plate_inertia_kg_m2
    p["gear_k"], p["gear_c"] = drive.gear_stiffness_nm_rad, drive.gear_damping_nm_s
    p["joint_k"], p["joint_c"] = drive.joint_stiffness_nm_rad, drive.joint_damping_nm_s
    p["gear_coast"] = coasting(rig)
    loose = drive.joint_friction_nm == 0.0 and not servo.takes_angle
    p["joint_fall"] = loose * (p["joint_backlash_play_rad"] > 0.0)
    p["unknown"] = discrepancy.pack(rig.unknown, servo.angle_limit_rad)
    p["step_s"], p["shaft_model"] = step_s, _MODELS[drive.shaft_model]
    p["arm_friction"], p["joint_friction"] = drive.arm_friction_nm, drive.joint_friction_nm
    p["stop_rad"], p["radius"], p["mass"] = servo.stop_rad, rig.ball.radius_m, rig.ball.mass_kg
    p["factor"] = rig.ball.rolling_factor
    _linkage(p, rig.linkage)
    derive(p)
    if not servo.takes_angle and step_growth(p) > 1.0 + GROWTH_MARGIN:
        raise ValueError(
            f"drive with gear_stiffness_nm_rad = {drive.gear_stiffness_nm_rad:g}, "
            f"joint_stiffness_nm_rad = {drive.joint_stiffness_nm_rad:g}, plate_inertia_kg_m2 = "
            f"{drive.plate_inertia_kg_m2:g} cannot be simulated in steps of {1e3 * step_s:g} ms: "
            "it would diverge; lower the stiffness or the damping, or raise the inertia"
        )
    p["position"], p["has_angle"] = int(servo.takes_angle), int(servo.has_angle)
    for key in Servo.by_axis:
        p[key] = servo.pair(key)
    p["walls"], p["wall_restitution"] = int(rig.walls.present), rig.walls.restitution
    p["encoder_step"] = servo.encoder_step_rad
    p["tachometer"] = float(servo.tachometer and not servo.takes_angle)
    p["tachometer_scale"], p["tachometer_noise"] = (
        servo.tachometer_scale,
        servo.tachometer_noise_rad_s,
    )
    p["camera_delay"] = rig.camera.delay_s + p["camera_delay_extra_s"][0]
    p["camera_height"] = rig.camera.ball_height_m
    p["camera_noise"], p["camera_dropout"] = rig.camera.noise_m, rig.camera.dropout
    return p


def _linkage(p: np.record, linkage: Linkage) -> None:
    """The linkage's kind and lengths, and the shares of the servos."""
    arms = linkage.kind == THREE_ARMS
    rods = not arms and any(linkage.pair("rod_length_m"))
    p["linkage"] = position_servo.THREE_ARMS if arms else position_servo.RODS if rods else 0
    p["arm_radius"], p["plate_side"] = linkage.pair("arm_radius_m"), linkage.pair("plate_side_m")
    p["rod"] = linkage.pair("rod_length_m")
    p["base_radius"], p["plate_radius"], p["arm_length"], p["rod_length"] = linkage.size
    p["height"], p["share_x"] = linkage.height_m, (1.0, 0.0, 0.0)
    if arms:
        p["share_x"] = [cos(azimuth) ** 2 for azimuth in AZIMUTHS]


def coasting(rig: Rig) -> float:
    """Inertia of arm and plate over the friction that brakes both in the gear's gap [s2/rad].

    It is the inverse of their deceleration. 0: they stay where the teeth leave them, as the plate's
    friction in its joints holds them; infinite: nothing brakes them.
    """
    drive = rig.drive
    if drive.joint_friction_nm > 0.0:
        return 0.0
    if drive.arm_friction_nm == 0.0:
        return inf
    return (GEARS_INERTIA_HIGH_KG_M2 + drive.plate_inertia_kg_m2) / drive.arm_friction_nm


def step_growth(p: np.record) -> float:
    """Return the growth of the drive's motion per step [1], above 1 where the simulation diverges.

    It is the spectral radius of one step of symplectic Euler (`step.drive_step`) on axis x with all
    play closed and no dry friction, v+ = v - M (K q + C v), q+ = q + h v+, with M = h J^-1, for q =
    (motor, arm, plate) [rad].
    """
    (k_g, k_j), (c_g, c_j) = ([p[f"{one}_{of}"][0] for one in ("gear", "joint")] for of in "kc")
    shafts = [
        np.array([[g, -g, 0.0], [-g, g + j, -j], [0.0, -j, j]]) for g, j in ((k_g, k_j), (c_g, c_j))
    ]
    shafts[1][0, 0] += p["motor_damping"][0]
    per_torque = np.array([p["motor_per_torque"][0], p["arm_per_torque"], p["plate_per_torque"]])
    with np.errstate(all="ignore"):
        turned, kept = (-per_torque[:, None] * one for one in shafts)
        kept, h = np.eye(3) + kept, p["step_s"]
        step = np.block([[np.eye(3) + h * turned, h * kept], [turned, kept]])
    if not np.isfinite(step).all():
        return inf
    return float(np.abs(np.linalg.eigvals(step)).max())


def no_volts(rig: Rig) -> np.ndarray:
    """Return a history (n, 2) of 0 V or 0 rad, newest first, with as many ticks as delays need."""
    late = "servo_dead_time" if rig.servo.takes_angle else "input_delay"
    delays = [axis.get("delay_s", 0.0) for axis in rig.effects.get(late, {}).values()]
    longest = max(delays, default=0.0)
    if rig.servo.takes_angle:
        longest += max(rig.servo.pair("dead_time_s")) + max(rig.servo.pair("period_s"))
    return np.zeros((ceil(longest * rig.control_rate_hz) + 2, 2))
