"""The MuJoCo mechanism with everything that can be hidden in a table, moved on block by block.

MuJoCo's own way where it has one: plays are limits, dry friction is `frictionloss` (Stribeck's
changes it with the speed), level and bumps turn gravity, a bent linkage or ripple is a cam (a joint
equality), cross coupling a pulley between the rods, an unbalanced ball a body whose mass lies
aside. Forces over the plate are applied to the ball, and so is rolling resistance: the rolling
friction of MuJoCo's contacts is as soft as it is small, here nothing but a drag. What happens to
volts before the motor and to positions after the camera's light are the foreign table's equations:
they are no mechanics.
"""

from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from experiments.benchmark.engines.foreign.parts import Odd, Plant, packed
from experiments.benchmark.engines.foreign.plant import G, _at_motor, _held, _odd_forces
from experiments.benchmark.engines.mujoco_engine.binding import mujoco
from experiments.benchmark.engines.mujoco_engine.mechanism import Build
from experiments.benchmark.engines.mujoco_engine.table import MujocoTable
from rig.parameters import Ball, Drive, Rig, Servo

ARM_FRICTION_NM, JOINT_FRICTION_NM = 3e-4, 1.2e-3  # a well-kept table: together 0.012 V
BLOCK_S = 1e-3  # forces and volts are held for so long at most
STEP_S = 2e-4
LAG_S = 2.75 * STEP_S  # of the soft constraints between motor and encoder: a part of any delay


@dataclass(frozen=True)
class Moved:
    """The ball after a block, in the plate's frame: position, velocity (2,) [m, m/s], height."""

    xy_m: np.ndarray
    velocity_m_s: np.ndarray
    height_m: float


def _rig(plant: Plant, axis: int) -> Rig:
    """What the mechanism reads of one axis: servo, plays, dry friction."""
    servo = Servo(gain_rad_s_V=plant.gain[axis], time_constant_s=plant.tau[axis])
    held = (ARM_FRICTION_NM + JOINT_FRICTION_NM) / servo.torque_per_volt_nm
    effects = {"coulomb_friction": {"friction_V": max(plant.friction[axis] - held, 0.0)}}
    for place, width, middle in (
        ("gear", plant.gear[axis], plant.gear_middle[axis]),
        ("joint", plant.joint[axis], plant.joint_middle[axis]),
    ):
        if width > 0:
            effects[f"{place}_backlash"] = {"play_rad": width, "offset_rad": middle}
    return Rig(
        servo=servo,
        ball=Ball(hollow=plant.factor < 0.65),
        drive=Drive(arm_friction_nm=ARM_FRICTION_NM, joint_friction_nm=JOINT_FRICTION_NM),
        effects={name: {"xy"[axis]: dict(pairs)} for name, pairs in effects.items()},
    )


def sine_as_cubic(at: float, turns: float, phase: float) -> np.ndarray:
    """Coefficients (4,) of the cubic in theta that touches sin(turns theta + phase) at `at`."""
    s, c = np.sin(turns * at + phase), np.cos(turns * at + phase)
    a0, a1, a2, a3 = s, turns * c, -(turns**2) * s / 2, -(turns**3) * c / 6
    return np.array(
        [
            a0 - a1 * at + a2 * at**2 - a3 * at**3,
            a1 - 2 * a2 * at + 3 * a3 * at**2,
            a2 - 3 * a3 * at,
            a3,
        ]
    )


