"""One dated JSON file of a calibration: lens, plate, markers, ball, level, servos, ...

`Draft` is the file while it grows, section by section in any order; `Bundle` has all that a camera
needs to see the ball. Sections are those of `calibration.records`.
"""

import json
from dataclasses import replace
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
from pydantic import Field, ValidationError

from calibration.camera.lens import CameraCalibration, calibrate_images
from calibration.camera.plate import PlatePose, level_pose
from calibration.camera.sheet import Sheet
from calibration.camera.virtual import sheet_pictures
from calibration.records import (
    BacklashRecord,
    FixedRecord,
    LensRecord,
    LevelRecord,
    MarkersRecord,
    PlateRecord,
    PositionServoRecord,
    SectionRecord,
    ServoRecord,
    Strict,
    TimingRecord,
)
from rig.files import first_error_line, json_of, write_whole
from rig.section import Length
from vision.plate.markers import MarkerLayout
from vision.synthetic.synthetic import Renderer
from vision.view import Camera, View

_B = TypeVar("_B", "Bundle", "Draft")
MAKERS = {
    "lens": "run rig calibrate camera",
    "plate": "run rig calibrate table",
    "markers": "run rig calibrate table",
}


class BundleError(ValueError):
    """A calibration file that cannot be used; the message is one line with the key and the cure."""


class _Common(Strict):
    """What finished and unfinished files share. `sections`: where the numbers of each came from."""

    schema_version: Literal[1] = 1
    made: datetime
    source: Literal["measured", "simulated"]
    fixed: FixedRecord | None = None
    timing: TimingRecord | None = None
    level: LevelRecord | None = None
    servo: ServoRecord | None = None
    position_servo: PositionServoRecord | None = None
    play: BacklashRecord | None = None
    sections: dict[str, SectionRecord] = Field(default_factory=dict)

    def save(self, path: str | Path) -> None:
        """Write the file as JSON. `OSError`: there is no such folder, or it cannot be written; an
        older one stays.
        """
        text = json.dumps(self.model_dump(mode="json", exclude_none=True), indent=1)
        write_whole(Path(path), text.encode() + b"\n")


def _camera(lens: LensRecord) -> Camera:
    matrix, distortion = np.array(lens.matrix), np.array(lens.distortion)
    return Camera(matrix, distortion, lens.width_px, lens.height_px)


def _readout_s(timing: TimingRecord | None) -> float:
    found = timing.readout_s if timing is not None else None
    return found.value if found is not None and found.low * found.high > 0 else 0.0


class Draft(_Common):
    """A calibration that is being made: sections are added one after the other, in any order.

    `lens`, `plate`, `markers` and the ball's radius are None until they are measured; further
    sections as of `calibration.records`.
    """

    lens: LensRecord | None = None
    plate: PlateRecord | None = None
    markers: MarkersRecord | None = None
    ball_radius_m: Length | None = None

    @property
    def camera(self) -> Camera:
        """The calibrated lens. `BundleError`: it is not calibrated yet."""
        if self.lens is None:
            raise BundleError(f"the calibration has no lens yet: {MAKERS['lens']}")
        return _camera(self.lens)

    @property
    def view(self) -> View:
        """The camera over the level plate. `BundleError`: lens or plate are not calibrated yet."""
        if self.plate is None:
            raise BundleError(f"the calibration has no plate yet: {MAKERS['plate']}")
        pose, covariance = self.plate.camera_from_plate, self.plate.covariance
        return View(self.camera, np.array(pose), np.array(covariance))

    def with_section(self, name: str, section: SectionRecord, **records: Any) -> "Draft":
        """A copy of the draft with new `records` (field name -> record) and with `section`, which
        says where they came from, under `name`. A record of None removes the field's value and
        section. `made` becomes the section's."""
        gone = {key for key, record in records.items() if record is None}
        sections = {k: v for k, v in self.sections.items() if k not in gone} | {name: section}
        return self.model_copy(update={**records, "sections": sections, "made": section.made})


