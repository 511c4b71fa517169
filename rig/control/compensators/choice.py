"""Backlash compensators of the literature by name, and the function that evaluates the chosen one.

To add one: a file with its state (a numpy dtype) and compiled functions; its state goes into
COMPENSATOR_STATES, its name and index into PUBLISHED, its branch into `compensator_volts`. The loop
and the batch kernel follow.
"""

import numpy as np

from rig.compiled import compiled
from rig.control import compensation
from rig.control.compensators.adaptive import ADAPTIVE_STATE, adaptive_inverse
from rig.control.compensators.disturbance import disturbance_volts
from rig.control.compensators.hybrid import HYBRID_STATE, hybrid_volts, soft_reference
from rig.control.compensators.neural import NEURAL_STATE, neural_volts
from rig.control.compensators.smooth import SMOOTH_STATE, smooth_inverse
from rig.table import R_MOTOR, R_THETA

FIRST_PUBLISHED = 64  # numbers below are the bits of the paper's conditions
SMOOTH, ADAPTIVE, ADAPTIVE_ASYMMETRIC, HYBRID, NEURAL, DISTURBANCE, LQG, MPC = range(
    FIRST_PUBLISHED, FIRST_PUBLISHED + 8
)
PUBLISHED = {
    "smooth": SMOOTH,
    "adaptive": ADAPTIVE,
    "adaptive-asymmetric": ADAPTIVE_ASYMMETRIC,
    "hybrid": HYBRID,
    "neural": NEURAL,
    "disturbance": DISTURBANCE,
    "lqg": LQG,  # this and the next: no PID below; `rig.control.optimal`, called by `controllers`
    "mpc": MPC,
}
COMPENSATOR_STATES = np.dtype(
    [
        ("smooth", SMOOTH_STATE),
        ("adaptive", ADAPTIVE_STATE),
        ("hybrid", HYBRID_STATE),
        ("neural", NEURAL_STATE),
    ]
)


@compiled
def compensator_volts(s, c, g, estimate, twist, reading, a, joint, gear):
    """Volts of the published compensator g.compensator on axis `a` [V].

    s: record COMPENSATOR_STATES, changed in place; c: record CONTROL, whose wanted_theta is read
    and whose reference is written; g: record CONTROL_SETTINGS; estimate: state of `observers`;
    twist: of the gear about the middle of its play [rad]; reading (READING_SIZE,); joint, gear:
    known lost motion, full width [rad].
    """
    theta, rate, wanted = reading[R_THETA + a], estimate.rate[a], c.wanted_theta[a]
    least, reference, volts = 2.0 * g.encoder_step, wanted, 0.0
    if g.compensator == NEURAL:
        return (
            neural_volts(s.neural, a, wanted, theta, joint, g.servo_kp, g.motor_gain, g.tick_s)
            - g.servo_kd * rate
        )
    if g.compensator == SMOOTH:
        reference, volts = smooth_inverse(s.smooth, a, wanted, joint, gear, g.motor_gain, g.tick_s)
    elif g.compensator == ADAPTIVE or g.compensator == ADAPTIVE_ASYMMETRIC:
        reference = adaptive_inverse(
            s.adaptive,
            a,
            reading,
            wanted,
            g.backlash_factor,
            g.ball_gain,
            g.tick_s,
            least,
            g.compensator == ADAPTIVE,
        )
    elif g.compensator == HYBRID:
        reference = soft_reference(s.hybrid, a, wanted, theta, joint, least, g.tick_s)
    reference = min(max(reference, -g.angle_limit), g.angle_limit)
    c.reference[a] = reference
    error = reference - theta
    if g.compensator == HYBRID:
        motor = reading[R_MOTOR + a]
        known = rate if np.isnan(motor) else motor
        return hybrid_volts(
            error, known, known, twist, gear, g.servo_kp, g.motor_gain, g.motor_lag, g.encoder_step
        )
    if g.compensator == ADAPTIVE or g.compensator == ADAPTIVE_ASYMMETRIC:
        volts = compensation.gear_volts(error, twist, gear, g.servo_kp, g.encoder_step)
    elif g.compensator == DISTURBANCE:
        volts = disturbance_volts(estimate.observed[a], g.torque_per_volt)
    return g.servo_kp * error - g.servo_kd * rate + volts
