"""Hybrid control that switches on the state of the play: contact, or crossing the gap.

*In contact* the servo slides on s = e' + lambda e = 0, e = reference - theta (Slotine and Li,
"Applied Nonlinear Control", 1991, with the boundary layer phi against chatter). With the motor's
tau w' + w = K V and a reference that stands, s' = 0 asks for V = w (1 - lambda tau)/K, and

    V = w (1 - lambda tau)/K + (K_s/lambda) s + eta sat(s/phi)

reaches the surface in finite time where eta is above the friction; K_s/lambda makes its
proportional part that of the other compensators. *In the gap* the motor is led to the other side so
that it lands softly (as in Nordin and Gutman's survey, Automatica 38, 2002): with d left to go

    w = sqrt(2 a d),   which is zero at d = 0 and brakes by a all the way.

In the gear the motor itself follows it; in the joint, where the gap is crossed by the servo, the
reference's shift does.
"""

from math import sqrt

import numpy as np

from rig.compiled import compiled
from rig.plant.shaft import play_operator

LAMBDA_1_S = 25.0
ETA_V, PHI_RAD_S = 0.15, 0.5
BRAKING_RAD_S2 = 20.0
SLOWEST_RAD_S = 0.08  # a landing that never comes is worse than a small knock
SPEED_V_S_RAD = 0.5  # the motor's speed loop in the gap

HYBRID_STATE = np.dtype([("plate", np.float64, (2,)), ("shift", np.float64, (2,))])


@compiled
def landing_speed(left):
    """Speed sqrt(2 a d) at which to cross what is `left` of the gap [rad], with its sign
    [rad/s].
    """
    speed = sqrt(2.0 * BRAKING_RAD_S2 * abs(left))
    return speed if left > 0.0 else -speed


@compiled
def soft_reference(s, a, wanted, theta, joint, least, tick_s):
    """Servo reference on axis `a` [rad], shifted across the joint's gap so that it lands softly.

    s: record HYBRID_STATE, changed in place; wanted, theta: wanted plate angle and encoder angle
    [rad]; joint: full width [rad]; least: smallest error that counts [rad]; tick_s: period [s].
    """
    half = 0.5 * joint
    s.plate[a] = play_operator(s.plate[a], theta, half, -half)
    missing, aim = wanted - s.plate[a], min(max(s.shift[a], -half), half)
    if missing > least:
        aim = half
    elif missing < -least:
        aim = -half
    left = aim - s.shift[a]
    if left != 0.0:
        step = tick_s * max(abs(landing_speed(left)), SLOWEST_RAD_S)
        s.shift[a] = aim if step >= abs(left) else s.shift[a] + (step if left > 0.0 else -step)
    return wanted + s.shift[a]


@compiled
def sliding_volts(error, rate, gain, motor_gain, lag_s):
    """Volts of the sliding mode in contact: those on the surface plus those that reach it [V].

    error: reference minus encoder angle [rad]; rate: omega [rad/s]; gain: K_s [V/rad]; motor_gain:
    K [rad/s/V]; lag_s: tau. With s = lambda e - omega, the module's law for a reference that
    stands.
    """
    s = LAMBDA_1_S * error - rate
    on_surface = rate * (1.0 - LAMBDA_1_S * lag_s) / motor_gain
    return on_surface + gain / LAMBDA_1_S * s + ETA_V * min(max(s / PHI_RAD_S, -1.0), 1.0)


@compiled
def gap_left(error, twist, gear, least):
    """How far the motor is from the side of the gear that must push [rad]; 0 in contact there.

    error: reference minus encoder angle [rad], whose sign names the side (none within `least`);
    twist: about the middle of the play [rad]; gear: full width [rad].
    """
    half = 0.5 * gear
    if error > least:
        return min(max(half - twist, 0.0), gear)
    if error < -least:
        return max(min(-half - twist, 0.0), -gear)
    return 0.0


@compiled
def hybrid_volts(error, rate, motor_rate, twist, gear, gain, motor_gain, lag_s, least):
    """Volts of the mode that the gear is in, contact or crossing the gap [V].

    motor_rate: of the motor [rad/s]; error, twist, gear, least: as of `gap_left`; rate, gain,
    motor_gain, lag_s: as of `sliding_volts`.
    """
    left = gap_left(error, twist, gear, least)
    if abs(left) <= least:
        return sliding_volts(error, rate, gain, motor_gain, lag_s)
    speed = landing_speed(left)
    return speed / motor_gain + SPEED_V_S_RAD * (speed - motor_rate)
