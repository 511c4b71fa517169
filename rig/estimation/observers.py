"""What the loop believes besides the play: the ball's motion and the shaft's torque.

*Ball filter* (all compensators): a critically damped kinematic filter (alpha-beta) on the
exposures, read out at the present tick; it knows no plant. *Torque estimator and observer* (Eq. 9,
Fig. 3):

    T_e = (T_m - J_m s omega_m)/(tau s + 1),   Omega = K/(tau s + 1) T_e,

with T_m = A V - B omega_m the motor's torque at the load shaft, in discrete time by the exact step
response of 1/(tau s + 1). s/(tau s + 1) omega_m = (omega_m - filtered omega_m)/lag needs no
derivative. T_e holds the shaft's torque and the motor's own dry friction; it is recorded in both
compensators and acts on none. Without a tachometer omega_m is the encoder's difference: what gear
play does inside one gap is then invisible, and one count makes 0.08 N m of noise.
"""

from math import exp

import numpy as np

from rig.compiled import compiled, inlined
from rig.parameters import GEARS_INERTIA_HIGH_KG_M2, Rig
from rig.safety.limits import free_rate
from rig.table import R_BALL, R_EXPOSED, R_MOTOR, R_NEW, R_THETA, R_TIME

ESTIMATE = np.dtype(
    [
        ("ball", np.float64, (2,)),
        ("velocity", np.float64, (2,)),
        ("exposed", np.float64),
        ("frames", np.int64),
        ("theta", np.float64, (2,)),
        ("rate", np.float64, (2,)),
        ("free_rate", np.float64, (2,)),  # of a motor in the play of its gears, by the volts
        ("torque_sum", np.float64, (2,)),
        ("rate_filtered", np.float64, (2,)),
        ("torque", np.float64, (2,)),  # T_e [N m]
        ("observed", np.float64, (2,)),  # Omega
        ("ticks", np.int64),
        ("t_s", np.float64),  # of the last tick
    ]
)
MOST_MISSED = 25  # ticks that are made up for; chosen: of 50 ms at 500 Hz, when the limiter stops
ESTIMATE_SETTINGS = np.dtype(
    [
        (name, np.float64)
        for name in (
            "tick_s filter torque_per_volt damping inertia decay lag gain motor_gain motor_decay"
        ).split()
    ]
)


def settings(rig: Rig) -> np.record:
    """Return the observers' settings (dtype ESTIMATE_SETTINGS) from the rig without its effects."""
    q = np.zeros(1, ESTIMATE_SETTINGS)[0]
    q["tick_s"] = 1 / rig.control_rate_hz
    q["filter"] = rig.gains.ball_filter_rad_s
    q["torque_per_volt"] = rig.servo.torque_per_volt_nm
    q["damping"] = rig.servo.damping_nm_s
    load = GEARS_INERTIA_HIGH_KG_M2 + rig.drive.plate_inertia_kg_m2
    q["inertia"] = rig.servo.inertia_kg_m2 - load
    q["gain"] = rig.gains.observer_gain
    q["motor_gain"] = rig.servo.gain_rad_s_V
    q["motor_decay"] = exp(-q["tick_s"] / rig.servo.time_constant_s)
    q["decay"] = exp(-q["tick_s"] / rig.gains.torque_filter_s)
    # By so much the sampled filter lags a ramp (tau in continuous time): with it a steady
    # acceleration is recovered exactly.
    q["lag"] = q["tick_s"] * q["decay"] / (1 - q["decay"])
    return q


def start() -> np.record:
    """Return the observers' state (dtype ESTIMATE) before the first reading."""
    estimate = np.zeros(1, ESTIMATE)[0]
    estimate["exposed"] = -1.0
    return estimate


@compiled
def observe_ball(b, q, reading):
    """Take a new observation into the ball filter.

    b, q: of `start` and `settings`; b is changed in place. reading (READING_SIZE,) has no effect
    where it holds no newer observation. `b.ball` [m] and `b.velocity` [m/s] are those at its
    exposure. Critically damped alpha-beta filter: alpha = 1 - rho^2, beta = (1 - rho)^2, rho =
    exp(-filter dt).
    """
    if reading[R_NEW] == 0.0:
        return
    dt = reading[R_EXPOSED] - b.exposed
    if b.frames > 0 and dt <= 0.0:  # an observation once more: nothing new
        return
    fresh = b.frames == 0 or dt > 0.25  # after a quarter second nothing old is worth keeping
    rho = exp(-q.filter * dt)
    for a in range(2):
        if fresh:
            b.ball[a], b.velocity[a] = reading[R_BALL + a], 0.0
            continue
        predicted = b.ball[a] + dt * b.velocity[a]
        miss = reading[R_BALL + a] - predicted
        b.ball[a] = predicted + (1.0 - rho * rho) * miss
        b.velocity[a] += (1.0 - rho) ** 2 / dt * miss
    b.exposed = reading[R_EXPOSED]
    b.frames += 1


