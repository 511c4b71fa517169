"""The camera's lens from pictures of a ChArUco sheet, with every reason to distrust it checked."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from calibration.on_plate import disagreement_mm, lens_covariance, std_mm
from vision.view import Camera

MIN_CORNERS, MIN_VIEWS, MIN_TILTED, TILTED_DEG = 12, 15, 5, 25.0
GRID, MIN_COVERAGE = (6, 4), 0.80
MAX_RMS_PX, MAX_FOCAL_STD = 0.5, 0.005
# A picture is an outlier at 2.5 medians, but not for fitting worse than corners can be found.
MAX_VIEW_RATIO, GOOD_VIEW_PX = 2.5, 0.1
HALF_SET_WARN_MM, HALF_SET_LIMIT_MM = 0.2, 0.5
FLAGS = ("CALIB_FIX_K3",)  # k3 only earns its keep with wide lenses; it spoils k1 and k2 elsewhere
PARAMETERS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")


class CalibrationError(ValueError):
    """The pictures do not determine the numbers well enough; the message says what to do."""


@dataclass(frozen=True)
class Sheet:
    """A printed ChArUco board: `columns` x `rows` squares. The default fits on A4."""

    columns: int = 11
    rows: int = 8
    square_m: float = 0.024
    marker_m: float = 0.018
    dictionary: str = "DICT_5X5_50"

    @property
    def size_m(self) -> tuple[float, float]:
        """Width and height of the printed area."""
        return self.columns * self.square_m, self.rows * self.square_m

    @cached_property
    def board(self) -> cv2.aruco.CharucoBoard:
        book = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self.dictionary))
        size = (self.columns, self.rows)
        return cv2.aruco.CharucoBoard(size, self.square_m, self.marker_m, book)

    def image(self, px_per_square: int = 140) -> np.ndarray:
        """The print (h, w) uint8 without margin."""
        size = (self.columns * px_per_square, self.rows * px_per_square)
        return np.asarray(self.board.generateImage(size, marginSize=0, borderBits=1))


@dataclass(frozen=True, eq=False)
class SheetView:
    """Corners of the sheet seen in one picture: `points_m` (n, 3), `corners_px` (n, 2)."""

    index: int
    points_m: np.ndarray
    corners_px: np.ndarray


@dataclass(frozen=True, eq=False)
class CameraCalibration:
    """A lens with its uncertainty. `std` by parameter (px; none for k), `view_rms_px` by view.

    `plate_std_mm`: the largest standard deviation on the plate that the pixels' noise leads to.
    `half_set_mm`: 95th percentile of the difference on the plate between the calibrations from
    every other view and from the rest. It sees what a small rms hides.
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

    @property
    def warnings(self) -> list[str]:
        if self.half_set_mm <= HALF_SET_WARN_MM:
            return []
        return [
            f"two half sets disagree by {self.half_set_mm:.2f} mm on the plate "
            f"(over {HALF_SET_WARN_MM} mm): take more pictures, more tilted, to the edges"
        ]


def find_sheet(images: Iterable[np.ndarray], sheet: Sheet) -> list[SheetView]:
    """The sheet in each picture (h, w[, 3]) uint8; pictures with under 12 corners are left out."""
    detector = cv2.aruco.CharucoDetector(sheet.board)
    views = []
    for index, image in enumerate(images):
        grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        corners, ids, _, _ = detector.detectBoard(grey)
        if ids is None or np.size(ids) < MIN_CORNERS:
            continue
        corners = np.asarray(corners, np.float32).reshape(-1, 2)
        points, pixels = sheet.board.matchImagePoints(  # type: ignore[call-overload]
            corners,  # pyright: ignore (the stub knows marker lists only)
            np.asarray(ids).reshape(-1),
        )
        points = np.asarray(points, np.float32).reshape(-1, 3)
        views.append(SheetView(index, points, np.asarray(pixels, np.float32).reshape(-1, 2)))
    return views


def calibrate_images(
    images: Sequence[np.ndarray], sheet: Sheet, *, distance_m: float = 0.75
) -> CameraCalibration:
    """`find_sheet` and `calibrate_camera` for pictures (h, w[, 3]) uint8 of one camera."""
    sizes = sorted({image.shape[1::-1] for image in images})
    if len(sizes) != 1:
        raise CalibrationError(f"the pictures must be of one size, got {sizes or 'no pictures'}")
    return calibrate_camera(find_sheet(images, sheet), sizes[0], distance_m=distance_m)


