"""A table whose servos take an angle, as one compiled function: commands in, plate and ball one
tick on.

The servos turn the arms (`position_servo.py`), whatever the plate's weight; behind the joints' play
lies the same plate as behind motors (`step.py`), and the same ball. A plate on three arms shifts
with its tilt and is lifted by arms that do not keep step: what that does to the ball is the
acceleration of the plate's centre, k (R^T c'') by the equations of `ball.py`.
"""

from math import nan

import numpy as np

from rig.compiled import compiled, inlined
from rig.linkage import rod_tilt
from rig.plant.ball import plate_sines
from rig.plant.plant import (
    ARM,
    ARM_RATE,
    BALL,
    BALL_W,
    JOINT_LOST,
    MOTOR,
    MOTOR_RATE,
    PLATE,
    PLATE_RATE,
    SEEN_T,
    SERVO_POSE,
    SERVO_THIRD,
    SPIN,
    ball_of,
    sight,
    unnamed,
)
from rig.plant.position_servo import (
    ANGLE,
    POSE,
    RATE,
    RODS,
    SERVOS,
    SERVOS_STATE,
    THREE_ARMS,
    aim,
    arrived,
    drawn_off,
    move_servos,
    servo_laws,
    table_angles,
)
from rig.plant.step import (
    ball_step,
    felt_angle,
    felt_slope,
    held_ball,
    joint_play,
    joint_torque,
    off_plate,
    plate_speed,
    tilt,
)
from rig.three_arms import centre


@compiled
def felt_sines(p, felt_x, felt_y):
    """sin(phi_x), sin(phi_y) [1] from the felt angles [rad], by the table's linkage."""
    cross_x, cross_y = p.cross_coupling_fraction[0], p.cross_coupling_fraction[1]
    if p.linkage != RODS:
        return plate_sines(felt_x, felt_y, p.ratio, cross_x, cross_y)
    a, _ = _lever(p, 0, felt_x)
    b, _ = _lever(p, 1, felt_y)
    return a + cross_x * b, b + cross_y * a


@inlined
def _lever(p, a, felt):
    """Sine of the tilt by the rod of axis `a`, and its derivative [1]."""
    arm, lever, rod = p.arm_radius[a], p.arm_radius[a] / p.ratio[a], p.rod[a]
    if rod > 0.0:
        return rod_tilt(felt, arm, lever, rod)
    return p.ratio[a] * np.sin(felt), p.ratio[a] * np.cos(felt)


@inlined
def _motion(p, plate_x, rate_x, plate_y, rate_y):
    """`step.tilt` by the table's linkage."""
    if p.linkage != RODS:
        return tilt(p, plate_x, rate_x, plate_y, rate_y)
    cross_x, cross_y = p.cross_coupling_fraction[0], p.cross_coupling_fraction[1]
    a, slope_a = _lever(p, 0, felt_angle(p, 0, plate_x))
    b, slope_b = _lever(p, 1, felt_angle(p, 1, plate_y))
    rate_a = slope_a * felt_slope(p, 0, plate_x) * rate_x
    rate_b = slope_b * felt_slope(p, 1, plate_y) * rate_y
    s_x, s_y = a + cross_x * b, b + cross_y * a
    c = np.sqrt(1.0 - s_x * s_x - s_y * s_y)
    return s_x, s_y, -(rate_b + cross_y * rate_a) / c, (rate_a + cross_x * rate_b) / c


@inlined
def _follow(p, a, before, after, h, load, plate):
    """Plate's angle, rate and play (3,) on axis `a` after a step in which the arm has turned."""
    angle, rate, lost = plate
    arm_rate = (after - before) / h
    torque = joint_torque(p, a, before - angle, arm_rate - rate, lost)
    rate = plate_speed(p, rate, torque + load)
    turned = angle + h * rate
    return turned, rate, joint_play(p, a, before - angle, after - turned, lost)


@inlined
def _carried(p, motion, moved, ball):
    """The ball (5 numbers) after the plate's centre changed its velocity by `moved` (3,) [m/s]."""
    s_x, s_y = motion[0], motion[1]
    c = np.sqrt(1.0 - s_x * s_x - s_y * s_y)
    xy = -s_x * s_y / (1.0 + c)
    along_x = moved[0] * (1.0 - s_x * s_x / (1.0 + c)) + moved[1] * xy - moved[2] * s_x
    along_y = moved[0] * xy + moved[1] * (1.0 - s_y * s_y / (1.0 + c)) - moved[2] * s_y
    return (ball[0], ball[1], ball[2] - p.factor * along_x, ball[3] - p.factor * along_y, ball[4])


@compiled
def _servos_of(s, servos):
    """Write the servos' state out of the table's (STATE_ROWS, 2) into `servos` (SERVOS_STATE,)."""
    servos[ANGLE], servos[ANGLE + 1] = s[MOTOR, 0], s[MOTOR, 1]
    servos[RATE], servos[RATE + 1] = s[MOTOR_RATE, 0], s[MOTOR_RATE, 1]
    servos[ANGLE + 2], servos[RATE + 2] = s[SERVO_THIRD, 0], s[SERVO_THIRD, 1]
    servos[POSE], servos[POSE + 1] = s[SERVO_POSE, 0], s[SERVO_POSE, 1]
    servos[POSE + 2] = s[SERVO_POSE + 1, 0]


