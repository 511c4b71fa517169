"""One servo axis and a ball on a moving plate: written from the equations, apart from the product.

Fixed steps of `STEP_s`. The servo's first order lag is exact under a constant voltage, dry friction
is implicit (it stops the shaft and never drives it), the ball is a leapfrog with an impulse at the
contact point that makes it roll, or slip where friction is too small.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

STEP_s = 0.00025
G_m_s2 = 9.81
CENTRED = 0.3  # share of a servo's angle that a soft centre passes on
TOOTH_RAD = 0.03  # half width of a tooth that rubs
BRIDGE_V = 0.1  # volts of the current within which a bridge's loss changes its sign


class Servo(NamedTuple):
    """Two axes, every entry of shape (2,). Voltages act at the motor's terminals."""

    gain_rad_s_V: np.ndarray
    tau_s: np.ndarray
    offset_V: np.ndarray
    dead_V: np.ndarray  # half width of the dead zone
    asymmetry: np.ndarray  # V (1 + a sgn V)
    friction_V: np.ndarray
    softness_rad_s: np.ndarray  # 0: a friction that sticks; else tanh(omega / softness)
    extra_V: np.ndarray  # Stribeck: friction + extra exp(-(omega / speed)^2)
    extra_speed_rad_s: np.ndarray
    tooth_V: np.ndarray  # more dry friction within TOOTH_RAD of one angle
    tooth_rad: np.ndarray
    one_way_V: np.ndarray  # more dry friction in positive direction alone
    drag_V_s: np.ndarray  # V - drag |omega|: viscous friction that differs by direction
    pendulum_V: np.ndarray  # V - pendulum sin(theta)
    spring_V_rad: np.ndarray  # V - spring max(theta - from, 0)
    spring_from_rad: np.ndarray
    bridge_V: np.ndarray  # lost against the sign of the motor's current, V - omega / K
    gear_rad: np.ndarray  # full width between motor and encoder
    coast_1_s: np.ndarray  # the arm's own damping inside the gear's gap
    coast_rad_s2: np.ndarray  # and its dry deceleration
    joint_rad: np.ndarray  # full width between encoder and plate
    joint_V: np.ndarray  # friction of the plate, felt while a flank of the joint pushes it
    fall_1_m_s2: np.ndarray  # turns the plate inside the joint by the ball's place; 0: it stays
    bounce: np.ndarray  # restitution of such a plate at the joint's flanks


class Ball(NamedTuple):
    """A ball on the plate. `spin` is m r^2 / J: 1.5 hollow, 2.5 solid."""

    spin: float
    radius_m: float
    arm_m: float
    side_m: float
    level_rad: np.ndarray  # (2,) constant slope
    bowl_1_s2: float
    rolling_m_s2: float
    felt_m_s2: float  # more of it on the half where x > 0
    drag_1_s: float
    off_centre_m: float  # of the centre of mass
    waves: np.ndarray  # (n, 4) slope in rad, wave numbers k_x and k_y in rad/m, phase
    mu: float  # friction at the contact point
    walls: bool
    restitution: float
    swing_hz: float  # at which an elastic plate swings behind its servos; 0: it is rigid
    swing_damping: float
    centred_rad: float  # within +- of it the plate turns by CENTRED of the servo; 0: rigid


@njit(cache=True)
def speed_after(omega, theta, V, lead, p, i, h):
    """omega at t + h of tau omega' = K (V_eff - F(omega)) - omega for axis i.

    lead = arm - plate: the plate's friction is felt where a flank of the joint pushes it.
    """
    u = V * (1.0 + p.asymmetry[i] * np.sign(V))
    u = np.sign(u) * max(abs(u) - p.dead_V[i], 0.0) + p.offset_V[i]
    u -= p.pendulum_V[i] * math.sin(theta) + p.drag_V_s[i] * abs(omega)
    u -= p.spring_V_rad[i] * max(theta - p.spring_from_rad[i], 0.0)
    level = p.friction_V[i] + p.extra_V[i] * math.exp(-((omega / p.extra_speed_rad_s[i]) ** 2))
    level += p.tooth_V[i] * math.exp(-(((theta - p.tooth_rad[i]) / TOOTH_RAD) ** 2))
    level += p.one_way_V[i] if omega > 0.0 or (omega == 0.0 and u > 0.0) else 0.0
    u -= p.bridge_V[i] * math.tanh((V - omega / p.gain_rad_s_V[i]) / BRIDGE_V)
    decay = math.exp(-h / p.tau_s[i])
    reach = (1.0 - decay) * p.gain_rad_s_V[i]
    if p.softness_rad_s[i] > 0.0:
        return decay * omega + reach * (u - level * math.tanh(omega / p.softness_rad_s[i]))
    free = decay * omega + reach * u
    if lead * np.sign(free) >= 0.5 * p.joint_rad[i] * (1.0 - 1e-9):
        level += p.joint_V[i]
    return np.sign(free) * max(abs(free) - reach * level, 0.0)


