"""The table once more, as a MuJoCo mechanism: shares numbers with the product, but no dynamics.

Per axis a motor (armature), an arm with the encoder and a crank, each a body on its own hinge.
Play is a limited tendon between two of them whose limit is a spring that can only push; a shaft
without play is an elastic tendon. From the crank's pin and from the plate's edge a rod of 100 m
leads up, and both rods always have the same length change: that is Eq. 14 as a mechanism, without
its formula. The plate, a box of real mass, hangs in its centre on a universal joint, or on a ball
joint with a flywheel of 1e3 kg m2 about the plate's normal, so that it does not turn about that.
The ball is a free body which only contact and friction move.
"""

from dataclasses import dataclass
from math import atan2, pi, sqrt

import numpy as np
from scipy.optimize import brentq

from rig.parameters import GEARS_INERTIA_HIGH_KG_M2, GRAVITY_M_S2, Rig

ROD_M = 100.0
PLATE_HALF_THICKNESS_M = 0.004
CAM_SHARE = 0.2  # of the gears' inertia
SOFT = 1e-3  # impedance of a limit that acts as a spring: 0.1 % of other forces leaks in
KNOWN_EFFECTS = {
    "coulomb_friction", "voltage_offset", "level_offset", "gear_backlash", "joint_backlash",
}  # fmt: skip


@dataclass(frozen=True)
class Build:
    """How the mechanism is built and stepped."""

    step_s: float = 1e-4
    universal: bool = False  # False: the plate does not turn about its normal
    grip: float = 20.0  # friction of ball and plate; the default never slips
    wall_rate_rad_s: float = 600.0  # of the walls' spring on the ball
    crank_share: float = 0.1  # of the plate's inertia at the crank, the plate itself has the rest
    cam: bool = False  # between arm and joint, a hinge whose angle is a function of the arm's
    cross: tuple[float, float] = (0.0, 0.0)  # share of the other axis's rod in each axis's
    heavy_m: tuple[float, float, float] = (0.0, 0.0, 0.0)  # the ball's mass off its centre


def effect(rig: Rig, name: str, key: str, axis: str) -> float:
    return rig.effects.get(name, {}).get(axis, {}).get(key, 0.0)


def damping_ratio(restitution: float) -> float:
    """Of a spring with damper that only pushes: a body leaves it at -e times its speed [1].

    The contact ends when the force, not the depth, is back at zero.
    """

    def leaves_at(z: float) -> float:
        return np.exp(-z / sqrt(1 - z * z) * (pi - atan2(2 * z * sqrt(1 - z * z), 1 - 2 * z * z)))

    return float(brentq(lambda z: leaves_at(z) - restitution, 1e-9, 0.999))  # pyright: ignore[reportArgumentType]


def _shaft(rig: Rig, place: str, axis: str, ends: tuple[str, str], apart: float) -> str:
    """Tendon between two hinges: elastic, or with play limited; `apart` = 1/J_1 + 1/J_2."""
    k = getattr(rig.drive, f"{place}_stiffness_nm_rad")
    c = getattr(rig.drive, f"{place}_damping_nm_s")
    play = effect(rig, f"{place}_backlash", "play_rad", axis)
    centre = effect(rig, f"{place}_backlash", "offset_rad", axis)
    how = f'stiffness="{k}" damping="{c}" springlength="0"'
    if play > 0:  # MuJoCo's limits are set as accelerations: force = solref/apart
        how = (
            f'limited="true" range="{centre - play / 2} {centre + play / 2}" '
            f'solreflimit="{-k * apart} {-c * apart}" solimplimit="{SOFT} {SOFT} 1"'
        )
    first, second = (f"{end}_{axis}" for end in ends)
    pair = f'<joint joint="{first}" coef="1"/><joint joint="{second}" coef="-1"/>'
    return f'<fixed name="{place}_{axis}" {how}>{pair}</fixed>'


