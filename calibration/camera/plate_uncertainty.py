"""Errors of the lens in millimetres on the plate.

A wrong lens is partly compensated by the pose that is found with it. So each camera first finds the
plate from the pixels of its markers, as it would in use; compared are points at the ball's height.
"""

import cv2
import numpy as np

from vision.plate.markers import default_layout
from vision.view import Camera, View

_BALL_HEIGHT_M = 0.02
_GRID = np.linspace(-0.13, 0.13, 9)
_POINTS = np.stack(np.meshgrid(_GRID, _GRID), axis=-1).reshape(-1, 2)
_CORNERS = default_layout(0.275).corners_m.reshape(-1, 2)


def shift_mm(believed: Camera, real: Camera, distance_m: float) -> np.ndarray:
    """Error (81, 2) [mm] of the ball's place over a grid on the plate when pixels of camera `real`
    are read with camera `believed`: believed minus true place.

    The real camera looks straight down on the plate from `distance_m` [m]; `believed` first finds
    the plate's pose from the markers' pixels (`cv2.solvePnP`).
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
    """95th percentile over the plate of the distance [mm] between the places that cameras `a` and
    `b` give (`shift_mm`)."""
    return float(np.percentile(np.linalg.norm(shift_mm(a, b, distance_m), axis=1), 95))


def std_mm(camera: Camera, covariance: np.ndarray, distance_m: float) -> np.ndarray:
    """Standard deviation (81,) [mm] of the ball's place over the plate due to the lens's
    `covariance` (9, 9), propagated to first order along the covariance's eigenvectors.

    Parameters in OpenCV's order: fx, fy, cx, cy, k1, k2, p1, p2, k3. `distance_m`: of the camera
    from the plate.
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
    """Covariance (9, 9) of the lens's parameters from views (points (n, 3) [m], rotation vector,
    translation [m]) with pixel noise `sigma_px`.

    The inverse of the Gauss-Newton information; the views' poses are eliminated by the Schur
    complement. Parameters that are not `free` (9,) have zero variance. `LinAlgError`: the views do
    not determine the free parameters.
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