@njit(cache=True)
def servo_step(shaft, V, place, p, i, h):
    """Move `shaft` = (motor angle and speed, arm angle and speed, plate's servo angle and speed) by
    h, the ball at `place` m."""
    motor, omega, arm, arm_speed, plate, fall = shaft
    half = 0.5 * p.joint_rad[i]
    new = speed_after(omega, arm, V, arm - plate, p, i, h)
    motor += 0.5 * h * (omega + new)
    if p.gear_rad[i] > 0.0:
        arm_speed *= math.exp(-h * p.coast_1_s[i])
        arm_speed = np.sign(arm_speed) * max(abs(arm_speed) - h * p.coast_rad_s2[i], 0.0)
        arm += h * arm_speed
        gap = 0.5 * p.gear_rad[i]
        if abs(arm - motor) > gap:  # the flank takes the arm along
            arm = motor + gap * np.sign(arm - motor)
            arm_speed = new
    else:
        arm, arm_speed = motor, new
    if p.fall_1_m_s2[i] > 0.0:
        fall += h * p.fall_1_m_s2[i] * place
        plate += h * fall
        for side in (1.0, -1.0):
            if side * (plate - arm) > half and side * (fall - arm_speed) > 0.0:
                fall = arm_speed - p.bounce[i] * (fall - arm_speed)
    plate = min(max(plate, arm - half), arm + half)
    shaft[0], shaft[1], shaft[2] = motor, new, arm
    shaft[3], shaft[4], shaft[5] = arm_speed, plate, fall


@njit(cache=True)
def tilt_rad(theta, b):
    """phi with sin(phi) = 2 R_d sin(theta) / L, theta less what a soft centre swallows."""
    theta -= (1.0 - CENTRED) * min(max(theta, -b.centred_rad), b.centred_rad)
    return math.asin(2.0 * b.arm_m / b.side_m * math.sin(theta))


@njit(cache=True)
def whole_acceleration(x, y, vx, vy, heavy, b, out):
    """Accelerations that act on ball and spin alike: bowl, drag, resistance, heavy side, waves."""
    factor = b.spin / (1.0 + b.spin)
    pull = factor * G_m_s2 * b.off_centre_m / b.radius_m
    out[0] = -b.bowl_1_s2 * x - b.drag_1_s * vx + pull * heavy[0]
    out[1] = -b.bowl_1_s2 * y - b.drag_1_s * vy + pull * heavy[1]
    for slope, kx, ky, phase in b.waves:
        k = math.hypot(kx, ky)
        rise = slope * math.cos(kx * x + ky * y + phase)
        out[0] -= factor * G_m_s2 * rise * kx / k
        out[1] -= factor * G_m_s2 * rise * ky / k


@njit(cache=True)
def roll_heavy_side(heavy, vx, vy, b, h):
    """heavy' = w x heavy with w = (-v_y, v_x, 0) / r; `heavy` keeps its length of 1."""
    wx, wy = -vy / b.radius_m, vx / b.radius_m
    nx, ny, nz = heavy
    heavy[0] += h * wy * nz
    heavy[1] -= h * wx * nz
    heavy[2] += h * (wx * ny - wy * nx)
    heavy /= math.sqrt(heavy[0] ** 2 + heavy[1] ** 2 + heavy[2] ** 2)


@njit(cache=True)
def ball_step(ball, heavy, phi, rate, old_rate, push, b, h):
    """Move `ball` = (x, y, v_x, v_y, r w_x, r w_y) by h in the plate's frame.

    free: v' = g sin(phi + level) + phi' (x phi_x' + y phi_y') - r phi''
    contact: slip = v + r phi' - r w; the impulse that ends it is bounded by mu g h.
    """
    x, y = ball[0], ball[1]
    extra = np.empty(2)
    whole_acceleration(x, y, ball[2], ball[3], heavy, b, extra)
    turning = x * rate[0] + y * rate[1]
    slip = np.empty(2)
    for i in range(2):
        pull = G_m_s2 * math.sin(phi[i] + b.level_rad[i]) + rate[i] * turning
        ball[2 + i] += h * (pull + extra[i] + push[i]) - b.radius_m * (rate[i] - old_rate[i])
        ball[4 + i] += h * (extra[i] + push[i])
        slip[i] = ball[2 + i] + b.radius_m * rate[i] - ball[4 + i]
    size = math.hypot(slip[0], slip[1])
    need = size / (1.0 + b.spin)
    share = min(1.0, b.mu * G_m_s2 * h / need) if need > 0.0 else 0.0
    for i in range(2):
        impulse = -share * slip[i] / (1.0 + b.spin)
        ball[2 + i] += impulse
        ball[4 + i] -= b.spin * impulse
    speed = math.hypot(ball[2], ball[3])
    rolling_m_s2 = b.rolling_m_s2 + (b.felt_m_s2 if x > 0.0 else 0.0)
    if rolling_m_s2 > 0.0 and speed > 0.0:
        lost = min(1.0, rolling_m_s2 * h / speed)
        for i in range(2):
            ball[4 + i] -= lost * ball[2 + i]
            ball[2 + i] -= lost * ball[2 + i]
    for i in range(2):
        ball[i] += h * ball[2 + i]
        rim = 0.5 * b.side_m - b.radius_m
        if b.walls and abs(ball[i]) > rim:
            ball[i] = np.sign(ball[i]) * rim
            if ball[i] * ball[2 + i] > 0.0:
                ball[4 + i] -= (1.0 + b.restitution) * ball[2 + i]
                ball[2 + i] *= -b.restitution
    roll_heavy_side(heavy, ball[2], ball[3], b, h)
