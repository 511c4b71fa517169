"""The whole table as one compiled function: volts in, two drives, plate and ball one tick on.

Per axis three inertias in a row: motor -(gear: stiffness, damping, play)- arm with the encoder
-(joint: the same)- plate; all angles at the servo's load shaft. Symplectic Euler at `step_s`
(0.1 ms): speeds from the torques at the old angles, angles from the new speeds; dry friction
implicitly. First order in the step, and energy stays bounded.
"""

from math import ceil, nan

import numpy as np

from rig.compiled import compiled, inlined
from rig.discrepancy import discrepancy_acceleration
from rig.plant.ball import velocity
from rig.plant.own_equations import BALL as BALL_SIDE
from rig.plant.own_equations import with_own
from rig.plant.step import (
    ball_step,
    drive_step,
    effective_volts,
    felt_angle,
    held_ball,
    off_plate,
    tilt,
)

__all__ = ["advance", "effective_volts", "felt_angle", "plate_motion", "rest"]

# Rows of the state, one column per axis.
MOTOR, MOTOR_RATE, ARM, ARM_RATE, PLATE, PLATE_RATE, GEAR_LOST, JOINT_LOST = range(8)
BALL, BALL_W, SPIN = range(8, 11)
# Of position servos: angle and rate of a third one; the pose that three arms hold (two sines, the
# height) and the speed of its centre, filled in by `position_plant`.
SERVO_THIRD, SERVO_POSE = 11, 12
STATE_ROWS = 15
# Columns of what the light saw: ball, sines of the plate's tilt, ball velocity, time.
SEEN_X, SEEN_Y, SEEN_SX, SEEN_SY, SEEN_VX, SEEN_VY, SEEN_T = range(7)


def rest(ball_xy_m: tuple[float, float] = (0.0, 0.0), height_m: float = 0.0) -> np.ndarray:
    """State (STATE_ROWS, 2) of a table at rest: servos at zero, the ball at `ball_xy_m`.

    height_m: at which three arms hold the plate's centre.
    """
    state = np.zeros((STATE_ROWS, 2))
    state[SERVO_POSE + 1, 0] = height_m
    state[BALL] = ball_xy_m
    return state


@inlined
def plate_motion(s, p):
    """sin(phi_x), sin(phi_y) [1], omega_1, omega_2 [rad/s] of the plate in state s (STATE_ROWS,
    2).
    """
    return tilt(p, s[PLATE, 0], s[PLATE_RATE, 0], s[PLATE, 1], s[PLATE_RATE, 1])


@inlined
def axis_of(s, a):
    """State of axis `a` as the tuple of 8 numbers that `step` takes, from s (STATE_ROWS, 2)."""
    return (
        s[MOTOR, a],
        s[MOTOR_RATE, a],
        s[ARM, a],
        s[ARM_RATE, a],
        s[PLATE, a],
        s[PLATE_RATE, a],
        s[GEAR_LOST, a],
        s[JOINT_LOST, a],
    )


@inlined
def ball_of(s):
    """State of the ball as the tuple (x, y, w_x, w_y, spin) that `step` takes, from s
    (STATE_ROWS, 2).
    """
    return s[BALL, 0], s[BALL, 1], s[BALL_W, 0], s[BALL_W, 1], s[SPIN, 0]


@inlined
def _keep(s, axis_x, axis_y, ball):
    """Write the state back."""
    s[MOTOR, 0], s[MOTOR_RATE, 0], s[ARM, 0], s[ARM_RATE, 0] = axis_x[:4]
    s[PLATE, 0], s[PLATE_RATE, 0], s[GEAR_LOST, 0], s[JOINT_LOST, 0] = axis_x[4:]
    s[MOTOR, 1], s[MOTOR_RATE, 1], s[ARM, 1], s[ARM_RATE, 1] = axis_y[:4]
    s[PLATE, 1], s[PLATE_RATE, 1], s[GEAR_LOST, 1], s[JOINT_LOST, 1] = axis_y[4:]
    s[BALL, 0], s[BALL, 1], s[BALL_W, 0], s[BALL_W, 1], s[SPIN, 0] = ball


@inlined
def late_row(rows, delay_s, into_tick_s, ticks_s):
    """Row of a history of volts that acts `into_tick_s` after a tick, delayed by `delay_s`.

    Row 0 holds the volts of the present tick. rows: the history's length; ticks_s: period of a tick
    [s]. A longer delay than the history gives its last row.
    """
    late = delay_s - into_tick_s
    return min(int(ceil(late / ticks_s)), rows - 1) if late > 0.0 else 0


