"""The camera's lens from pictures of a ChArUco sheet, with every reason to distrust it checked."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.lens_fit import FLAGS, PARAMETERS, Fit, solve, without_false_corners
from calibration.misfit import misfit
from calibration.on_plate import shift_mm, std_mm
from calibration.pictures import (
    leave_out_blurred,
    refuse_blurred_pictures,
    refuse_wrong_print,
    refuse_wrong_sheet,
)
from calibration.sheet import MIN_CORNERS, CalibrationError, Sheet, SheetView, find_sheet
from vision.view import Camera

__all__ = [
    "PARAMETERS", "CalibrationError", "CameraCalibration", "Sheet", "SheetView",
    "calibrate_camera", "calibrate_images", "coverage", "find_sheet",
]  # fmt: skip

MIN_VIEWS, MIN_TILTED, TILTED_DEG = 15, 5, 25.0
GRID, MIN_COVERAGE = (6, 4), 0.80
MAX_RMS_PX, MAX_FOCAL_STD = 0.5, 0.005
# A picture is an outlier at 2.5 medians, but not for fitting worse than corners can be found.
MAX_VIEW_RATIO, GOOD_VIEW_PX = 2.5, 0.1
HALF_SET_WARN_MM, HALF_SET_LIMIT_MM = 0.2, 0.5
MAX_FALSE_SHARE = 0.01
CLEAR_Z = 6.0
CURL_WARN_MM, CURL_LIMIT_MM = 0.3, 0.8
LENS_WARN_PX, LENS_LIMIT_PX = 0.05, 0.2
MAX_STRETCH, MAX_OFF_CENTRE = 0.02, 0.1


@dataclass(frozen=True, eq=False)
class CameraCalibration:
    """A lens with its uncertainty. `std` by parameter (px; none for k), `view_rms_px` by view.

    `plate_std_mm`: the largest standard deviation on the plate that the pixels' noise leads to, and
    `std_map_mm` (9, 9) all of them, rows from -y to +y. `half_set_mm`: 95th percentile of the
    difference on the plate between the calibrations from every other view and from the rest, and
    `half_map_mm` (9, 9) all of it: it sees what a small rms hides. `views` are those of the fit.
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


def calibrate_images(
    images: Sequence[np.ndarray], sheet: Sheet, *, distance_m: float = 0.75
) -> CameraCalibration:
    """`find_sheet` and `calibrate_camera` for pictures (h, w[, 3]) uint8 of one camera.

    Raises `CalibrationError`, by name, also for what only the pictures show: another sheet, a
    mirror, blur, pictures of several sizes.
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
    return calibrate_views(views, sheet, sizes[0], distance_m=distance_m)


def calibrate_views(
    views: Sequence[SheetView], sheet: Sheet, size_px: tuple[int, int], *, distance_m: float = 0.75
) -> CameraCalibration:
    """`calibrate_camera` for views found in pictures, after what only those show was checked."""
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
    """The lens from the sheet's views in pictures of `size_px` (width, height).

    `distance_m` is about where the plate will be: the two half sets are compared there. Raises
    `CalibrationError` on anything that makes the numbers doubtful; `notes` join the warnings.
    """
    covered = _refuse_thin_set(views, size_px)
    views, fit, false_share, worst = without_false_corners(views, size_px)
    tilted = sum(tilt > TILTED_DEG for tilt in fit.tilts_deg)
    if tilted < MIN_TILTED:
        raise CalibrationError(
            f"no tilt: {tilted} pictures show the sheet tilted by over {TILTED_DEG:.0f} degrees, "
            f"{MIN_TILTED} are needed to tell focal length from distance: tilt it more"
        )
    notes = [*notes, *_odd_pixels(fit.camera), *_shapes(fit, views)]
    notes += _false_corners(false_share, worst)
    _refuse_bad_fit(fit, views)
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
    """Cells (column, row) of a 6x4 grid over the image in which some corner was seen."""
    if not views:
        return set()
    uv = np.concatenate([view.corners_px for view in views]) + 0.5
    found = np.clip((uv / size_px * GRID).astype(int), 0, np.array(GRID) - 1)
    return {(int(i), int(j)) for i, j in found}


def coverage(views: Sequence[SheetView], size_px: tuple[int, int]) -> float:
    """Share of a 6x4 grid's cells in which some corner was seen."""
    return len(cells(views, size_px)) / (GRID[0] * GRID[1])


def _false_corners(share: float, worst: int) -> list[str]:
    text = f"false corners: {share:.1%} of the corners lie off, most in picture {worst}"
    if share > MAX_FALSE_SHARE:
        raise CalibrationError(
            f"{text} (limit {MAX_FALSE_SHARE:.0%}): reflections, something that hides the sheet?"
        )
    return [f"{text}: left out"] if share > 0 else []


def _odd_pixels(camera: Camera) -> list[str]:
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


def _shapes(fit: Fit, views: Sequence[SheetView]) -> list[str]:
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


def _refuse_bad_fit(fit: Fit, views: Sequence[SheetView]) -> None:
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
