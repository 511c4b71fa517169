"""Gear play online: motor against encoder (Fig. 2, deadzone parameters beta_1, beta_2, theta_b).

The integrated tachometer minus the encoder is the twist
theta_d = o + s (alpha + w) + e theta + b t: o the unknown start inside the play, s = +1 or -1 the
side in contact, e and b the tachometer's scale error and offset, w the shaft's wind-up against the
friction of arm and plate (from the rig file, assumed there). The arm moves only while a tooth
pushes it, so at an encoder edge in steady motion s is its direction; a Kalman filter over
(o, alpha, e, b) adapts there. Two times nothing is learnt: after the arm was struck (it may fly
ahead of the tooth), and while the motor brakes harder than friction brakes the arm (it may coast
to the other side). beta_1 = o + alpha, beta_2 = o - alpha, theta_b = theta_d between them.
"""

from math import pi

import numpy as np

from rig.compiled import compiled
from rig.estimation.observers import scalar_update
from rig.parameters import GEARS_INERTIA_HIGH_KG_M2, Rig
from rig.table import R_MOTOR, R_THETA

MOVING_EDGES = 3  # encoder edges in one direction before the arm counts as pushed
AFTER_COASTING_S = 0.05  # how long nothing is learnt after hard braking
AFTER_STRIKE_S = 0.04  # and after the arm began to move the other way
BRAKING_FILTER_S = 0.01

GEAR_STATE = np.dtype(
    [
        ("ticks", np.int64),
        ("motor", np.float64, (2,)),  # integrated tachometer [rad]
        ("speed", np.float64, (2,)),
        ("smooth", np.float64, (2,)),  # filtered speed [rad/s]
        ("wait", np.float64, (2,)),  # seconds until something may be learnt again
        ("edge_theta", np.float64, (2,)),
        ("edges", np.float64, (2,)),  # signed count of encoder edges in one direction
        ("mean", np.float64, (2, 4)),  # o, alpha, e, b
        ("cov", np.float64, (2, 4, 4)),
        ("twist", np.float64, (2,)),  # theta_d about the middle of the play
    ]
)
GEAR_SETTINGS = np.dtype(
    [
        (name, np.float64)
        for name in (
            "tick_s encoder_step prior_alpha prior_scale prior_offset drift alpha_drift windup "
            "coast decay"
        ).split()
    ]
)


def settings(rig: Rig) -> np.record:
    """Return the observer's settings (dtype GEAR_SETTINGS) from the rig without its effects."""
    q = np.zeros(1, GEAR_SETTINGS)[0]
    drive, friction = rig.drive, rig.drive.arm_friction_nm + rig.drive.joint_friction_nm
    q["tick_s"] = 1 / rig.control_rate_hz
    q["encoder_step"] = rig.servo.encoder_step_rad
    q["prior_alpha"] = 3 * pi / 180
    q["prior_scale"] = 0.02  # tachometer by the manual
    q["prior_offset"] = 0.02  # rad/s
    q["drift"] = 5e-4  # of the integrated speed [rad/sqrt(s)]
    q["alpha_drift"] = 1e-4  # rad/sqrt(s): lets early mistakes heal
    q["windup"] = friction / drive.gear_stiffness_nm_rad
    inertia = GEARS_INERTIA_HIGH_KG_M2 + drive.plate_inertia_kg_m2
    q["coast"] = 0.1 * friction / inertia  # a tenth of the braking that friction alone gives
    q["decay"] = np.exp(-q["tick_s"] / BRAKING_FILTER_S)
    return q


def start(q: np.record) -> np.record:
    """Return the observer's state (dtype GEAR_STATE): zero play, with the prior variances of
    `q`.
    """
    e = np.zeros(1, GEAR_STATE)[0]
    for a in range(2):
        stds = [q["prior_alpha"], q["prior_alpha"], q["prior_scale"], q["prior_offset"]]
        e["cov"][a] = np.diag(stds) ** 2
    return e


@compiled
def _watch_braking(e, q, a, speed):
    """Let the wait run down; begin it anew while the motor brakes hard: the arm may coast."""
    before = e.smooth[a]
    e.smooth[a] = q.decay * before + (1.0 - q.decay) * speed
    acceleration = (e.smooth[a] - before) / q.tick_s
    if acceleration * e.smooth[a] < 0.0 and abs(acceleration) > q.coast:
        e.wait[a] = AFTER_COASTING_S
        e.edges[a] = 0.0
    e.wait[a] = max(e.wait[a] - q.tick_s, 0.0)


@compiled
def observe_gear(e, q, reading):
    """Run one control tick of both axes on reading (READING_SIZE,).

    e, q: of `start` and `settings`; e is changed in place. Without a tachometer (NaN) nothing is
    learnt.
    """
    t = e.ticks * q.tick_s
    for a in range(2):
        speed, theta = reading[R_MOTOR + a], reading[R_THETA + a]
        if e.ticks == 0:
            e.motor[a] = e.edge_theta[a] = theta
            e.speed[a] = speed
        if np.isnan(speed):
            continue
        e.motor[a] += 0.5 * (e.speed[a] + speed) * q.tick_s
        e.speed[a] = speed
        e.cov[a, 0, 0] += q.drift**2 * q.tick_s
        e.cov[a, 1, 1] += q.alpha_drift**2 * q.tick_s
        known = e.mean[a, 0] + e.mean[a, 2] * theta + e.mean[a, 3] * t
        e.twist[a] = e.motor[a] - theta - known
        moved = theta - e.edge_theta[a]
        _watch_braking(e, q, a, speed)
        if abs(moved) < 0.5 * q.encoder_step:
            continue
        e.edge_theta[a] = theta
        way = 1.0 if moved > 0.0 else -1.0
        if e.edges[a] * way > 0.0:
            e.edges[a] += way
        else:
            e.edges[a] = way
            e.wait[a] = max(e.wait[a], AFTER_STRIKE_S)
        if e.wait[a] > 0.0 or abs(e.edges[a]) < MOVING_EDGES:
            continue
        row = (1.0, way, theta, t)
        # Slow, the edge has just been passed: the arm is half a count behind. Fast, rounding is
        # as often up as down.
        behind = max(0.5 * (q.encoder_step - abs(speed) * q.tick_s), 0.0)
        z = e.motor[a] - (theta - way * behind) - way * q.windup
        innovation = z - (known + way * e.mean[a, 1])
        scalar_update(e.mean[a], e.cov[a], row, innovation, (2.0 * q.encoder_step) ** 2)
    e.ticks += 1