def _crossing(share: float, other: str) -> str:
    """A rod's second branch over a pulley, to the other crank's pin (or to its far side)."""
    if share == 0:
        return ""
    end = "pin" if share > 0 else "back"
    return (
        f'<pulley divisor="{1 / abs(share)}"/><site site="over_{end}_{other}"/>'
        f'<site site="{end}_crank_{other}"/>'
    )


def _axis(rig: Rig, build: Build, a: int, stiff: str) -> tuple[str, str, str, str]:
    """Bodies, tendons, equality and actuator of one axis."""
    servo, drive, n = rig.servo, rig.drive, "xy"[a]
    plate = drive.plate_inertia_kg_m2
    inertia = {
        "motor": servo.inertia_kg_m2 - GEARS_INERTIA_HIGH_KG_M2 - plate,
        "arm": GEARS_INERTIA_HIGH_KG_M2,
        "crank": build.crank_share * plate,
    }
    if build.cam:
        inertia["cam"] = CAM_SHARE * inertia["arm"]
        inertia["arm"] -= inertia["cam"]
    dry = {
        "motor": servo.torque_per_volt_nm * effect(rig, "coulomb_friction", "friction_V", n),
        "arm": drive.arm_friction_nm,
        "crank": drive.joint_friction_nm,
        "cam": 0.0,
    }
    radius, half = rig.linkage.arm_radius_m, rig.linkage.plate_side_m / 2
    edge = (half, 0) if a == 0 else (0, half)
    bodies = "".join(
        f'<body name="{part}_{n}" pos="0 {a} -1"><inertial pos="0 0 0" mass="1e-6" '
        f'diaginertia="1e-12 1e-12 1e-12"/><joint name="{part}_{n}" axis="0 1 0" '
        f'armature="{inertia[part]}" frictionloss="{dry[part]}" {stiff} '
        + (f'limited="true" range="{-servo.stop_rad} {servo.stop_rad}"' if part == "motor" else "")
        + f'/><site name="pin_{part}_{n}" pos="{radius} 0 0"/>'
        f'<site name="back_{part}_{n}" pos="{-radius} 0 0"/></body>'
        for part in inertia
    ) + (
        f'<site name="over_pin_{n}" pos="{radius} {a} {ROD_M - 1}"/>'
        f'<site name="over_back_{n}" pos="{-radius} {a} {ROD_M - 1}"/>'
        f'<site name="over_edge_{n}" pos="{edge[0]} {edge[1]} {ROD_M}"/>'
    )
    before = "cam" if build.cam else "arm"
    tendons = (
        _shaft(rig, "gear", n, ("motor", "arm"), 1 / inertia["motor"] + 1 / inertia["arm"])
        + _shaft(rig, "joint", n, (before, "crank"), 1 / inertia[before] + 1 / inertia["crank"])
        + f'<spatial name="rod_{n}"><site site="over_pin_{n}"/><site site="pin_crank_{n}"/>'
        f"{_crossing(build.cross[a], 'yx'[a])}</spatial>"
        f'<spatial name="edge_{n}"><site site="over_edge_{n}"/><site site="edge_{n}"/></spatial>'
    )
    equal = f'<tendon tendon1="edge_{n}" tendon2="rod_{n}" polycoef="0 1 0 0 0"/>'
    if build.cam:
        equal += f'<joint name="cam_{n}" joint1="cam_{n}" joint2="arm_{n}" polycoef="0 1 0 0 0"/>'
    per_volt = servo.torque_per_volt_nm
    actuator = (
        f'<general name="volts_{n}" joint="motor_{n}" gainprm="{per_volt}" biastype="affine" '
        f'biasprm="{per_volt * effect(rig, "voltage_offset", "offset_V", n)} 0 '
        f'{-servo.damping_nm_s}"/>'
    )
    return bodies, tendons, equal, actuator


