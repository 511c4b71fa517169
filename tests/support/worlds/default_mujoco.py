"""Tables in MuJoCo as a newcomer would write them: default softness of friction and contact.

Motor, arm and crank of each axis are hinges; play is a limited tendon, a coupling without play an
equality, dry friction `frictionloss`: it settles a joint within about 10 ms. The plate hangs on a
universal joint that the cranks drive; contact alone carries the ball, which MuJoCo's contact slows
by 0.8 % of its acceleration (measured at a fixed slope), the twin of a camera scale.
"""

import math

import numpy as np

from tests.support.worlds.logs import World, rig_toml, truth

STEP_s = 0.0005
GAIN_rad_s_V, TAU_s = 1.53, 0.025
INERTIA_kg_m2 = 0.00213  # at the load shaft
TORQUE_Nm_V = GAIN_rad_s_V * INERTIA_kg_m2 / TAU_s
ARM_SHARE, CRANK_SHARE = 0.05, 0.03  # of the inertia
ARM_DAMPING, CRANK_DAMPING = 0.002, 0.0005  # N m s/rad
RADIUS_m, MASS_kg, SIDE_m, LEVER_m = 0.019625, 0.0027, 0.275, 0.0254
G_m_s2 = 9.81
CAMERA_Hz, DELAY_s, CAMERA_SD_m, MOTOR_SD_V = 60.0, 0.012, 3e-4, 0.01
TWIN = "camera_scale"  # of the ball that rolls too slowly


def _axis(n: str, friction_V: float, gear_rad: float, joint_rad: float, plate_V: float):
    """Bodies, tendons, equalities and motor of one axis."""
    ratio = 2.0 * LEVER_m / SIDE_m
    motor = 1.0 - ARM_SHARE - CRANK_SHARE
    parts = {
        "motor": (motor, INERTIA_kg_m2 / TAU_s - ARM_DAMPING - CRANK_DAMPING, friction_V),
        "arm": (ARM_SHARE, ARM_DAMPING, 0.0),
        "crank": (CRANK_SHARE, CRANK_DAMPING, plate_V),
    }
    bodies = "".join(
        f'<body pos="0 0 1"><joint name="{part}_{n}" axis="0 1 0" damping="{damping}" '
        f'armature="{share * INERTIA_kg_m2}" frictionloss="{dry_V * TORQUE_Nm_V}"/>'
        '<geom size="0.001" mass="1e-6" contype="0" conaffinity="0"/></body>'
        for part, (share, damping, dry_V) in parts.items()
    )
    tendons, equalities = "", ""
    for first, second, play in (("motor", "arm", gear_rad), ("arm", "crank", joint_rad)):
        if play > 0.0:
            tendons += (
                f'<fixed limited="true" range="{-play / 2} {play / 2}" solreflimit="0.002 1">'
                f'<joint joint="{first}_{n}" coef="1"/><joint joint="{second}_{n}" coef="-1"/>'
                "</fixed>"
            )
        else:
            equalities += f'<joint joint1="{first}_{n}" joint2="{second}_{n}" solref="0.002 1"/>'
    # asin(r sin(theta)) to the third order
    bend = f"0 {ratio} 0 {-ratio * (1.0 - ratio**2) / 6.0} 0"
    equalities += (
        f'<joint joint1="plate_{n}" joint2="crank_{n}" polycoef="{bend}" solref="0.002 1"/>'
    )
    return bodies, tendons, equalities, f'<motor joint="motor_{n}" gear="{TORQUE_Nm_V}"/>'


def _rim() -> str:
    h, t = SIDE_m / 2, 0.005
    places = ((h + t, 0, t, h), (-h - t, 0, t, h), (0, h + t, h, t), (0, -h - t, h, t))
    return "".join(
        f'<geom type="box" pos="{x} {y} 0.02" size="{a} {b} 0.02" solref="0.01 0.5"/>'
        for x, y, a, b in places
    )


def _model(pairs: dict, *, walls: bool, grip: float) -> str:
    axes = [_axis(n, *(pairs.get(k, (0.0, 0.0))[a] for k in KEYS)) for a, n in enumerate("xy")]
    bodies, tendons, equalities, motors = ("".join(part) for part in zip(*axes, strict=True))
    inertia = 2.0 / 3.0 * MASS_kg * RADIUS_m**2
    contact = f'condim="6" friction="{grip} 0.0001 0"'
    return f"""<mujoco><option timestep="{STEP_s}" integrator="implicitfast" cone="elliptic"
 gravity="0 0 {-G_m_s2}"/><worldbody>{bodies}
<body name="plate"><joint name="plate_y" axis="-1 0 0"/><joint name="plate_x" axis="0 1 0"/>
<geom type="box" size="{SIDE_m / 2} {SIDE_m / 2} 0.004" pos="0 0 -0.004" mass="0.3" {contact}/>
{_rim() if walls else ""}</body>
<body name="ball" pos="0 0 {RADIUS_m}"><freejoint/><inertial pos="0 0 0" mass="{MASS_kg}"
 diaginertia="{inertia} {inertia} {inertia}"/><geom size="{RADIUS_m}" {contact}/></body>
</worldbody><tendon>{tendons}</tendon><equality>{equalities}</equality>
<actuator>{motors}</actuator></mujoco>"""


