"""Tables whose servos take an angle as MuJoCo mechanisms: position actuators, rods, contacts.

The servos are MuJoCo's own: a position actuator behind its first-order filter (`filterexact`). Two
rods are bodies connected to a plate on a ball joint, whose flywheel keeps it from turning about its
normal; three arms carry a free plate by rods that are hinged at their elbows and connected to it
(3-RRS). No formula of a linkage stands here: constraints close the loops. Play of two rods is a
horn that turns on its arm between two stops; dry friction of the pivot holds the plate within it.
"""

import importlib
from math import cos, pi, sin
from typing import Any

import numpy as np

from experiments.benchmark.engines.mujoco_engine.table import FLYWHEEL_KG_M2
from rig.linkage import THREE_ARMS, Linkage
from rig.parameters import GRAVITY_M_S2, Ball, Rig, Servo

mujoco: Any = importlib.import_module("mujoco")  # its compiled part has no types
STEP_S = 1e-4
STIFF_NM_RAD, ARMATURE_KG_M2 = 400.0, 4e-4  # chosen: 1000 rad/s, critically damped: 2 ms of lag
DAMPING_NM_S = 2 * (STIFF_NM_RAD * ARMATURE_KG_M2) ** 0.5
LIGHT = '<inertial pos="0 0 0" mass="1e-4" diaginertia="1e-7 1e-7 1e-7"/>'
HALF_THICKNESS_M = 0.004
HORN_ARMATURE_KG_M2 = 2e-6  # assumed: rod and horn of a few grams
HARD = f"{3 * STEP_S} 1", "0.9999 0.9999 1"  # solref, solimp


def _hinged(name: str, at: str, axis: str, inside: str, armature: float) -> str:
    return (
        f'<body name="{name}" {at}>{LIGHT}<joint name="{name}" axis="{axis}" '
        f'armature="{armature}"/>{inside}</body>'
    )


def _horn(n: str, axis: str, play_rad: float, inside: str) -> str:
    """What turns on the arm between two stops `play_rad` apart."""
    ref, imp = HARD
    joint = (
        f'<joint name="horn_{n}" axis="{axis}" armature="{HORN_ARMATURE_KG_M2}" limited="true" '
        f'range="{-play_rad / 2} {play_rad / 2}" solreflimit="{ref}" solimplimit="{imp}"/>'
    )
    return f'<body name="horn_{n}">{LIGHT}{joint}{inside}</body>'


def _two_rods(
    rig: Rig, play_rad: tuple[float, float] | None, friction_nm: float
) -> tuple[str, str, str]:
    """Bodies, the plate's joint, constraints. An arm that rises lifts the plate's other side, so
    the rods stand at -x and -y."""
    bodies, joined = "", ""
    for a, n in enumerate("xy"):
        one = rig.linkage.on(n)
        arm, lever, rod = one.arm_radius_m, one.plate_side_m / 2, one.rod_length_m
        out = f"{-arm} 0 0" if a == 0 else f"0 {-arm} 0"
        axle = (-(lever - arm), 0, -rod) if a == 0 else (0, -(lever - arm), -rod)
        up = f'<joint name="rod_{n}" type="ball" armature="1e-6"/>'
        inside = (
            f'<body name="rod_{n}" pos="{out}">{LIGHT}{up}<site name="top_{n}" pos="0 0 {rod}"/>'
            "</body>"
        )
        axis = "0 1 0" if a == 0 else "-1 0 0"
        at = f'pos="{axle[0]} {axle[1]} {axle[2]}"'
        if play_rad is not None:
            inside = _horn(n, axis, play_rad[a], inside)
        bodies += _hinged(f"arm_{n}", at, axis, inside, ARMATURE_KG_M2)
        joined += f'<connect site1="top_{n}" site2="edge_{n}"/>'
    edges = (
        f'<site name="edge_x" pos="{-rig.linkage.half_sides_m[0]} 0 0"/>'
        f'<site name="edge_y" pos="0 {-rig.linkage.half_sides_m[1]} 0"/>'
    )
    ref, imp = HARD
    dry = f'frictionloss="{friction_nm}" solreffriction="{ref}" solimpfriction="{imp}"'
    return bodies, f'<joint name="tilt" type="ball" {dry}/>{edges}', joined


def _three_arms(rig: Rig, level_rad: float) -> tuple[str, str, str]:
    base, plate, arm, rod = rig.linkage.size
    bodies, joined, sites = "", "", '<freejoint name="tilt"/>'
    for i in range(3):
        psi = 2 * pi * i / 3
        u, v = cos(psi), sin(psi)
        elbow = np.array([base + arm * cos(level_rad), arm * sin(level_rad)])
        top = np.array([plate, rig.linkage.height_m])
        d = top - elbow
        assert abs(np.hypot(*d) - rod) < 1e-9
        end = f"{d[0] * u} {d[0] * v} {d[1]}"
        out = f"{(elbow[0] - base) * u} {(elbow[0] - base) * v} {elbow[1]}"
        axis = f"{v} {-u} 0"  # a positive turn raises the arm
        upper = (
            f'<body name="rod_{i}" pos="{out}">{LIGHT}<joint name="rod_{i}" axis="{axis}" '
            f'armature="1e-6"/><site name="top_{i}" pos="{end}"/></body>'
        )
        at = f'pos="{base * u} {base * v} 0"'
        bodies += _hinged(f"arm_{i}", at, axis, upper, ARMATURE_KG_M2)
        sites += f'<site name="edge_{i}" pos="{plate * u} {plate * v} 0"/>'
        joined += f'<connect site1="top_{i}" site2="edge_{i}"/>'
    return bodies, sites, joined


