"""Joint play online: encoder against camera (Fig. 2 behind the encoder).

The ball obeys x'' = k g (2 R_d/L) sin(theta_p) + d, d the level error. Where the plate is inside
the play, friction decides, and two models run side by side, each an extended Kalman filter over
(x, v, d, alpha) that steps from exposure to exposure through the buffered encoder angles:

*keeps*: the plate stays where it was left: theta_p = theta - s alpha, s the side last pushed;
*drops*: the plate lies on the ball's side: theta_p = theta + alpha sgn(x).

d(theta_p)/d(alpha) adapts alpha; the likelihood of the innovations says which model the table
follows; where neither fits, the play is not known. alpha includes the shaft's wind-up against
friction; the reported play does not. An asymmetric play is a twin of the level error: only the
width shows.
"""

from math import exp, log, pi

import numpy as np

from rig.compiled import compiled
from rig.estimation.observers import scalar_update
from rig.parameters import Rig
from rig.plant.elementary_functions import sine
from rig.table import R_BALL, R_EXPOSED, R_NEW, R_THETA, R_TIME, R_VARIANCE

HISTORY = 256  # ticks of encoder angles kept for the camera's delay
KEEPS, DROPS = 0, 1
MISFIT_SHARE = 0.005  # of the last 200 or so innovations
WORST_MISFIT = 1.25  # neither model explains the ball: what they say of the play is no knowledge
MODEL_ERROR_M = 1e-4  # what the ball model and the encoder's counts leave out between two frames
NEAR_M = 0.004  # a ball so near to the pivot does not say which side the plate is on

JOINT_STATE = np.dtype(
    [
        ("tick", np.int64),
        ("begin", np.float64),  # time of tick 0: all times below count from it [s]
        ("theta", np.float64, (HISTORY, 2)),
        ("time", np.float64),  # of the last exposure
        ("mean", np.float64, (2, 2, 4)),  # model, axis: x, v, d, alpha
        ("cov", np.float64, (2, 2, 4, 4)),
        ("plate", np.float64, (2, 2)),  # theta_p as each model believes it
        ("side", np.float64, (2, 2)),  # -d(theta_p)/d(alpha)
        ("evidence", np.float64, (2, 2)),  # log likelihood of the innovations
        ("misfit", np.float64, (2, 2)),  # running mean of the squared normalised innovations
        ("alpha", np.float64, (2,)),  # what both models together say, and its variance
        ("variance", np.float64, (2,)),
        ("keeps", np.float64, (2,)),  # probability that the plate keeps its place
    ]
)
JOINT_SETTINGS = np.dtype(
    [
        (name, np.float64)
        for name in (
            "tick_s encoder_step gain radius_ratio prior_alpha velocity_noise level_noise "
            "alpha_noise gate settled windup"
        ).split()
    ]
)


def settings(rig: Rig) -> np.record:
    """Return the observer's settings (dtype JOINT_SETTINGS) from the rig without its effects."""
    q = np.zeros(1, JOINT_SETTINGS)[0]
    q["tick_s"] = 1 / rig.control_rate_hz
    q["encoder_step"] = rig.servo.encoder_step_rad
    q["gain"] = rig.ball_gain_m_s2
    q["radius_ratio"] = rig.ball.radius_m * rig.linkage.ratio
    q["prior_alpha"] = pi / 180  # half width: plays up to some degrees are sensible
    q["velocity_noise"] = 0.002  # what the ball model leaves out, m/s/sqrt(s)
    q["level_noise"] = 3e-4  # m/s2/sqrt(s)
    q["alpha_noise"] = 1e-4  # rad/sqrt(s)
    q["gate"] = 5.0  # standard deviations beyond which the ball was pushed
    q["settled"] = 0.2 * pi / 180
    q["windup"] = rig.drive.joint_friction_nm / rig.drive.joint_stiffness_nm_rad
    return q


def start(q: np.record) -> np.record:
    """Return the observer's state (dtype JOINT_STATE): zero play, with the prior variance of
    `q`.
    """
    e = np.zeros(1, JOINT_STATE)[0]
    e["tick"], e["time"] = -1, -1.0
    e["cov"][:] = np.diag([1.0, 0.3, 0.03, q["prior_alpha"]]) ** 2
    e["variance"], e["keeps"] = q["prior_alpha"] ** 2, 0.5
    return e


@compiled
def _believed_plate(e, q, m, a, theta):
    """theta_p by model `m`; sets `side`. A play below the encoder's step has no sides to keep."""
    alpha = max(e.mean[m, a, 3], 0.0)
    if m == DROPS:
        x = e.mean[m, a, 0]
        e.side[m, a] = -min(max(x / NEAR_M, -1.0), 1.0)
        return theta - e.side[m, a] * alpha
    least = max(alpha, q.encoder_step)
    if theta - least > e.plate[m, a]:
        e.plate[m, a], e.side[m, a] = theta - least, 1.0
    elif theta + least < e.plate[m, a]:
        e.plate[m, a], e.side[m, a] = theta + least, -1.0
    return e.plate[m, a] + e.side[m, a] * (least - alpha)


