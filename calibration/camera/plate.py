"""The level plate's pose, averaged over frames, and the residuals of its markers in mm."""

from collections.abc import Sequence
from dataclasses import dataclass
from warnings import catch_warnings, simplefilter

import numpy as np

from calibration.camera.print_scale import scale_on_plate
from calibration.camera.sheet import CalibrationError, Sheet
from vision.plate.markers import MarkerLayout, detect, edge_offsets, find_pose
from vision.view import Camera, View

MIN_FRAMES = 3
MAX_RESIDUAL_MM = 0.3
MAX_SCATTER_MM = 0.3


@dataclass(frozen=True, eq=False)
class PlatePose:
    """Pose of the level plate, `camera_from_plate` (4, 4) [m], as the mean over `frames`.

    `covariance` (6, 6): of the mean pose (as `View.pose_cov`). `residual_mm`: rms distance between
    the markers' printed sides and the layout, after the median over all frames: noise averages out;
    a wrong print, a bent plate or a wrong lens does not. `scatter_mm`: rms movement of the markers
    in space between frames. `sheet_scale`: measured over stated size of the calibration sheet, None
    where none lay on the plate.
    """

    camera_from_plate: np.ndarray
    covariance: np.ndarray
    residual_mm: float
    scatter_mm: float
    frames: int
    sheet_scale: float | None = None


def level_pose(
    images: Sequence[np.ndarray], camera: Camera, layout: MarkerLayout, sheet: Sheet | None = None
) -> PlatePose:
    """The plate's pose from frames (h, w, 3) uint8 taken with the plate level and at rest.

    `sheet`: the calibration sheet; where it lies flat on the plate, its size is measured against
    the markers. `CalibrationError`: frames of another size than the camera's, under 3 with markers,
    a plate that moved meanwhile, markers that are not where the layout says, or a sheet of a wrong
    size.
    """
    fits = [find_pose(of_camera(image, camera), layout, camera) for image in images]
    good = [(image, fit) for image, fit in zip(images, fits, strict=True) if fit is not None]
    if len(good) < MIN_FRAMES:
        raise CalibrationError(
            f"the plate's markers were found in {len(good)} of {len(images)} frames, {MIN_FRAMES} "
            "are needed: light, focus, and are they the markers of the layout?"
        )
    views = [fit.view for _, fit in good]
    view = View(camera, _mean_pose([v.camera_from_plate for v in views]))
    corners = layout.corners_m.reshape(-1, 2)
    points = np.column_stack((corners, np.tile((0.0, 1.0), (len(corners), 1))))
    seen = np.array([points @ v.camera_from_plate[:3].T for v in views])
    scatter_mm = 1e3 * float(np.sqrt(np.mean(np.sum((seen - seen.mean(0)) ** 2, axis=2))))
    if scatter_mm > MAX_SCATTER_MM:
        raise CalibrationError(
            f"moved camera or plate: the plate moved by {scatter_mm:.2f} mm rms between the frames "
            f"(limit {MAX_SCATTER_MM} mm): hold it level and still, fix the camera"
        )
    residual_mm = _residual_mm([image for image, _ in good], layout, view)
    known = [v.pose_cov for v in views if v.pose_cov is not None]
    covariance = np.mean(known, axis=0) / len(known)
    scale = scale_on_plate([image for image, _ in good], view, sheet) if sheet else None
    return PlatePose(view.camera_from_plate, covariance, residual_mm, scatter_mm, len(good), scale)


def of_camera(image: np.ndarray, camera: Camera) -> np.ndarray:
    """The image (h, w, 3), where it has the size that the camera was calibrated at;
    `CalibrationError` where it has another."""
    if image.shape[:2] != (camera.height_px, camera.width_px):
        raise CalibrationError(
            f"wrong resolution: a frame of {image.shape[1]}x{image.shape[0]} px does not belong to "
            f"a camera calibrated at {camera.width_px}x{camera.height_px} px: use the same settings"
        )
    return image


def _mean_pose(poses: list[np.ndarray]) -> np.ndarray:
    """Mean translation and chordal mean rotation (4, 4)."""
    mean = np.mean(poses, axis=0)
    left, _, right = np.linalg.svd(mean[:3, :3])
    mean[:3, :3] = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return mean


def _residual_mm(images, layout: MarkerLayout, view: View) -> float:
    offsets = np.array([edge_offsets(image, layout, view) for image in images])
    for frame, image in zip(offsets, images, strict=True):
        frame[~np.isin(layout.ids, detect(image, layout).ids)] = np.nan  # hidden by a ball or hand
    mm_per_px = 1e3 * view.camera_from_plate[2, 3] / view.camera.pinhole[0]
    with catch_warnings():
        simplefilter("ignore", RuntimeWarning)  # a side that no frame shows has no mean
        mean = np.nanmedian(offsets, axis=0)
        by_marker = np.sqrt(np.nanmean(mean**2, axis=(1, 2)))
        residual_mm = mm_per_px * float(np.sqrt(np.nanmean(mean**2)))
    if not residual_mm <= MAX_RESIDUAL_MM:
        worst = int(layout.ids[int(np.nanargmax(by_marker))])
        raise CalibrationError(
            f"the markers lie {residual_mm:.2f} mm rms off the layout (limit {MAX_RESIDUAL_MM} "
            f"mm), worst marker {worst}: measure its corners, flatten the plate"
        )
    return residual_mm
