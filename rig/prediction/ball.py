"""The ball's part of the predictor: measured encoder angles to the next exposure.

The joint's play follows the angles tick by tick; the ball rolls on the moving plate in midpoint
steps of several ticks, with every ball-side and camera-side effect by the simulator's own equation,
and a Kalman filter over position and velocity per axis.
"""

from math import exp, sqrt

import numpy as np

from rig.compiled import compiled, inlined
from rig.discrepancy import discrepancy_acceleration
from rig.plant import effect_equations as equations
from rig.plant.ball import rolling
from rig.plant.own_equations import BALL, with_own
from rig.plant.plant import felt_angle
from rig.plant.position_plant import felt_sines
from rig.plant.shaft import loaded_play

FILTER_S = 1.0  # of observations before a look ahead
LONGEST_GAP_S = 0.25  # unseen for longer, the filter starts anew
FIRST_SPEED_M_S = 0.5
# A step of the ball: at most so many ticks and so long. Chosen: on logs of 500 Hz residuals change
# by less than 0.01 of their deviations, in a third of the time that steps of a tick take.
TICKS_A_STEP, LONGEST_STEP_S = 5, 0.01
# A plate that is not held in its play takes the arm's mean rate over twice RATE_S and bounces.
# Both are chosen: a count over 30 ms is 0.05 rad/s, less than plates fall; with these, costs are
# lowest at the plays of simulated tables (the shaft's damping alone gives a restitution of 0.5).
RATE_S, RESTITUTION = 0.015, 0.3
HALF_BRAKED_RAD_S2 = 20.0  # deceleration at a `joint_fall` of 0.5: of light bearings; chosen


@inlined
def _played(p, a, theta, plate, place):
    """The angle behind the joint's play on axis `a` [rad], from that before it and `plate`, what it
    was.

    place: of the ball [m], whose weight lies over a plate that a servo holds at an angle; the light
    ball on a plate that motors turn is left out.
    """
    load = p.weight[a] * place if p.position else 0.0
    return loaded_play(plate, theta, p.joint_1[a], p.joint_2[a], load, p.joint_friction)


@compiled
def _sines(p, plate_x, plate_y):
    """Sines of the plate's tilt [1] in these play positions [rad]."""
    return felt_sines(p, felt_angle(p, 0, plate_x), felt_angle(p, 1, plate_y))


@inlined
def _angle(theta, t, k, a, when):
    """Encoder angle between ticks, straight, and before the first as it was in that [rad]."""
    low = theta[k, a]
    if k + 1 >= theta.shape[0] or when <= t[k]:
        return low
    return low + (theta[k + 1, a] - low) * (when - t[k]) / (t[k + 1] - t[k])


@inlined
def _fallen(p, a, theta, rate, plate, place, h):
    """The angle behind the joint's play on axis `a` [rad] and its rate [rad/s] after h [s].

    theta, rate: of the arm's end [rad, rad/s]; plate (4,): angles and rates of both axes before;
    place: of the ball [m]. In the play the ball's weight turns the plate, dry friction brakes it,
    and it bounces off the play's ends, which move with the arm. On a servo that takes an angle it
    is the joint's friction, and the plate lands without a bounce: with one, costs are as low but
    ragged in the play. Behind motors it brakes the less the nearer `joint_fall` is to 1.
    """
    if p.position:
        brake, kept = p.joint_friction / p.plate_inertia, 0.0
    else:
        brake, kept = HALF_BRAKED_RAD_S2 * (1.0 / p.joint_fall[a] - 1.0), RESTITUTION
    speed = plate[2 + a] + h * p.weight[a] * place / p.plate_inertia
    speed = equations.stick(speed, h * brake)
    angle = plate[a] + h * speed
    low, high = theta - p.joint_1[a], theta - p.joint_2[a]
    if angle < low:
        return low, max(rate + kept * (rate - speed), speed)
    if angle > high:
        return high, min(rate + kept * (rate - speed), speed)
    return angle, speed


@inlined
def _rate(p, t, theta, k, a):
    """Rate of the arm's end about tick k on axis `a` [rad/s]: of an encoder over RATE_S to either
    side, of angles that a model gives from tick to tick."""
    last = theta.shape[0] - 1
    counted_s = RATE_S if p.has_angle or not p.position else 0.0
    ticks = max(int(counted_s / (t[min(k + 1, last)] - t[min(k, last - 1)])), 1)
    low, high = max(k - ticks, 0), min(k + ticks, last)
    return (theta[high, a] - theta[low, a]) / (t[high] - t[low])


