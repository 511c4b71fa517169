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


class Servos(NamedTuple):
    """Servos of the axes x and y, entries of shape (2,) but for the period."""

    lag_s: np.ndarray
    dead_time_s: np.ndarray
    rate_rad_s: np.ndarray
    band_rad: np.ndarray  # half width: so far off its command it does nothing
    quantum_rad: np.ndarray
    scale: np.ndarray  # it goes to (1 + scale) command + zero
    zero_rad: np.ndarray
    play_rad: np.ndarray  # full width, behind the servo
    motor_s: np.ndarray  # in which a motor takes up the rate that is wanted of it; 0: at once
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
def lengths(pose, arms, f, misses):
    """What the six constraints of a plate on three arms miss: each joint in its arm's plane (m),
    each rod as long as it is (m2). pose (6,): rotation vector and centre."""
    turn = turned(pose[:3])
    for i in range(3):
        u, v = math.cos(2.0 * math.pi * i / 3.0), math.sin(2.0 * math.pi * i / 3.0)
        p = f.plate_m * (turn[:, 0] * u + turn[:, 1] * v) + pose[3:]
        misses[i] = -v * p[0] + u * p[1]
        out = u * p[0] + v * p[1] - f.base_m - f.arm_m * math.cos(arms[i])
        up = p[2] - f.arm_m * math.sin(arms[i])
        misses[3 + i] = out * out + up * up - f.rod_m**2


@njit(cache=True)
def tilt_misses(unknown, tilt, f, misses):
    """The six constraints, and the two that the plate's x and y axes fall by these angles.

    unknown (9,): pose and arms; misses (9,); the centre's height is the ninth.
    """
    lengths(unknown[:6], unknown[6:], f, misses)
    turn = turned(unknown[:3])
    misses[6] = -turn[2, 0] - math.sin(tilt[0])
    misses[7] = -turn[2, 1] - math.sin(tilt[1])
    misses[8] = unknown[5] - f.height_m


@njit(cache=True)
def hold(tilt, unknown, f):
    """Bring `unknown` (9,) to the pose and the arms that hold the plate at `tilt` (2,)."""
    miss, near, slope = np.empty(9), np.empty(9), np.empty((9, 9))
    for _ in range(20):
        tilt_misses(unknown, tilt, f, miss)
        if np.abs(miss).max() < 1e-13:
            return
        for k in range(9):
            unknown[k] += DIFFERENCE
            tilt_misses(unknown, tilt, f, near)
            unknown[k] -= DIFFERENCE
            slope[:, k] = (near - miss) / DIFFERENCE
        unknown -= np.linalg.solve(slope, miss)


@njit(cache=True)
def pose_of(arms, pose, f):
    """Bring `pose` (6,) to where these arms hold the plate."""
    miss, near, slope = np.empty(6), np.empty(6), np.empty((6, 6))
    for _ in range(20):
        lengths(pose, arms, f, miss)
        if np.abs(miss).max() < 1e-12:
            return
        for k in range(6):
            pose[k] += DIFFERENCE
            lengths(pose, arms, f, near)
            pose[k] -= DIFFERENCE
            slope[:, k] = (near - miss) / DIFFERENCE
        pose -= np.linalg.solve(slope, miss)


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
