"""Adaptive inverse of a play of unknown break points c_r, c_l (Tao and Kokotovic).

The inverse (IEEE Trans. Automatic Control 38(2), 1993; "Adaptive Control of Systems with Actuator
and Sensor Nonlinearities", 1996) is exact where its parameters are:

    BI(u) = u + c_r while u rises, u + c_l while u falls, kept while it stands.

The plate behind the joint is not measured, the ball is: x'' = b sin(theta_p) + d, so an observer
with the believed plate has the output error e = W(s) [(c - c*) . omega], omega_i = -1 while side i
was the last to push. With xi = W(s) omega by the observer's own sensitivity equations the
parameters go down the normalised gradient, projected onto c_l <= c_r, |c| <= HIGHEST_RAD:

    c <- c + Gamma e xi/(m^2 + xi . xi)     at every frame.

*Symmetric*: c_l = -c_r, one parameter, and the observer estimates d besides (third order).
*Asymmetric*: both are free; a level error is then the play's middle, as nothing tells them apart.
Gear play, which the motor's own sensors show, is undone as in the compensator *with*.
"""

import numpy as np

from rig.compiled import compiled
from rig.plant.elementary_functions import sine
from rig.plant.shaft import play_operator
from rig.table import R_BALL, R_EXPOSED, R_NEW, R_THETA, R_TIME

POLE_1_S = 4.0  # of the observer: the slower, the less of the camera's noise, the later
STEP, STEP_ASYMMETRIC = 0.04, 0.01  # Gamma, of a frame; two that share their error go slower
LEAST_XI = 0.015  # m [m/rad]
HIGHEST_RAD = 0.06
PUSHED_M = 0.015  # an error that no wrong play makes: the ball was pushed, or is new
HISTORY = 64  # ticks that the observer's ball is kept for the camera's delay
RIGHT, LEFT = 0, 1

ADAPTIVE_STATE = np.dtype(
    [
        ("c", np.float64, (2, 2)),  # axis; right, left [rad]
        ("plate", np.float64, (2,)),
        ("side", np.int64, (2,)),
        ("ball", np.float64, (2, 3)),  # x, v, d
        ("xi", np.float64, (2, 2, 3)),  # d(ball)/d(c_right, c_left)
        ("past", np.float64, (2, HISTORY)),
        ("ticks", np.int64, (2,)),
        ("exposed", np.float64, (2,)),
        ("turn", np.float64, (2,)),  # the wanted angle's last extreme
        ("way", np.int64, (2,)),  # RIGHT while it rises
    ]
)


@compiled
def inverse(s, a, wanted, upper, lower, least):
    """BI(wanted) on axis `a` [rad] for break points upper >= lower [rad].

    s: record ADAPTIVE_STATE, changed in place. The wanted angle has turned when it has come back
    from its last extreme by more than `least` [rad].
    """
    if s.way[a] == RIGHT:
        s.turn[a] = max(s.turn[a], wanted)
        if wanted < s.turn[a] - least:
            s.way[a], s.turn[a] = LEFT, wanted
    else:
        s.turn[a] = min(s.turn[a], wanted)
        if wanted > s.turn[a] + least:
            s.way[a], s.turn[a] = RIGHT, wanted
    return wanted + (upper if s.way[a] == RIGHT else lower)


@compiled
def believe(s, a, theta, ball_gain, tick_s, symmetric):
    """Advance the observer of axis `a` by one tick: believed plate, ball, and sensitivities xi.

    s: record ADAPTIVE_STATE, changed in place; theta: encoder angle [rad]; ball_gain: b [m/s2/rad];
    tick_s: period [s]; symmetric: c_left = -c_right, one parameter.
    """
    upper, lower = s.c[a, RIGHT], s.c[a, LEFT]
    if theta - upper >= s.plate[a]:
        s.side[a] = RIGHT
    elif theta - lower <= s.plate[a]:
        s.side[a] = LEFT
    s.plate[a] = play_operator(s.plate[a], theta, upper, lower)
    s.ball[a, 0] += tick_s * s.ball[a, 1]
    s.ball[a, 1] += tick_s * (ball_gain * sine(s.plate[a]) + s.ball[a, 2])
    for i in range(2):
        omega = -1.0 if s.side[a] == i else 0.0
        if symmetric:  # one parameter, c_right = -c_left, kept in the first place
            omega = (-1.0 if s.side[a] == RIGHT else 1.0) if i == RIGHT else 0.0
        s.xi[a, i, 0] += tick_s * s.xi[a, i, 1]
        s.xi[a, i, 1] += tick_s * (ball_gain * omega + s.xi[a, i, 2])
    s.past[a, s.ticks[a] % HISTORY] = s.ball[a, 0]
    s.ticks[a] += 1