@inlined
def _follow(p, place, plate, t, theta, k, now, end):
    """Have the plate's play positions follow the encoder's ticks, from `now` over one step of the
    ball that ends at `end` [s] or before; the last tick's index, the step's end [s], and the means
    of both positions over it [rad].

    p: record PLANT; place (2,): of the ball [m]; plate (2,): the positions, changed in place; k:
    index of the last tick at or before `now`.
    """
    begin, last = now, min(end, now + LONGEST_STEP_S)
    mean_x, mean_y = 0.0, 0.0
    for i in range(TICKS_A_STEP):
        while k + 1 < t.shape[0] and t[k + 1] <= now + 1e-9:
            k += 1
        tick = t[k + 1] if k + 1 < t.shape[0] else end
        until = min(tick, end if i == 0 else last)
        x, y = plate[0], plate[1]
        for a in range(2):
            angle = _angle(theta, t, k, a, until)
            if p.joint_fall[a] > 0.0 or (p.position and p.joint_1[a] > p.joint_2[a]):
                rate = _rate(p, t, theta, k, a)
                plate[a], plate[2 + a] = _fallen(p, a, angle, rate, plate, place[a], until - now)
            else:
                plate[a] = _played(p, a, angle, plate[a], place[a])
        mean_x += 0.5 * (until - now) * (x + plate[0])
        mean_y += 0.5 * (until - now) * (y + plate[1])
        now = until
        if now >= last - 1e-9:
            break
    return k, now, mean_x / (now - begin), mean_y / (now - begin)


@compiled
def ball_step(p, s, plate, mean_x, mean_y, sines, now, dt):
    """Move the ball's state s (5,) = x, y, w_x, w_y, spin on by dt on a plate that moves.

    p: record PLANT; plate (2,): the plate's play positions after the step, mean_x, mean_y: their
    means over it [rad]; sines (2,): of the plate's tilt before [1]; now: the run's time at the
    step's middle [s]. s and sines are changed in place. One midpoint step of `plant.ball`'s
    equations of motion.
    """
    s_x, s_y = _sines(p, plate[0], plate[1])
    mid_x, mid_y = _sines(p, mean_x, mean_y)
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
        part_x, part_y = x / p.half_side[0], y / p.half_side[1]
        a_x += discrepancy_acceleration(p.unknown, 0, part_x, part_y, v_x + 0.5 * dt * a_x, now)
        a_y += discrepancy_acceleration(p.unknown, 1, part_x, part_y, v_y + 0.5 * dt * a_y, now)
    if p.own.ball:
        a_x = with_own(p.own, BALL, 0, a_x, x, v_x + 0.5 * dt * a_x, now)
        a_y = with_own(p.own, BALL, 1, a_y, y, v_y + 0.5 * dt * a_y, now)
    n_x, n_y = v_x + dt * a_x, v_y + dt * a_y
    kept = equations.rolling_resistance(n_x, n_y, p.rolling_resistance_deceleration_m_s2[0], dt)
    n_x, n_y = n_x * kept, n_y * kept
    s[0] += 0.5 * dt * (v_x + n_x)
    s[1] += 0.5 * dt * (v_y + n_y)
    s[2], s[3], s[4] = n_x + r * o2, n_y - r * o1, s[4] + dt * turn
    sines[0], sines[1] = s_x, s_y


@compiled
def _tick_of(t, when):
    """Index of the last tick at or before `when`."""
    return max(np.searchsorted(t, when, side="right") - 1, 0)


@compiled
def _cover(c, dt, q, r, memory_s):
    """Covariance c (6,) = xx, xv, vv, xn, vn, nn of position, velocity and camera noise dt later.

    White acceleration of density q; the noise is an AR(1) of variance r that forgets in memory_s.
    """
    keep = exp(-dt / memory_s) if memory_s > 0.0 else 0.0
    c[0] += 2.0 * dt * c[1] + dt * dt * c[2] + q * dt * dt / 3.0
    c[1] += dt * c[2] + 0.5 * q * dt
    c[2] += q
    c[3] = keep * (c[3] + dt * c[4])
    c[4] *= keep
    c[5] = keep * keep * c[5] + (1.0 - keep * keep) * r
    return keep


@compiled
def _gains(c, g):
    """Gains g (3,) of a measurement x + n, the covariance after it in `c`; returns its variance."""
    h0, h1, h2 = c[0] + c[3], c[1] + c[4], c[3] + c[5]
    total = h0 + h2
    g[0], g[1], g[2] = h0 / total, h1 / total, h2 / total
    c[0] -= g[0] * h0
    c[1] -= g[0] * h1
    c[2] -= g[1] * h1
    c[3] -= g[0] * h2
    c[4] -= g[1] * h2
    c[5] -= g[2] * h2
    return total


