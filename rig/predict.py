"""One step ahead from measured signals: the innovations of a calibrated observer.

The table is a cascade with a measured middle: volts -> servo -> encoder -> plate -> ball -> camera.
So the servo's part predicts the encoder's next count from the volts, and the ball's part predicts
the next exposure from the *measured* encoder angles: servo-side and ball-side effects show in two
separate channels. Shafts are rigid here (a play is its operator); every effect is the compiled
equation that the simulator calls. With true parameters and no noise the innovations vanish with
the tick.

*Servo*, per axis: first-order motor (K, tau) exactly over a tick, Kalman filter over angle and
speed.
*Ball*: rolling on the moving plate, one midpoint step a tick between exposures, Kalman filter over
(position, velocity) per axis.
"""

from dataclasses import dataclass
from math import exp, sqrt

import numpy as np

from rig import effect_equations as equations
from rig.ball import plate_sines, rolling
from rig.compiled import compiled
from rig.log import Log
from rig.parameters import Rig
from rig.plant import effective_volts, felt_angle
from rig.plant_record import pack
from rig.shaft import play_operator
from rig.unknown import unknown_acceleration

NOISE = np.dtype(
    [
        (name, np.float64)
        for name in (
            "servo_process "  # of the speed, rad/s/sqrt(s)
            "servo_measured "  # of the encoder, rad
            "ball_process "  # of the velocity, m/s/sqrt(s)
            "ball_measured"  # of the camera, m
        ).split()
    ]
)


@dataclass(frozen=True, eq=False)
class Signals:
    """What a log gives to predict from; a channel that it lacks is empty.

    t_s (n,), volts_V and theta_rad (n, 2), exposed_s (k,), ball_m (k, 2).
    """

    t_s: np.ndarray
    volts_V: np.ndarray
    theta_rad: np.ndarray
    exposed_s: np.ndarray
    ball_m: np.ndarray


def signals(log: Log, *, camera_delay_s: float) -> Signals:
    """Take the signals of a log's rows; `camera_delay_s` dates observations without a stamp."""
    exposed, ball = log.ball(camera_delay_s)
    pair = [np.column_stack([log[f"{n}_x_{u}"], log[f"{n}_y_{u}"]]) for n, u in _PAIRS]
    return Signals(np.array(log["t_s"]), pair[0], pair[1], exposed, ball)


_PAIRS = (("voltage", "V"), ("theta", "rad"))


@dataclass(frozen=True, eq=False)
class Innovations:
    """Servo (n, 2) [rad] and ball (k, 2) [m]: measured minus predicted, NaN before a prediction;
    their standard deviations as the filters expect them, servo (n, 2), ball (k,)."""

    servo: np.ndarray
    servo_std: np.ndarray
    ball: np.ndarray
    ball_std: np.ndarray


def noise(
    *,
    servo_process: float = 0.2,
    servo_measured: float = 4.4e-4,
    ball_process: float = 0.002,
    ball_measured: float = 3e-4,
) -> np.record:
    """Noise levels of the filters; the encoder's is a count over sqrt(12)."""
    record = np.zeros(1, NOISE)[0]
    record["servo_process"], record["servo_measured"] = servo_process, servo_measured
    record["ball_process"], record["ball_measured"] = ball_process, ball_measured
    return record


def predict(rig: Rig, known: Signals, levels: np.record) -> Innovations:
    """Innovations of a log under the model `rig`, effects included."""
    p = pack(rig)
    n, k = len(known.t_s), len(known.exposed_s)
    servo, servo_std = np.full((n, 2), np.nan), np.full((n, 2), np.nan)
    ball, ball_std = np.full((k, 2), np.nan), np.full(k, np.nan)
    if known.volts_V.size and np.isfinite(known.volts_V).all():
        predict_servo(
            p, levels, known.t_s, known.volts_V, known.theta_rad, rig.servo.gain_rad_s_V,
            rig.servo.time_constant_s, servo, servo_std,
        )  # fmt: skip
    if k:
        predict_ball(
            p, levels, known.t_s, known.theta_rad, known.exposed_s, known.ball_m, ball, ball_std
        )
    return Innovations(servo, servo_std, ball, ball_std)


@compiled
def delayed_volts(volts, k, a, dt, delay_s):
    """Mean of the volts that reach motor `a` during tick k when they come `delay_s` late [V]."""
    whole = int(delay_s / dt)
    part = delay_s / dt - whole
    new, old = max(k - whole, 0), max(k - whole - 1, 0)
    return (1.0 - part) * volts[new, a] + part * volts[old, a] if part > 0.0 else volts[new, a]


