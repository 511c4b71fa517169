"""A servo that takes an angle: what becomes of a commanded angle, the same in simulator, predictor
and controller.

On its way a command u(t) [rad] meets, in this order,

    the clock        read at the multiples of the servo's period only, held between them,
    dead time        u(t - t_d),
    quantum          round(u/q) q,
    scale, zero      (1 + s) u + z, and off by what has no name (`rig.discrepancy`),
    dead band        e = sgn(u - theta) max(|u - theta| - w, 0),
    lag              omega = e/T, which over a step h with constant e is e (1 - exp(-h/T))/h,
    rate limit       |omega| <= Omega, and such that |d omega/dt| <= A still stops it at its target:
                     |omega| <= A h (sqrt(1/4 + 2 |e|/(A h^2)) - 1/2),
    motor            M d omega/dt = (the rate above) - omega: M T s^2 + T s + 1 with the lag,
    acceleration     |omega - omega before| <= A h.

Nothing moves until the command is further off than w, and the angle stops that far short. `p` is
the plant's record; x and y are the servos of two rods. Of three arms the servo i takes the values
of x and y in the shares cos^2 and sin^2 of its azimuth.
"""

from math import ceil, exp, floor, sqrt

import numpy as np

from rig.compiled import compiled, inlined
from rig.discrepancy import servo_discrepancy
from rig.plant.effect_equations import dead_zone
from rig.three_arms import arm_angle, solve_pose

EQ_14, RODS, THREE_ARMS = 0, 1, 2
SERVOS = 3
# State (SERVOS_STATE,) of all servos: angles, rates, then the pose of a plate on three arms.
ANGLE, RATE, POSE, SERVOS_STATE = 0, 3, 6, 9
_EARLY = 1e-9  # of a tick or a period: a time that is due but for rounding is due


@inlined
def clocked(when, period_s):
    """Time at which the servo last read its command [s], no later than `when`."""
    return floor(when / period_s + _EARLY) * period_s if period_s > 0.0 else when


@inlined
def late_command_row(rows, late_s, tick_s):
    """Row of a history of commands that held `late_s` before the present tick began.

    Row 0 holds the present tick's. rows: the history's length; tick_s: period of a tick [s]. A time
    before the history gives its last row.
    """
    return min(int(ceil(late_s / tick_s - _EARLY)), rows - 1) if late_s > 0.0 else 0


@inlined
def mixed(p, i, pair):
    """Value for servo i of a `pair` by axis."""
    share = p.share_x[i]
    return share * pair[0] + (1.0 - share) * pair[1]


@inlined
def quantised(angle, quantum_rad):
    """The angle to the nearest multiple of the quantum [rad]; 0: as it is."""
    return floor(angle / quantum_rad + 0.5) * quantum_rad if quantum_rad > 0.0 else angle


@inlined
def angle_scale(angle, fraction):
    """(1 + fraction) angle [rad]."""
    return (1.0 + fraction) * angle


@inlined
def angle_zero(angle, offset_rad):
    """angle + offset [rad]."""
    return angle + offset_rad


@inlined
def command_dead_band(error_rad, half_width_rad):
    """sgn(error) max(|error| - half width, 0) [rad]."""
    return dead_zone(error_rad, half_width_rad, half_width_rad)


@inlined
def servo_lag(lag_s, extra_s):
    """Time constant of the servo [s]: the rig file's plus what is beyond it, at least 0."""
    return max(lag_s + extra_s, 0.0)


@inlined
def servo_dead_time(dead_time_s, delay_s):
    """Dead time of the servo [s]: the rig file's plus what is beyond it."""
    return dead_time_s + delay_s


@inlined
def rate_limit(limit_rad_s, further_rad_s):
    """The lower of both limits [rad/s]."""
    return min(limit_rad_s, further_rad_s)


@inlined
def rate_law(lag_s, motor_lag_s, limit_rad_s, acceleration_rad_s2, h):
    """What gives a servo's rate over a step h [s], a constant of the servo: the share of its error
    that it makes good a second [1/s], that of a new rate which its motor takes up [1], the limit
    [rad/s] and by how much its rate changes at most [rad/s]."""
    share = (1.0 - exp(-h / lag_s)) / h if lag_s > 0.0 else 1.0 / h
    taken_up = 1.0 - exp(-h / motor_lag_s) if motor_lag_s > 0.0 else 1.0
    return share, taken_up, limit_rad_s, acceleration_rad_s2 * h


@inlined
def next_rate(error, rate, law, h):
    """Rate of a servo over the next step h [rad/s].

    error: command less angle, after the dead band [rad]; rate: over the step before; law: of
    `rate_law`.
    """
    share, taken_up, limit_rad_s, change = law
    size = abs(error)
    stops = change * (sqrt(0.25 + 2.0 * size / (change * h)) - 0.5)
    wanted = min(size * share, limit_rad_s, stops)
    wanted = wanted if error > 0.0 else -wanted
    if taken_up < 1.0:
        wanted = rate + (wanted - rate) * taken_up
    return min(max(wanted, rate - change), rate + change)


@inlined
def told_at(p, a, now):
    """Time of the command that reaches the servo of axis `a` at the time now [s]; a period of the
    servo begins at p.period_begin_s."""
    late = servo_dead_time(p.dead_time_s[a], p.servo_dead_time_delay_s[a])
    begin = p.period_begin_s[a]
    return begin + clocked(now - late - begin, p.period_s[a])


@inlined
def rounded(p, a, told):
    """An angle told to axis `a`, to the quantum of its servo [rad]; arms round their own."""
    return told if p.linkage == THREE_ARMS else quantised(told, p.quantum_rad[a])