@compiled
def _ticks_since(b, q, reading):
    """Ticks from the last reading to this one: 1, or more where some were missed."""
    steps = (reading[R_TIME] - b.t_s) / q.tick_s
    b.t_s = reading[R_TIME]
    if b.ticks == 0 or not steps >= 1.5:
        return 1
    return MOST_MISSED if steps > MOST_MISSED else int(steps + 0.5)


@compiled
def observe_torque(b, q, reading, volts):
    """Run one tick of Eq. 9's torque estimator and observer on both axes, and those that were
    missed before it, in which the arms went on evenly.

    b, q: of `start` and `settings`; b is changed in place. reading (READING_SIZE,); volts (2,):
    applied since the last tick.
    """
    ticks = _ticks_since(b, q, reading)
    for a in range(2):
        theta = reading[R_THETA + a]
        if b.ticks == 0:
            b.theta[a] = theta
        difference = (theta - b.theta[a]) / (ticks * q.tick_s)
        speed = reading[R_MOTOR + a]
        if np.isnan(speed):
            speed = difference
        motor = q.torque_per_volt * volts[a] - q.damping * speed
        for _ in range(ticks):
            b.rate[a] = q.decay * b.rate[a] + (1.0 - q.decay) * difference
            b.free_rate[a] = free_rate(b.free_rate[a], volts[a], q.motor_gain, q.motor_decay)
            b.torque_sum[a] = q.decay * b.torque_sum[a] + (1.0 - q.decay) * motor
            b.rate_filtered[a] = q.decay * b.rate_filtered[a] + (1.0 - q.decay) * speed
            b.torque[a] = b.torque_sum[a] - q.inertia * (speed - b.rate_filtered[a]) / q.lag
            b.observed[a] = q.decay * b.observed[a] + (1.0 - q.decay) * q.gain * b.torque[a]
        b.theta[a] = theta
    b.ticks += 1


@compiled
def observe_angles(b, q, reading):
    """Run one tick of the arms' rates alone, for servos without a torque, and those that were
    missed before it; b is changed in place.
    """
    ticks = _ticks_since(b, q, reading)
    for a in range(2):
        theta = reading[R_THETA + a]
        if b.ticks == 0:
            b.theta[a] = theta
        difference = (theta - b.theta[a]) / (ticks * q.tick_s)
        for _ in range(ticks):
            b.rate[a] = q.decay * b.rate[a] + (1.0 - q.decay) * difference
        b.theta[a] = theta
    b.ticks += 1


@compiled
def ball_now(b, t, a):
    """Position of the ball on axis `a` [m]: that of b, record ESTIMATE, carried on at its velocity
    from its exposure to time t [s].
    """
    return b.ball[a] + b.velocity[a] * (t - b.exposed)


@compiled
def observe(b, q, reading, volts):
    """Run one tick of the ball filter and the torque observer; b, q, reading, volts: as of
    `observe_torque`.
    """
    observe_ball(b, q, reading)
    observe_torque(b, q, reading, volts)


@compiled
def seconds_blind(b, reading):
    """Time from the exposure of the last observation to `reading` (READING_SIZE,) [s]; before the
    first one, time since the start + 1 s. b: record ESTIMATE.
    """
    return reading[R_TIME] - b.exposed


@inlined
def scalar_update(mean, cov, row, innovation, variance):
    """Kalman update of mean (4,) and cov (4, 4), in place, by one scalar z = row . mean + noise.

    row: a tuple of 4; innovation = z - row . mean; variance: of the noise. Returns the variance of
    the innovation.
    """
    column = _dot(cov[0], row), _dot(cov[1], row), _dot(cov[2], row), _dot(cov[3], row)
    total = variance
    for i in range(4):
        total += row[i] * column[i]
    for i in range(4):
        mean[i] += column[i] / total * innovation
    for i in range(4):
        for j in range(4):
            cov[i, j] -= column[i] * column[j] / total
    return total


@inlined
def _dot(line, row):
    return line[0] * row[0] + line[1] * row[1] + line[2] * row[2] + line[3] * row[3]
