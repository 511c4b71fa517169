"""Checks the printed size of the sheet against the plate's markers.

A lens cannot tell a small sheet from a far one. Where sheet and plate are seen in one picture, a
sheet that lies on the plate is measured against the markers, and one that would have to lie below
the plate cannot be of the size it is said to be.
"""

from collections.abc import Sequence

import numpy as np

from calibration.camera.sheet import CalibrationError, Sheet, SheetView, sheet_view
from vision.plate.markers import MarkerLayout, find_pose
from vision.view import Camera, View

MAX_ERROR = 0.01  # a board 5 mm thick under a camera 0.75 m up looks 0.7 % larger
_FLAT_RAD, _NEAR, _SUNK = np.radians(0.6), 0.1, 0.02
_LOOKED_AT = 40
_LYING_M = 0.0007


def scale_on_plate(images: Sequence[np.ndarray], view: View, sheet: Sheet) -> float | None:
    """Measured over stated size (median) of the sheet that lies on the plate in frames (h, w[, 3])
    uint8 of one `view`; None where no frame shows one. `CalibrationError`: the size is off by over
    1 %."""
    scales = []
    for image in images:
        seen = sheet_view(image, sheet)
        if seen is not None:
            scale, left_m = _similar(view.plate_from_pixel(seen.corners_px), seen.points_m)
            if left_m < _LYING_M:
                scales.append(scale)
    if not scales:
        return None
    _refuse(float(np.median(scales)), sheet)
    return float(np.median(scales))


def _similar(there: np.ndarray, points_m: np.ndarray) -> tuple[float, float]:
    """Scale of the similarity that lays `points_m` (n, 3), y down, onto `there` (n, 2), y up, and
    the rms distance that is left [m]: only a sheet that lies on the plate fits."""
    seen = (there - there.mean(axis=0)) @ (1, 1j)
    told = points_m[:, :2] @ (1, -1j)
    told = told - told.mean()
    factor = np.vdot(told, seen) / np.vdot(told, told)
    return float(abs(factor)), float(np.sqrt(np.mean(np.abs(seen - factor * told) ** 2)))


def check_against_plate(
    images: Sequence[np.ndarray],
    views: Sequence[SheetView],
    camera: Camera,
    layout: MarkerLayout,
    sheet: Sheet,
) -> bool:
    """Whether the sheet's size could be checked: whether in some calibration picture the plate's
    markers are seen and the sheet lies on the plate.

    A sheet that is parallel to the plate within 0.6 degrees lies on it; nobody holds one so by
    hand. `views`: the fitted ones, whose `index` points into `images`. `CalibrationError`: the size
    is off by over 1 %, or a sheet would have to lie below the plate.
    """
    checked = False
    for view in views[:: max(1, len(views) // _LOOKED_AT)]:
        fit = find_pose(images[view.index], layout, camera)
        if fit is None or not fit.accepted:
            continue
        flat, scale, sunk = _against(view, fit.view, camera)
        if flat and abs(scale - 1) < _NEAR:
            _refuse(scale, sheet)
            checked = True
        elif sunk > _SUNK:
            raise CalibrationError(
                f"wrong square size: in picture {view.index} the sheet would lie {sunk:.1%} of "
                "the distance below the plate: the squares are smaller than "
                f"{1e3 * sheet.square_m:g} mm; measure the print (--square-mm)"
            )
    return checked


def _against(seen: SheetView, plate: View, camera: Camera) -> tuple[bool, float, float]:
    """Of a sheet over a plate: does it look flat on it, how large would it be lying there, and how
    far does its middle lie below the plate, as a share of the distance."""
    import cv2

    _, turn, shift = cv2.solvePnP(seen.points_m, seen.corners_px, camera.matrix, camera.distortion)
    rotation = np.asarray(cv2.Rodrigues(np.asarray(turn))[0])
    pose = plate.camera_from_plate
    normal, middle = pose[:3, 2], pose[:3, 3]
    corners = seen.points_m @ rotation.T + np.asarray(shift).reshape(3) - middle
    heights = corners @ normal
    far = abs(float(middle @ normal))
    flat = np.arccos(min(abs(float(rotation[:, 2] @ normal)), 1.0)) < _FLAT_RAD
    # A sheet on the plate that is told s times too small comes out 1/s too near.
    scale = far / max(far - float(heights.mean()), 1e-6)
    return bool(flat), scale, float(-heights.mean() / far)


def _refuse(scale: float, sheet: Sheet) -> None:
    if abs(scale - 1) > MAX_ERROR:
        raise CalibrationError(
            f"wrong square size: the sheet on the plate measures {scale:.3f} times what was said, "
            f"{1e3 * scale * sheet.square_m:.2f} mm a square instead of "
            f"{1e3 * sheet.square_m:g} mm (limit {MAX_ERROR:.0%}): measure both prints"
        )