@compiled
def predict_ball(p, levels, t, theta, exposed, ball, fresh, longest_gap_s, out, std):
    """Fill `out` (m, 2) [m] with the camera's innovations and `std` (m,) [m] with their deviations.

    p: record PLANT; levels: record NOISE; t (n,) [s] and theta (n, 2) [rad]: ticks and encoder
    angles; exposed (m,) [s] and ball (m, 2) [m]: observations, NaN where unseen. The filter starts
    anew where `fresh` (m,) is true (after a push, in another run) and where the ball was unseen for
    longer than `longest_gap_s`; rows without a prediction keep what they held. Before the first
    tick the plate is at rest: were what was exposed before left out, the filter would begin with
    another observation for another delay of the camera, and all of its first second change. A ball
    whose centre lies `camera_height` higher than the log's maker took it to be is seen too far down
    the tilt, by that height times its sine.
    """
    s, plate, sines = np.zeros(5), np.zeros(4), np.zeros(2)
    noise, c, g = np.zeros(2), np.zeros(6), np.zeros(3)
    extra = p.camera_delay_extra_s[0] + p.frame_wait_s
    scale, yaw = p.camera_scale_fraction[0], p.camera_yaw_angle_rad[0]
    k1, high = p.lens_distortion_k1_1_m2[0], p.camera_height
    r = levels.ball_measured**2
    now, started, k = 0.0, False, 0
    for i in range(exposed.shape[0]):
        end = exposed[i] - extra
        if not (ball[i, 0] - ball[i, 0] == 0.0 and ball[i, 1] - ball[i, 1] == 0.0):
            continue
        z_x, z_y = equations.camera_unmap(ball[i, 0], ball[i, 1], scale, yaw, k1)
        if not started or fresh[i] or end - now > longest_gap_s:
            k = _tick_of(t, end)
            s[2] = s[3] = s[4] = noise[0] = noise[1] = 0.0
            for a in range(2):
                angle = _angle(theta, t, k, a, end)
                if not started:
                    plate[a] = angle
                plate[a] = _played(p, a, angle, plate[a], z_x if a == 0 else z_y)
            # A first position is the truth plus the noise: the two err by the same, opposed.
            c[0], c[1], c[2], c[3], c[4], c[5] = r, 0.0, FIRST_SPEED_M_S**2, -r, 0.0, r
            now, started = end, True
            sines[0], sines[1] = _sines(p, plate[0], plate[1])
            s[0], s[1] = z_x - high * sines[0], z_y - high * sines[1]
            continue
        before = now
        while now < end - 1e-9:
            k, until, x, y = _follow(p, s, plate, t, theta, k, now, end)
            ball_step(p, s, plate, x, y, sines, 0.5 * (now + until), until - now)
            now = until
        dt = end - before
        keep = _cover(c, dt, levels.ball_process**2 * dt, r, levels.ball_memory_s)
        total = _gains(c, g)
        noise[0], noise[1] = keep * noise[0], keep * noise[1]
        seen_x = s[0] + high * sines[0] + noise[0]
        seen_y = s[1] + high * sines[1] + noise[1]
        miss_x, miss_y = z_x - seen_x, z_y - seen_y
        m_x, m_y = equations.camera_map(seen_x, seen_y, scale, yaw, k1)
        out[i, 0], out[i, 1], std[i] = ball[i, 0] - m_x, ball[i, 1] - m_y, sqrt(total)
        s[0], s[1] = s[0] + g[0] * miss_x, s[1] + g[0] * miss_y
        s[2], s[3] = s[2] + g[1] * miss_x, s[3] + g[1] * miss_y
        noise[0], noise[1] = noise[0] + g[2] * miss_x, noise[1] + g[2] * miss_y


@compiled
def look_ahead(p, levels, t, theta, exposed, ball, fresh, horizon_s, every_s, errors, spread):
    """Fill `errors` (m, 2) [m], measured minus predicted `horizon_s` ahead once every `every_s`,
    and `spread` (m,) [m], their standard deviations as the filter expects them.

    p, levels, t, theta, exposed, ball, fresh: as of `predict_ball`. From a filtered state on only
    the encoder angles are used. Rows in which no window ends keep what they held; a window that
    crosses a fresh start is left out.
    """
    m = exposed.shape[0]
    out, std = np.full((m, 2), np.nan), np.full(m, np.nan)
    seen = ball.copy()
    last = 0
    for i in range(m):
        if fresh[i]:
            last = i
        if exposed[i] - exposed[last] < every_s or i - last < 10:
            continue
        last = i
        # Blind the filter for the horizon: what it says at its end is the prediction.
        j = i
        while j + 1 < m and exposed[j + 1] - exposed[i] <= horizon_s and not fresh[j + 1]:
            j += 1
        if j == i or exposed[j] - exposed[i] < 0.9 * horizon_s:
            continue
        begin = i
        while begin > 0 and exposed[i] - exposed[begin] < FILTER_S and not fresh[begin]:
            begin -= 1
        for n in range(i + 1, j):
            seen[n] = np.nan
        predict_ball(
            p,
            levels,
            t,
            theta,
            exposed[begin : j + 1],
            seen[begin : j + 1],
            fresh[begin : j + 1],
            2.0 * horizon_s,
            out[begin : j + 1],
            std[begin : j + 1],
        )
        errors[j], spread[j] = out[j], std[j]
        seen[i + 1 : j] = ball[i + 1 : j]
