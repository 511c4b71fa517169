"""Geometry of the scene [m]: plate, linkage and backlash gauges; the level plate is at z = 0."""

from math import cos, sin

import numpy as np

from rig.parameters import Rig
from rig.plant.ball import plate_rotation, tilt_sines

DROP_M = 0.075  # from the plate down to the servos' shafts
ZOOM = 40.0  # a play of a degree is half a millimetre at the arm: drawn larger
TOOTH_M = 0.010


def quaternion(rotation: np.ndarray) -> np.ndarray:
    """Unit quaternion (w, x, y, z), (4,), of a rotation matrix (3, 3) by less than half a turn."""
    w = 0.5 * np.sqrt(max(1.0 + float(np.trace(rotation)), 1e-12))
    x, y, z = (
        (rotation[2, 1] - rotation[1, 2]) / (4 * w),
        (rotation[0, 2] - rotation[2, 0]) / (4 * w),
        (rotation[1, 0] - rotation[0, 1]) / (4 * w),
    )
    return np.array([w, x, y, z])


def plate_wxyz(theta_rad: np.ndarray, rig: Rig) -> np.ndarray:
    """The plate's orientation at the servo angles theta_rad (2,), as a quaternion (w, x, y, z)."""
    sines = tilt_sines((float(theta_rad[0]), float(theta_rad[1])), rig.linkage.ratios)
    return quaternion(plate_rotation(sines))


def linkage(axis: int, theta_rad: np.ndarray, rig: Rig) -> np.ndarray:
    """Points (3, 3) [m] of the linkage of axis 0 or 1 at the servo angles theta_rad (2,): the
    servo's shaft, the arm's tip and the plate's end of the rod.

    A positive angle lowers the tip and with it the plate's + side (Eq. 14).
    """
    r, half = rig.linkage.pair("arm_radius_m")[axis], rig.linkage.half_sides_m[axis]
    angle = float(theta_rad[axis])
    along, across = np.eye(3)[axis], np.eye(3)[1 - axis]
    shaft = half * along + r * across - DROP_M * np.eye(3)[2]
    tip = shaft - r * cos(angle) * across - r * sin(angle) * np.eye(3)[2]
    sines = tilt_sines((float(theta_rad[0]), float(theta_rad[1])), rig.linkage.ratios)
    edge = plate_rotation(sines) @ (half * along - 0.003 * np.eye(3)[2])
    return np.array([shaft, tip, edge])


def gauges(play_rad: float, twist_rad: float, rig: Rig) -> tuple[float, float, int]:
    """A backlash as drawn, ZOOM times as large as at the arm's end: half the gap [m], the tooth's
    place in it [m], and the side that it touches (-1 or 1; 0: none).

    play_rad: full width; twist_rad: driving minus driven side.
    """
    scale = ZOOM * rig.linkage.arm_radius_m
    half = 0.5 * max(play_rad, 0.0) * scale
    at = float(np.clip(twist_rad * scale, -half, half))
    touches = int(np.sign(twist_rad)) if abs(twist_rad) >= 0.5 * play_rad - 1e-5 else 0
    return half, at, touches


def plate_point(origin: np.ndarray, direction: np.ndarray) -> np.ndarray | None:
    """Where the ray from `origin` (3,) [m] along `direction` (3,) meets the top of the level plate:
    (x, y), (2,) [m]; None where it does not.
    """
    if abs(direction[2]) < 1e-9 or -origin[2] / direction[2] <= 0:
        return None
    return (origin - origin[2] / direction[2] * direction)[:2]


def backlash_widths(rig: Rig) -> tuple[np.ndarray, np.ndarray]:
    """Full gear and joint play of the rig's effects by axis, (2,) each [rad]."""
    found = []
    for name in ("gear_backlash", "joint_backlash"):
        effect = rig.effects.get(name, {})
        found.append(np.array([effect.get(a, {}).get("play_rad", 0.0) for a in "xy"]))
    return found[0], found[1]
