"""The camera's lens from pictures of a ChArUco sheet, accepted only after the checks of its rooms.

Order: what only pictures show (`pictures.py`), coverage, the fit without false corners
(`lens_fit.py`), its acceptance tests (`lens_checks.py`), two half sets of the pictures against each
other, and the sheet's size against the plate's markers (`print_scale.py`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.camera.lens_checks import (
    check_false_corners,
    check_fit,
    check_pixels,
    check_sheet_and_lens,
)
from calibration.camera.lens_fit import FLAGS, PARAMETERS, solve, without_false_corners
from calibration.camera.pictures import (
    leave_out_blurred,
    refuse_blurred_pictures,
    refuse_wrong_print,
    refuse_wrong_sheet,
)
from calibration.camera.plate_uncertainty import shift_mm, std_mm
from calibration.camera.print_scale import check_against_plate
from calibration.camera.sheet import MIN_CORNERS, CalibrationError, Sheet, SheetView, find_sheet
from vision.plate.markers import MarkerLayout
from vision.view import Camera

MIN_VIEWS, MIN_TILTED, TILTED_DEG = 15, 5, 25.0
GRID, MIN_COVERAGE = (6, 4), 0.80
HALF_SET_WARN_MM, HALF_SET_LIMIT_MM = 0.2, 0.5


@dataclass(frozen=True, eq=False)
class CameraCalibration:
    """A calibrated lens with its uncertainty.

    `std`: standard deviations by parameter (px; k and p without unit). `rms_px`: reprojection
    error. `views`, `view_index`, `view_rms_px`: the fitted views, their pictures' indices and their
    errors. `coverage`: share of the image grid with corners; `tilted_views`: how many views are
    tilted by over TILTED_DEG. `std_map_mm` (9, 9): standard deviation on the plate due to the
    pixels' noise, rows from -y to +y; `plate_std_mm`: its largest value. `half_map_mm` (9, 9):
    distance on the plate between the lenses from every other view and from the rest, which shows
    systematic errors that a small rms does not; `half_set_mm`: its 95th percentile. `flags`:
    OpenCV's flags of the fit. `scale_checked`: whether the sheet's size was checked against the
    plate's markers.
    """

    camera: Camera
    std: dict[str, float]
    rms_px: float
    view_index: tuple[int, ...]
    view_rms_px: tuple[float, ...]
    coverage: float
    tilted_views: int
    plate_std_mm: float
    half_set_mm: float
    flags: tuple[str, ...] = FLAGS
    std_map_mm: np.ndarray | None = None
    half_map_mm: np.ndarray | None = None
    warnings: tuple[str, ...] = ()
    views: tuple[SheetView, ...] = ()
    scale_checked: bool = False


def calibrate_images(
    images: Sequence[np.ndarray],
    sheet: Sheet,
    *,
    distance_m: float = 0.75,
    layout: MarkerLayout | None = None,
) -> CameraCalibration:
    """Calibrate one camera from pictures (h, w[, 3]) uint8 of the sheet: `find_sheet`, the checks
    of the pictures, and `calibrate_camera`.

    `distance_m`: about where the plate will be; `layout`: the plate's markers; where they are seen
    beside the sheet, the sheet's size is checked against them.

    `CalibrationError`, by the fault's name: another sheet, a mirror image, blur, pictures of
    several sizes, a wrong print, and everything that `calibrate_camera` refuses.
    """
    sizes = sorted({image.shape[1::-1] for image in images})
    if len(sizes) != 1:
        raise CalibrationError(
            f"wrong resolution: the pictures must be of one size, got {sizes or 'no pictures'}"
        )
    refuse_wrong_sheet(images, sheet)
    views = find_sheet(images, sheet)
    if len(views) < MIN_VIEWS <= len(images):
        refuse_blurred_pictures(images, len(views))
    found = calibrate_views(views, sheet, sizes[0], distance_m=distance_m)
    if layout is None:
        return found
    checked = check_against_plate(images, found.views, found.camera, layout, sheet)
    return replace(found, scale_checked=checked)


def calibrate_views(
    views: Sequence[SheetView], sheet: Sheet, size_px: tuple[int, int], *, distance_m: float = 0.75
) -> CameraCalibration:
    """Calibrate from views found in pictures of `size_px` (width, height): leaves out the blurred
    ones, checks the print, and calls `calibrate_camera`.

    `distance_m`: about where the plate will be. `CalibrationError`: too few sharp views, markers of
    the wrong size, and everything that `calibrate_camera` refuses.
    """
    sharp, notes = leave_out_blurred(views)
    if len(sharp) < MIN_VIEWS <= len(views):
        raise CalibrationError(f"{notes[0]}; {len(sharp)} are left, {MIN_VIEWS} are needed")
    if len(sharp) >= MIN_VIEWS:
        refuse_wrong_print(sharp, sheet)
    return calibrate_camera(sharp, size_px, distance_m=distance_m, notes=notes)


def calibrate_camera(
    views: Sequence[SheetView],
    size_px: tuple[int, int],
    *,
    distance_m: float = 0.75,
    notes: Sequence[str] = (),
) -> CameraCalibration:
    """Fit the lens to the sheet's views in pictures of `size_px` (width, height) and accept it only
    after all checks.

    `distance_m`: about where the plate will be; the two half sets are compared there. `notes` join
    the warnings. `CalibrationError`: too few views, too little coverage or tilt, a fit that a check
    of `lens_checks` refuses, or half sets that differ by over HALF_SET_LIMIT_MM.
    """
    covered = _refuse_thin_set(views, size_px)
    views, fit, false_share, worst = without_false_corners(views, size_px)
    tilted = sum(tilt > TILTED_DEG for tilt in fit.tilts_deg)
    if tilted < MIN_TILTED:
        raise CalibrationError(
            f"no tilt: {tilted} pictures show the sheet tilted by over {TILTED_DEG:.0f} degrees, "
            f"{MIN_TILTED} are needed to tell focal length from distance: tilt it more"
        )
    notes = [*notes, *check_pixels(fit.camera), *check_sheet_and_lens(fit, views)]
    notes += check_false_corners(false_share, worst)
    check_fit(fit, views)
    halves = [solve(views[start::2], size_px).camera for start in (0, 1)]
    half = np.linalg.norm(shift_mm(halves[0], halves[1], distance_m), axis=1)
    half_mm = float(np.percentile(half, 95))
    std = std_mm(fit.camera, fit.covariance, distance_m)
    return CameraCalibration(
        fit.camera,
        dict(zip(PARAMETERS, np.sqrt(np.diag(fit.covariance)).tolist(), strict=True)),
        fit.rms_px,
        tuple(view.index for view in views),
        tuple(fit.view_rms_px.tolist()),
        covered,
        tilted,
        float(std.max()),
        half_mm,
        std_map_mm=std.reshape(9, 9),
        half_map_mm=half.reshape(9, 9),
        warnings=(*_half_sets(half_mm, notes), *notes),
        views=tuple(views),
    )


def _refuse_thin_set(views: Sequence[SheetView], size_px: tuple[int, int]) -> float:
    """The coverage, if there are views enough and all over the image."""
    if len(views) < MIN_VIEWS:
        raise CalibrationError(
            f"too few views: the sheet was found in {len(views)} pictures, {MIN_VIEWS} are needed "
            f"(a picture counts with {MIN_CORNERS} corners or more): take more, sharp and well lit"
        )
    covered = coverage(views, size_px)
    if covered < MIN_COVERAGE:
        raise CalibrationError(
            f"the sheet covered {covered:.0%} of a {GRID[0]}x{GRID[1]} grid over the image, "
            f"{MIN_COVERAGE:.0%} are needed: hold it also into the corners"
        )
    return covered


def cells(views: Sequence[SheetView], size_px: tuple[int, int]) -> set[tuple[int, int]]:
    """Cells (column, row) of a 6x4 grid over the image of `size_px` (width, height) in which some
    corner was seen."""
    if not views:
        return set()
    uv = np.concatenate([view.corners_px for view in views]) + 0.5
    found = np.clip((uv / size_px * GRID).astype(int), 0, np.array(GRID) - 1)
    return {(int(i), int(j)) for i, j in found}


def coverage(views: Sequence[SheetView], size_px: tuple[int, int]) -> float:
    """Share (0 to 1) of the cells of a 6x4 grid over the image of `size_px` (width, height) in
    which some corner was seen.
    """
    return len(cells(views, size_px)) / (GRID[0] * GRID[1])


def _half_sets(half_mm: float, notes: Sequence[str]) -> list[str]:
    if half_mm > HALF_SET_LIMIT_MM:
        why = "; ".join(notes) or "is the sheet flat, the focus fixed? take more"
        raise CalibrationError(
            f"two half sets of the pictures disagree by {half_mm:.2f} mm on the plate "
            f"(limit {HALF_SET_LIMIT_MM} mm): {why}"
        )
    if half_mm <= HALF_SET_WARN_MM:
        return []
    return [
        f"two half sets disagree by {half_mm:.2f} mm on the plate "
        f"(over {HALF_SET_WARN_MM} mm): take more pictures, more tilted, to the edges"
    ]