@compiled
def adapt(s, a, seen_m, late_ticks, dt, symmetric):
    """Take a frame on axis `a`: gradient step of c, then the observer's correction by the error e.

    s: record ADAPTIVE_STATE, changed in place; seen_m: measured position [m]; late_ticks: age of
    the frame in ticks; dt: time since the frame before [s]; symmetric: as in `believe`. A frame
    whose error is above PUSHED_M, or that comes after more than 0.25 s, restarts the observer's
    ball instead.
    """
    back = min(max(late_ticks, 0), min(HISTORY, s.ticks[a]) - 1)
    error = seen_m - s.past[a, (s.ticks[a] - 1 - back) % HISTORY]
    if abs(error) > PUSHED_M or dt > 0.25:
        s.ball[a, 0], s.ball[a, 1] = s.ball[a, 0] + error, 0.0
        for i in range(2):
            for j in range(3):
                s.xi[a, i, j] = 0.0
        return
    x, y = s.xi[a, RIGHT, 0], s.xi[a, LEFT, 0]
    gamma = STEP if symmetric else STEP_ASYMMETRIC
    step = gamma * error / (LEAST_XI * LEAST_XI + x * x + y * y)
    if symmetric:
        c = min(max(s.c[a, RIGHT] + step * x, 0.0), HIGHEST_RAD)
        s.c[a, RIGHT], s.c[a, LEFT] = c, -c
    else:
        upper, lower = s.c[a, RIGHT] + step * x, s.c[a, LEFT] + step * y
        if lower > upper:
            upper = lower = 0.5 * (upper + lower)
        s.c[a, RIGHT] = min(max(upper, -HIGHEST_RAD), HIGHEST_RAD)
        s.c[a, LEFT] = min(max(lower, -HIGHEST_RAD), HIGHEST_RAD)
    p = POLE_1_S
    gains = (3 * p * dt, 3 * p * p * dt, p**3 * dt)
    if not symmetric:
        gains = (2 * p * dt, p * p * dt, 0.0)
    for j in range(3):
        s.ball[a, j] += gains[j] * error
    for i in range(2):
        owed = s.xi[a, i, 0]
        for j in range(3):
            s.xi[a, i, j] -= gains[j] * owed


@compiled
def adaptive_inverse(s, a, reading, wanted, factor, ball_gain, tick_s, least, symmetric):
    """Servo reference on axis `a` [rad] of the adaptive inverse; runs its observer and adaptation.

    s: record ADAPTIVE_STATE, changed in place; reading (READING_SIZE,); wanted: wanted plate angle
    [rad]; factor: share of the estimated width that is compensated (1: all of it); ball_gain
    [m/s2/rad]; tick_s: period [s]; least: of `inverse` [rad]; symmetric: as in `believe`.
    """
    theta = reading[R_THETA + a]
    if s.ticks[a] == 0:
        s.plate[a], s.turn[a], s.exposed[a] = theta, wanted, -1.0
    believe(s, a, theta, ball_gain, tick_s, symmetric)
    if reading[R_NEW] != 0.0 and reading[R_EXPOSED] > s.exposed[a]:
        late = int((reading[R_TIME] - reading[R_EXPOSED]) / tick_s + 0.5)
        adapt(s, a, reading[R_BALL + a], late, reading[R_EXPOSED] - s.exposed[a], symmetric)
        s.exposed[a] = reading[R_EXPOSED]
    upper, lower = factor * s.c[a, RIGHT], factor * s.c[a, LEFT]
    if not symmetric:  # a wrong width; the middle is no play
        middle = 0.5 * (s.c[a, RIGHT] + s.c[a, LEFT])
        upper = middle + factor * (s.c[a, RIGHT] - middle)
        lower = middle + factor * (s.c[a, LEFT] - middle)
    return inverse(s, a, wanted, upper, lower, least)
