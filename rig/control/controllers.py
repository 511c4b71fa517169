"""The control system of the paper's Fig. 6: PID on the ball, position to volts, with or without an
inverse of backlash.

Outer loop: theta_wanted = clip(K_p e + K_i integral(e) - K_d v) per axis; inner loop ("Position
Model"): V = K_s (theta_r - theta) - K_v omega. Compensator *without* ends there; *with* is the
same PID plus the inverse of the estimated play (`compensation.py`). Where the servos take an angle,
theta_r is what they are told: there is no inner loop, and "volts" below are angles [rad].
"""

import numpy as np

from rig.compiled import compiled
from rig.control import compensation
from rig.control.compensators.choice import (
    COMPENSATOR_STATES,
    FIRST_PUBLISHED,
    LQG,
    MPC,
    PUBLISHED,
    compensator_volts,
)
from rig.control.optimal import lqg, mpc
from rig.control.optimal.design import WEIGHTS
from rig.estimation.backlash_observer import lost_in_gear, lost_in_joint
from rig.estimation.observers import ball_now
from rig.parameters import Rig
from rig.table import R_THETA, R_TIME

# Which inverse acts, as bits. An inverse also raises the gain at reversals, so *with* has
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
COMPENSATORS = {"without": WITHOUT, "with": WITH, "sham": SHAM, "misplaced": MISPLACED} | PUBLISHED

CONTROL = np.dtype(
    [
        ("integral", np.float64, (2,)),
        ("wanted_theta", np.float64, (2,)),
        ("reference", np.float64, (2,)),
        ("inverse", compensation.INVERSE),
        ("gear_inverse", compensation.INVERSE),
        ("compensators", COMPENSATOR_STATES),
        ("lqg", lqg.LQG_STATE),
        ("mpc", mpc.MPC_STATE),
    ]
)
CONTROL_SETTINGS = np.dtype(
    [
        (name, np.float64)
        for name in (
            "tick_s kp ki kd integral_limit servo_kp servo_kd angle_limit encoder_step "
            "backlash_factor ball_gain motor_gain motor_lag torque_per_volt"
        ).split()
    ]
    + [
        ("takes_angle", np.int64),
        ("joint_given", np.float64, (2,)),
        ("gear_given", np.float64, (2,)),
        ("compensator", np.int64),
        ("lqg", lqg.LQG_SETTINGS),
        ("mpc", mpc.MPC_SETTINGS),
    ]
)


def settings(rig: Rig, compensator: int) -> np.record:
    """Return the settings (dtype CONTROL_SETTINGS) from the rig's gains and known backlash.

    compensator: a number of COMPENSATORS.
    """
    g = np.zeros(1, CONTROL_SETTINGS)[0]
    g["tick_s"] = 1 / rig.control_rate_hz
    g["kp"], g["ki"] = rig.gains.proportional_rad_m, rig.gains.integral_rad_m_s
    g["kd"], g["integral_limit"] = rig.gains.derivative_rad_s_m, rig.gains.integral_limit_rad
    g["servo_kp"] = rig.gains.servo_proportional_V_rad
    g["servo_kd"] = rig.gains.servo_derivative_V_s_rad
    g["angle_limit"] = rig.servo.angle_limit_rad
    g["encoder_step"] = rig.servo.encoder_step_rad
    g["backlash_factor"], g["ball_gain"] = rig.play.factor, rig.ball_gain_m_s2
    g["motor_gain"], g["motor_lag"] = rig.servo.gain_rad_s_V, rig.servo.time_constant_s
    g["torque_per_volt"] = rig.servo.torque_per_volt_nm
    g["joint_given"] = rig.play.joint_x_rad, rig.play.joint_y_rad
    g["gear_given"] = rig.play.gear_x_rad, rig.play.gear_y_rad
    if compensator in (LQG, MPC):
        weights = WEIGHTS["mpc" if compensator == MPC else "lqg"]
        g["lqg"] = lqg.settings(rig, weights)
        if compensator == MPC:
            g["mpc"] = mpc.settings(rig, weights)
    g["compensator"], g["takes_angle"] = compensator, int(rig.servo.takes_angle)
    return g


def check_compensator(rig: Rig, compensator: int) -> None:
    """Raise ValueError (one line) where a compensator commands volts and the servos take angles."""
    if rig.servo.takes_angle and compensator >= FIRST_PUBLISHED:
        name = next(name for name, number in COMPENSATORS.items() if number == compensator)
        usable = ", ".join(n for n, number in COMPENSATORS.items() if number < FIRST_PUBLISHED)
        raise ValueError(f"arm '{name}' commands volts, the servos take an angle; use {usable}")


def start() -> np.record:
    """Return the controller's state (dtype CONTROL) at the start: every integral and shift zero."""
    return np.zeros(1, CONTROL)[0]