def calibrate_camera(
    views: Sequence[SheetView], size_px: tuple[int, int], *, distance_m: float = 0.75
) -> CameraCalibration:
    """The lens from the sheet's views in pictures of `size_px` (width, height).

    `distance_m` is about where the plate will be: the two half sets are compared there. Raises
    `CalibrationError` on anything that makes the numbers doubtful.
    """
    covered = _refuse_thin_set(views, size_px)
    fit = _solve(views, size_px)
    tilted = sum(_tilt_deg(turn) > TILTED_DEG for turn in fit.turns)
    if tilted < MIN_TILTED:
        raise CalibrationError(
            f"{tilted} pictures show the sheet tilted by over {TILTED_DEG:.0f} degrees, "
            f"{MIN_TILTED} are needed to tell focal length from distance: tilt it more"
        )
    _refuse_bad_fit(fit, views)
    halves = [_solve(views[start::2], size_px).camera for start in (0, 1)]
    half_mm = disagreement_mm(halves[0], halves[1], distance_m)
    if half_mm > HALF_SET_LIMIT_MM:
        raise CalibrationError(
            f"two half sets of the pictures disagree by {half_mm:.2f} mm on the plate "
            f"(limit {HALF_SET_LIMIT_MM} mm): is the sheet flat, the focus fixed? take more"
        )
    return CameraCalibration(
        fit.camera,
        dict(zip(PARAMETERS, np.sqrt(np.diag(fit.covariance)).tolist(), strict=True)),
        fit.rms_px,
        tuple(view.index for view in views),
        tuple(fit.view_rms_px.tolist()),
        covered,
        tilted,
        float(std_mm(fit.camera, fit.covariance, distance_m).max()),
        half_mm,
    )


def _refuse_thin_set(views: Sequence[SheetView], size_px: tuple[int, int]) -> float:
    """The coverage, if there are views enough and all over the image."""
    if len(views) < MIN_VIEWS:
        raise CalibrationError(
            f"the sheet was found in {len(views)} pictures, {MIN_VIEWS} are needed "
            f"(a picture counts with {MIN_CORNERS} corners or more): take more, sharp and well lit"
        )
    covered = coverage(views, size_px)
    if covered < MIN_COVERAGE:
        raise CalibrationError(
            f"the sheet covered {covered:.0%} of a {GRID[0]}x{GRID[1]} grid over the image, "
            f"{MIN_COVERAGE:.0%} are needed: hold it also into the corners"
        )
    return covered


def coverage(views: Sequence[SheetView], size_px: tuple[int, int]) -> float:
    """Share of a 6x4 grid's cells in which some corner was seen."""
    uv = np.concatenate([view.corners_px for view in views]) + 0.5
    cells = np.clip((uv / size_px * GRID).astype(int), 0, np.array(GRID) - 1)
    return len({(int(i), int(j)) for i, j in cells}) / (GRID[0] * GRID[1])


@dataclass(frozen=True, eq=False)
class _Fit:
    camera: Camera
    covariance: np.ndarray  # (9, 9)
    rms_px: float
    view_rms_px: np.ndarray
    turns: list[np.ndarray]


def _solve(views: Sequence[SheetView], size_px: tuple[int, int]) -> _Fit:
    flags = sum(getattr(cv2, name) for name in FLAGS)
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)  # sums in the order of threads would give other last digits every time
    try:
        rms, matrix, lens, turns, shifts, std, _, per_view = cv2.calibrateCameraExtended(
            [view.points_m for view in views],
            [view.corners_px for view in views],
            size_px,
            np.eye(3),
            np.zeros(5),
            flags=flags,
        )
    except cv2.error as error:
        raise CalibrationError(
            "the sheet's views do not determine the camera: tilt it, and show it at several places"
        ) from error
    finally:
        cv2.setNumThreads(threads)
    camera = Camera(matrix, np.asarray(lens).reshape(-1)[:5], *size_px)
    free = np.asarray(std).reshape(-1)[: len(PARAMETERS)] > 0
    poses = [(v.points_m, t, s) for v, t, s in zip(views, turns, shifts, strict=True)]
    unknowns = free.sum() + 6 * len(views)
    numbers = 2 * sum(len(view.points_m) for view in views)
    sigma = float(rms) * np.sqrt(0.5 * numbers / max(numbers - unknowns, 1))  # rms is per point
    covariance = lens_covariance(poses, camera, free, sigma)
    return _Fit(camera, covariance, float(rms), np.asarray(per_view).reshape(-1), list(turns))


def _tilt_deg(turn: np.ndarray) -> float:
    rotation = np.asarray(cv2.Rodrigues(np.asarray(turn))[0])
    return float(np.degrees(np.arccos(min(abs(rotation[2, 2]), 1.0))))


def _refuse_bad_fit(fit: _Fit, views: Sequence[SheetView]) -> None:
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