class Bundle(_Common):
    """A finished calibration: lens, plate, markers and ball, with which the ball can be located."""

    lens: LensRecord
    plate: PlateRecord
    markers: MarkersRecord
    ball_radius_m: Length

    @cached_property
    def view(self) -> View:
        """The camera over the level plate, with the pose's covariance, and its readout where it
        surely has one."""
        camera = replace(_camera(self.lens), readout_s=_readout_s(self.timing))
        return View(camera, np.array(self.plate.camera_from_plate), np.array(self.plate.covariance))

    @cached_property
    def layout(self) -> MarkerLayout:
        """The markers on the plate, in the plate frame [m]."""
        record = self.markers
        return MarkerLayout(np.array(record.ids), np.array(record.corners_m), record.dictionary)

    @property
    def plate_side_m(self) -> float:
        """Side of the square plate [m]."""
        return self.plate.side_m

    @property
    def stamped_late_s(self) -> float:
        """How long after its light the camera's frames are stamped [s], as measured; else 0."""
        return max(self.timing.delay_s.value, 0.0) if self.timing is not None else 0.0

    def check_size(self, width_px: int, height_px: int) -> None:
        """Raise `BundleError` where pictures of `width_px` x `height_px` are not of the size that
        the lens was calibrated with.
        """
        if (width_px, height_px) != (self.lens.width_px, self.lens.height_px):
            raise BundleError(
                f"the calibration is for {self.lens.width_px}x{self.lens.height_px} px, the camera "
                f"gives {width_px}x{height_px} px: set that size or calibrate again"
            )


def load(path: str | Path) -> Bundle:
    """Read a finished calibration file. `BundleError`: the content is not a complete, valid
    calibration (a section that is missing is named with the command that makes it); `OSError`: the
    file cannot be read."""
    bundle = _read(path, Bundle)
    try:
        _ = bundle.view, bundle.layout  # shapes and dictionary
    except ValueError as error:
        raise BundleError(f"{path} is no calibration bundle: {error}") from error
    if len(bundle.layout.ids) and np.abs(bundle.layout.corners_m).max() > bundle.plate_side_m:
        raise BundleError(
            f"{path}: markers.corners_m reach beyond a plate of {bundle.plate_side_m:g} m; "
            "give metres"
        )
    return bundle


def load_draft(path: str | Path) -> Draft:
    """Read a calibration file that may lack sections. `BundleError`: the content is not a valid
    calibration; `OSError`: the file cannot be read."""
    return _read(path, Draft)


def _read(path: str | Path, kind: type[_B]) -> _B:
    try:
        return kind.model_validate(json_of(Path(path)))
    except ValidationError as error:
        first = error.errors()[0]
        section = str(first["loc"][0]) if first["loc"] else ""
        if first["type"] == "missing" and first["loc"] == (section,) and section in MAKERS:
            raise BundleError(f"{path} has no {section} yet: {MAKERS[section]}") from error
        raise BundleError(f"{path}: {first_error_line(error, kind)}") from error
    except ValueError as error:
        raise BundleError(f"{path} is no calibration bundle: {error}") from error


def lens_record(lens: CameraCalibration) -> LensRecord:
    """The section `lens` of a calibration file from a calibrated camera."""
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
        uncertainty_mm=None if lens.std_map_mm is None else lens.std_map_mm.tolist(),
        half_set_map_mm=None if lens.half_map_mm is None else lens.half_map_mm.tolist(),
        view_rms_px=list(lens.view_rms_px),
    )


def plate_record(plate: PlatePose, side_m: float) -> PlateRecord:
    """The section `plate` of a calibration file from a pose found by `level_pose`; `side_m`: side
    of the square plate."""
    return PlateRecord(
        camera_from_plate=plate.camera_from_plate.tolist(),
        covariance=plate.covariance.tolist(),
        residual_mm=plate.residual_mm,
        scatter_mm=plate.scatter_mm,
        frames=plate.frames,
        side_m=side_m,
        sheet_scale=plate.sheet_scale,
    )


def markers_record(layout: MarkerLayout) -> MarkersRecord:
    """The section `markers` of a calibration file from a layout."""
    return MarkersRecord(
        dictionary=layout.dictionary, ids=layout.ids.tolist(), corners_m=layout.corners_m.tolist()
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
    """A finished calibration from its parts; `made` defaults to now (UTC). `ValidationError`
    (pydantic): a radius, side or count outside its range."""
    return Bundle(
        made=made or datetime.now(UTC).replace(microsecond=0),
        source=source,
        lens=lens_record(lens),
        plate=plate_record(plate, plate_side_m),
        markers=markers_record(layout),
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
    """Calibrate the virtual camera from rendered pictures alone, as a real one: `pictures` of the
    calibration sheet for the lens, `frames` of the level plate for its pose.

    `sheet` defaults to `Sheet()`; `made` to now (UTC). `CalibrationError`: the pictures are refused
    by `calibrate_images` or `level_pose`.
    """
    sheet, scene = sheet or Sheet(), renderer.scene
    distance_m = float(renderer.view.camera_from_plate[2, 3])
    shots = list(sheet_pictures(renderer, sheet, pictures, rng))
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
