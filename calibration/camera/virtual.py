"""How to hold a calibration sheet before a camera: poses that show all that must be seen."""

import cv2
import numpy as np

from calibration.sheet import Sheet

# Where the sheet's centre is aimed, in half images from the middle: corners, sides, middle.
_AIMS = ((-1, -1), (0, -1), (1, -1), (-1, 1), (0, 1), (1, 1), (0, 0), (0.5, 0))


def sheet_poses(
    sheet: Sheet,
    field: tuple[float, float],
    distance_m: float,
    count: int,
    rng: np.random.Generator,
) -> list[np.ndarray]:
    """Poses (4, 4) camera_from_sheet, every other one tilted by 28 to 42 degrees, all round.

    `field` is (width, height) of the view at distance 1; the sheet is held between 0.67 and one
    `distance_m` away. Its origin is the top left corner of the print, x right, y down.
    """
    poses = []
    for k in range(count):
        tilt = np.radians(rng.uniform(28, 42) if k % 2 else rng.uniform(3, 22))
        towards = 2 * np.pi * 0.381966 * k  # the golden angle: no direction twice
        lean = tilt * np.array([np.cos(towards), np.sin(towards), 0.0])
        spin = np.array([0.0, 0.0, rng.uniform(-0.5, 0.5)])
        turn = np.asarray(cv2.Rodrigues(spin)[0]) @ np.asarray(cv2.Rodrigues(lean)[0])
        away = distance_m * rng.uniform(0.67, 1.0)
        aim = np.array(_AIMS[k % len(_AIMS)]) * np.array(field) / 2 * rng.uniform(0.55, 1.0)
        centre = away * np.array([*aim, 1.0])
        pose = np.eye(4)
        pose[:3, :3] = turn
        pose[:3, 3] = centre - turn[:, :2] @ (0.5 * np.array(sheet.size_m))
        poses.append(pose)
    return poses
