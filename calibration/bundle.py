"""One dated JSON file with everything the camera needs: lens, plate, markers, ball, how sure."""

import json
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Literal, NoReturn

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from calibration.camera import CameraCalibration, Sheet, calibrate_images
from calibration.plate import PlatePose, level_pose
from calibration.sheet_poses import sheet_poses
from vision.markers import MarkerLayout
from vision.synthetic import Renderer
from vision.view import Camera, View


class BundleError(ValueError):
    """A calibration file that cannot be used; the message names the key and the cure."""


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class LensRecord(_Strict):
    """The camera; `std` by parameter name, in px (k and p without unit)."""

    matrix: list[list[float]] = Field(min_length=3, max_length=3)
    distortion: list[float] = Field(min_length=5, max_length=5)
    width_px: int = Field(gt=0)
    height_px: int = Field(gt=0)
    std: dict[str, float]
    rms_px: float = Field(ge=0)
    views: int = Field(ge=0)
    coverage: float = Field(ge=0, le=1)
    plate_std_mm: float = Field(ge=0)
    half_set_mm: float = Field(ge=0)
    flags: list[str]


class PlateRecord(_Strict):
    """The level plate; `covariance` of its pose as in `View.pose_cov`."""

    camera_from_plate: list[list[float]] = Field(min_length=4, max_length=4)
    covariance: list[list[float]] = Field(min_length=6, max_length=6)
    residual_mm: float = Field(ge=0)
    scatter_mm: float = Field(ge=0)
    frames: int = Field(ge=0)
    side_m: float = Field(gt=0)


class MarkersRecord(_Strict):
    """The printed markers: ids and corners in the plate frame, metres."""

    dictionary: str
    ids: list[int]
    corners_m: list[list[list[float]]]


class Bundle(_Strict):
    """A calibration. `view` is the camera over the level plate, `layout` the markers on it."""

    schema_version: Literal[1] = 1
    made: datetime
    source: Literal["measured", "simulated"]
    lens: LensRecord
    plate: PlateRecord
    markers: MarkersRecord
    ball_radius_m: float = Field(gt=0)

    @cached_property
    def view(self) -> View:
        lens = self.lens
        camera = Camera(
            np.array(lens.matrix), np.array(lens.distortion), lens.width_px, lens.height_px
        )
        return View(camera, np.array(self.plate.camera_from_plate), np.array(self.plate.covariance))

    @cached_property
    def layout(self) -> MarkerLayout:
        record = self.markers
        return MarkerLayout(np.array(record.ids), np.array(record.corners_m), record.dictionary)

    @property
    def plate_side_m(self) -> float:
        return self.plate.side_m

    def check_size(self, width_px: int, height_px: int) -> None:
        """Raises `BundleError` for a picture size the lens was not calibrated at."""
        if (width_px, height_px) != (self.lens.width_px, self.lens.height_px):
            raise BundleError(
                f"the calibration is for {self.lens.width_px}x{self.lens.height_px} px, the camera "
                f"gives {width_px}x{height_px} px: set that size or calibrate again"
            )

    def save(self, path: str | Path) -> None:
        """Write the bundle as JSON; the folder must exist."""
        text = json.dumps(self.model_dump(mode="json"), indent=1)
        Path(path).write_text(text + "\n", encoding="utf-8")


def load(path: str | Path) -> Bundle:
    """Read a bundle. Raises `BundleError` for anything else, `OSError` for an unreadable file."""
    try:
        text = Path(path).read_text(encoding="utf-8")
        bundle = Bundle.model_validate(json.loads(text))
        _ = bundle.view, bundle.layout  # shapes and dictionary
    except ValidationError as error:
        _explain(Path(path), error)
    except ValueError as error:
        raise BundleError(f"{path} is no calibration bundle: {error}") from error
    return bundle


def _explain(path: Path, error: ValidationError) -> NoReturn:
    """One line about the first fault; an unknown key lists the known ones."""
    fault = error.errors()[0]
    where = ".".join(str(part) for part in fault["loc"]) or "the file"
    if fault["type"] != "extra_forbidden":
        raise BundleError(f"{path}: {where}: {fault['msg']}") from error
    models = {"lens": LensRecord, "plate": PlateRecord, "markers": MarkersRecord}
    model = models.get(str(fault["loc"][0]), Bundle) if len(fault["loc"]) > 1 else Bundle
    known = ", ".join(model.model_fields)
    raise BundleError(f"{path}: unknown key {where}; known keys: {known}") from error


def _lens_record(lens: CameraCalibration) -> LensRecord:
    camera = lens.camera
    return LensRecord(
        matrix=camera.matrix.tolist(),
        distortion=camera.distortion.tolist(),
        width_px=camera.width_px,
        height_px=camera.height_px,
        std=lens.std,
        rms_px=lens.rms_px,
        views=len(lens.view_index),
        coverage=lens.coverage,
        plate_std_mm=lens.plate_std_mm,
        half_set_mm=lens.half_set_mm,
        flags=list(lens.flags),
    )


def make_bundle(
    lens: CameraCalibration,
    plate: PlatePose,
    layout: MarkerLayout,
    *,
    ball_radius_m: float,
    plate_side_m: float,
    source: Literal["measured", "simulated"],
    made: datetime | None = None,
) -> Bundle:
    """The record of a calibration; `made` defaults to now (UTC)."""
    return Bundle(
        made=made or datetime.now(UTC).replace(microsecond=0),
        source=source,
        lens=_lens_record(lens),
        plate=PlateRecord(
            camera_from_plate=plate.camera_from_plate.tolist(),
            covariance=plate.covariance.tolist(),
            residual_mm=plate.residual_mm,
            scatter_mm=plate.scatter_mm,
            frames=plate.frames,
            side_m=plate_side_m,
        ),
        markers=MarkersRecord(
            dictionary=layout.dictionary,
            ids=layout.ids.tolist(),
            corners_m=layout.corners_m.tolist(),
        ),
        ball_radius_m=ball_radius_m,
    )


def calibrate_virtual(
    renderer: Renderer,
    rng: np.random.Generator,
    *,
    sheet: Sheet | None = None,
    pictures: int = 24,
    frames: int = 8,
    made: datetime | None = None,
) -> Bundle:
    """Calibrate the virtual camera as one would a real one: from its pictures alone.

    The renderer's view serves only to hold the sheet where a person would, before the lens.
    """
    sheet = sheet or Sheet()
    camera, scene = renderer.view.camera, renderer.scene
    distance_m = float(renderer.view.camera_from_plate[2, 3])
    field = camera.width_px / camera.pinhole[0], camera.height_px / camera.pinhole[1]
    poses = sheet_poses(sheet, field, distance_m, pictures, rng)
    px_per_square, margin_px = 140, 140
    paper = np.pad(sheet.image(px_per_square), margin_px, constant_values=255)
    margin_m = sheet.square_m * margin_px / px_per_square
    size_m = (sheet.size_m[0] + 2 * margin_m, sheet.size_m[1] + 2 * margin_m)
    shots = []
    for pose in poses:
        corner = pose.copy()
        corner[:3, 3] -= pose[:3, :2] @ (margin_m, margin_m)
        shots.append(renderer.render_sheet(paper, size_m, corner))
    lens = calibrate_images(shots, sheet, distance_m=distance_m)
    level = [renderer.render(np.eye(3), None) for _ in range(frames)]
    plate = level_pose(level, lens.camera, scene.layout)
    return make_bundle(
        lens,
        plate,
        scene.layout,
        ball_radius_m=scene.ball_radius_m,
        plate_side_m=scene.plate_side_m,
        source="simulated",
        made=made,
    )
