"""The deadzone parameter estimator of the paper's Fig. 2, online: beta_1, beta_2 and theta_b.

Two places of play, two sensor pairs, each starting every run at zero play:

*Gear* (motor against encoder). The integrated tachometer minus the encoder is the twist
theta_d = o + s alpha + e theta, with o the unknown start inside the play, e the tachometer's scale
error and s = +1 or -1 the side in contact: the arm moves only while a tooth pushes it. A Kalman
filter over (o, alpha, e) adapts at every encoder edge in steady motion.

*Joint* (encoder against camera). Behind a play whose plate stays where it was left, the ball obeys
x'' = k g (2 R_d/L) sin(theta_p) + d with theta_p = theta - s alpha in contact. An extended Kalman
filter over (x, v, d, alpha) steps from exposure to exposure through the buffered encoder angles;
d(theta_p)/d(alpha) = -s adapts alpha, d takes the level error (an asymmetric play is its twin).

Each returns a standard deviation: while it is not well below the estimate, the play is not known
and `known_play` says 0.
"""

from math import pi, sin, sqrt

import numpy as np

from rig.compiled import compiled
from rig.parameters import Rig
from rig.signals import R_BALL, R_EXPOSED, R_MOTOR, R_NEW, R_THETA, R_TIME, R_VARIANCE

HISTORY = 256  # ticks of encoder angles kept for the camera's delay
MOVING_EDGES = 3  # encoder edges in one direction before the arm counts as pushed

PLAY_STATE = np.dtype(
    [
        ("tick", np.int64),
        ("begin", np.float64),  # time of tick 0: all times below count from it [s]
        ("theta", np.float64, (HISTORY, 2)),
        ("motor", np.float64, (2,)),  # integrated tachometer [rad]
        ("speed", np.float64, (2,)),
        ("edge_theta", np.float64, (2,)),
        ("edges", np.float64, (2,)),  # signed count of encoder edges in one direction
        ("gear", np.float64, (2, 3)),  # o, alpha, e
        ("gear_cov", np.float64, (2, 3, 3)),
        ("twist", np.float64, (2,)),
        ("ball_time", np.float64),
        ("ball", np.float64, (2, 4)),  # x, v, d, alpha
        ("ball_cov", np.float64, (2, 4, 4)),
        ("plate", np.float64, (2,)),  # theta_p as the estimator believes it
        ("side", np.float64, (2,)),
    ]
)
PLAY_SETTINGS = np.dtype(
    [
        (name, np.float64)
        for name in (
            "tick_s encoder_step ball_gain radius_ratio prior_alpha tachometer_scale "
            "tachometer_noise velocity_noise level_noise alpha_noise gate"
        ).split()
    ]
)


def settings(rig: Rig) -> np.record:
    """Settings of both estimators from what the controller may know of the rig (no effects)."""
    q = np.zeros(1, PLAY_SETTINGS)[0]
    q["tick_s"] = 1 / rig.control_rate_hz
    q["encoder_step"] = rig.servo.encoder_step_rad
    q["ball_gain"] = rig.ball_gain_m_s2
    q["radius_ratio"] = rig.ball.radius_m * rig.linkage.ratio
    q["prior_alpha"] = 3 * pi / 180
    q["tachometer_scale"] = 0.02  # manual: 2 %
    q["tachometer_noise"] = 0.002  # drift of the integrated speed, rad/sqrt(s)
    q["velocity_noise"] = 0.002  # what the ball model leaves out, m/s/sqrt(s)
    q["level_noise"] = 1e-3  # m/s2/sqrt(s)
    q["alpha_noise"] = 5e-5  # rad/sqrt(s)
    q["gate"] = 5.0  # standard deviations beyond which the ball was pushed
    return q


