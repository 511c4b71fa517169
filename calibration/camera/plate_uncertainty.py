"""What an error of the lens costs where it matters: millimetres on the plate.

A wrong lens is partly hidden by the pose it makes believe, so each camera first finds the plate
from the pixels of its markers, as it would in use, and then the ball's height is looked at.
"""

import cv2
import numpy as np

from vision.markers import default_layout
from vision.view import Camera, View

_BALL_HEIGHT_M = 0.02
_GRID = np.linspace(-0.13, 0.13, 9)
_POINTS = np.stack(np.meshgrid(_GRID, _GRID), axis=-1).reshape(-1, 2)
_CORNERS = default_layout(0.275).corners_m.reshape(-1, 2)


def shift_mm(believed: Camera, real: Camera, distance_m: float) -> np.ndarray:
    """Where `believed` puts 81 points over the plate (81, 2), minus where they are, in mm.

    The pixels come from `real`, level above the plate at `distance_m`.
    """
    pose = np.eye(4)
    pose[:3, :3] = np.diag([1.0, -1.0, -1.0])
    pose[2, 3] = distance_m
    truth = View(real, pose)
    ball = np.column_stack((_POINTS, np.full(len(_POINTS), _BALL_HEIGHT_M)))
    corners = np.column_stack((_CORNERS, np.zeros(len(_CORNERS))))
    seen = truth.pixel_from_plate(corners)
    _, turn, shift = cv2.solvePnP(corners, seen, believed.matrix, believed.distortion)
    pose = np.eye(4)
    pose[:3, :3] = np.asarray(cv2.Rodrigues(np.asarray(turn))[0])
    pose[:3, 3] = np.asarray(shift).reshape(3)
    places = View(believed, pose).plate_from_pixel(truth.pixel_from_plate(ball), _BALL_HEIGHT_M)
    return 1e3 * (places - _POINTS)


def disagreement_mm(a: Camera, b: Camera, distance_m: float) -> float:
    """95th percentile over the plate of the distance between what two cameras believe."""
    return float(np.percentile(np.linalg.norm(shift_mm(a, b, distance_m), axis=1), 95))


def std_mm(camera: Camera, covariance: np.ndarray, distance_m: float) -> np.ndarray:
    """Standard deviation (81,) in mm over the plate that `covariance` (9, 9) leads to.

    Parameters in OpenCV's order: fx, fy, cx, cy, k1, k2, p1, p2, k3.
    """
    values, vectors = np.linalg.eigh(covariance)
    variance = np.zeros(len(_POINTS))
    for value, vector in zip(values, vectors.T, strict=True):
        if value > 0:
            step = np.sqrt(value) * vector
            variance += np.sum(shift_mm(_moved(camera, step), camera, distance_m) ** 2, axis=1)
    return np.sqrt(variance)


def _moved(camera: Camera, step: np.ndarray) -> Camera:
    matrix = camera.matrix.copy()
    matrix[[0, 1, 0, 1], [0, 1, 2, 2]] += step[:4]
    return Camera(matrix, camera.distortion + step[4:], camera.width_px, camera.height_px)


def lens_covariance(
    views: list[tuple[np.ndarray, np.ndarray, np.ndarray]],
    camera: Camera,
    free: np.ndarray,
    sigma_px: float,
) -> np.ndarray:
    """Covariance (9, 9) of the lens from views (points (n, 3), rotation vector, translation).

    The views' poses are eliminated (Schur complement); parameters not `free` (9,) stay exact.
    """
    information = np.zeros((9, 9))
    for points, turn, shift in views:
        _, jacobian = cv2.projectPoints(points, turn, shift, camera.matrix, camera.distortion)
        jacobian = np.asarray(jacobian).reshape(-1, 15)  # rotation, translation, f, c, k
        pose, lens = jacobian[:, :6], jacobian[:, 6:]
        cross = pose.T @ lens
        information += lens.T @ lens - cross.T @ np.linalg.solve(pose.T @ pose, cross)
    covariance = np.zeros((9, 9))
    at = np.ix_(free, free)
    covariance[at] = sigma_px**2 * np.linalg.inv(information[at])
    return covariance
