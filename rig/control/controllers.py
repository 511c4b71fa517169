"""The control system of the paper's Fig. 6: PID on the ball, position to volts, play undone or not.

Outer loop: theta_wanted = clip(K_p e + K_i integral(e) - K_d v) per axis; inner loop ("Position
Model"): V = K_s (theta_r - theta) - K_v omega. The arm *without* ends there; the arm *with* is the
same PID plus the inverse of the estimated play (`compensation.py`).
"""

import numpy as np

from rig import compensation
from rig.arms.choice import ARMS_STATE, CURES, FIRST, arm_volts
from rig.compiled import compiled
from rig.observers import ball_now
from rig.parameters import Rig
from rig.play_observer import lost_in_gear, lost_in_joint
from rig.signals import R_THETA, R_TIME

# Which inverse acts, as bits. An inverse also raises the gain at reversals, so the arm *with* has
# controls: a *sham* (the same inverse in the wrong direction) and one *misplaced* (gear play undone
# on the reference, where the loop already sees the load).
WITHOUT = 0
JOINT_INVERSE = 1
GEAR_INVERSE = 2
GEAR_INVERSE_ON_REFERENCE = 4
BACKWARDS = 8
WITH = JOINT_INVERSE | GEAR_INVERSE
SHAM = WITH | BACKWARDS
MISPLACED = JOINT_INVERSE | GEAR_INVERSE_ON_REFERENCE
ARMS = {"without": WITHOUT, "with": WITH, "sham": SHAM, "misplaced": MISPLACED} | CURES

CONTROL = np.dtype(
    [
        ("integral", np.float64, (2,)),
        ("wanted_theta", np.float64, (2,)),
        ("reference", np.float64, (2,)),
        ("inverse", compensation.INVERSE),
        ("gear_inverse", compensation.INVERSE),
        ("arms", ARMS_STATE),
    ]
)
CONTROL_SETTINGS = np.dtype(
    [
        (name, np.float64)
        for name in (
            "tick_s kp ki kd integral_limit servo_kp servo_kd angle_limit encoder_step "
            "play_factor ball_gain motor_gain motor_lag torque_per_volt"
        ).split()
    ]
    + [("joint_given", np.float64, (2,)), ("gear_given", np.float64, (2,)), ("arm", np.int64)]
)


def settings(rig: Rig, arm: int) -> np.record:
    """Settings of the arm (bits above) from the rig's gains."""
    g = np.zeros(1, CONTROL_SETTINGS)[0]
    g["tick_s"] = 1 / rig.control_rate_hz
    g["kp"], g["ki"] = rig.gains.proportional_rad_m, rig.gains.integral_rad_m_s
    g["kd"], g["integral_limit"] = rig.gains.derivative_rad_s_m, rig.gains.integral_limit_rad
    g["servo_kp"] = rig.gains.servo_proportional_V_rad
    g["servo_kd"] = rig.gains.servo_derivative_V_s_rad
    g["angle_limit"] = rig.servo.angle_limit_rad
    g["encoder_step"] = rig.servo.encoder_step_rad
    g["play_factor"], g["ball_gain"] = rig.play.factor, rig.ball_gain_m_s2
    g["motor_gain"], g["motor_lag"] = rig.servo.gain_rad_s_V, rig.servo.time_constant_s
    g["torque_per_volt"] = rig.servo.torque_per_volt_nm
    g["joint_given"] = rig.play.joint_x_rad, rig.play.joint_y_rad
    g["gear_given"] = rig.play.gear_x_rad, rig.play.gear_y_rad
    g["arm"] = arm
    return g


def start() -> np.record:
    return np.zeros(1, CONTROL)[0]


@compiled
def wanted_angle(c, g, a, error, velocity):
    """Outer PID [rad]: clipped at the servo's limit; the integral stands still while clipped."""
    free = g.kp * error + c.integral[a] - g.kd * velocity
    clipped = min(max(free, -g.angle_limit), g.angle_limit)
    step = g.ki * error * g.tick_s
    if free == clipped or (free - clipped) * step < 0.0:
        c.integral[a] = min(max(c.integral[a] + step, -g.integral_limit), g.integral_limit)
    return clipped


@compiled
def _joint(g, play, q_play, a):
    """What is lost in the joint as this arm takes it [rad]: calibrated where it is, else observed;
    nothing where the plate drops."""
    given = g.joint_given[a]
    if given > 0.0:
        found = given + 2.0 * q_play.joint.windup if play.joint.keeps[a] >= 0.5 else 0.0
    else:
        found = lost_in_joint(play, q_play, a)
    return g.play_factor * found


@compiled
def _gear(g, play, q_play, a):
    """The same in the gear [rad]."""
    given = g.gear_given[a]
    found = given + 2.0 * q_play.gear.windup if given > 0.0 else lost_in_gear(play, q_play, a)
    return g.play_factor * found


@compiled
def control(c, g, belief, play, q_play, reading, target, volts):
    """One tick: wanted volts of both axes into `volts` (2,), the ball to `target` (2,) [m].

    `belief` and `play` are the observers' states; what they estimate of play is used by the arm
    "with" alone, and only once it is known.
    """
    for a in range(2):
        theta = reading[R_THETA + a]
        error = target[a] - ball_now(belief, reading[R_TIME], a)
        wanted = wanted_angle(c, g, a, error, belief.velocity[a])
        c.wanted_theta[a] = wanted
        reference = c.reference[a] = wanted
        joint, gear = _joint(g, play, q_play, a), _gear(g, play, q_play, a)
        if g.arm >= FIRST:
            volts[a] = arm_volts(c.arms, c, g, belief, play.gear.twist[a], reading, a, joint, gear)
            continue
        least = 2.0 * g.encoder_step
        if g.arm & JOINT_INVERSE:
            reference = compensation.joint_reference(c.inverse, a, wanted, theta, joint, least)
        if g.arm & GEAR_INVERSE_ON_REFERENCE:
            reference = compensation.joint_reference(
                c.gear_inverse, a, reference, theta, gear, least
            )
        if g.arm & BACKWARDS:
            reference = 2.0 * wanted - reference
        reference = min(max(reference, -g.angle_limit), g.angle_limit)
        c.reference[a] = reference
        v = g.servo_kp * (reference - theta) - g.servo_kd * belief.rate[a]
        if g.arm & GEAR_INVERSE:
            crossing = compensation.gear_volts(
                reference - theta, play.gear.twist[a], gear, g.servo_kp, g.encoder_step
            )
            v += -crossing if g.arm & BACKWARDS else crossing
        volts[a] = v


@compiled
def follow(c, g, belief, reading, angles, volts):
    """Inner loop alone: both servos to `angles` (2,) [rad], clipped at the limit."""
    for a in range(2):
        c.wanted_theta[a] = min(max(angles[a], -g.angle_limit), g.angle_limit)
        c.reference[a] = c.wanted_theta[a]
        volts[a] = (
            g.servo_kp * (c.reference[a] - reading[R_THETA + a]) - g.servo_kd * belief.rate[a]
        )


@compiled
def level(g, belief, reading, volts):
    """Hold both servos at zero: before anything is seen and while the ball is not."""
    for a in range(2):
        volts[a] = -g.servo_kp * reading[R_THETA + a] - g.servo_kd * belief.rate[a]
