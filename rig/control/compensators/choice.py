"""The arms of the literature by name, and the one function that lets the chosen one act.

To add an arm: a file with its state (a numpy dtype) and compiled functions; its state goes into
ARMS_STATE, its name and number into CURES, its branch into `arm_volts`. The loop and the batch
kernel follow.
"""

import numpy as np

from rig import compensation
from rig.arms.adaptive import ADAPTIVE_STATE, adaptive_inverse
from rig.arms.disturbance import disturbance_volts
from rig.arms.hybrid import HYBRID_STATE, hybrid_volts, soft_reference
from rig.arms.neural import NEURAL_STATE, neural_volts
from rig.arms.smooth import SMOOTH_STATE, smooth_inverse
from rig.compiled import compiled
from rig.signals import R_MOTOR, R_THETA

FIRST = 64  # numbers below are the bits of the paper's arms
SMOOTH, ADAPTIVE, ADAPTIVE_ASYMMETRIC, HYBRID, NEURAL, DISTURBANCE = range(FIRST, FIRST + 6)
CURES = {
    "smooth": SMOOTH,
    "adaptive": ADAPTIVE,
    "adaptive-asymmetric": ADAPTIVE_ASYMMETRIC,
    "hybrid": HYBRID,
    "neural": NEURAL,
    "disturbance": DISTURBANCE,
}
ARMS_STATE = np.dtype(
    [
        ("smooth", SMOOTH_STATE),
        ("adaptive", ADAPTIVE_STATE),
        ("hybrid", HYBRID_STATE),
        ("neural", NEURAL_STATE),
    ]
)


@compiled
def arm_volts(s, c, g, belief, twist, reading, a, joint, gear):
    """Volts of the arm g.arm on axis `a` [V]; joint, gear: known lost motion, full width [rad].

    s: ARMS_STATE; c: the controller's state, whose wanted_theta it reads and reference it writes.
    """
    theta, rate, wanted = reading[R_THETA + a], belief.rate[a], c.wanted_theta[a]
    least, reference, volts = 2.0 * g.encoder_step, wanted, 0.0
    if g.arm == NEURAL:
        return (
            neural_volts(s.neural, a, wanted, theta, joint, g.servo_kp, g.motor_gain, g.tick_s)
            - g.servo_kd * rate
        )
    if g.arm == SMOOTH:
        reference, volts = smooth_inverse(s.smooth, a, wanted, joint, gear, g.motor_gain, g.tick_s)
    elif g.arm == ADAPTIVE or g.arm == ADAPTIVE_ASYMMETRIC:
        reference = adaptive_inverse(
            s.adaptive, a, reading, wanted, g.play_factor, g.ball_gain, g.tick_s, least,
            g.arm == ADAPTIVE,
        )  # fmt: skip
    elif g.arm == HYBRID:
        reference = soft_reference(s.hybrid, a, wanted, theta, joint, least, g.tick_s)
    reference = min(max(reference, -g.angle_limit), g.angle_limit)
    c.reference[a] = reference
    error = reference - theta
    if g.arm == HYBRID:
        motor = reading[R_MOTOR + a]
        known = rate if np.isnan(motor) else motor
        return hybrid_volts(
            error, known, known, twist, gear, g.servo_kp, g.motor_gain, g.motor_lag, g.encoder_step
        )
    if g.arm == ADAPTIVE or g.arm == ADAPTIVE_ASYMMETRIC:
        volts = compensation.gear_volts(error, twist, gear, g.servo_kp, g.encoder_step)
    elif g.arm == DISTURBANCE:
        volts = disturbance_volts(belief.observed[a], g.torque_per_volt)
    return g.servo_kp * error - g.servo_kd * rate + volts
