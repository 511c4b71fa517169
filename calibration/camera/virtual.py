"""Pictures of a calibration sheet by the virtual camera, held as a person would hold it."""

from collections.abc import Iterator

import cv2
import numpy as np

from calibration.camera.sheet import Sheet
from vision.synthetic.synthetic import Renderer

# Where the sheet's centre is aimed, in half images from the middle: corners, sides, middle.
_AIMS = ((-1, -1), (0, -1), (1, -1), (-1, 1), (0, 1), (1, 1), (0, 0), (0.5, 0))
LEAST_WIDTH = 0.59  # of the image; chosen: in smaller pictures blur makes the markers too small


def sheet_poses(
    sheet: Sheet,
    field: tuple[float, float],
    distance_m: float,
    count: int,
    rng: np.random.Generator,
) -> list[np.ndarray]:
    """`count` random poses (4, 4) camera_from_sheet [m] of a sheet held before a camera; every
    other one is tilted by 28 to 42 degrees, the others by 3 to 22, in all directions.

    `field`: (width, height) of the view at distance 1; the sheet is held between 0.67 and 1 times
    `distance_m` away. The sheet's origin is the top left corner of the print, x right, y down.
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


def sheet_pictures(
    renderer: Renderer, sheet: Sheet, count: int, rng: np.random.Generator
) -> Iterator[np.ndarray]:
    """Yield `count` rendered frames (h, w, 3) uint8 of the sheet, placed all over the image and
    tilted in all directions.

    The renderer's view only serves to place the sheet where a person would hold it, between plate
    and lens, and no farther than that it fills LEAST_WIDTH of the image.
    """
    camera = renderer.view.camera
    field = camera.width_px / camera.pinhole[0], camera.height_px / camera.pinhole[1]
    plate_m = float(renderer.view.camera_from_plate[2, 3])
    distance_m = min(plate_m, sheet.size_m[0] / (LEAST_WIDTH * field[0]))
    px_per_square, margin_px = 140, 140
    paper = np.pad(sheet.image(px_per_square), margin_px, constant_values=255)
    margin_m = sheet.square_m * margin_px / px_per_square
    size_m = (sheet.size_m[0] + 2 * margin_m, sheet.size_m[1] + 2 * margin_m)
    for pose in sheet_poses(sheet, field, distance_m, count, rng):
        corner = pose.copy()
        corner[:3, 3] -= pose[:3, :2] @ (margin_m, margin_m)
        yield renderer.render_sheet(paper, size_m, corner)
