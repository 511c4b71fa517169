"""A plate on three arms (3-RRS): tilt to arm angles in closed form, arm angles to tilt by Newton.

Arm i stands at the azimuth psi_i = 120 degrees i from +x, at the radius r_b, and turns by alpha in
the vertical plane through the centre; a rod of length l leads from its end, at the length a, to a
ball joint of the plate at the radius r_p. In that plane, with X the joint's distance from the arm's
axis and Z its height,

    X cos(alpha) + Z sin(alpha) = (X^2 + Z^2 + a^2 - l^2)/(2 a),

solved with the elbow outwards. The three planes hold the ball joints, so the plate turns without
torsion, by the shortest turn of `rig.plant.ball.plate_rotation`, and its centre shifts by
(r_p (R_xx - R_yy)/2, -r_p R_xy) (I. Bonev, Geometric analysis of parallel mechanisms, 2002,
chapter 4). Angles of arms are measured from the horizontal, s_x, s_y are the sines of the tilt.
"""

from collections.abc import Sequence
from math import acos, atan2, cos, nan, pi, sin, sqrt

import numpy as np

from rig.compiled import compiled, inlined

ARMS = 3
AZIMUTHS = (0.0, 2.0 * pi / 3.0, 4.0 * pi / 3.0)
COSINES, SINES = tuple(map(cos, AZIMUTHS)), tuple(map(sin, AZIMUTHS))
# Chosen: a rod within 10 degrees of its arm, or of the horizontal, moves six times as far as what
# it should hold, and play and errors with it; so does a plate whose three rods nearly meet.
LEAST_TRANSMISSION = sin(pi / 18)
NEWTON_STEPS, NEWTON_END_M2 = 30, 1e-15


@inlined
def joint(i, s_x, s_y, height, plate_radius):
    """Distance from the centre line and height of the plate's ball joint i [m].

    s_x, s_y: sines of the tilt; height: of the plate's centre [m].
    """
    c = sqrt(1.0 - s_x * s_x - s_y * s_y)
    xx, yy = 1.0 - s_x * s_x / (1.0 + c), 1.0 - s_y * s_y / (1.0 + c)
    xy = -s_x * s_y / (1.0 + c)
    u, v = COSINES[i], SINES[i]
    out = u * (0.5 * (xx - yy) + xx * u + xy * v) + v * (-xy + xy * u + yy * v)
    return plate_radius * out, height - plate_radius * (s_x * u + s_y * v)


@inlined
def joint_slopes(i, s_x, s_y, plate_radius):
    """Derivatives of what `joint` tells by (s_x, s_y, height): of the distance, and of the height
    (3,) each."""
    c = sqrt(1.0 - s_x * s_x - s_y * s_y)
    m = 1.0 / (1.0 + c)
    m_x, m_y = m * m * s_x / c, m * m * s_y / c
    u, v = COSINES[i], SINES[i]
    by_xx, by_yy, by_xy = u * u + 0.5 * u, v * v - 0.5 * u, 2.0 * u * v - v
    x = by_xx * (2.0 * s_x * m + s_x * s_x * m_x) + by_yy * s_y * s_y * m_x
    x += by_xy * (s_y * m + s_x * s_y * m_x)
    y = by_xx * s_x * s_x * m_y + by_yy * (2.0 * s_y * m + s_y * s_y * m_y)
    y += by_xy * (s_x * m + s_x * s_y * m_y)
    return (-plate_radius * x, -plate_radius * y, 0.0), (-plate_radius * u, -plate_radius * v, 1.0)


@inlined
def centre(s_x, s_y, plate_radius):
    """Shift of the plate's centre in x and y [m] with its tilt."""
    c = sqrt(1.0 - s_x * s_x - s_y * s_y)
    shift_x = 0.5 * plate_radius * (s_y * s_y - s_x * s_x) / (1.0 + c)
    return shift_x, plate_radius * s_x * s_y / (1.0 + c)


@compiled
def arm_angle(i, s_x, s_y, height, size):
    """Angle of arm i [rad] that holds the plate at this tilt; NaN where it is out of reach.

    size: (base radius, plate radius, arm length, rod length) [m].
    """
    base, plate, arm, rod = size
    if s_x * s_x + s_y * s_y >= 1.0:
        return nan
    out, z = joint(i, s_x, s_y, height, plate)
    x = out - base
    far = sqrt(x * x + z * z)
    bent = (far * far + arm * arm - rod * rod) / (2.0 * arm * far)
    return atan2(z, x) - acos(bent) if abs(bent) <= 1.0 else nan


@compiled
def solve_3(m, b, x):
    """Solve m x = b for x (3,) by Cramer's rule; returns the determinant of m (3, 3)."""
    c0 = m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1]
    c1 = m[1, 2] * m[2, 0] - m[1, 0] * m[2, 2]
    c2 = m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0]
    det = m[0, 0] * c0 + m[0, 1] * c1 + m[0, 2] * c2
    d0 = m[0, 2] * m[2, 1] - m[0, 1] * m[2, 2]
    d1 = m[0, 0] * m[2, 2] - m[0, 2] * m[2, 0]
    d2 = m[0, 1] * m[2, 0] - m[0, 0] * m[2, 1]
    e0 = m[0, 1] * m[1, 2] - m[0, 2] * m[1, 1]
    e1 = m[0, 2] * m[1, 0] - m[0, 0] * m[1, 2]
    e2 = m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]
    x[0] = (c0 * b[0] + d0 * b[1] + e0 * b[2]) / det
    x[1] = (c1 * b[0] + d1 * b[1] + e1 * b[2]) / det
    x[2] = (c2 * b[0] + d2 * b[1] + e2 * b[2]) / det
    return det


