"""What a calibration file holds, section by section: strict, in SI units but where a name says."""

import hashlib
from collections.abc import Iterable
from datetime import datetime
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

SECTIONS = ("lens", "plate", "timing", "level", "servo", "play")
Map = list[list[float]]


class Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class LensRecord(Strict):
    """The camera; `std` by parameter name, in px (k and p without unit).

    `uncertainty_mm` and `half_set_map_mm` (9, 9): standard deviation and difference of two half
    sets over the plate from -0.13 to 0.13 m, rows from -y to +y.
    """

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
    uncertainty_mm: Map | None = None
    half_set_map_mm: Map | None = None
    view_rms_px: list[float] = []


class PlateRecord(Strict):
    """The level plate; `covariance` of its pose as in `View.pose_cov`."""

    camera_from_plate: list[list[float]] = Field(min_length=4, max_length=4)
    covariance: list[list[float]] = Field(min_length=6, max_length=6)
    residual_mm: float = Field(ge=0)
    scatter_mm: float = Field(ge=0)
    frames: int = Field(ge=0)
    side_m: float = Field(gt=0)
    sheet_scale: float | None = None


class MarkersRecord(Strict):
    """The printed markers: ids and corners in the plate frame, metres."""

    dictionary: str
    ids: list[int]
    corners_m: list[list[list[float]]]


class FixedRecord(Strict):
    """Markers that stand still beside the plate, as the camera saw them: what a knock moves."""

    dictionary: str
    ids: list[int]
    corners_px: list[list[list[float]]]
    mm_per_px: float = Field(gt=0)


class Value(Strict):
    """A number with its 95 % interval."""

    value: float
    low: float
    high: float


class TimingRecord(Strict):
    """How long after the light the camera's frames are stamped, against the encoders."""

    delay_s: Value
    play_rad: dict[Literal["x", "y"], float]
    frames: int = Field(ge=0)
    source: Literal["markers", "ball"]


class LevelRecord(Strict):
    """How far the plate is from level at servo angle zero, by axis; `gain_m_s2` of Eq. 15."""

    slope_rad: dict[Literal["x", "y"], Value]
    gain_m_s2: dict[Literal["x", "y"], Value]
    play_rad: dict[Literal["x", "y"], float]


class ServoAxis(Strict):
    """One servo: breakaway volts in both directions, K, tau and the moving friction."""

    breakaway_positive_V: Value
    breakaway_negative_V: Value
    gain_rad_s_V: Value
    time_constant_s: Value
    offset_V: Value
    friction_V: Value
    sign: Literal[-1, 1]


class ServoRecord(Strict):
    x: ServoAxis
    y: ServoAxis


class PlayAxis(Strict):
    """One play of one axis, full width at the servo; its middle where it was seen."""

    width_rad: Value
    middle_rad: Value | None = None
    symmetric: bool | None = None


class PlayRecord(Strict):
    """Play by where it lies ("gear", "joint") or what it was seen by, then by axis; `not_seen`:
    what could not be measured, and why."""

    plays: dict[str, dict[Literal["x", "y"], PlayAxis]]
    not_seen: dict[str, str] = {}


class DataFile(Strict):
    """One file that numbers came from."""

    name: str
    sha256: str
    size_bytes: int = Field(ge=0)


class Section(Strict):
    """When a section was made, from which files, which pictures show it, and what was said."""

    made: datetime
    data: list[DataFile] = []
    pictures: list[str] = []
    warnings: list[str] = []


def fingerprint(paths: Iterable[Path]) -> list[DataFile]:
    """Names, hashes and sizes of files; a folder stands for the files in it."""
    found = []
    for path in paths:
        inside = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
        for file in inside:
            name = file.name if file == path else f"{path.name}/{file.relative_to(path).as_posix()}"
            with file.open("rb") as stream:
                digest = hashlib.file_digest(stream, "sha256").hexdigest()
            found.append(DataFile(name=name, sha256=digest, size_bytes=file.stat().st_size))
    return found