@inlined
def arriving(p, a, told):
    """What becomes of a rounded angle told to axis `a` before the servo follows it [rad]."""
    return angle_zero(angle_scale(told, p.angle_scale_fraction[a]), p.angle_zero_offset_rad[a])


@inlined
def arrived(p, a, history, t, now, tick_s):
    """What has become of the command of axis `a` that reaches its servo at the time now [rad].

    history (n, 2): commands by axis, the one of the tick that began at t first [rad].
    """
    row = late_command_row(history.shape[0], t - told_at(p, a, now), tick_s)
    return arriving(p, a, rounded(p, a, history[row, a]))


@inlined
def drawn_off(p, a, goal, angle, rate, now, h):
    """Where axis `a` goes in the next step h [s] that is told to go to `goal` [rad]: there, and off
    by what has no name.

    That is a function of the time now [s], of the axis's angle [rad] and of the rate at which it
    would turn without: its own rate would answer itself within the step. rate: over the step before
    [rad/s].
    """
    if not p.unknown.on:
        return goal
    band = p.dead_band_rad[a] + p.command_dead_band_half_width_rad[a]
    lag = servo_lag(p.lag_s[a], p.servo_lag_lag_s[a])
    limit = rate_limit(p.rate_limit_rad_s[a], p.rate_limit_limit_rad_s[a])
    law = rate_law(lag, p.motor_lag_s[a], limit, p.acceleration_limit_rad_s2[a], h)
    omega = next_rate(command_dead_band(goal - angle, band), rate, law, h)
    return goal + servo_discrepancy(p.unknown, a, angle, omega, now)


@compiled
def aim(p, x, y, wanted):
    """Write the servos' targets (SERVOS,) into `wanted`; x, y: where the axes are to go [rad].

    Where three arms cannot reach the tilt, `wanted` stays.
    """
    if p.linkage != THREE_ARMS:
        wanted[0], wanted[1] = x, y
        return
    size = (p.base_radius, p.plate_radius, p.arm_length, p.rod_length)
    s_x, s_y = np.sin(x), np.sin(y)
    for i in range(SERVOS):
        alpha = arm_angle(i, s_x, s_y, p.height, size) - p.level_arm
        if alpha - alpha == 0.0:
            wanted[i] = quantised(alpha, mixed(p, i, p.quantum_rad))


@inlined
def mixed_limit(p, i):
    """Rate limit of servo i [rad/s]; an axis without one takes no part in the mean."""
    x = rate_limit(p.rate_limit_rad_s[0], p.rate_limit_limit_rad_s[0])
    y = rate_limit(p.rate_limit_rad_s[1], p.rate_limit_limit_rad_s[1])
    share = p.share_x[i]
    return share * x + (1.0 - share) * y


@inlined
def servo_law(p, i, h):
    """Dead band of servo i [rad] and its `rate_law` for steps of h [s]."""
    band = mixed(p, i, p.dead_band_rad) + mixed(p, i, p.command_dead_band_half_width_rad)
    lag = servo_lag(mixed(p, i, p.lag_s), mixed(p, i, p.servo_lag_lag_s))
    motor, acceleration = mixed(p, i, p.motor_lag_s), mixed(p, i, p.acceleration_limit_rad_s2)
    return band, rate_law(lag, motor, mixed_limit(p, i), acceleration, h)


@inlined
def servo_laws(p, h):
    """`servo_law` of each of SERVOS."""
    return servo_law(p, 0, h), servo_law(p, 1, h), servo_law(p, 2, h)


@inlined
def moved_servo(p, law, wanted, angle, rate, h):
    """Angle [rad] and rate [rad/s] of a servo after h [s] towards the angle `wanted` [rad]; law: of
    `servo_law`."""
    band, of_rate = law
    rate = next_rate(command_dead_band(wanted - angle, band), rate, of_rate, h)
    turned = angle + h * rate
    rate = rate if abs(turned) <= p.stop_rad else 0.0
    return min(max(turned, -p.stop_rad), p.stop_rad), rate


@inlined
def _move(p, i, law, wanted, h, state):
    """Move servo i on by h [s] towards its angle wanted[i] [rad]; law: of `servo_law`."""
    angle, rate = moved_servo(p, law, wanted[i], state[ANGLE + i], state[RATE + i], h)
    state[ANGLE + i], state[RATE + i] = angle, rate


@inlined
def move_servos(p, laws, wanted, h, state):
    """Move the servos on by h [s] towards the angles `wanted` (SERVOS,) [rad], in place; laws: of
    `servo_laws`."""
    first, second, third = laws
    _move(p, 0, first, wanted, h, state)
    _move(p, 1, second, wanted, h, state)
    if p.linkage == THREE_ARMS:
        _move(p, 2, third, wanted, h, state)


@compiled
def table_angles(p, state, angles):
    """Write the axes' angles (2,) [rad] into `angles`: of the servos, or the tilt by three arms.

    The pose of three arms in `state` is brought to their angles, and stays where they hold none.
    """
    if p.linkage != THREE_ARMS:
        angles[0], angles[1] = state[ANGLE], state[ANGLE + 1]
        return
    size = (p.base_radius, p.plate_radius, p.arm_length, p.rod_length)
    turned = state[ANGLE : ANGLE + SERVOS] + p.level_arm
    solve_pose(turned, size, state[POSE : POSE + 3])
    angles[0], angles[1] = np.arcsin(state[POSE]), np.arcsin(state[POSE + 1])


def servos_at_level(p: np.record) -> np.ndarray:
    """Return the state (SERVOS_STATE,) of servos that hold the plate level."""
    state = np.zeros(SERVOS_STATE)
    state[POSE + 2] = p["height"]
    return state