class HiddenTable:
    """The mechanism as `plant` and `odd` say.

    start: x, y, x', y' and spin of the ball (5,) [m, m/s, rad/s]; None = servos alone.
    """

    def __init__(self, plant: Plant, odd: Odd, start: np.ndarray | None, step_s: float) -> None:
        self._plant, self._odd, self._ball = plant, odd, start is not None
        begin = [0.0] * 5 if start is None else start.tolist()
        self._records = packed(plant), packed(odd)
        x, y = _rig(plant, 0), _rig(plant, 1)
        build = Build(
            step_s=step_s,
            cam=True,
            cross=(float(plant.cross[0]), float(plant.cross[1])),
            heavy_m=(float(odd.heavy[0]), float(odd.heavy[1]), float(odd.heavy[2])),
        )
        self.table = MujocoTable(
            replace(x, effects=_both(x, y)),
            np.random.default_rng(0),
            build=build,
            start_m=begin[:2],
            velocity_m_s=begin[2:4],
            spin_rad_s=begin[4],
            drive_y=y,
        )
        self._model, self._data = self.table.model, self.table.data
        self._who = int(self._model.body("ball").id)
        self._mass = float(self._model.body_mass[self._who])
        self._cams = [int(self._model.equality(f"cam_{n}").id) for n in "xy"]
        self._motors = [int(self._model.joint(f"motor_{n}").dofadr[0]) for n in "xy"]
        self._dry = self._model.dof_frictionloss[self._motors].copy()
        self._drives = [int(self._model.actuator(f"volts_{n}").id) for n in "xy"]
        self._viscous = self._model.actuator_biasprm[self._drives, 2].copy()
        self._per_volt = x.servo.torque_per_volt_nm
        self._step_s = step_s
        self._slope(0.0)
        self._bend()

    def _slope(self, t: float) -> None:
        """Gravity as the plate's frame has it: level, its drift, a bump."""
        p, odd = self._plant, self._odd
        s = p.slope + p.slope_rate * t
        if odd.bump_from <= t < odd.bump_to:
            s = s + odd.bump
        down = G * np.array([*s, -sqrt(1 - s @ s)])
        self._model.opt.gravity[:] = down if self._ball else 0.0

    def _bend(self) -> None:
        """The cams' polynomials, ripple by its cubic at the arm's present angle."""
        p, theta = self._plant, self.table.angles()[1]
        for a, cam in enumerate(self._cams):
            bent = np.array([0.0, 1.0, p.quadratic[a], p.cubic[a], 0.0])
            if p.ripple[a] != 0:
                wave = sine_as_cubic(theta[a], p.ripple_turns[a], p.ripple_phase[a])
                bent[:4] += p.ripple[a] * wave
                bent[0] -= p.ripple[a] * np.sin(p.ripple_phase[a])
            self._model.eq_data[cam, :5] = bent

    def _rub(self) -> None:
        """Dry friction of the motors that falls with their speed."""
        p, speed = self._plant, self._data.qvel[self._motors]
        extra = p.stribeck * np.exp(-((speed / p.stribeck_speed) ** 2))
        self._model.dof_frictionloss[self._motors] = self._dry + self._per_volt * extra

    def _lean(self) -> None:
        """Viscous friction of the motors that differs by direction."""
        way = np.sign(self._data.qvel[self._motors])
        self._model.actuator_biasprm[self._drives, 2] = self._viscous * (
            1.0 + way * self._plant.lopsided
        )

    def volts(self, commands: np.ndarray, dt: float, t: float, h: float) -> np.ndarray:
        """What is left of the commands (2, n) at the motors (2,) over [t, t + h]."""
        p, (plant, odd) = self._plant, self._records
        late = np.maximum(p.delay - LAG_S, 0.0)
        held = [_held(commands[a], dt, t - late[a], h) for a in range(2)]
        x, y = (min(max(v, -top), top) for v, top in zip(held, p.limit, strict=True))
        motor = self.table.angles()[0]
        at_x = _at_motor(plant, odd, 0, x, y, motor[0], t)
        return np.array([at_x, _at_motor(plant, odd, 1, y, x, motor[1], t)])

    def move(self, volts: np.ndarray, push: np.ndarray, now: Moved, t: float, steps: int) -> Moved:
        """So many steps on; `push`: acceleration of the ball by others (2,) [m/s2]."""
        p, odd, d = self._plant, self._odd, self._data
        if p.slope_rate.any() or odd.bump.any():
            self._slope(t)
        if p.ripple.any():
            self._bend()
        if p.stribeck.any():
            self._rub()
        if p.lopsided.any():
            self._lean()
        d.ctrl[:] = volts
        if self._ball:
            (x, y), (vx, vy) = now.xy_m, now.velocity_m_s
            strange = _odd_forces(self._records[1], p.factor, x, y, vx, vy, (0.0, 0.0, 0.0), t)
            if odd.bump_from <= t < odd.bump_to:  # that is gravity's here
                strange = np.array(strange) - p.factor * G * odd.bump
            a = push + strange - p.bowl * now.xy_m - self._braked(now.velocity_m_s)
            frame = d.xmat[self.table.plate].reshape(3, 3)
            d.xfrc_applied[self._who, :3] = frame[:, :2] @ (self._mass / p.factor * a)
        mujoco.mj_step(self._model, d, nstep=steps)
        return self._where(now, steps * self._step_s) if self._ball else now

    def _braked(self, v: np.ndarray) -> np.ndarray:
        """Drag and rolling resistance [m/s2]; this grows from 0 to its size over a small speed."""
        p = self._plant
        slow = 4 * BLOCK_S * p.rolling
        return p.drag * v + p.rolling * v / max(np.hypot(v[0], v[1]), slow, 1e-9)

    def _where(self, before: Moved, passed_s: float) -> Moved:
        """The ball now (up to date with the last step), its velocity since `before`."""
        mujoco.mj_kinematics(self._model, self._data)
        frame = self._data.xmat[self.table.plate].reshape(3, 3)
        xyz = self._data.xpos[self._who] @ frame
        return Moved(xyz[:2], (xyz[:2] - before.xy_m) / passed_s, float(xyz[2]))

    def motor_speeds(self) -> np.ndarray:
        return self._data.qvel[self._motors]


def _both(x: Rig, y: Rig) -> dict[str, dict[str, dict[str, float]]]:
    """The effects of both axes' rigs as one."""
    names = dict.fromkeys([*x.effects, *y.effects])
    return {n: {**x.effects.get(n, {}), **y.effects.get(n, {})} for n in names}
