"""What a fitted lens gives reason to doubt: refused beyond one limit, said beyond another."""

from collections.abc import Sequence

import numpy as np

from calibration.lens_fit import Fit
from calibration.misfit import misfit
from calibration.sheet import CalibrationError, SheetView
from vision.view import Camera

MAX_RMS_PX, MAX_FOCAL_STD = 0.5, 0.005
# A picture is an outlier at 2.5 medians, but not for fitting worse than corners can be found.
MAX_VIEW_RATIO, GOOD_VIEW_PX = 2.5, 0.1
MAX_FALSE_SHARE = 0.01
CLEAR_Z = 6.0
CURL_WARN_MM, CURL_LIMIT_MM = 0.3, 0.8
LENS_WARN_PX, LENS_LIMIT_PX = 0.05, 0.2
MAX_STRETCH, MAX_OFF_CENTRE = 0.02, 0.1


def false_corners(share: float, worst: int) -> list[str]:
    text = f"false corners: {share:.1%} of the corners lie off, most in picture {worst}"
    if share > MAX_FALSE_SHARE:
        raise CalibrationError(
            f"{text} (limit {MAX_FALSE_SHARE:.0%}): reflections, something that hides the sheet?"
        )
    return [f"{text}: left out"] if share > 0 else []


def odd_pixels(camera: Camera) -> list[str]:
    """Signs that the pictures were scaled or cut after the sensor."""
    fx, fy, cx, cy = camera.pinhole
    if abs(fx / fy - 1) > MAX_STRETCH:
        raise CalibrationError(
            f"wrong resolution: the pixels come out {fx / fy:.3f} times higher than wide (limit "
            f"{MAX_STRETCH:.0%}): were the pictures stretched? take the camera's own resolution"
        )
    off = max(
        abs(cx / (camera.width_px - 1) - 0.5),
        abs(cy / (camera.height_px - 1) - 0.5),
    )
    if off <= MAX_OFF_CENTRE:
        return []
    return [f"the lens's middle lies {off:.0%} of the picture off its centre: were they cut?"]


def shapes(fit: Fit, views: Sequence[SheetView]) -> list[str]:
    """What the residuals say of the sheet's flatness and the lens's kind."""
    posed = [
        (view.points_m, view.corners_px, turn, shift)
        for view, turn, shift in zip(views, fit.turns, fit.shifts, strict=True)
    ]
    found, notes = misfit(posed, fit.camera, fit.free), []
    lens_first = found.lens_z > found.bent_z
    if found.bent_z > CLEAR_Z and found.bent_mm > CURL_WARN_MM and not lens_first:
        text = f"curled board: the sheet is bent by {found.bent_mm:.1f} mm"
        cure = "glue it to a glass or aluminium plate"
        if found.bent_mm > CURL_LIMIT_MM:
            raise CalibrationError(f"{text} (limit {CURL_LIMIT_MM} mm): {cure}")
        notes.append(f"{text}: {cure}")
    if found.lens_z > CLEAR_Z and found.lens_px > LENS_WARN_PX and lens_first:
        text = f"wrong lens model: a richer one would move the corners by {found.lens_px:.2f} px"
        cure = "too wide a lens for k1, k2, p1, p2? calibrate without zoom, take a longer lens"
        if found.lens_px > LENS_LIMIT_PX:
            raise CalibrationError(f"{text} rms (limit {LENS_LIMIT_PX} px): {cure}")
        notes.append(f"{text} rms: {cure}")
    return notes


def refuse_bad_fit(fit: Fit, views: Sequence[SheetView]) -> None:
    worst = int(np.argmax(fit.view_rms_px))
    usual = float(np.median(fit.view_rms_px))
    if fit.rms_px > MAX_RMS_PX:
        raise CalibrationError(
            f"reprojection rms {fit.rms_px:.2f} px (limit {MAX_RMS_PX} px), worst picture "
            f"{views[worst].index} with {fit.view_rms_px[worst]:.2f} px: is the sheet flat, the "
            "square size right, the focus fixed?"
        )
    if fit.view_rms_px[worst] > MAX_VIEW_RATIO * max(usual, GOOD_VIEW_PX):
        raise CalibrationError(
            f"picture {views[worst].index} fits with {fit.view_rms_px[worst]:.2f} px, over "
            f"{MAX_VIEW_RATIO} x the median {usual:.2f} px: blurred or bent? leave it out"
        )
    std = np.sqrt(np.diag(fit.covariance))
    share = max(std[0] / fit.camera.matrix[0, 0], std[1] / fit.camera.matrix[1, 1])
    if share > MAX_FOCAL_STD:
        raise CalibrationError(
            f"focal length known to {share:.1%} only (limit {MAX_FOCAL_STD:.1%}): more pictures "
            "with the sheet tilted by 30 to 45 degrees"
        )