@inlined
def sight(p, now, exposure_s, x, y, motion, ball):
    """What the camera's light shows at `exposure_s`: a tuple in the order of the columns SEEN_*.

    The step goes from `now` [s], with the ball at x, y [m], to the motion (of `tilt`) and the
    ball's state after it; the ball's position is interpolated to the exposure, tilt and velocity
    are those after the step.
    """
    part = min(max((exposure_s - now) / p.step_s, 0.0), 1.0)
    s_x, s_y, o1, o2 = motion
    v_x, v_y = velocity(ball[2], ball[3], o1, o2, p.radius)
    return x + part * (ball[0] - x), y + part * (ball[1] - y), s_x, s_y, v_x, v_y, exposure_s


@inlined
def unnamed(p, ball, motion, t):
    """The acceleration of the ball that is in no catalogue, unnamed or of a lab's own, if there is
    any [m/s2].
    """
    a_x, a_y = 0.0, 0.0
    if not (p.unknown.on or p.own.ball):
        return a_x, a_y
    v_x, v_y = velocity(ball[2], ball[3], motion[2], motion[3], p.radius)
    if p.unknown.on:
        x, y = ball[0] / p.half_side[0], ball[1] / p.half_side[1]
        a_x = discrepancy_acceleration(p.unknown, 0, x, y, v_x, t)
        a_y = discrepancy_acceleration(p.unknown, 1, x, y, v_y, t)
    if p.own.ball:
        a_x = with_own(p.own, BALL_SIDE, 0, a_x, ball[0], v_x, t)
        a_y = with_own(p.own, BALL_SIDE, 1, a_y, ball[1], v_y, t)
    return a_x, a_y


@inlined
def _motor_volts(p, a, history, i, ticks_s, now, axis):
    """Volts at motor `a` in step i of the tick [V]."""
    back = late_row(history.shape[0], p.input_delay_delay_s[a], (i + 0.5) * p.step_s, ticks_s)
    return effective_volts(p, a, history[back, 0], history[back, 1], axis[2], axis[3], now)


@compiled
def advance(s, p, history, t, ticks_s, push_x, push_y, held, exposure_s, seen):
    """Move the plant from `t` over one control tick of `ticks_s` seconds; True when the ball falls.

    s (STATE_ROWS, 2): the state, changed in place; p: of `pack`; history (n, 2): volts applied (see
    `no_volts`), the present tick's first; push_x, push_y: acceleration of the ball [m/s2]; held:
    the ball is held in its place on the plate. exposure_s: time of the next exposure (inf for
    none); `seen` (7,), columns SEEN_*, is filled in at the step in which that time passes, else its
    SEEN_T is NaN. The ball falls when its contact point leaves the plate.
    """
    # No store inside the loop: the compiler may then keep the whole record in registers.
    axis_x, axis_y, ball = axis_of(s, 0), axis_of(s, 1), ball_of(s)
    shown = (nan, nan, nan, nan, nan, nan, nan)
    fallen, looked, h = off_plate(p, ball), False, p.step_s
    for i in range(int(round(ticks_s / h))):
        now, x, y = t + i * h, ball[0], ball[1]
        load_x = 0.0 if held or fallen else p.weight[0]
        load_y = 0.0 if held or fallen else p.weight[1]
        volts_x = _motor_volts(p, 0, history, i, ticks_s, now, axis_x)
        volts_y = _motor_volts(p, 1, history, i, ticks_s, now, axis_y)
        axis_x = drive_step(p, 0, volts_x, load_x * x, axis_x)
        axis_y = drive_step(p, 1, volts_y, load_y * y, axis_y)
        motion = tilt(p, axis_x[4], axis_x[5], axis_y[4], axis_y[5])
        if held:
            ball = ball if fallen else held_ball(p, motion, ball)
        elif not fallen:
            more_x, more_y = unnamed(p, ball, motion, now)
            ball = ball_step(p, now, push_x + more_x, push_y + more_y, motion, ball)
        fallen = fallen or off_plate(p, ball)
        if not looked and exposure_s <= now + h:
            shown, looked = sight(p, now, exposure_s, x, y, motion, ball), True
    _keep(s, axis_x, axis_y, ball)
    for i in range(7):
        seen[i] = shown[i] if looked or i == SEEN_T else seen[i]
    return fallen