def _plate(rig: Rig, build: Build) -> str:
    side = rig.linkage.plate_side_m
    h, t = side / 2, PLATE_HALF_THICKNESS_M
    i = (1 - build.crank_share) * rig.drive.plate_inertia_kg_m2 / rig.linkage.ratio**2
    joint = (
        '<joint name="tilt_x" axis="0 1 0"/><joint name="tilt_y" axis="-1 0 0"/>'
        if build.universal
        else '<joint name="tilt" type="ball"/>'
    )
    walls = ""
    if rig.walls.present:
        for w, (x, y) in enumerate(((1, 0), (-1, 0), (0, 1), (0, -1))):
            size = f"{t if x else side} {t if y else side} 0.05"
            walls += f'<geom name="wall_{w}" type="box" size="{size}" '
            walls += f'pos="{x * (h + t)} {y * (h + t)} 0.05"/>'
    return (
        f'<body name="plate"><inertial pos="0 0 0" mass="0.3" diaginertia="{i} {i} {2 * i}"/>'
        f"{joint}"
        f'<geom name="top" type="box" size="{h} {h} {t}" pos="0 0 {-t}"/>{walls}'
        f'<site name="edge_x" pos="{h} 0 0"/><site name="edge_y" pos="0 {h} 0"/></body>'
    )


def mechanism(rig: Rig, build: Build, drive_y: Rig | None = None) -> str:
    """The MJCF of a rig, whose y axis is driven as that of `drive_y` where given.

    ValueError: it has effects that this table does not model.
    """
    unknown = set(rig.effects) - KNOWN_EFFECTS
    if unknown:
        raise ValueError(f"not in the MuJoCo table: {', '.join(sorted(unknown))}")
    if rig.drive.shaft_model != "exact":
        raise ValueError(f"the MuJoCo table has no shaft '{rig.drive.shaft_model}': use exact")
    h = build.step_s
    hard = f'solref="{3 * h} 1" solimp="0.9999 0.9999 1"'
    stiff = "".join(
        f' solref{k}="{3 * h} 1" solimp{k}="0.9999 0.9999 1"' for k in ("friction", "limit")
    )
    axes = [_axis(one, build, a, stiff) for a, one in enumerate((rig, drive_y or rig))]
    slope = [effect(rig, "level_offset", "slope_rad", n) for n in "xy"]
    g = GRAVITY_M_S2 * np.array([*slope, -sqrt(1 - slope[0] ** 2 - slope[1] ** 2)])
    ball, m = rig.ball, max(rig.ball.mass_kg, 1e-6)
    i = (2 / 3 if ball.hollow else 2 / 5) * m * ball.radius_m**2
    touch = f'condim="3" friction="{build.grip} {build.grip} 1e-9 1e-9 1e-9" {hard}'
    heavy = " ".join(str(float(part)) for part in build.heavy_m)
    e, w = rig.walls.restitution, build.wall_rate_rad_s
    bounce = f'condim="1" solimp="0.9999 0.9999 1" solref="{-w * w} {-2 * w * damping_ratio(e)}"'
    pairs = f'<pair geom1="top" geom2="ball" {touch}/>' + "".join(
        f'<pair geom1="wall_{k}" geom2="ball" {bounce}/>' for k in range(4 * rig.walls.present)
    )
    return f"""<mujoco><compiler angle="radian" inertiafromgeom="false" autolimits="false"/>
<option timestep="{h}" gravity="{g[0]} {g[1]} {g[2]}" cone="elliptic" solver="Newton"
 iterations="60" tolerance="1e-14" integrator="Euler" impratio="1"><flag eulerdamp="disable"
 warmstart="enable"/></option>
<default><geom contype="0" conaffinity="0"/><equality {hard}/></default>
<worldbody>{axes[0][0]}{axes[1][0]}{_plate(rig, build)}
<body name="ball" pos="0 0 {ball.radius_m}"><freejoint/><inertial pos="{heavy}" mass="{m}"
 diaginertia="{i} {i} {i}"/><geom name="ball" type="sphere" size="{ball.radius_m}"/></body>
</worldbody>
<tendon>{axes[0][1]}{axes[1][1]}</tendon><equality>{axes[0][2]}{axes[1][2]}</equality>
<actuator>{axes[0][3]}{axes[1][3]}</actuator><contact>{pairs}</contact></mujoco>"""
