"""The sections of a calibration file; SI units except where a name says otherwise."""

import hashlib
from collections.abc import Iterable
from datetime import datetime
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, ConfigDict, Field, FiniteFloat

from rig.files import StrictModel
from rig.section import Length

Map = list[list[float]]
Row = list[FiniteFloat]
MarkerId = Annotated[int, Field(ge=0, lt=2**31)]
LATEST_S = 10.0  # chosen: no camera is as late, and milliseconds taken for seconds are seen
# Most that an axis of a pose may be off in length or angle [1]; chosen: rounded digits.
RIGID = 1e-3


def _camera_matrix(rows: list[Row]) -> list[Row]:
    """OpenCV's camera matrix, or ValueError."""
    shaped = all(len(row) == 3 for row in rows)
    if not (shaped and min(rows[0][0], rows[1][1]) > 0 and rows[2] == [0, 0, 1]):
        form = "[[fx, s, cx], [0, fy, cy], [0, 0, 1]]"
        raise ValueError(f"lens.matrix is no {form} with focal lengths above 0")
    return rows


def _pose(rows: list[Row]) -> list[Row]:
    """A rigid transformation (4, 4) to a place before the camera, or ValueError."""
    if any(len(row) != 4 for row in rows):
        raise ValueError("plate.camera_from_plate is not 4 x 4")
    pose = np.array(rows)
    turn = pose[:3, :3]
    off = np.abs(turn.T @ turn - np.eye(3)).max()
    if not (off < RIGID and np.linalg.det(turn) > 0 and (pose[3] == (0, 0, 0, 1)).all()):
        raise ValueError("plate.camera_from_plate is no turn and shift of a rigid plate")
    if pose[2, 3] <= 0:
        raise ValueError("plate.camera_from_plate puts the plate behind the camera")
    return rows


def _covariance(rows: list[Row]) -> list[Row]:
    """A covariance (6, 6), or ValueError."""
    if any(len(row) != 6 for row in rows) or min(rows[i][i] for i in range(6)) < 0:
        raise ValueError("plate.covariance is not 6 x 6 with variances of 0 and more")
    return rows


def _corners(markers: list[list[Row]]) -> list[list[Row]]:
    """Four corners apart of every marker (n, 4, 2), or ValueError."""
    for marker in markers:
        if len(marker) != 4 or any(len(corner) != 2 for corner in marker):
            raise ValueError("corners are not four (x, y) for each marker")
        (ax, ay), (bx, by), (cx, cy), (dx, dy) = marker
        if (cx - ax) * (dy - by) == (dx - bx) * (cy - ay):  # twice the area by the diagonals
            raise ValueError("corners hold a marker without an area")
    return markers


Corners = Annotated[list[list[Row]], AfterValidator(_corners)]


class Strict(StrictModel):
    """A strict record in which a number may be unbounded or unknown (inf, nan)."""

    model_config = ConfigDict(allow_inf_nan=True)


class LensRecord(Strict):
    """The lens section: OpenCV's camera matrix (3, 3) [px], distortion (k1, k2, p1, p2, k3), image
    size, and how good the fit is.

    `std`: standard deviation by parameter name, px for fx, fy, cx, cy, without unit for k and p.
    `rms_px`: reprojection error over all corners; `view_rms_px`: of each picture. `coverage`: share
    (0 to 1) of the image grid in which corners were seen. `uncertainty_mm` and `half_set_map_mm`
    (9, 9): standard deviation and difference of two half sets on the plate, each coordinate from
    -0.13 to 0.13 m, rows from -y to +y; `plate_std_mm` the largest value of the first map,
    `half_set_mm` the 95th percentile of the second. `flags`: OpenCV's calibration flags by name.
    """

    matrix: Annotated[list[Row], Field(min_length=3, max_length=3), AfterValidator(_camera_matrix)]
    distortion: Row = Field(min_length=5, max_length=5)
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
    """The plate section: pose (4, 4) [m] of the level plate in the camera's frame and its
    covariance (6, 6) [rad, m], ordered as in `View.pose_cov`.

    `residual_mm`: rms distance of the markers from the layout; `scatter_mm`: rms movement between
    the `frames` used; `side_m`: side of the square plate; `sheet_scale`: measured over stated size
    of the calibration sheet, None where none lay on the plate.
    """

    camera_from_plate: Annotated[
        list[Row], Field(min_length=4, max_length=4), AfterValidator(_pose)
    ]
    covariance: Annotated[list[Row], Field(min_length=6, max_length=6), AfterValidator(_covariance)]
    residual_mm: float = Field(ge=0)
    scatter_mm: float = Field(ge=0)
    frames: int = Field(ge=0)
    side_m: Length
    sheet_scale: float | None = None


class MarkersRecord(Strict):
    """The printed markers: OpenCV's dictionary name, ids (n,) and corners (n, 4, 2) in the plate
    frame [m]."""

    dictionary: str
    ids: list[MarkerId]
    corners_m: Corners


class FixedRecord(Strict):
    """Markers that stand still beside the plate, as seen at the calibration: ids (n,), corners (n,
    4, 2) [px]; `mm_per_px` is the scale of the picture at the plate (used by `camera_shift`)."""

    dictionary: str
    ids: list[MarkerId]
    corners_px: Corners
    mm_per_px: FiniteFloat = Field(gt=0)