@compiled
def solve_pose(angles, size, pose):
    """Bring `pose` (3,) = sines s_x, s_y and height [m] to where the arms hold the plate.

    angles (3,) [rad]; size: of `arm_angle`; pose: the pose next to which the solution is looked
    for, changed in place. Newton's method. False, and the pose left alone, where there is none.
    """
    base, plate, arm, rod = size
    s_x, s_y, height = pose
    ends, slope = np.empty((ARMS, 2)), np.empty((ARMS, 3))
    miss, step = np.empty(ARMS), np.empty(3)
    for i in range(ARMS):
        ends[i, 0], ends[i, 1] = base + arm * cos(angles[i]), arm * sin(angles[i])
    for _ in range(NEWTON_STEPS):
        worst = 0.0
        for i in range(ARMS):
            x, z = joint(i, s_x, s_y, height, plate)
            x, z = x - ends[i, 0], z - ends[i, 1]
            miss[i] = x * x + z * z - rod * rod
            worst = max(worst, abs(miss[i]))
            outwards, upwards = joint_slopes(i, s_x, s_y, plate)
            for k in range(3):
                slope[i, k] = 2.0 * (x * outwards[k] + z * upwards[k])
        if worst < NEWTON_END_M2:
            pose[0], pose[1], pose[2] = s_x, s_y, height
            return True
        if solve_3(slope, miss, step) == 0.0:
            return False
        s_x, s_y, height = s_x - step[0], s_y - step[1], height - step[2]
        if not s_x * s_x + s_y * s_y < 1.0:
            return False
    return False


@compiled
def transmission(s_x, s_y, height, size):
    """Least of what says that a pose is not singular [1]; NaN where it is out of reach.

    Of every leg the sine between arm and rod, and the determinant by which tilt and height follow
    the rods, divided by that of a level plate on upright rods (3 sqrt(3)/2, per r_p^2).
    """
    base, plate, arm, rod = size
    least, slope = 1.0, np.empty((ARMS, 3))
    for i in range(ARMS):
        alpha = arm_angle(i, s_x, s_y, height, size)
        if np.isnan(alpha):
            return nan
        out, z = joint(i, s_x, s_y, height, plate)
        n_x = (out - base - arm * cos(alpha)) / rod
        n_z = (z - arm * sin(alpha)) / rod
        least = min(least, n_z * cos(alpha) - n_x * sin(alpha))
        outwards, upwards = joint_slopes(i, s_x, s_y, plate)
        for k in range(3):
            slope[i, k] = n_x * outwards[k] + n_z * upwards[k]
    det = solve_3(slope, np.zeros(3), np.empty(3))
    return min(least, abs(det) / (1.5 * sqrt(3.0) * plate * plate))


def turned(s_x: float, s_y: float, height: float, size: tuple[float, ...]) -> tuple[float, ...]:
    """What the arms turn from level [rad] to hold the plate at a tilt of these sines; NaN where
    it is out of reach.
    """
    return tuple(
        arm_angle(i, s_x, s_y, height, size) - arm_angle(i, 0.0, 0.0, height, size)
        for i in range(ARMS)
    )


def sines(angles: Sequence[float], height: float, size: tuple[float, ...]) -> tuple[float, float]:
    """Sines (s_x, s_y) of the tilt at which arms hold the plate that are turned by `angles` (3,)
    from level [rad], wherever its centre then is; NaN where they hold none. The inverse of
    `turned`.
    """
    pose = np.array((0.0, 0.0, height))
    level = arm_angle(0, 0.0, 0.0, height, size)
    found = solve_pose(np.array(angles, float) + level, size, pose)
    return (float(pose[0]), float(pose[1])) if found else (nan, nan)


def most_turned(tilt_rad: float, height: float, size: tuple[float, ...]) -> tuple[float, ...]:
    """How far each arm turns at most [rad] while both tilts stay within tilt_rad.

    An arm's angle is monotonic in the height of its joint, which is extreme on the tilts' edge; a
    mrad is left for what lies between the poses looked at.
    """
    steps, end = 16, sin(tilt_rad)
    side = [sin(tilt_rad * (2 * k / steps - 1)) for k in range(steps + 1)]
    edge = [pose for s in side for pose in ((s, end), (s, -end), (end, s), (-end, s))]
    poses = [turned(s_x, s_y, height, size) for s_x, s_y in edge]
    return tuple(max(abs(pose[i]) for pose in poses) + 1e-3 for i in range(ARMS))


def reach_rad(height: float, size: tuple[float, ...], travel_rad: float, most_rad: float) -> float:
    """Largest angle [rad], at most `most_rad`, up to which both tilts can be asked for at once.

    Up to it every pose is within reach, not singular (`LEAST_TRANSMISSION`), and no arm turns by
    more than `travel_rad` from where it holds the plate level. -1: not even the level pose.
    """
    good, steps = -1.0, 20
    for k in range(steps + 1):
        tilt = most_rad * k / steps
        for j in range(-4, 5):
            for sign in (1, -1):
                for a, b in ((sign * tilt, tilt * j / 4), (tilt * j / 4, sign * tilt)):
                    s_x, s_y = sin(a), sin(b)
                    if not transmission(s_x, s_y, height, size) >= LEAST_TRANSMISSION:
                        return good
                    if max(map(abs, turned(s_x, s_y, height, size))) > travel_rad:
                        return good
        good = tilt
    return good