def start(q: np.record) -> np.record:
    """A fresh estimator: zero play, and honest about not knowing it."""
    e = np.zeros(1, PLAY_STATE)[0]
    e["tick"] = -1
    e["ball_time"] = -1.0
    for a in range(2):
        e["gear_cov"][a] = np.diag([q["prior_alpha"], q["prior_alpha"], q["tachometer_scale"]]) ** 2
        e["ball_cov"][a] = np.diag([1.0, 0.3, 0.03, q["prior_alpha"]]) ** 2
    return e


@compiled
def _scalar_update(mean, cov, gain_row, innovation, variance):
    """Kalman update of (mean (n,), cov (n, n)) by one scalar with row `gain_row` (n,). In place."""
    n = mean.shape[0]
    column = np.empty(n)
    total = variance
    for i in range(n):
        column[i] = 0.0
        for j in range(n):
            column[i] += cov[i, j] * gain_row[j]
        total += gain_row[i] * column[i]
    for i in range(n):
        mean[i] += column[i] / total * innovation
    for i in range(n):
        for j in range(n):
            cov[i, j] -= column[i] * column[j] / total


@compiled
def observe_gear(e, q, reading):
    """One tick of the gear's play estimator; without a tachometer nothing is learnt."""
    row = np.empty(3)
    for a in range(2):
        speed = reading[R_MOTOR + a]
        theta = reading[R_THETA + a]
        if e.tick == 0:
            e.motor[a] = theta
            e.edge_theta[a] = theta
        if np.isnan(speed):
            continue
        before = e.speed[a] if e.tick > 0 else speed
        e.motor[a] += 0.5 * (before + speed) * q.tick_s
        e.speed[a] = speed
        e.gear_cov[a, 0, 0] += q.tachometer_noise**2 * q.tick_s
        e.twist[a] = e.motor[a] - theta - e.gear[a, 0] - e.gear[a, 2] * theta
        moved = theta - e.edge_theta[a]
        if abs(moved) < 0.5 * q.encoder_step:
            continue
        e.edge_theta[a] = theta
        way = 1.0 if moved > 0.0 else -1.0
        e.edges[a] = e.edges[a] + way if e.edges[a] * way > 0.0 else way
        if abs(e.edges[a]) < MOVING_EDGES:
            continue
        row[0], row[1], row[2] = 1.0, way, theta
        # Slow, the edge has just been passed: the arm is half a count behind. Fast, rounding is
        # as often up as down.
        behind = max(0.5 * (q.encoder_step - abs(speed) * q.tick_s), 0.0)
        z = e.motor[a] - (theta - way * behind)
        innovation = z - (e.gear[a, 0] + way * e.gear[a, 1] + e.gear[a, 2] * theta)
        _scalar_update(e.gear[a], e.gear_cov[a], row, innovation, (2.0 * q.encoder_step) ** 2)


@compiled
def _believed_plate(e, a, theta, least):
    """Move the believed plate behind the play; a play below the encoder's step has no sides."""
    alpha = max(e.ball[a, 3], least)
    if theta - alpha > e.plate[a]:
        e.plate[a], e.side[a] = theta - alpha, 1.0
    elif theta + alpha < e.plate[a]:
        e.plate[a], e.side[a] = theta + alpha, -1.0
    # The belief `least` is only for the sides: with no play the plate is at theta.
    return e.plate[a] + e.side[a] * (alpha - max(e.ball[a, 3], 0.0))


