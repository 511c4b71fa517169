"""The ball's part of the predictor: measured encoder angles to the next exposure.

Rolling on the moving plate, one midpoint step a tick between exposures, with every ball-side and
camera-side effect by the simulator's own equation, and a Kalman filter over position and velocity
per axis.
"""

from math import sqrt

import numpy as np

from rig import effect_equations as equations
from rig.ball import plate_sines, rolling
from rig.compiled import compiled
from rig.plant import felt_angle
from rig.shaft import play_operator
from rig.unknown import unknown_acceleration

LONGEST_GAP_S = 0.25  # unseen for longer, the filter starts anew
FIRST_SPEED_M_S = 0.5


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
