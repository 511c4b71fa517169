"""Acceptance tests of a fitted lens: each refuses beyond a limit, and warns beyond a smaller one.

A `check_...` raises `CalibrationError`, named after the fault, with the number, the limit and the
cure, or returns warnings. The limits are chosen: they pass the rendered pictures of sound cameras
and refuse the faults of `tests/benchmarks/calibration/calibration_faults.py`.
"""

from collections.abc import Sequence

import numpy as np

from calibration.camera.lens_fit import LensFit
from calibration.camera.misfit import misfit
from calibration.camera.sheet import CalibrationError, SheetView
from vision.view import Camera

MAX_RMS_PX, MAX_FOCAL_STD = 0.5, 0.005
# A picture is an outlier at 2.5 medians, but not for fitting worse than corners can be excess.
MAX_VIEW_RATIO, GOOD_VIEW_PX = 2.5, 0.1
MAX_FALSE_SHARE = 0.01
CLEAR_Z = 6.0
CURL_WARN_MM, CURL_LIMIT_MM = 0.3, 0.8
LENS_WARN_PX, LENS_LIMIT_PX = 0.05, 0.2
MAX_STRETCH, MAX_OFF_CENTRE = 0.02, 0.1


def check_false_corners(share: float, worst: int) -> list[str]:
    """Return a warning if corners were left out as grossly off: `share` (0 to 1) of all, most of
    them in picture `worst`. `CalibrationError`: the share is over MAX_FALSE_SHARE."""
    text = f"false corners: {share:.1%} of the corners lie off, most in picture {worst}"
    if share > MAX_FALSE_SHARE:
        raise CalibrationError(
            f"{text} (limit {MAX_FALSE_SHARE:.0%}): reflections, something that hides the sheet?"
        )
    return [f"{text}: left out"] if share > 0 else []


def check_pixels(camera: Camera) -> list[str]:
    """Return a warning if the lens's centre is far off the picture's, as after cropping.
    `CalibrationError`: the pixels are not square within MAX_STRETCH, as after scaling."""
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


def check_sheet_and_lens(fit: LensFit, views: Sequence[SheetView]) -> list[str]:
    """Return warnings if the residuals of `fit` show a bent sheet or a lens that the model does not
    describe, whichever is more significant (`misfit`); `views` are those that were fitted.

    `CalibrationError`: a bend over CURL_LIMIT_MM or a lens error over LENS_LIMIT_PX.
    """
    posed = [
        (view.points_m, view.corners_px, turn, shift)
        for view, turn, shift in zip(views, fit.turns, fit.shifts, strict=True)
    ]
    excess, notes = misfit(posed, fit.camera, fit.free), []
    lens_first = excess.lens_z > excess.bent_z
    if excess.bent_z > CLEAR_Z and excess.bent_mm > CURL_WARN_MM and not lens_first:
        text = f"curled board: the sheet is bent by {excess.bent_mm:.1f} mm"
        cure = "glue it to a glass or aluminium plate"
        if excess.bent_mm > CURL_LIMIT_MM:
            raise CalibrationError(f"{text} (limit {CURL_LIMIT_MM} mm): {cure}")
        notes.append(f"{text}: {cure}")
    if excess.lens_z > CLEAR_Z and excess.lens_px > LENS_WARN_PX and lens_first:
        text = f"wrong lens model: a richer one would move the corners by {excess.lens_px:.2f} px"
        cure = "too wide a lens for k1, k2, p1, p2? calibrate without zoom, take a longer lens"
        if excess.lens_px > LENS_LIMIT_PX:
            raise CalibrationError(f"{text} rms (limit {LENS_LIMIT_PX} px): {cure}")
        notes.append(f"{text} rms: {cure}")
    return notes


def check_fit(fit: LensFit, views: Sequence[SheetView]) -> None:
    """Check the residuals of all and of each picture and the focal length's standard deviation;
    `views` are those that were fitted.

    `CalibrationError`: rms over MAX_RMS_PX, a picture over MAX_VIEW_RATIO medians, or a focal
    length with a relative standard deviation over MAX_FOCAL_STD.
    """
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