@compiled
def _step_ball(e, q, a, t0, t1):
    """Predict axis `a` from exposure t0 to t1 through the buffered angles; fills mean and cov."""
    c = q.ball_gain
    t = t0
    s_v = s_x = 0.0
    x, v, d = e.ball[a, 0], e.ball[a, 1], e.ball[a, 2]
    side_before = e.side[a]
    before = after = 0.0
    first = True
    while t < t1 - 1e-9:
        k = int(t / q.tick_s + 1e-6)
        end = min((k + 1) * q.tick_s, t1)
        dt = end - t
        part = (0.5 * (t + end)) / q.tick_s - k
        low, high = e.theta[k % HISTORY, a], e.theta[min(k + 1, e.tick) % HISTORY, a]
        after = _believed_plate(e, a, low + part * (high - low), q.encoder_step)
        if first:
            before, first = after, False
        acceleration = c * sin(after) + d
        x += dt * (v + 0.5 * dt * acceleration)
        v += dt * acceleration
        s_x += dt * (s_v + 0.5 * dt * e.side[a])
        s_v += dt * e.side[a]
        t = end
    x -= q.radius_ratio * (after - before)  # the Euler term of the moving plate
    e.ball[a, 0], e.ball[a, 1] = x, v
    T = t1 - t0
    F = np.eye(4)
    F[0, 1], F[0, 2], F[1, 2] = T, 0.5 * T * T, T
    F[0, 3] = -c * s_x + q.radius_ratio * (e.side[a] - side_before)
    F[1, 3] = -c * s_v
    P = F @ e.ball_cov[a] @ F.T
    P[1, 1] += q.velocity_noise**2 * T
    P[0, 1] += q.velocity_noise**2 * T * T / 2
    P[1, 0] = P[0, 1]
    P[0, 0] += q.velocity_noise**2 * T**3 / 3
    P[2, 2] += q.level_noise**2 * T
    P[3, 3] += q.alpha_noise**2 * T
    e.ball_cov[a] = P


@compiled
def observe_joint(e, q, reading):
    """One tick of the joint's play estimator: it works when a new observation came."""
    if reading[R_NEW] == 0.0:
        return
    t1 = reading[R_EXPOSED] - e.begin
    if t1 <= max(e.ball_time, 0.0):
        return
    row = np.zeros(4)
    row[0] = 1.0
    oldest = (e.tick - HISTORY + 2) * q.tick_s
    for a in range(2):
        z = reading[R_BALL + a]
        if e.ball_time < max(oldest, 0.0):  # first observation, or the ball was away too long
            e.ball[a, 0], e.ball[a, 1] = z, 0.0
            for i in range(4):
                for j in range(4):
                    if i < 2 or j < 2:
                        e.ball_cov[a, i, j] = 0.0
            e.ball_cov[a, 0, 0], e.ball_cov[a, 1, 1] = reading[R_VARIANCE], 0.1
            e.plate[a] = reading[R_THETA + a]
            continue
        _step_ball(e, q, a, e.ball_time, t1)
        innovation = z - e.ball[a, 0]
        deviation = sqrt(e.ball_cov[a, 0, 0] + reading[R_VARIANCE])
        if abs(innovation) > q.gate * deviation:  # a push: the velocity is new, the play is not
            e.ball[a, 0] = z
            e.ball[a, 1] += innovation / max(t1 - e.ball_time, q.tick_s)
            for i in range(4):
                for j in range(4):
                    if i < 2 or j < 2:
                        e.ball_cov[a, i, j] = 0.0
            e.ball_cov[a, 0, 0], e.ball_cov[a, 1, 1] = reading[R_VARIANCE], 0.1
            continue
        _scalar_update(e.ball[a], e.ball_cov[a], row, innovation, reading[R_VARIANCE])
        e.ball[a, 3] = min(max(e.ball[a, 3], 0.0), 0.1)
    e.ball_time = t1


@compiled
def observe_play(e, q, reading):
    """One control tick of both estimators: sees the reading alone."""
    e.tick += 1
    if e.tick == 0:
        e.begin = reading[R_TIME]
    for a in range(2):
        e.theta[e.tick % HISTORY, a] = reading[R_THETA + a]
    observe_gear(e, q, reading)
    observe_joint(e, q, reading)


@compiled
def known_play(width, deviation):
    """The full width when it is known, else 0: known when 2 deviations lie below it [rad]."""
    return width if width > 2.0 * deviation else 0.0
