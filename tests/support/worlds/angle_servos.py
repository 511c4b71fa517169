"""Servos that take an angle, and what they tilt: written from geometry, apart from the product.

A servo answers a command that is held in closed form. Two rods and three arms are solved as the
bars that they are: so many lengths that have to hold, by Newton's method.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from tests.support.worlds.plant import G_m_s2

DIFFERENCE = 1e-6  # of a numerical derivative
PULL_TURNS, TAUT_RAD, SWAY_HZ = 4.0, 0.05, 1.7
SWING_DAMPING_1 = 0.1  # of an elastic plate


class Servos(NamedTuple):
    """Two servos of the axes x and y, or those of three arms: entries of shape (2,) or (3,) but for
    play and swing (2,) of the axes and for numbers that all of them share."""

    lag_s: np.ndarray
    dead_time_s: np.ndarray
    rate_rad_s: np.ndarray
    band_rad: np.ndarray  # half width: so far off its command it does nothing
    scale: np.ndarray  # it goes to (1 + scale) command + zero
    zero_rad: np.ndarray
    motor_s: np.ndarray  # in which a motor takes up the rate that is wanted of it; 0: at once
    pull_rad: np.ndarray  # a spring on a gear draws it off by pull sin(PULL_TURNS angle)
    cable_1: (
        np.ndarray
    )  # a cable that is taut beyond TAUT_RAD draws it back by this share of the way
    sway_rad: np.ndarray  # and it swings about its command at SWAY_HZ
    begin_s: np.ndarray  # when it listens first; then once a period
    play_rad: np.ndarray  # full width, behind the servo
    swing_hz: np.ndarray  # at which an elastic plate swings behind its rods; 0: it is rigid
    quantum_rad: float  # of commands, and of readings
    friction_nm: float  # holds the plate within the play
    period_s: float  # between two pulses; 0: it listens all the time


class Frame(NamedTuple):
    """Two rods of `rod_m` on arms of `arm_m` and levers of `lever_m` (2,), or three arms."""

    three: bool
    arm_m: float
    lever_m: np.ndarray
    rod_m: float
    base_m: float  # radius on which the three arms stand
    plate_m: float  # and that of their joints on the plate
    height_m: float


@njit(cache=True)
def answer(angle, goal, lag_s, rate_rad_s, band_rad, h):
    """Angle after h of a servo that is told to go to `goal` all the while.

    angle' = clip(e/lag, -rate, rate) with e = goal - angle less the band: straight on until
    |e| = rate lag, from there e = rate lag exp(-t/lag).
    """
    off = abs(goal - angle) - band_rad
    if off <= 0.0:
        return angle
    way = 1.0 if goal > angle else -1.0
    straight = max(off - rate_rad_s * lag_s, 0.0)
    if straight >= rate_rad_s * h:
        return angle + way * rate_rad_s * h
    if lag_s <= 0.0:
        return angle + way * off
    left = h - straight / rate_rad_s
    rest = (off - straight) * math.exp(-left / lag_s)
    return angle + way * (off - rest)


@njit(cache=True)
def driven(angle, rate, goal, lag_s, rate_rad_s, band_rad, motor_s, h):
    """Angle and rate after h of a motor that a proportional controller drives to `goal`:
    rate' = (wanted - rate)/motor_s, wanted as the rate of `answer`."""
    off = max(abs(goal - angle) - band_rad, 0.0)
    wanted = min(off / lag_s, rate_rad_s) * (1.0 if goal > angle else -1.0)
    after = wanted + (rate - wanted) * math.exp(-h / motor_s)
    return angle + h * wanted + motor_s * (rate - after), after


@njit(cache=True)
def drawn_off(s, i, angle, now):
    """By how much servo i is drawn off the angle that it is told [rad]."""
    pull = s.pull_rad[i] * math.sin(PULL_TURNS * angle)
    pull -= s.cable_1[i] * max(angle - TAUT_RAD, 0.0)
    return pull + s.sway_rad[i] * math.sin(2.0 * math.pi * SWAY_HZ * now)


@njit(cache=True)
def behind_play(plate, arm, play_rad, load_nm, friction_nm):
    """The plate's angle behind a play of this full width: an arm takes it along at either end, and
    a ball that is heavy enough for the friction lays it on its own side."""
    half = 0.5 * play_rad
    if abs(load_nm) > friction_nm:
        return arm + half if load_nm > 0.0 else arm - half
    return min(max(plate, arm - half), arm + half)


