"""Runs of the plant: a table under volts, a single axis, a table whose servos take an angle."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from tests.support.worlds.plant import STEP_s, ball_step, servo_step, tilt_rad


class Loop(NamedTuple):
    """Rates, camera and the controller: a PD (and slow I) for the ball, a P for the angle."""

    rows_hz: float
    counts: float  # of the encoder, a turn
    camera_hz: float
    delay_s: float
    scale: float  # measured = (1 + scale) R(yaw) true + noise
    yaw_rad: float
    kp_rad_m: float
    kd_rad_s_m: float
    ki_rad_m_s: float
    speed_filter_s: float  # of the ball's speed from frame to frame
    angle_limit_rad: float
    inner_V_rad: float
    limit_V: float
    lag_s: float  # of servos that take an angle; 0: they follow exactly


@njit(cache=True)
def followed(rate, ahead, swing_hz, damping, h):
    """Rate after h of a plate, rigid or elastic, that has `ahead` to go to where its rods are."""
    if swing_hz == 0.0:
        return ahead / h
    w = 2.0 * math.pi * swing_hz
    return rate + h * (w * w * ahead - 2.0 * damping * w * rate)


@njit(cache=True)
def look(ball, noise, loop):
    """What the camera sees of the ball, in m."""
    c, s = math.cos(loop.yaw_rad), math.sin(loop.yaw_rad)
    x, y = ball[0] * (1.0 + loop.scale), ball[1] * (1.0 + loop.scale)
    return c * x - s * y + noise[0], s * x + c * y + noise[1]


@njit(cache=True)
def wanted_angle(memory, target, seen, age, loop):
    """Servo angle for one axis; memory = (newest, its speed, integral), `seen` nan: no frame."""
    if not math.isnan(seen):
        if not math.isnan(memory[0]):
            share = age / (age + loop.speed_filter_s)
            memory[1] += share * ((seen - memory[0]) / age - memory[1])
        memory[0] = seen
    if math.isnan(memory[0]):
        return 0.0
    error = target - memory[0]
    memory[2] = min(max(memory[2] + loop.ki_rad_m_s * error / loop.rows_hz, -0.15), 0.15)
    wanted = loop.kp_rad_m * error - loop.kd_rad_s_m * memory[1] + memory[2]
    return min(max(wanted, -loop.angle_limit_rad), loop.angle_limit_rad)


@njit(cache=True)
def new_frame(frames, told, t):
    """Index of the newest frame that has become usable by t, or `told` where there is none."""
    newest = told
    while newest + 1 < len(frames) and frames[newest + 1, 0] <= t:
        newest += 1
    return newest


@njit(cache=True)
def run_table(p, b, loop, start, targets, torque_V, push, slipped, camera_noise):
    """Closed loop under volts; columns V_x, V_y, theta_x, theta_y, ball_x, ball_y a row.

    `torque_V`, `push` (m/s2) and `slipped` (rad on the encoder) have a row a tick, like `targets`.
    Row t: angle read at t, volts applied from t on, ball nan where no frame became usable.
    """
    rows = len(targets)
    log = np.full((rows, 6), np.nan)
    shafts, memory = np.zeros((2, 6)), np.full((2, 3), 0.0)
    memory[:, 0] = np.nan
    ball = np.zeros(6)
    ball[:2] = start
    heavy = np.array([0.6, 0.0, -0.8])
    frames = np.full((int(rows / loop.rows_hz * loop.camera_hz) + 3, 3), np.inf)
    taken, told = 0, -1
    phi, rate, old = np.zeros(2), np.zeros(2), np.zeros(2)
    inner = round(1.0 / (loop.rows_hz * STEP_s))
    for row in range(rows):
        t = row / loop.rows_hz
        newest = new_frame(frames, told, t)
        for i in range(2):
            theta = round((shafts[i, 2] + slipped[row, i]) * loop.counts / 6.283185307179586)
            theta *= 6.283185307179586 / loop.counts
            seen = frames[newest, 1 + i] if newest > told else np.nan
            wanted = wanted_angle(memory[i], targets[row, i], seen, 1.0 / loop.camera_hz, loop)
            V = loop.inner_V_rad * (wanted - theta)
            log[row, i] = min(max(V, -loop.limit_V), loop.limit_V)
            log[row, 2 + i], log[row, 4 + i] = theta, seen
        told = newest
        for k in range(inner):
            if t + k * STEP_s >= taken / loop.camera_hz:
                frames[taken, 0] = t + k * STEP_s + loop.delay_s
                frames[taken, 1], frames[taken, 2] = look(ball, camera_noise[row], loop)
                taken += 1
            for i in range(2):
                servo_step(shafts[i], log[row, i] + torque_V[row, i], ball[i], p, i, STEP_s)
                new = tilt_rad(shafts[i, 4], b)
                old[i] = rate[i]
                rate[i] = followed(rate[i], new - phi[i], b.swing_hz, b.swing_damping, STEP_s)
                phi[i] += STEP_s * rate[i]
            ball_step(ball, heavy, phi, rate, old, push[row], b, STEP_s)
    return log


@njit(cache=True)
def run_axis(p, rows_hz, counts, inner_V_rad, limit_V, targets, open_V, torque_V):
    """Axis 0 alone: V = clip(P (target - theta) + open_V); columns V, theta in counts, omega."""
    log = np.empty((len(targets), 3))
    shaft = np.zeros(6)
    inner = round(1.0 / (rows_hz * STEP_s))
    for row in range(len(targets)):
        theta = round(shaft[2] * counts / 6.283185307179586) * 6.283185307179586 / counts
        V = inner_V_rad * (targets[row] - theta) + open_V[row]
        V = min(max(V, -limit_V), limit_V)
        log[row, 0], log[row, 1], log[row, 2] = V, theta, shaft[1]
        for _ in range(inner):
            servo_step(shaft, V + torque_V[row], 0.0, p, 0, STEP_s)
    return log


@njit(cache=True)
def run_positions(b, loop, targets, push, camera_noise):
    """A table whose plate goes in a straight line from one row's angle to the next.

    With `lag_s` the angle is a command, held for a row, and lag theta_p' = theta - theta_p.
    Columns theta_x, theta_y, ball_x, ball_y a row; every row has a ball, `loop.delay_s` old.
    """
    rows = len(targets)
    inner = round(1.0 / (loop.rows_hz * STEP_s))
    h = 1.0 / (loop.rows_hz * inner)
    late = round(loop.delay_s / h)
    path, log = np.zeros((rows * inner + 1, 2)), np.zeros((rows, 4))
    memory = np.zeros((2, 3))
    ball, heavy = np.zeros(6), np.array([0.0, 0.0, -1.0])
    theta, goal, angle = np.zeros(2), np.zeros(2), np.zeros(2)
    phi, rate, old = np.zeros(2), np.zeros(2), np.zeros(2)
    for row in range(rows):
        seen = look(path[max(row * inner - late, 0)], camera_noise[row], loop)
        for i in range(2):
            theta[i] = goal[i]
            log[row, i], log[row, 2 + i] = theta[i], seen[i]
            goal[i] = wanted_angle(memory[i], targets[row, i], seen[i], 1.0 / loop.rows_hz, loop)
            if loop.lag_s > 0.0:
                log[row, i] = goal[i]
        for k in range(inner):
            for i in range(2):
                if loop.lag_s > 0.0:
                    angle[i] += (1.0 - math.exp(-h / loop.lag_s)) * (goal[i] - angle[i])
                else:
                    angle[i] = theta[i] + (goal[i] - theta[i]) * (k + 1) / inner
                new = tilt_rad(angle[i], b)
                old[i] = rate[i]
                rate[i] = (new - phi[i]) / h
                phi[i] = new
            ball_step(ball, heavy, phi, rate, old, push[row], b, h)
            path[row * inner + k + 1] = ball[:2]
    return log
