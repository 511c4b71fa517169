"""Runs of a table whose servos are told angles: a program's loop, the servos, plate and ball."""

import math

import numpy as np
from numba import njit

from tests.support.worlds.angle_servos import (
    SWING_DAMPING_1,
    answer,
    behind_play,
    drawn_off,
    driven,
    fallen_axes,
    load_nm,
    rod_tilt,
    solve,
)
from tests.support.worlds.loops import followed, look, wanted_angle
from tests.support.worlds.plant import STEP_s, ball_step

EACH = 4  # steps of the ball for one of the arms: 1 ms


@njit(cache=True)
def heard(told, when_s, row, rows_hz, period_s, begin_s):
    """The command (2,) that was valid at `when_s`, or at the last pulse before it; one comes at
    `begin_s`."""
    if period_s > 0.0:
        when_s = begin_s + math.floor((when_s - begin_s) / period_s + 1e-9) * period_s
    at = int(math.floor(when_s * rows_hz + 1e-9))
    return told[min(max(at, 0), row)]


@njit(cache=True)
def nearest(angle, quantum):
    return round(angle / quantum) * quantum if quantum > 0.0 else angle


@njit(cache=True)
def aim(i, told, s, f, unknown, level):
    """Where servo i is told to go, after its own steps, scale and zero; told (2,): by axis."""
    angle = told[min(i, 1)]
    if f.three:
        solve(unknown, told, f)
        angle = unknown[6 + i] - level
    return (1.0 + s.scale[i]) * nearest(angle, s.quantum_rad) + s.zero_rad[i]


@njit(cache=True)
def read_back(arms, s, f, level, pose, theta):
    """Write the angles that the servos read (2,) into `theta`: of three arms the tilt that they
    hold, each to its own steps."""
    counted = np.array([nearest(angle, s.quantum_rad) for angle in arms])
    if f.three:
        solve(pose, counted + level, f)
        theta[0], theta[1] = fallen_axes(pose)
    else:
        theta[0], theta[1] = counted[0], counted[1]


@njit(cache=True)
def run_commanded(b, mass_kg, s, f, level, loop, targets, push, noise):
    """Columns command_x, command_y, theta_x, theta_y, ball_x, ball_y a row.

    theta: of `read_back`; the ball is `loop.delay_s` old; `level`: angle of an arm under a level
    plate.
    """
    rows = len(targets)
    inner = round(1.0 / (loop.rows_hz * STEP_s))
    h = 1.0 / (loop.rows_hz * inner)
    late, servos = round(loop.delay_s / h), 3 if f.three else 2
    path, log, told = np.zeros((rows * inner + 1, 2)), np.zeros((rows, 6)), np.zeros((rows, 2))
    memory, ball, heavy = np.zeros((2, 3)), np.zeros(6), np.array([0.0, 0.0, -1.0])
    arms, goals, theta, plate = np.zeros(3), np.zeros(3), np.zeros(2), np.zeros(2)
    phi, rate, old, way, read = np.zeros(2), np.zeros(2), np.zeros(2), np.zeros(2), np.zeros(2)
    unknown, pose, rates = np.zeros(9), np.zeros(6), np.zeros(3)
    unknown[5] = pose[5] = f.height_m
    unknown[6:] = level
    last = np.full((3, 2), np.nan)
    slope = 1.0 if f.three else f.arm_m / f.lever_m.mean()
    for row in range(rows):
        seen = look(path[max(row * inner - late, 0)], noise[row], loop)
        read_back(arms, s, f, level, pose, read)
        for i in range(2):
            told[row, i] = wanted_angle(
                memory[i], targets[row, i], seen[i], 1.0 / loop.rows_hz, loop
            )
            log[row, i], log[row, 2 + i], log[row, 4 + i] = told[row, i], read[i], seen[i]
        for k in range(inner):
            now = (row * inner + k) * h
            if k % EACH == 0:
                span = h * min(EACH, inner - k)
                for i in range(servos):
                    when_s, clock = now - s.dead_time_s[i], (s.period_s, s.begin_s[i])
                    command = heard(told, when_s, row, loop.rows_hz, *clock)
                    if command[0] != last[i, 0] or command[1] != last[i, 1]:
                        goals[i] = aim(i, command, s, f, unknown, level)
                        last[i] = command
                    goal = goals[i] + drawn_off(s, i, arms[i], now)
                    lag, most, band = s.lag_s[i], s.rate_rad_s[i], s.band_rad[i]
                    if s.motor_s[i] > 0.0:
                        arms[i], rates[i] = driven(
                            arms[i], rates[i], goal, lag, most, band, s.motor_s[i], span
                        )
                    else:
                        arms[i] = answer(arms[i], goal, lag, most, band, span)
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
                    way[i] = followed(way[i], tilt - phi[i], s.swing_hz[i], SWING_DAMPING_1, span)
            for i in range(2):
                old[i] = rate[i]
                rate[i] = way[i]
                phi[i] += h * way[i]
            ball_step(ball, heavy, phi, rate, old, push[row], b, h)
            path[row * inner + k + 1] = ball[:2]
    return log