KEYS = ("friction_V", "gear_rad", "joint_rad", "plate_V")


class Pilot:
    """A PD (and slow I) for the ball, a P for the angle, on what camera and encoders say."""

    def __init__(self, rows_hz: float) -> None:
        self._rows_hz, self._seen = rows_hz, np.full(2, np.nan)
        self._speed, self._integral = np.zeros(2), np.zeros(2)

    def look(self, seen: np.ndarray) -> None:
        if not np.isnan(self._seen[0]):
            self._speed += 0.5 * ((seen - self._seen) * CAMERA_Hz - self._speed)
        self._seen = seen

    def volts(self, theta: np.ndarray, target: np.ndarray) -> np.ndarray:
        wanted = np.zeros(2)
        if not np.isnan(self._seen[0]):
            error = target - self._seen
            self._integral = np.clip(self._integral + 0.3 * error / self._rows_hz, -0.15, 0.15)
            wanted = np.clip(3.45 * error - 2.11 * self._speed + self._integral, -0.5, 0.5)
        return np.clip(14.0 * (wanted - theta), -6.0, 6.0)


def _log(seed: int, size_m=0.08, *, walls=False, grip=1.0, seconds=40.0, rows_hz=500.0, **pairs):
    """Columns of a closed-loop run with random steps of the target."""
    import mujoco

    rng = np.random.default_rng(seed)
    m = mujoco.MjModel.from_xml_string(_model(pairs, walls=walls, grip=grip))
    d = mujoco.MjData(m)
    n, inner = int(seconds * rows_hz), round(1.0 / rows_hz / STEP_s)
    arms = [m.joint(f"arm_{a}").qposadr[0] for a in "xy"]
    ball, plate = m.body("ball").id, m.body("plate").id
    target = np.zeros((n, 2))
    for a in range(2):
        row = 0
        while row < n:
            end = row + int(rng.uniform(1.0, 3.0) * rows_hz)
            target[row:end, a], row = rng.uniform(-size_m, size_m), end
    log, frames, used, pilot = np.full((n, 6), np.nan), [], 0, Pilot(rows_hz)
    for row in range(n):
        while used < len(frames) and frames[used][0] <= row / rows_hz:
            log[row, 4:] = frames[used][1]
            pilot.look(frames[used][1])
            used += 1
        theta = np.round(d.qpos[arms] * 4096 / math.tau) * math.tau / 4096
        log[row, 2:4], log[row, :2] = theta, pilot.volts(theta, target[row])
        d.ctrl[:] = log[row, :2] + rng.normal(0.0, MOTOR_SD_V, 2)
        for _ in range(inner):
            if d.time >= len(frames) / CAMERA_Hz - 1e-9:
                place = d.xmat[plate].reshape(3, 3).T @ d.xpos[ball]
                frames.append((d.time + DELAY_s, place[:2] + rng.normal(0.0, CAMERA_SD_m, 2)))
            mujoco.mj_step(m, d)
    assert abs(d.xpos[ball][2]) < 0.1, "the ball fell"
    names = "voltage_x_V voltage_y_V theta_x_rad theta_y_rad ball_x_m ball_y_m".split()
    return {"t_s": np.arange(n) / rows_hz} | dict(zip(names, log.T, strict=True))


def mujoco_friction(seed: int) -> World:
    """Dry friction of 0.19 V on both axes, as soft as MuJoCo's is."""
    size = {"friction_V": 0.19}
    columns = _log(seed, friction_V=(0.19, 0.19))
    return columns, rig_toml(), truth({"coulomb_friction": {"x": size, "y": size}}, TWIN)


def mujoco_friction_of_one_axis(seed: int) -> World:
    """0.4 V on y alone."""
    found = truth({"coulomb_friction": {"y": {"friction_V": 0.4}}}, TWIN)
    return _log(seed, friction_V=(0.0, 0.4)), rig_toml(), found


def mujoco_gears(seed: int) -> World:
    """Gear play of 1.7 degrees, through which the arm coasts."""
    size = {"play_rad": 0.03}
    columns = _log(seed, gear_rad=(0.03, 0.03))
    return columns, rig_toml(), truth({"gear_backlash": {"x": size, "y": size}}, TWIN)


def mujoco_joint(seed: int) -> World:
    """Joint play of 1.7 degrees on x; the plate's friction of 0.05 V loads the arms."""
    columns = _log(seed, joint_rad=(0.03, 0.0), plate_V=(0.05, 0.05))
    size = {"play_rad": 0.03}
    found = truth({"joint_backlash": {"x": size}}, "coulomb_friction", "stribeck_friction", TWIN)
    return columns, rig_toml(), found


def mujoco_walls(seed: int) -> World:
    """Healthy but for MuJoCo's slow ball, with a rim at which it lies at times."""
    columns = _log(seed, 0.15, walls=True)
    rig = rig_toml(walls={"present": True, "restitution": 0.5})
    return columns, rig, truth({}, TWIN, kind="healthy")


def mujoco_slipping_ball(seed: int) -> World:
    """An oily plate: friction coefficient 0.006, the ball slides where the plate is steep."""
    return _log(seed, grip=0.006), rig_toml(), truth({}, TWIN, kind="unknown")