class PositionTable:
    """The mechanism of a rig file, its arms told angles; truth for tests.

    level_rad: angle of three arms from the horizontal that holds the plate level; ball_m: where the
    ball lies on the plate, None for no ball; play_rad: full width of the play of two rods, between
    arm and horn, None for no horn; friction_nm: of the plate in its pivot.
    """

    def __init__(
        self,
        rig: Rig,
        *,
        level_rad: float = 0.0,
        ball_m: tuple[float, float] | None = None,
        play_rad: tuple[float, float] | None = None,
        friction_nm: float = 0.0,
    ) -> None:
        self._rig, arms = rig, rig.linkage.kind == THREE_ARMS
        bodies, joint, joined = (
            _three_arms(rig, level_rad) if arms else _two_rods(rig, play_rad, friction_nm)
        )
        self.names = [f"arm_{n}" for n in ("012" if arms else "xy")]
        lags = rig.servo.pair("lag_s") if not arms else (rig.servo.lag_s,) * 3
        servos = "".join(
            f'<general joint="{n}" dyntype="filterexact" dynprm="{lag}" gainprm="{STIFF_NM_RAD}" '
            f'biastype="affine" biasprm="0 {-STIFF_NM_RAD} {-DAMPING_NM_S}"/>'
            for n, lag in zip(self.names, lags, strict=True)
        )
        ref, imp = HARD
        hard = f'solref="{ref}" solimp="{imp}"'
        (h_x, h_y), t = rig.linkage.half_sides_m, HALF_THICKNESS_M
        z = rig.linkage.height_m if arms else 0.0
        ball, pair = "", ""
        if ball_m is not None:
            m, r = rig.ball.mass_kg, rig.ball.radius_m
            i = (2 / 3 if rig.ball.hollow else 2 / 5) * m * r * r
            ball = (
                f'<body name="ball" pos="{ball_m[0]} {ball_m[1]} {z + r}"><freejoint/>'
                f'<inertial pos="0 0 0" mass="{m}" diaginertia="{i} {i} {i}"/>'
                f'<geom name="ball" type="sphere" size="{r}"/></body>'
            )
            pair = (
                '<contact><pair geom1="top" geom2="ball" condim="3" '
                f'friction="20 20 1e-9 1e-9 1e-9" {hard}/></contact>'
            )
        self.model = mujoco.MjModel.from_xml_string(
            f"""<mujoco><compiler angle="radian" inertiafromgeom="false" autolimits="false"/>
<option timestep="{STEP_S}" gravity="0 0 {-GRAVITY_M_S2}" cone="elliptic" solver="Newton"
 iterations="60" tolerance="1e-14" integrator="Euler"><flag eulerdamp="disable"/></option>
<default><geom contype="0" conaffinity="0"/><equality {hard}/></default>
<worldbody>{bodies}<body name="plate" pos="0 0 {z}"><inertial pos="0 0 0" mass="0.05"
 diaginertia="1e-4 1e-4 2e-4"/>{joint}
 <geom name="top" type="box" size="{h_x} {h_y} {t}" pos="0 0 {-t}"/></body>{ball}</worldbody>
<equality>{joined}</equality><actuator>{servos}</actuator>{pair}</mujoco>"""
        )
        if not arms:
            self.model.dof_armature[int(self.model.joint("tilt").dofadr[0]) + 2] = FLYWHEEL_KG_M2
        self.data = mujoco.MjData(self.model)
        mujoco.mj_setConst(self.model, self.data)
        mujoco.mj_forward(self.model, self.data)

    def advance(self, angles_rad: np.ndarray, steps: int) -> None:
        """Tell the arms these angles (from level) for so many steps."""
        self.data.ctrl[:] = angles_rad
        for _ in range(steps):
            mujoco.mj_step(self.model, self.data)

    def arms_rad(self) -> np.ndarray:
        """Angles of the arms from level."""
        return np.array([self.data.joint(n).qpos[0] for n in self.names])

    def frame(self) -> np.ndarray:
        """World from plate (3, 3)."""
        return self.data.body("plate").xmat.reshape(3, 3)

    def sines(self) -> np.ndarray:
        """Sines of the plate's tilt (2,): how far its axes point down."""
        return -self.frame()[2, :2]

    def centre_m(self) -> np.ndarray:
        """The plate's centre (3,) [m]."""
        return self.data.body("plate").xpos.copy()

    def ball_m(self) -> np.ndarray:
        """Ball's centre in the plate's frame (3,) [m]."""
        return self.frame().T @ (self.data.body("ball").xpos - self.centre_m())


def table_of_lengths(
    size_m: tuple[float, float, float, float, float],
    side_m: float | np.ndarray,
    ball: tuple[float, float],
    *,
    limit_rad: float,
    **more: Any,
) -> PositionTable:
    """The mechanism of these lengths, for who knows no rig file, its servos as fast as they can.

    size_m: arm, rod, and of three arms base, plate, height; side_m: of three arms' plate, or (2,)
    of two rods'; ball: radius [m] and mass [kg], solid; limit_rad: of the angles; more: as of
    `PositionTable`.
    """
    arm, rod, base, plate, height = size_m
    if np.ndim(side_m) == 0:
        link = Linkage(THREE_ARMS, arm, float(side_m), rod, base, plate, height)
    else:
        x, y = ({"plate_side_m": float(side)} for side in np.asarray(side_m))
        link = Linkage(arm_radius_m=arm, rod_length_m=rod, x=x, y=y)
    rig = Rig(
        servo=Servo("position", lag_s=1e-6, angle_limit_rad=limit_rad, stop_rad=1.2),
        linkage=link,
        ball=Ball(hollow=False, radius_m=ball[0], mass_kg=ball[1]),
    )
    return PositionTable(rig, **more)