class Value(Strict):
    """A number with the limits `low` and `high` of its 95 % interval, all in one unit."""

    value: float
    low: float
    high: float

    @classmethod
    def around(cls, value: float, half_width: float) -> "Value":
        """The interval from `value` - `half_width` to `value` + `half_width`."""
        return cls(value=value, low=value - half_width, high=value + half_width)

    @classmethod
    def within(cls, value: float, half_width: float, *, at_least: float) -> "Value":
        """The same of a number that cannot be below `at_least`. A fit ends just inside such a
        bound: what is nearer to it than a thousandth of the half width is the bound."""
        end = at_least + 1e-3 * half_width
        low, high = (max(limit, at_least) for limit in (value - half_width, value + half_width))
        return cls(value=value if value > end else at_least, low=low, high=high)


def _delay(delay_s: Value) -> Value:
    """A camera's delay, or ValueError."""
    if not abs(delay_s.value) <= LATEST_S:
        raise ValueError(f"timing.delay_s.value = {delay_s.value:g}: at most {LATEST_S:g} s")
    return delay_s


class TimingRecord(Strict):
    """The timing section: the camera's delay [s] from a frame's exposure to its time stamp on the
    encoders' clock.

    `play_rad`: full width of each axis's backlash, fitted with the delay; `frames`: number of
    frames used; `source`: what the delay was measured from; `readout_s`: from the exposure of the
    first row to the last's, None where nothing told it.
    """

    delay_s: Annotated[Value, AfterValidator(_delay)]
    readout_s: Value | None = None
    play_rad: dict[Literal["x", "y"], float]
    frames: int = Field(ge=0)
    source: Literal["markers", "ball"]


class LevelRecord(Strict):
    """The level section, by axis: the plate's slope [rad] at servo angle zero, the ball's
    acceleration per rad of servo angle (`gain_m_s2`), and the full width of the backlash fitted
    with them (`play_rad`)."""

    slope_rad: dict[Literal["x", "y"], Value]
    gain_m_s2: dict[Literal["x", "y"], Value]
    play_rad: dict[Literal["x", "y"], float]


class ServoAxis(Strict):
    """One servo: the volts at which it breaks away up and down, gain K [rad/s/V], time constant tau
    [s], offset and moving friction [V]; `sign` of the motor's direction."""

    breakaway_positive_V: Value
    breakaway_negative_V: Value
    gain_rad_s_V: Value
    time_constant_s: Value
    offset_V: Value
    friction_V: Value
    sign: Literal[-1, 1]


class ServoRecord(Strict):
    """The servo section: the servos of both axes."""

    x: ServoAxis
    y: ServoAxis


class PositionServoAxis(Strict):
    """One servo that takes an angle: keys and units of `[servo]`; `scale` and `zero_rad`: angle =
    (1 + scale) command + zero_rad; `together_s`: lag and dead time; `together_off_s`: how far off
    that is where the ball is slowed or its plate hangs otherwise (`calibration.motion.rolling`),
    which the interval does not hold. None where it was not seen; `not_seen`: key -> why.
    `rms_rad`: what is left of the angle."""

    lag_s: Value | None = None
    dead_time_s: Value
    together_s: Value | None = None
    together_off_s: float | None = None
    rate_limit_rad_s: Value | None = None
    acceleration_limit_rad_s2: Value | None = None
    dead_band_rad: Value | None = None
    scale: Value | None = None
    zero_rad: Value | None = None
    not_seen: dict[str, str] = {}
    rms_rad: float | None = None


class PositionServoRecord(Strict):
    """The section position_servo: servos that take an angle, of both axes; `source`: what showed
    where they stood."""

    x: PositionServoAxis
    y: PositionServoAxis
    source: Literal["angle", "plate", "ball"]


class BacklashAxis(Strict):
    """Backlash of one axis, seen at the servo [rad]: full width, and its middle where that was
    seen; `symmetric`: whether the middle's interval holds zero."""

    width_rad: Value
    middle_rad: Value | None = None
    symmetric: bool | None = None


class BacklashRecord(Strict):
    """The play section. `plays`: backlash by where it lies ("gear", "joint") or what it was
    measured from, then by axis; `not_seen`: what could not be measured -> why."""

    plays: dict[str, dict[Literal["x", "y"], BacklashAxis]]
    not_seen: dict[str, str] = {}


class DataFile(Strict):
    """One file that numbers came from: name, SHA-256 in hexadecimal digits, size."""

    name: str
    sha256: str
    size_bytes: int = Field(ge=0)


class SectionRecord(Strict):
    """When a section was made, from which files, which pictures show it, and its warnings."""

    made: datetime
    data: list[DataFile] = []
    pictures: list[str] = []
    warnings: list[str] = []


def fingerprint(paths: Iterable[Path]) -> list[DataFile]:
    """Names, SHA-256 and sizes of files; a folder in `paths` stands for all files below it, sorted
    by path. `OSError`: a file cannot be read."""
    files = []
    for path in paths:
        inside = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
        for file in inside:
            name = file.name if file == path else f"{path.name}/{file.relative_to(path).as_posix()}"
            with file.open("rb") as stream:
                digest = hashlib.file_digest(stream, "sha256").hexdigest()
            files.append(DataFile(name=name, sha256=digest, size_bytes=file.stat().st_size))
    return files