@compiled
def _predict(e, q, m, a, t0, t1):
    """Model `m` of axis `a` from exposure t0 to t1 through the buffered angles: mean and cov."""
    mean = e.mean[m, a]
    x, v, t = mean[0], mean[1], t0
    s_v = s_x = before = after = 0.0
    side_before, first = e.side[m, a], True
    while t < t1 - 1e-9:
        k = int(t / q.tick_s + 1e-6)
        end = min((k + 1) * q.tick_s, t1)
        dt, part = end - t, 0.5 * (t + end) / q.tick_s - k
        low, high = e.theta[k % HISTORY, a], e.theta[min(k + 1, e.tick) % HISTORY, a]
        after = _believed_plate(e, q, m, a, low + part * (high - low))
        if first:
            before, first = after, False
        acceleration = q.gain * sine(after) + mean[2]
        x += dt * (v + 0.5 * dt * acceleration)
        v += dt * acceleration
        s_x += dt * (s_v + 0.5 * dt * e.side[m, a])
        s_v += dt * e.side[m, a]
        t = end
    mean[0] = x - q.radius_ratio * (after - before)  # the Euler term of the moving plate
    mean[1] = v
    T = t1 - t0
    P, x_alpha = e.cov[m, a], -q.gain * s_x + q.radius_ratio * (e.side[m, a] - side_before)
    v_alpha = -q.gain * s_v
    for i in range(4):  # F P, then (F P) F'
        P[0, i] += T * P[1, i] + 0.5 * T * T * P[2, i] + x_alpha * P[3, i]
        P[1, i] += T * P[2, i] + v_alpha * P[3, i]
    for i in range(4):
        P[i, 0] += T * P[i, 1] + 0.5 * T * T * P[i, 2] + x_alpha * P[i, 3]
        P[i, 1] += T * P[i, 2] + v_alpha * P[i, 3]
    noise = q.velocity_noise**2 * T
    P[1, 1] += noise
    P[0, 1] += 0.5 * noise * T
    P[1, 0] += 0.5 * noise * T
    P[0, 0] += noise * T * T / 3
    P[2, 2] += q.level_noise**2 * T
    P[3, 3] += q.alpha_noise**2 * T


@compiled
def _restart(e, m, a, x, v, variance):
    """The ball's motion is new (first seen, or pushed); level and play are not."""
    e.mean[m, a, 0], e.mean[m, a, 1] = x, v
    for i in range(4):
        for j in range(4):
            if i < 2 or j < 2:
                e.cov[m, a, i, j] = 0.0
    e.cov[m, a, 0, 0], e.cov[m, a, 1, 1] = variance, 0.1


@compiled
def _weigh(e, q, a):
    """What both models together say of alpha: mixture mean and variance by their likelihood."""
    lead = e.evidence[KEEPS, a] - e.evidence[DROPS, a]
    keeps = 1.0 / (1.0 + exp(-min(max(lead, -50.0), 50.0)))
    e.keeps[a] = keeps
    one, other = e.mean[KEEPS, a, 3], e.mean[DROPS, a, 3]
    e.alpha[a] = keeps * one + (1.0 - keeps) * other
    e.variance[a] = keeps * (e.cov[KEEPS, a, 3, 3] + (one - e.alpha[a]) ** 2) + (1.0 - keeps) * (
        e.cov[DROPS, a, 3, 3] + (other - e.alpha[a]) ** 2
    )
    # A plate that drops also rattles: its model names the regime, but the width only roughly.
    e.variance[a] += (1.0 - keeps) * (one - other) ** 2
    if min(e.misfit[KEEPS, a], e.misfit[DROPS, a]) > WORST_MISFIT:
        e.variance[a] += q.prior_alpha**2


@compiled
def observe_joint(e, q, reading):
    """Run one control tick of both axes on reading (READING_SIZE,).

    e, q: of `start` and `settings`; e is changed in place. The encoder angles are buffered at every
    tick; the filters step when a new observation has come.
    """
    e.tick += 1
    if e.tick == 0:
        e.begin = reading[R_TIME]
    for a in range(2):
        e.theta[e.tick % HISTORY, a] = reading[R_THETA + a]
    if reading[R_NEW] == 0.0:
        return
    t1, variance = reading[R_EXPOSED] - e.begin, reading[R_VARIANCE] + MODEL_ERROR_M**2
    if t1 <= max(e.time, 0.0):
        return
    row = (1.0, 0.0, 0.0, 0.0)
    away = e.time < max((e.tick - HISTORY + 2) * q.tick_s, 0.0)  # first seen, or too long ago
    for a in range(2):
        z = reading[R_BALL + a]
        # Before both know their play, which one predicts better is an accident of the start.
        settled = max(e.cov[KEEPS, a, 3, 3], e.cov[DROPS, a, 3, 3]) < q.settled**2
        for m in range(2):
            if away:
                _restart(e, m, a, z, 0.0, variance)
                e.plate[m, a] = reading[R_THETA + a]
                continue
            _predict(e, q, m, a, e.time, t1)
            innovation = z - e.mean[m, a, 0]
            total = e.cov[m, a, 0, 0] + variance
            surprise = innovation**2 / total
            pushed = surprise > q.gate**2
            if settled:
                e.evidence[m, a] -= 0.5 * (min(surprise, q.gate**2) + log(total))
            if settled and not pushed:
                e.misfit[m, a] += MISFIT_SHARE * (surprise - e.misfit[m, a])
            if pushed:
                speed = e.mean[m, a, 1] + innovation / max(t1 - e.time, q.tick_s)
                _restart(e, m, a, z, speed, variance)
                continue
            scalar_update(e.mean[m, a], e.cov[m, a], row, innovation, variance)
            e.mean[m, a, 3] = min(max(e.mean[m, a, 3], 0.0), 0.1)
        _weigh(e, q, a)
    e.time = t1
