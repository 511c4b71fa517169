"""Servos as their makers build them, in MuJoCo: a motor, a proportional controller, a dead band.

A pulse tells an angle every `period_s`; the electronics drive the motor with a torque in proportion
to what is missing, beyond a dead band, up to the motor's stall torque. Nothing here is a first
order lag or a rate limit: they come of the motor's damping,

    mean delay of an answer = damping / gain,    rate limit = stall torque / damping.
"""

import importlib
from dataclasses import dataclass
from typing import Any

import numpy as np

from rig.table import Reading

mujoco: Any = importlib.import_module("mujoco")  # its compiled part has no types
STEP_S = 2e-4


@dataclass(frozen=True)
class Motor:
    """One servo's electronics and motor; torques at the load shaft."""

    gain_nm_rad: float = 6.0
    stall_nm: float = 1.2
    damping_nm_s: float = 0.24
    inertia_kg_m2: float = 4e-4
    dead_band_rad: float = 0.006
    dead_time_s: float = 0.008
    period_s: float = 0.02
    zero_rad: float = 0.0

    @property
    def lag_s(self) -> float:
        """Mean delay of the answer to a small step [s]: of J s^2 + d s + k, d/k."""
        return self.damping_nm_s / self.gain_nm_rad

    @property
    def rate_limit_rad_s(self) -> float:
        """Speed at stall torque [rad/s]."""
        return self.stall_nm / self.damping_nm_s


class MotorServos:
    """Two such servos as a table without a plate: `read`, `drive`, `close`."""

    voltage_limit_V, takes_angle = 0.0, True

    def __init__(self, x: Motor, y: Motor, *, tick_s: float = 0.004, counts: int = 4096) -> None:
        self.period_s, self._count, self._motors = tick_s, 2 * np.pi / counts, (x, y)
        bodies = "".join(
            f'<body><joint name="{n}" axis="0 0 1" damping="{m.damping_nm_s}"/>'
            f'<inertial pos="0 0 0" mass="0.01" diaginertia="{3 * f"{m.inertia_kg_m2} "}"/></body>'
            for n, m in zip("xy", self._motors, strict=True)
        )
        self._model = mujoco.MjModel.from_xml_string(
            f'<mujoco><option timestep="{STEP_S}" gravity="0 0 0"/><worldbody>{bodies}'
            '</worldbody><actuator><motor joint="x"/><motor joint="y"/></actuator></mujoco>'
        )
        self._data = mujoco.MjData(self._model)
        self._ticks, self._steps, self._told = -1, 0, [(0.0, (0.0, 0.0))]
        self._pulse = [(0.0, 0.0), (0.0, 0.0)]  # of each servo: when it began, its angle

    def read(self) -> Reading:
        """Move on by a tick; the angles to the nearest count."""
        if self._ticks >= 0:
            for _ in range(round(self.period_s / STEP_S)):
                self._step()
        self._ticks += 1
        angles = np.round(self._data.qpos / self._count) * self._count
        return Reading(self._ticks * self.period_s, (float(angles[0]), float(angles[1])))

    def drive(self, volts: tuple[float, float]) -> None:
        """Tell angles (x, y) [rad] from now on."""
        self._told.append((self._steps * STEP_S, volts))

    def close(self) -> None:
        """Tell 0."""
        self.drive((0.0, 0.0))

    def _step(self) -> None:
        now = self._steps * STEP_S
        for a, motor in enumerate(self._motors):
            wanted = self._pulsed(a, motor, now)
            error = wanted + motor.zero_rad - self._data.qpos[a]
            beyond = np.sign(error) * max(abs(error) - motor.dead_band_rad, 0.0)
            torque = motor.gain_nm_rad * beyond
            self._data.ctrl[a] = np.clip(torque, -motor.stall_nm, motor.stall_nm)
        mujoco.mj_step(self._model, self._data)
        self._steps += 1

    def _pulsed(self, a: int, motor: Motor, now: float) -> float:
        """The angle of the pulse that has arrived."""
        sent = np.floor((now - motor.dead_time_s) / motor.period_s + 1e-9) * motor.period_s
        if sent > self._pulse[a][0]:
            before = [told for when, told in self._told if when <= sent + 1e-9]
            self._pulse[a] = (sent, before[-1][a])
            self._told = self._told[-64:]
        return self._pulse[a][1]
