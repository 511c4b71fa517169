"""The least-squares fit of the lens to the sheet's views (`cv2.calibrateCamera`), without corners
that lie grossly off."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from calibration.camera.plate_uncertainty import lens_covariance
from calibration.camera.sheet import MIN_CORNERS, CalibrationError, SheetView
from vision.view import Camera

FLAGS = ("CALIB_FIX_K3",)  # k3 only earns its keep with wide lenses; it spoils k1 and k2 elsewhere
PARAMETERS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
# A corner is false, not merely noisy, beyond both; a hand over the sheet makes a few.
FALSE_SIGMAS, FALSE_PX = 8.0, 1.5


@dataclass(frozen=True, eq=False)
class LensFit:
    """A fitted lens: its covariance (9, 9) in the order of PARAMETERS, which of them were fitted
    (`free` (9,)), the reprojection errors [px] of all and of each view, and the views' poses
    camera_from_sheet as rotation vectors `turns` and translations `shifts` [m]."""

    camera: Camera
    covariance: np.ndarray
    free: np.ndarray
    rms_px: float
    view_rms_px: np.ndarray
    turns: list[np.ndarray]
    shifts: list[np.ndarray]

    @property
    def tilts_deg(self) -> list[float]:
        """Angle [deg] between sheet and sensor in each view."""
        rotations = [np.asarray(cv2.Rodrigues(np.asarray(turn))[0]) for turn in self.turns]
        return [float(np.degrees(np.arccos(min(abs(r[2, 2]), 1.0)))) for r in rotations]

    def residuals(self, views: Sequence[SheetView]) -> list[np.ndarray]:
        """Seen minus expected corners (n, 2) [px] of each view; `views` are those that were
        fitted."""
        camera, left = self.camera, []
        for view, turn, shift in zip(views, self.turns, self.shifts, strict=True):
            seen, _ = cv2.projectPoints(
                view.points_m, turn, shift, camera.matrix, camera.distortion
            )
            left.append(view.corners_px - np.asarray(seen).reshape(-1, 2))
        return left


def solve(views: Sequence[SheetView], size_px: tuple[int, int]) -> LensFit:
    """Fit the lens to all corners by least squares (`cv2.calibrateCameraExtended`); `size_px`:
    (width, height) of the pictures. `CalibrationError`: the views determine no camera."""
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
    by_view = np.asarray(per_view).reshape(-1)
    return LensFit(camera, covariance, free, float(rms), by_view, list(turns), list(shifts))


def without_false_corners(
    views: Sequence[SheetView], size_px: tuple[int, int]
) -> tuple[list[SheetView], LensFit, float, int]:
    """The views without corners that lie grossly off, their fit, the share of corners taken out,
    and the index of the picture with most of them (-1: none taken out).

    `size_px`: (width, height) of the pictures. Up to 6 fits in turn; after each, corners beyond
    FALSE_SIGMAS times the noise and beyond FALSE_PX go. The noise comes from the median of all
    distances, which a tenth of false corners hardly moves. `CalibrationError`: the views determine
    no camera.
    """
    kept, total = list(views), sum(len(view.points_m) for view in views)
    taken: dict[int, int] = {}
    fit = solve(kept, size_px)
    for _ in range(6):
        distances = [np.linalg.norm(left, axis=1) for left in fit.residuals(kept)]
        usual = float(np.median(np.concatenate(distances))) / 1.177  # of a Rayleigh's sigma
        limit = max(FALSE_SIGMAS * usual, FALSE_PX)
        if max(float(d.max()) for d in distances) <= limit:
            break
        cleaned = []
        for view, distance in zip(kept, distances, strict=True):
            good = distance <= limit
            taken[view.index] = taken.get(view.index, 0) + int(np.sum(~good))
            if good.sum() >= MIN_CORNERS:
                points, pixels = view.points_m[good], view.corners_px[good]
                cleaned.append(replace(view, points_m=points, corners_px=pixels))
        if len(cleaned) < 3:
            break
        kept = cleaned
        fit = solve(kept, size_px)
    worst = max(taken, key=lambda index: taken[index]) if taken else -1
    return kept, fit, sum(taken.values()) / total, worst
