"""The MuJoCo mechanism behind the product's seam: read, drive, close; and its truth for tests."""

from collections.abc import Sequence
from math import sqrt

import numpy as np

from experiments.benchmark.engines.mujoco_engine.binding import mujoco
from experiments.benchmark.engines.mujoco_engine.mechanism import Build, mechanism
from rig.parameters import Rig
from rig.safety.levelling import LevelOnExit
from rig.table import Reading
from vision.frames import Observation

FLYWHEEL_KG_M2 = 1e3


class MujocoTable(LevelOnExit):
    """The contract of `rig.table` over the mechanism; sensors and camera as the rig's numbers say.

    The ball starts at `start_m` in the plate's frame with the velocity `velocity_m_s`, rolling, and
    `spin_rad_s` about the normal, on a plate at rest with both servos at `theta_rad`.
    """

    def __init__(
        self,
        rig: Rig,
        rng: np.random.Generator,
        *,
        build: Build | None = None,
        start_m: Sequence[float] = (0.0, 0.0),
        velocity_m_s: Sequence[float] = (0.0, 0.0),
        spin_rad_s: float = 0.0,
        theta_rad: Sequence[float] = (0.0, 0.0),
        drive_y: Rig | None = None,
    ) -> None:
        self.period_s = 1 / rig.control_rate_hz
        self.voltage_limit_V = rig.servo.voltage_limit_V
        self._rig, self._build, self._rng = rig, build or Build(), rng
        self.model = mujoco.MjModel.from_xml_string(mechanism(rig, self._build, drive_y))
        if not self._build.universal:
            self.model.dof_armature[int(self.model.joint("tilt").dofadr[0]) + 2] = FLYWHEEL_KG_M2
        self.data = mujoco.MjData(self.model)
        mujoco.mj_setConst(self.model, self.data)  # the inertia that MuJoCo keeps of a change
        self.plate = int(self.model.body("plate").id)
        names = [f"{part}_{n}" for part in ("motor", "arm", "crank") for n in "xy"]
        cams = [f"cam_{n}" for n in "xy"] if self._build.cam else []
        self._cams = np.array([self.model.joint(n).qposadr[0] for n in cams], dtype=int)
        self._hinges = np.array([self.model.joint(n).qposadr[0] for n in names])
        self._rates = np.array([self.model.joint(n).dofadr[0] for n in names])
        self._place(theta_rad, start_m, velocity_m_s, spin_rad_s)
        self._ticks, self._frames, self._volts = -1, 0, (0.0, 0.0)
        self._pending: list[tuple[float, Observation]] = []

    def _place(self, theta, xy, velocity, spin) -> None:
        d, m, r = self.data, self.model, self._rig.ball.radius_m
        d.qpos[self._hinges] = np.tile(theta, 3)
        d.qpos[self._cams] = theta if len(self._cams) else ()
        s_x, s_y = self._rig.linkage.ratio * np.sin(theta)
        if self._build.universal:
            d.qpos[m.joint("tilt_x").qposadr[0]] = np.arcsin(s_x)
            d.qpos[m.joint("tilt_y").qposadr[0]] = np.arcsin(s_y / sqrt(1 - s_x**2))
        else:  # the shortest turn: about the horizontal line (-s_y, s_x)
            sine = max(np.hypot(s_x, s_y), 1e-12)
            half = np.arcsin(sine) / 2
            q = [np.cos(half), *(np.sin(half) / sine * np.array([-s_y, s_x, 0]))]
            first = int(m.joint("tilt").qposadr[0])
            d.qpos[first : first + 4] = q
        mujoco.mj_kinematics(m, d)
        frame = d.body("plate").xmat.reshape(3, 3)
        v = np.array([*velocity, 0.0])
        turn = np.array([-v[1] / r, v[0] / r, spin])
        free = int(m.body("ball").jntadr[0])
        q, w = int(m.jnt_qposadr[free]), int(m.jnt_dofadr[free])
        d.qpos[q : q + 3] = frame @ [*xy, r]
        d.qvel[w : w + 3], d.qvel[w + 3 : w + 6] = frame @ v, frame @ turn
        mujoco.mj_forward(m, d)

    # --- the truth ---
    def angles(self) -> np.ndarray:
        """Motor, arm and crank angles [rad], (3, 2)."""
        return self.data.qpos[self._hinges].reshape(3, 2)

    def sines(self) -> np.ndarray:
        """Sines of the plate's tilt, (2,): how far its axes point down."""
        return -self.data.body("plate").xmat.reshape(3, 3)[2, :2]

    def ball(self) -> tuple[np.ndarray, np.ndarray, float]:
        """Ball centre (3,) [m] and velocity (3,) [m/s] in the plate's frame; spin there [rad/s]."""
        plate, ball = self.data.body("plate"), self.data.body("ball")
        frame = plate.xmat.reshape(3, 3)
        turn = np.zeros(6)
        mujoco.mj_objectVelocity(self.model, self.data, mujoco.mjtObj.mjOBJ_BODY, plate.id, turn, 0)
        free = int(self.model.jnt_dofadr[self.model.body("ball").jntadr[0]])
        v, w = self.data.qvel[free : free + 3], self.data.qvel[free + 3 : free + 6]
        v = v - np.cross(turn[:3], ball.xpos)
        spin = float(frame[:, 2] @ ball.xmat.reshape(3, 3) @ w)
        return frame.T @ ball.xpos, frame.T @ v, spin

    # --- the contract ---
    def read(self) -> Reading:
        if self._ticks >= 0:
            self.advance(self._volts)
        self._ticks += 1
        servo, t = self._rig.servo, self._ticks * self.period_s
        step = servo.encoder_step_rad
        theta = np.floor(self.angles()[1] / step + 0.5) * step
        speed = self.data.qvel[self._rates[:2]] * (1 + servo.tachometer_scale)
        speed = speed + servo.tachometer_noise_rad_s * self._rng.standard_normal(2)
        due = [o for usable, o in self._pending if usable <= t + 1e-9]
        self._pending = [p for p in self._pending if p[0] > t + 1e-9]
        motor = (float(speed[0]), float(speed[1])) if servo.tachometer else None
        return Reading(t, (float(theta[0]), float(theta[1])), motor, due[-1] if due else None)

    def drive(self, volts: tuple[float, float]) -> None:
        if not np.isfinite(volts).all():
            raise ValueError(f"volts must be finite, got {volts}; use rig.safety.limits.limit")
        self._volts = volts

    def close(self) -> None:
        self._volts = (0.0, 0.0)

    @property
    def volts_V(self) -> tuple[float, float]:
        """What stands at the motors' terminals."""
        return self._volts

    def advance(self, volts: Sequence[float]) -> None:
        """One control tick under these volts, with the camera's exposures on the way."""
        self.data.ctrl[:] = volts
        left = round(self.period_s / self._build.step_s)
        begin, h = max(self._ticks, 0) * self.period_s, self._build.step_s
        exposed = (self._frames + 1) / self._rig.camera.rate_hz
        if exposed <= begin + self.period_s + 1e-12:
            before = min(int((exposed - begin) / h), left)
            mujoco.mj_step(self.model, self.data, nstep=before)
            self._look(exposed, exposed - begin - before * h)
            left -= before
        mujoco.mj_step(self.model, self.data, nstep=left)

    def _look(self, exposed: float, further_s: float) -> None:
        self._frames += 1
        xyz, v, _ = self.ball()
        if xyz[2] < 0.5 * self._rig.ball.radius_m:  # fallen off
            return
        camera = self._rig.camera
        x, y = xyz[:2] + further_s * v[:2] + camera.noise_m * self._rng.standard_normal(2)
        if self._rng.random() < camera.dropout:
            return
        variance = camera.noise_m**2
        seen = Observation((float(x), float(y)), (variance, 0.0, variance), exposed)
        self._pending.append((exposed + camera.delay_s, seen))