@compiled
def servo_step(p, a, motor, speed, volts, gain, tau, dt, free_gap):
    """Motor angle and speed a tick later: first order exactly, then dry friction.

    In contact the motor also turns arm and plate and their friction; inside a gap it is alone.
    """
    if free_gap:
        tau *= p.motor_inertia[a] / (p.motor_inertia[a] + p.arm_inertia + p.plate_inertia)
    decay = exp(-dt / tau)
    load = 0.0 if free_gap else (p.arm_friction + p.joint_friction) / p.torque_per_volt[a]
    dry = load + equations.friction_volts(
        speed,
        p.coulomb_friction_friction_V[a],
        p.stribeck_friction_extra_V[a],
        p.stribeck_friction_speed_rad_s[a],
    )
    target = gain * volts
    free = target + (speed - target) * decay
    after = equations.stick(free, gain * dry * (1.0 - decay))
    # The mean speed over the tick: exact for the first-order motor, dry friction on both ends.
    mean = target + (speed - target) * tau * (1.0 - decay) / dt
    return motor + dt * (mean + 0.5 * (after - free)), after


@compiled
def predict_servo(p, levels, t, volts, theta, gain, tau, out, std):
    """Fill `out` and `std` (n, 2): the encoder's innovations [rad] and what the filter expects."""
    n = t.shape[0]
    r = levels.servo_measured**2
    for a in range(2):
        beta_1, beta_2 = p.gear_1[a], p.gear_2[a]
        arm, motor, speed = theta[0, a], theta[0, a], 0.0
        p00, p01, p11 = r, 0.0, 1.0
        for k in range(n - 1):
            dt = t[k + 1] - t[k]
            delay = p.input_delay_delay_s[a]
            v_x = delayed_volts(volts, k, 0, dt, delay)
            v_y = delayed_volts(volts, k, 1, dt, delay)
            v = effective_volts(p, a, v_x, v_y, arm, speed, t[k])
            free_gap = motor - beta_1 < arm < motor - beta_2
            motor, speed = servo_step(p, a, motor, speed, v, gain, tau, dt, free_gap)
            arm = play_operator(arm, motor, beta_1, beta_2)
            decay = exp(-dt / tau)
            reach = tau * (1.0 - decay)
            q = levels.servo_process**2 * dt
            p00 += 2.0 * reach * p01 + reach * reach * p11 + q * dt * dt / 3.0
            p01 = decay * (p01 + reach * p11) + 0.5 * q * dt
            p11 = decay * decay * p11 + q
            total = p00 + r
            miss = theta[k + 1, a] - arm
            out[k + 1, a], std[k + 1, a] = miss, sqrt(total)
            held = motor - beta_1 < arm < motor - beta_2
            g0, g1 = p00 / total, p01 / total
            arm += g0 * miss
            if held:  # inside the gap the encoder says nothing of the motor
                continue
            motor += g0 * miss
            speed += g1 * miss
            p11 -= g1 * p01
            p01 -= g0 * p01
            p00 -= g0 * p00


@compiled
def _plate(p, a, theta, plate):
    """The servo angle that the plate feels behind joint play and linkage; new play position."""
    plate = play_operator(plate, theta, p.joint_1[a], p.joint_2[a])
    return felt_angle(p, a, plate), plate


@compiled
def _angle(theta, t, k, a, when):
    """Encoder angle between ticks, straight [rad]."""
    low = theta[k, a]
    if k + 1 >= theta.shape[0]:
        return low
    return low + (theta[k + 1, a] - low) * (when - t[k]) / (t[k + 1] - t[k])


@compiled
def ball_step(p, s, plate, sines, angle_x, angle_y, now, dt):
    """Ball state s (5,) = x, y, w_x, w_y, spin over dt while the plate moves to the new angles.

    `plate` (2,) and `sines` (2,) are the plate's play positions and tilt before; changed in place.
    """
    felt_x, plate[0] = _plate(p, 0, angle_x, plate[0])
    felt_y, plate[1] = _plate(p, 1, angle_y, plate[1])
    s_x, s_y = plate_sines(
        felt_x, felt_y, p.ratio, p.cross_coupling_fraction[0], p.cross_coupling_fraction[1]
    )
    mid_x, mid_y = 0.5 * (s_x + sines[0]), 0.5 * (s_y + sines[1])
    c = sqrt(1.0 - mid_x * mid_x - mid_y * mid_y)
    o1, o2 = -(s_y - sines[1]) / (dt * c), (s_x - sines[0]) / (dt * c)
    r = p.radius
    v_x, v_y = s[2] - r * o2, s[3] + r * o1
    slope_x = mid_x + p.level_offset_slope_rad[0] + p.level_drift_rate_rad_s[0] * now
    slope_y = mid_y + p.level_offset_slope_rad[1] + p.level_drift_rate_rad_s[1] * now
    x, y = s[0] + 0.5 * dt * v_x, s[1] + 0.5 * dt * v_y
    a_x, a_y, turn = rolling(x, y, v_x, v_y, s[4], slope_x, slope_y, o1, o2, p.factor, r)
    bowl, drag = p.plate_bowl_stiffness_1_s2[0], p.viscous_drag_rate_1_s[0]
    a_x += equations.plate_bowl(x, bowl) + equations.viscous_drag(v_x + 0.5 * dt * a_x, drag)
    a_y += equations.plate_bowl(y, bowl) + equations.viscous_drag(v_y + 0.5 * dt * a_y, drag)
    if p.unknown.on:
        part_x, part_y = x / p.half_side, y / p.half_side
        a_x += unknown_acceleration(p.unknown, 0, part_x, part_y, v_x + 0.5 * dt * a_x, now)
        a_y += unknown_acceleration(p.unknown, 1, part_x, part_y, v_y + 0.5 * dt * a_y, now)
    n_x, n_y = v_x + dt * a_x, v_y + dt * a_y
    kept = equations.rolling_resistance(n_x, n_y, p.rolling_resistance_deceleration_m_s2[0], dt)
    n_x, n_y = n_x * kept, n_y * kept
    s[0] += 0.5 * dt * (v_x + n_x)
    s[1] += 0.5 * dt * (v_y + n_y)
    s[2], s[3], s[4] = n_x + r * o2, n_y - r * o1, s[4] + dt * turn
    sines[0], sines[1] = s_x, s_y