@njit(cache=True)
def rod_gap(phi, theta, arm_m, lever_m, rod_m):
    """How much longer the rod's square would be than it is: its upper end on the plate at
    lever (cos phi, sin phi), its lower one on an arm that lies outwards, a rod's length below."""
    x = lever_m * math.cos(phi) - (lever_m - arm_m + arm_m * math.cos(theta))
    z = lever_m * math.sin(phi) - (arm_m * math.sin(theta) - rod_m)
    return x * x + z * z - rod_m * rod_m


@njit(cache=True)
def rod_tilt(theta, guess, arm_m, lever_m, rod_m):
    """Tilt of a plate on one rod [rad]."""
    phi = guess
    for _ in range(8):
        miss = rod_gap(phi, theta, arm_m, lever_m, rod_m)
        slope = rod_gap(phi + DIFFERENCE, theta, arm_m, lever_m, rod_m) - miss
        step = miss * DIFFERENCE / slope
        phi -= step
        if abs(step) < 1e-12:
            break
    return phi


@njit(cache=True)
def turned(w):
    """Rotation matrix of the rotation vector w (3,), by Rodrigues."""
    size = math.sqrt(w[0] ** 2 + w[1] ** 2 + w[2] ** 2)
    k = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
    if size < 1e-9:
        return np.eye(3) + k
    return np.eye(3) + math.sin(size) / size * k + (1.0 - math.cos(size)) / size**2 * (k @ k)


@njit(cache=True)
def misses(unknown, given, f, out):
    """Write what the constraints of a plate on three arms miss into `out`.

    Six of the joints: each is in its arm's plane (m), each rod as long as it is (m2). unknown (6,):
    the pose (rotation vector and centre), with the arms `given` (3,); or (9,): pose and arms, with
    the angles `given` (2,) by which the plate's x and y axes fall, and the height of its centre.
    """
    pose, arms = unknown[:6], unknown[6:] if len(unknown) == 9 else given
    turn = turned(pose[:3])
    for i in range(3):
        u, v = math.cos(2.0 * math.pi * i / 3.0), math.sin(2.0 * math.pi * i / 3.0)
        p = f.plate_m * (turn[:, 0] * u + turn[:, 1] * v) + pose[3:]
        out[i] = -v * p[0] + u * p[1]
        far = u * p[0] + v * p[1] - f.base_m - f.arm_m * math.cos(arms[i])
        up = p[2] - f.arm_m * math.sin(arms[i])
        out[3 + i] = far * far + up * up - f.rod_m**2
    if len(unknown) == 9:
        out[6] = -turn[2, 0] - math.sin(given[0])
        out[7] = -turn[2, 1] - math.sin(given[1])
        out[8] = pose[5] - f.height_m


@njit(cache=True)
def solve(unknown, given, f):
    """Bring `unknown` to where nothing is missed (see `misses`), by Newton's method."""
    n = len(unknown)
    miss, near, slope = np.empty(n), np.empty(n), np.empty((n, n))
    for _ in range(20):
        misses(unknown, given, f, miss)
        if np.abs(miss).max() < 1e-12:
            return
        for k in range(n):
            unknown[k] += DIFFERENCE
            misses(unknown, given, f, near)
            unknown[k] -= DIFFERENCE
            slope[:, k] = (near - miss) / DIFFERENCE
        unknown -= np.linalg.solve(slope, miss)


@njit(cache=True)
def fallen_axes(pose):
    """Angles by which the plate's x and y axes fall [rad]."""
    turn = turned(pose[:3])
    return math.asin(-turn[2, 0]), math.asin(-turn[2, 1])


def level_arm_rad(f: Frame) -> float:
    """Angle of an arm that holds the plate level, elbow outwards: two circles that meet."""
    out, up = f.plate_m - f.base_m, f.height_m
    far = math.hypot(out, up)
    inside = math.acos((far**2 + f.arm_m**2 - f.rod_m**2) / (2.0 * f.arm_m * far))
    return math.atan2(up, out) - inside


@njit(cache=True)
def load_nm(mass_kg, ratio, place_m):
    """Torque of the ball's weight at the servo [N m]."""
    return mass_kg * G_m_s2 * ratio * place_m
