"""Runs of a table whose servos are told angles: a program's loop, the servos, plate and ball."""

import math

import numpy as np
from numba import njit

from tests.support.worlds.angle_servos import (
    answer,
    behind_play,
    driven,
    fallen_axes,
    load_nm,
    rod_tilt,
    solve,
)
from tests.support.worlds.loops import look, wanted_angle
from tests.support.worlds.plant import STEP_s, ball_step

EACH = 4  # steps of the ball for one of the arms: 1 ms


@njit(cache=True)
def heard(told, when_s, row, rows_hz, period_s):
    """The command (2,) that was valid at `when_s`, or at the last pulse before it."""
    if period_s > 0.0:
        when_s = math.floor(when_s / period_s + 1e-9) * period_s
    at = int(math.floor(when_s * rows_hz + 1e-9))
    return told[min(max(at, 0), row)]


@njit(cache=True)
def nearest(angle, quantum):
    return round(angle / quantum) * quantum if quantum > 0.0 else angle


@njit(cache=True)
def aims(told_x, told_y, s, f, unknown, level, goals):
    """Where the servos (2, or 3 arms) are told to go, after scale, zero and their own steps."""
    for i in range(2):
        q = 0.0 if f.three else s.quantum_rad[i]
        angle = nearest(told_x if i == 0 else told_y, q)
        goals[i] = (1.0 + s.scale[i]) * angle + s.zero_rad[i]
    if f.three:
        solve(unknown, goals[:2].copy(), f)
        for i in range(3):
            goals[i] = nearest(unknown[6 + i] - level, s.quantum_rad[0])


@njit(cache=True)
def run_commanded(b, mass_kg, s, f, level, loop, targets, push, noise):
    """Columns command_x, command_y, theta_x, theta_y, ball_x, ball_y a row.

    theta: the servo's angle (of three arms the tilt that they hold) at the row; the ball is
    `loop.delay_s` old; `level`: angle of an arm under a level plate.
    """
    rows = len(targets)
    inner = round(1.0 / (loop.rows_hz * STEP_s))
    h = 1.0 / (loop.rows_hz * inner)
    late, servos = round(loop.delay_s / h), 3 if f.three else 2
    path, log, told = np.zeros((rows * inner + 1, 2)), np.zeros((rows, 6)), np.zeros((rows, 2))
    memory, ball, heavy = np.zeros((2, 3)), np.zeros(6), np.array([0.0, 0.0, -1.0])
    arms, goals, theta, plate = np.zeros(3), np.zeros(3), np.zeros(2), np.zeros(2)
    phi, rate, old, aim, way = np.zeros(2), np.zeros(2), np.zeros(2), np.zeros(2), np.zeros(2)
    unknown, pose, rates = np.zeros(9), np.zeros(6), np.zeros(3)
    unknown[5] = pose[5] = f.height_m
    unknown[6:] = level
    last = np.full(2, np.nan)
    slope = 1.0 if f.three else f.arm_m / f.lever_m.mean()
    for row in range(rows):
        seen = look(path[max(row * inner - late, 0)], noise[row], loop)
        for i in range(2):
            told[row, i] = wanted_angle(
                memory[i], targets[row, i], seen[i], 1.0 / loop.rows_hz, loop
            )
            log[row, i], log[row, 2 + i], log[row, 4 + i] = told[row, i], theta[i], seen[i]
        for k in range(inner):
            now = (row * inner + k) * h
            if k % EACH == 0:
                span = h * min(EACH, inner - k)
                for i in range(2):
                    aim[i] = heard(told, now - s.dead_time_s[i], row, loop.rows_hz, s.period_s)[i]
                if aim[0] != last[0] or aim[1] != last[1]:
                    aims(aim[0], aim[1], s, f, unknown, level, goals)
                    last[:] = aim
                for i in range(servos):
                    j = min(i, 1)
                    lag, most, band, motor = (
                        s.lag_s[j],
                        s.rate_rad_s[j],
                        s.band_rad[j],
                        s.motor_s[j],
                    )
                    if motor > 0.0:
                        arms[i], rates[i] = driven(
                            arms[i], rates[i], goals[i], lag, most, band, motor, span
                        )
                    else:
                        arms[i] = answer(arms[i], goals[i], lag, most, band, span)
                if f.three:
                    solve(pose, arms + level, f)
                    theta[0], theta[1] = fallen_axes(pose)
                else:
                    theta[0], theta[1] = arms[0], arms[1]
                for i in range(2):
                    load = load_nm(mass_kg, slope, ball[i])
                    plate[i] = behind_play(plate[i], theta[i], s.play_rad[i], load, s.friction_nm)
                    tilt = plate[i]
                    if not f.three:
                        tilt = rod_tilt(plate[i], phi[i], f.arm_m, f.lever_m[i], f.rod_m)
                    way[i] = (tilt - phi[i]) / span
            for i in range(2):
                old[i] = rate[i]
                rate[i] = way[i]
                phi[i] += h * way[i]
            ball_step(ball, heavy, phi, rate, old, push[row], b, h)
            path[row * inner + k + 1] = ball[:2]
    return log
