"""The table's equations in numpy, tables innermost: what a batch costs without a compiler.

Without the effects that the default table lacks (no sine of cogging, no walls, no delay).
"""

from collections.abc import Sequence

import numpy as np

from rig.parameters import GRAVITY_M_S2

NAMES = (
    "torque_per_volt motor_damping motor_inertia gear_k gear_c gear_decay gear_1 gear_2 joint_k "
    "joint_c joint_decay joint_1 joint_2 voltage_offset_offset_V coulomb_friction_friction_V "
    "level_offset_slope_rad"
).split()
SINGLES = (
    "step_s arm_inertia plate_inertia arm_friction joint_friction stop_rad ratio radius mass factor"
).split()


def stick(speed, change):
    return np.maximum(speed - change, 0.0) + np.minimum(speed + change, 0.0)


def shaft(twist, rate, lost, low, high, k, c):
    torque = k * (twist - lost) + c * rate
    return (lost >= high) * np.maximum(torque, 0.0) + (lost <= low) * np.minimum(torque, 0.0)


class Tables:
    """Tables side by side: axis rows (2, n), ball rows (n,)."""

    def __init__(self, plants: Sequence[np.record]) -> None:
        for name in NAMES:
            setattr(self, name, np.array([p[name] for p in plants]).T.copy())
        for name in SINGLES:
            setattr(self, name, np.array([np.ravel(p[name])[0] for p in plants]))
        n = len(plants)
        self.angles, self.rates = np.zeros((3, 2, n)), np.zeros((3, 2, n))
        self.gear_lost, self.joint_lost = np.zeros((2, n)), np.zeros((2, n))
        self.ball, self.w, self.spin = np.zeros((2, n)), np.zeros((2, n)), np.zeros(n)

    def step(self, volts: np.ndarray) -> None:
        """One step under volts (2,)."""
        h, (motor, arm, plate) = self.step_s, self.rates
        gear, joint = self.angles[0] - self.angles[1], self.angles[1] - self.angles[2]
        t_gear = shaft(gear, motor - arm, self.gear_lost, self.gear_2, self.gear_1, self.gear_k,
                       self.gear_c)  # fmt: skip
        t_joint = shaft(joint, arm - plate, self.joint_lost, self.joint_2, self.joint_1,
                        self.joint_k, self.joint_c)  # fmt: skip
        v = volts[:, None] + self.voltage_offset_offset_V
        torque = self.torque_per_volt * v - self.motor_damping * motor - t_gear
        dry = self.torque_per_volt * self.coulomb_friction_friction_V
        load = self.mass * GRAVITY_M_S2 * self.ratio * self.ball
        motor = stick(motor + h * torque / self.motor_inertia, h * dry / self.motor_inertia)
        arm = stick(arm + h * (t_gear - t_joint) / self.arm_inertia,
                    h * self.arm_friction / self.arm_inertia)  # fmt: skip
        plate = stick(plate + h * (t_joint + load) / self.plate_inertia,
                      h * self.joint_friction / self.plate_inertia)  # fmt: skip
        self.rates[:] = motor, arm, plate
        self.angles += h * self.rates
        self.rates[0][np.abs(self.angles[0]) > self.stop_rad] = 0.0
        np.clip(self.angles[0], -self.stop_rad, self.stop_rad, out=self.angles[0])
        after = self.angles[0] - self.angles[1], self.angles[1] - self.angles[2]
        self.gear_lost = np.clip(after[0] - (gear - self.gear_lost) * self.gear_decay,
                                 self.gear_2, self.gear_1)  # fmt: skip
        self.joint_lost = np.clip(after[1] - (joint - self.joint_lost) * self.joint_decay,
                                  self.joint_2, self.joint_1)  # fmt: skip
        self._roll(h)

    def _roll(self, h: np.ndarray) -> None:
        r, k, (x, y) = self.radius, self.factor, self.ball
        s = self.ratio * np.sin(self.angles[2])
        turn = self.ratio * np.cos(self.angles[2]) * self.rates[2]
        turn = turn / np.sqrt(1.0 - (s * s).sum(axis=0))
        o1, o2 = -turn[1], turn[0]
        v = self.w + r * np.stack([-o2, o1])
        slope = GRAVITY_M_S2 * (s + self.level_offset_slope_rad)
        gyro = (1.0 - k) * r * self.spin
        a = k * (slope + np.stack([o2 * o2 * x - o1 * o2 * y, o1 * o1 * y - o1 * o2 * x]))
        a = a + gyro * np.stack([o1, o2])
        spin = -(o1 * v[0] + o2 * v[1]) / r
        v = v + h * a
        self.ball = self.ball + h * v
        self.w = v + r * np.stack([o2, -o1])
        self.spin = self.spin + h * spin
