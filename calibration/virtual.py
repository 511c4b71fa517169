"""Pictures that somebody would take of a calibration sheet with the virtual camera."""

from collections.abc import Iterator

import numpy as np

from calibration.sheet import Sheet
from calibration.sheet_poses import sheet_poses
from vision.synthetic import Renderer


def sheet_pictures(
    renderer: Renderer, sheet: Sheet, count: int, rng: np.random.Generator
) -> Iterator[np.ndarray]:
    """`count` frames (h, w, 3) uint8 of the sheet, held all over the image and tilted all round.

    The renderer's view serves only to hold the sheet where a person would, before the lens.
    """
    camera = renderer.view.camera
    distance_m = float(renderer.view.camera_from_plate[2, 3])
    field = camera.width_px / camera.pinhole[0], camera.height_px / camera.pinhole[1]
    px_per_square, margin_px = 140, 140
    paper = np.pad(sheet.image(px_per_square), margin_px, constant_values=255)
    margin_m = sheet.square_m * margin_px / px_per_square
    size_m = (sheet.size_m[0] + 2 * margin_m, sheet.size_m[1] + 2 * margin_m)
    for pose in sheet_poses(sheet, field, distance_m, count, rng):
        corner = pose.copy()
        corner[:3, 3] -= pose[:3, :2] @ (margin_m, margin_m)
        yield renderer.render_sheet(paper, size_m, corner)