@compiled
def wanted_angle(c, g, a, error, velocity):
    """Outer PID: servo angle that axis `a` asks for, clipped at the servo's limit [rad].

    c: record CONTROL, whose integral is advanced by one tick, unless the output is clipped and the
    integral would drive it further out (conditional integration); g: record CONTROL_SETTINGS;
    error: target minus ball [m]; velocity: of the ball [m/s].
    """
    free = g.kp * error + c.integral[a] - g.kd * velocity
    clipped = min(max(free, -g.angle_limit), g.angle_limit)
    step = g.ki * error * g.tick_s
    if free == clipped or (free - clipped) * step < 0.0:
        c.integral[a] = min(max(c.integral[a] + step, -g.integral_limit), g.integral_limit)
    return clipped


@compiled
def _joint(g, backlash, q_backlash, a):
    """What is lost in the joint as this compensator takes it [rad]: calibrated where it is, else
    observed; nothing where the plate drops."""
    given = g.joint_given[a]
    if given > 0.0:
        found = given + 2.0 * q_backlash.joint.windup if backlash.joint.keeps[a] >= 0.5 else 0.0
    else:
        found = lost_in_joint(backlash, q_backlash, a)
    return g.backlash_factor * found


@compiled
def _gear(g, backlash, q_backlash, a):
    """The same in the gear [rad]."""
    given = g.gear_given[a]
    found = (
        given + 2.0 * q_backlash.gear.windup
        if given > 0.0
        else lost_in_gear(backlash, q_backlash, a)
    )
    return g.backlash_factor * found


@compiled
def control(c, g, estimate, backlash, q_backlash, reading, target, volts):
    """Run one tick of both axes: volts that move the ball to `target` (2,) [m] into `volts` (2,).

    c: record CONTROL, changed in place; g: record CONTROL_SETTINGS; estimate, backlash: states of
    `observers` and `backlash_observer`; q_backlash: settings of the latter; reading
    (READING_SIZE,). Backlash is compensated by its calibrated width where there is one, else by the
    estimated one once that is known. The volts are not yet limited.
    """
    for a in range(2):
        theta = reading[R_THETA + a]
        if g.compensator == LQG or g.compensator == MPC:
            place = ball_now(estimate, reading[R_TIME], a)
            lqg.estimate(c.lqg, g.lqg, g, reading, a, place, estimate.velocity[a])
            if g.compensator == LQG:
                volts[a] = lqg.lqg_volts(c.lqg, g.lqg, c, g, a, target[a])
            else:
                volts[a] = mpc.mpc_volts(c.mpc, c.lqg, g.mpc, c, g, a, target[a])
            continue
        error = target[a] - ball_now(estimate, reading[R_TIME], a)
        wanted = wanted_angle(c, g, a, error, estimate.velocity[a])
        c.wanted_theta[a] = wanted
        reference = c.reference[a] = wanted
        joint, gear = _joint(g, backlash, q_backlash, a), _gear(g, backlash, q_backlash, a)
        if g.compensator >= FIRST_PUBLISHED:
            volts[a] = compensator_volts(
                c.compensators, c, g, estimate, backlash.gear.twist[a], reading, a, joint, gear
            )
            continue
        least = 2.0 * g.encoder_step
        if g.compensator & JOINT_INVERSE:
            reference = compensation.joint_reference(c.inverse, a, wanted, theta, joint, least)
        if g.compensator & GEAR_INVERSE_ON_REFERENCE:
            reference = compensation.joint_reference(
                c.gear_inverse, a, reference, theta, gear, least
            )
        if g.compensator & BACKWARDS:
            reference = 2.0 * wanted - reference
        reference = min(max(reference, -g.angle_limit), g.angle_limit)
        c.reference[a] = reference
        if g.takes_angle:
            volts[a] = reference
            continue
        v = g.servo_kp * (reference - theta) - g.servo_kd * estimate.rate[a]
        if g.compensator & GEAR_INVERSE:
            crossing = compensation.gear_volts(
                reference - theta, backlash.gear.twist[a], gear, g.servo_kp, g.encoder_step
            )
            v += -crossing if g.compensator & BACKWARDS else crossing
        volts[a] = v


@compiled
def follow(c, g, estimate, reading, angles, volts):
    """Run the inner loop alone: volts that move the servos to `angles` (2,) [rad] into `volts`
    (2,).

    c, g, estimate, reading: as of `control`. The angles are clipped at the servo's limit; the volts
    are not yet limited.
    """
    for a in range(2):
        c.wanted_theta[a] = min(max(angles[a], -g.angle_limit), g.angle_limit)
        c.reference[a] = c.wanted_theta[a]
        if g.takes_angle:
            volts[a] = c.reference[a]
            continue
        volts[a] = (
            g.servo_kp * (c.reference[a] - reading[R_THETA + a]) - g.servo_kd * estimate.rate[a]
        )


@compiled
def level(g, estimate, reading, volts):
    """Write the volts that hold both servos at angle zero into `volts` (2,), not yet limited.

    g, estimate, reading: as of `control`. It is used before the ball is first seen and while it is
    out of sight.
    """
    for a in range(2):
        volts[a] = -g.servo_kp * reading[R_THETA + a] - g.servo_kd * estimate.rate[a]
        if g.takes_angle:
            volts[a] = 0.0