@compiled
def predict_ball(p, levels, t, theta, exposed, ball, out, std):
    """Fill `out` (m, 2) [m] and `std` (m,): the camera's innovations at the exposures."""
    s, plate, sines = np.zeros(5), np.zeros(2), np.zeros(2)
    extra = p.camera_delay_extra_s[0]
    scale, yaw = p.camera_scale_fraction[0], p.camera_yaw_angle_rad[0]
    k1 = p.lens_distortion_k1_1_m2[0]
    r = levels.ball_measured**2
    p00, p01, p11 = 0.0, 0.0, 0.0
    now, started, k = 0.0, False, 0
    for i in range(exposed.shape[0]):
        end = exposed[i] - extra
        if end < t[0] or not (ball[i, 0] - ball[i, 0] == 0.0 and ball[i, 1] - ball[i, 1] == 0.0):
            continue
        if not started or end - now > LONGEST_GAP_S:
            k = _tick_of(t, end)
            s[0], s[1] = equations.camera_unmap(ball[i, 0], ball[i, 1], scale, yaw, k1)
            s[2] = s[3] = s[4] = 0.0
            for a in range(2):
                angle = _angle(theta, t, k, a, end)
                if not started:
                    plate[a] = angle
                _, plate[a] = _plate(p, a, angle, plate[a])
            p00, p01, p11, now, started = r, 0.0, FIRST_SPEED_M_S**2, end, True
            sines[0], sines[1] = _sines(p, plate)
            continue
        before = now
        while now < end - 1e-9:
            while k + 1 < t.shape[0] and t[k + 1] <= now + 1e-9:
                k += 1
            until = min(t[k + 1], end) if k + 1 < t.shape[0] else end
            angle_x, angle_y = _angle(theta, t, k, 0, until), _angle(theta, t, k, 1, until)
            ball_step(p, s, plate, sines, angle_x, angle_y, 0.5 * (now + until), until - now)
            now = until
        dt = end - before
        q = levels.ball_process**2 * dt
        p00 += 2.0 * dt * p01 + dt * dt * p11 + q * dt * dt / 3.0
        p01 += dt * p11 + 0.5 * q * dt
        p11 += q
        total = p00 + r
        m_x, m_y = equations.camera_map(s[0], s[1], scale, yaw, k1)
        out[i, 0], out[i, 1], std[i] = ball[i, 0] - m_x, ball[i, 1] - m_y, sqrt(total)
        z_x, z_y = equations.camera_unmap(ball[i, 0], ball[i, 1], scale, yaw, k1)
        g0, g1 = p00 / total, p01 / total
        s[2] += g1 * (z_x - s[0])
        s[3] += g1 * (z_y - s[1])
        s[0] += g0 * (z_x - s[0])
        s[1] += g0 * (z_y - s[1])
        p11 -= g1 * p01
        p01 -= g0 * p01
        p00 -= g0 * p00


LONGEST_GAP_S = 0.25  # unseen for longer, the filter starts anew
FIRST_SPEED_M_S = 0.5


@compiled
def _tick_of(t, when):
    """Index of the last tick at or before `when`."""
    return max(np.searchsorted(t, when, side="right") - 1, 0)


@compiled
def _sines(p, plate):
    """Tilt of the plate in its present play positions."""
    return plate_sines(
        felt_angle(p, 0, plate[0]), felt_angle(p, 1, plate[1]), p.ratio,
        p.cross_coupling_fraction[0], p.cross_coupling_fraction[1],
    )  # fmt: skip