@compiled
def _keep(s, servos, angles, arm_rates, plates, ball):
    """Write the state back."""
    for a in range(2):
        s[MOTOR, a], s[MOTOR_RATE, a] = servos[ANGLE + a], servos[RATE + a]
        s[ARM, a], s[ARM_RATE, a] = angles[a], arm_rates[a]
        s[SERVO_POSE, a] = servos[POSE + a]
        s[PLATE, a], s[PLATE_RATE, a], s[JOINT_LOST, a] = plates[a, 0], plates[a, 1], plates[a, 2]
        s[BALL, a], s[BALL_W, a] = ball[a], ball[2 + a]
    s[SERVO_THIRD, 0], s[SERVO_THIRD, 1] = servos[ANGLE + 2], servos[RATE + 2]
    s[SERVO_POSE + 1, 0], s[SPIN, 0] = servos[POSE + 2], ball[4]


@inlined
def _centre(p, servos):
    """The plate's centre (3,) [m] on three arms; at rest on two rods."""
    if p.linkage != THREE_ARMS:
        return 0.0, 0.0, 0.0
    x, y = centre(servos[POSE], servos[POSE + 1], p.plate_radius)
    return x, y, servos[POSE + 2]


@compiled
def advance_commanded(s, p, history, t, ticks_s, push_x, push_y, held, exposure_s, seen):
    """Move the plant from `t` over one control tick; True when the ball falls.

    history (n, 2): angles commanded (see `plant_record.no_volts`), the present tick's first [rad];
    the other arguments are those of `plant.advance`.
    """
    servos, ball = np.empty(SERVOS_STATE), ball_of(s)
    wanted, angles = np.empty(SERVOS), np.empty(2)
    _servos_of(s, servos)
    plates, h, looked = np.empty((2, 3)), p.step_s, False
    laws = servo_laws(p, h)
    before, rates = np.empty(2), np.empty(2)
    for a in range(2):
        plates[a, 0], plates[a, 1], plates[a, 2] = s[PLATE, a], s[PLATE_RATE, a], s[JOINT_LOST, a]
        angles[a], rates[a] = s[ARM, a], s[ARM_RATE, a]
    wanted[:] = servos[ANGLE : ANGLE + SERVOS]
    shown, fallen = (nan, nan, nan, nan, nan, nan, nan), off_plate(p, ball)
    lifted = s[SERVO_POSE + 2, 0], s[SERVO_POSE + 2, 1], s[SERVO_POSE + 1, 1]
    for i in range(int(round(ticks_s / h))):
        now, x, y = t + i * h, ball[0], ball[1]
        here = _centre(p, servos)
        x_to = arrived(p, 0, history, t, now + 0.5 * h, ticks_s)
        y_to = arrived(p, 1, history, t, now + 0.5 * h, ticks_s)
        x_to = drawn_off(p, 0, x_to, angles[0], rates[0], now, h)
        y_to = drawn_off(p, 1, y_to, angles[1], rates[1], now, h)
        aim(p, x_to, y_to, wanted)
        move_servos(p, laws, wanted, h, servos)
        before[0], before[1] = angles[0], angles[1]
        table_angles(p, servos, angles)
        free = not (held or fallen)
        for a in range(2):
            load = p.weight[a] * ball[a] if free else 0.0
            plate = plates[a, 0], plates[a, 1], plates[a, 2]
            plate = _follow(p, a, before[a], angles[a], h, load, plate)
            plates[a, 0], plates[a, 1], plates[a, 2] = plate
            rates[a] = (angles[a] - before[a]) / h
        motion = _motion(p, plates[0, 0], plates[0, 1], plates[1, 0], plates[1, 1])
        there = _centre(p, servos)
        going = (there[0] - here[0]) / h, (there[1] - here[1]) / h, (there[2] - here[2]) / h
        moved = going[0] - lifted[0], going[1] - lifted[1], going[2] - lifted[2]
        lifted = going
        if held:
            ball = ball if fallen else held_ball(p, motion, ball)
        elif not fallen:
            more_x, more_y = unnamed(p, ball, motion, now)
            if p.linkage == THREE_ARMS:
                ball = _carried(p, motion, moved, ball)
            ball = ball_step(p, now, push_x + more_x, push_y + more_y, motion, ball)
        fallen = fallen or off_plate(p, ball)
        if not looked and exposure_s <= now + h:
            shown, looked = sight(p, now, exposure_s, x, y, motion, ball), True
    _keep(s, servos, angles, rates, plates, ball)
    s[SERVO_POSE + 2, 0], s[SERVO_POSE + 2, 1], s[SERVO_POSE + 1, 1] = lifted
    for i in range(7):
        seen[i] = shown[i] if looked or i == SEEN_T else seen[i]
    return fallen
