"""LQG: a steady-state Kalman filter and the linear-quadratic regulator of one axis, tick by tick.

The ball's filter x = (p, p', d) runs with the measured servo angle as its input and is corrected by
each frame at the moment of its exposure: with the age D of the frame

    x += Phi(D) l (y - p(t - D)),   Phi(D) = [1 D D^2/2; 0 1 D; 0 0 1]

The servo's (theta, omega, w) runs with the volts of the last tick and is corrected by the encoder.
The regulator of `design` acts on the distance from the target and from the angle -d/b that holds
the ball there; it is written as a wanted angle, which the servo's limit bounds:

    wanted = -d/b - (k_p e + k_v p')/k_theta,   V = k_theta (wanted - theta) - k_omega omega - w
"""

import numpy as np

from rig.compiled import compiled
from rig.control.optimal import design
from rig.parameters import Rig
from rig.table import R_BALL, R_EXPOSED, R_NEW, R_THETA, R_TIME

MEMORY = 128  # ticks for which predictions are kept, for frames that come late
AXIS = np.dtype(
    [
        ("on", np.int64),  # whether the filter runs
        ("last_s", np.float64),
        ("ball", np.float64, (3,)),
        ("servo", np.float64, (3,)),
        ("volts", np.float64),
        ("times", np.float64, (MEMORY,)),
        ("places", np.float64, (MEMORY,)),
        ("next", np.int64),
    ]
)
LQG_STATE = np.dtype([("axes", AXIS, (2,))])
LQG_SETTINGS = np.dtype(
    [
        ("gain", np.float64, (4,)),
        ("ball_gain", np.float64, (3,)),
        ("servo_gain", np.float64, (3,)),
        ("decay", np.float64),  # exp(-h/tau)
        ("voltage_limit", np.float64),
    ]
)


def settings(rig: Rig, weights: design.Weights) -> np.record:
    """The settings (dtype LQG_SETTINGS) from what a controller may know of the rig, whose servos
    take volts."""
    q = np.zeros(1, LQG_SETTINGS)[0]
    tick_s = 1.0 / rig.control_rate_hz
    q["gain"] = design.regulator(rig, tick_s, weights)[0]
    q["ball_gain"] = design.ball_filter(rig, weights)
    q["servo_gain"] = design.servo_filter(rig, tick_s, weights)
    q["decay"] = np.exp(-tick_s / rig.servo.time_constant_s)
    q["voltage_limit"] = rig.servo.voltage_limit_V
    return q


@compiled
def forget(s):
    """Stop the filters of both axes, as while the ball is held; s: record LQG_STATE."""
    s.axes[0].on = s.axes[1].on = 0


@compiled
def estimate(s, q, g, reading, a, place, velocity):
    """Carry the filters of axis `a` on to this tick.

    s: record LQG_STATE, changed in place; q: record LQG_SETTINGS; g: record CONTROL_SETTINGS;
    reading (READING_SIZE,); place [m], velocity [m/s]: of the ball as the rig's observer has them,
    from which the filters start where they did not run in the last tick.
    """
    x, t, theta = s.axes[a], reading[R_TIME], reading[R_THETA + a]
    if x.on == 0 or t - x.last_s > 2.5 * g.tick_s:
        x.on, x.next, x.volts = 1, 0, 0.0
        x.ball[0], x.ball[1], x.ball[2] = place, velocity, 0.0
        x.servo[0], x.servo[1], x.servo[2] = theta, 0.0, 0.0
        for i in range(MEMORY):
            x.times[i], x.places[i] = t, place
    else:
        h = t - x.last_s
        push = g.ball_gain * x.servo[0] + x.ball[2]
        x.ball[0] += h * (x.ball[1] + 0.5 * h * push)
        x.ball[1] += h * push
        top = g.motor_gain * (x.volts + x.servo[2])
        over = x.servo[1] - top
        x.servo[0] += top * h + over * g.motor_lag * (1.0 - q.decay)
        x.servo[1] = top + over * q.decay
    x.last_s = t
    miss = theta - x.servo[0]
    for i in range(3):
        x.servo[i] += q.servo_gain[i] * miss
    x.times[x.next], x.places[x.next] = t, x.ball[0]
    if reading[R_NEW] != 0.0:
        _correct(x, q, reading[R_BALL + a], reading[R_EXPOSED], t)
    x.next = (x.next + 1) % MEMORY


@compiled
def _correct(x, q, seen, exposed_s, t):
    """Correct the ball's state by what was seen at `exposed_s`, and the predictions kept since."""
    age = min(max(t - exposed_s, 0.0), x.times[x.next] - x.times[(x.next + 1) % MEMORY])
    best, at = np.inf, x.next
    for i in range(MEMORY):
        off = abs(x.times[i] - (t - age))
        if off < best:
            best, at = off, i
    miss = seen - x.places[at]
    p, v, d = q.ball_gain[0] * miss, q.ball_gain[1] * miss, q.ball_gain[2] * miss
    x.ball[0] += p + age * (v + 0.5 * age * d)
    x.ball[1] += v + age * d
    x.ball[2] += d
    for i in range(MEMORY):
        since = x.times[i] - (t - age)
        if since >= 0.0:
            x.places[i] += p + since * (v + 0.5 * since * d)


@compiled
def hold_angle(x, g):
    """The servo angle that holds the ball against d [rad], within the servo's limit."""
    return min(max(-x.ball[2] / g.ball_gain, -g.angle_limit), g.angle_limit)


@compiled
def lqg_volts(s, q, c, g, a, target):
    """Volts of axis `a` that lead the ball to `target` [m]; s, q, g: as of `estimate`, c: record
    CONTROL, into which the wanted angle is written."""
    x = s.axes[a]
    k = q.gain
    wanted = hold_angle(x, g) - (k[0] * (x.ball[0] - target) + k[1] * x.ball[1]) / k[2]
    wanted = min(max(wanted, -g.angle_limit), g.angle_limit)
    c.wanted_theta[a] = c.reference[a] = wanted
    volts = k[2] * (wanted - x.servo[0]) - k[3] * x.servo[1] - x.servo[2]
    x.volts = min(max(volts, -q.voltage_limit), q.voltage_limit)
    return volts
