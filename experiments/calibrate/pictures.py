"""Pictures beside a calibration: what it looked at, how sure it is, how it fits."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from calibration.camera.lens import GRID, CameraCalibration, cells
from calibration.camera.sheet import SheetView
from calibration.motion.commanded_moves import Followed
from calibration.motion.manoeuvres import Trace
from calibration.motion.rolling import Rolling
from calibration.motion.servo import moves, pulse_angle
from calibration.motion.timing import Wiggle, expected_sines
from calibration.records import LevelRecord, ServoRecord, TimingRecord
from experiments.picture_files import our_style, subplots, write_figure, write_image
from rig.parameters import Rig
from vision.plate.markers import MarkerLayout
from vision.view import View

_GREEN, _RED, _DOT = (60, 150, 60), (60, 60, 170), (235, 235, 235)


def coverage_picture(
    views: Sequence[SheetView],
    size: tuple[int, int],
    path: Path,
    *,
    over: np.ndarray | None = None,
) -> Path:
    """Draw every corner seen, and green the covered cells of the grid, red the others: PNG.

    size: (width, height) [px] of the frames; over: frame (h, w[, 3]) uint8 of that size to draw on.
    Returns `path`. OSError: it cannot be written.
    """
    width, height = size
    image = np.zeros((height, width, 3), np.uint8)
    seen = cells(views, size)
    for column in range(GRID[0]):
        for row in range(GRID[1]):
            low = (column * width // GRID[0], row * height // GRID[1])
            high = ((column + 1) * width // GRID[0] - 2, (row + 1) * height // GRID[1] - 2)
            cv2.rectangle(image, low, high, _GREEN if (column, row) in seen else _RED, -1)
    if over is not None:
        frame = over if over.ndim == 3 else cv2.cvtColor(over, cv2.COLOR_GRAY2BGR)
        image = cv2.addWeighted(image, 0.35, frame, 0.65, 0.0)
    for view in views:
        for u, v in np.rint(view.corners_px).astype(int):
            cv2.circle(image, (int(u), int(v)), max(1, width // 400), _DOT, -1)
    text = f"{len(views)} pictures, {len(seen)} of {GRID[0] * GRID[1]} cells"
    cv2.putText(image, text, (8, height - 10), cv2.FONT_HERSHEY_SIMPLEX, width / 1200, _DOT, 1)
    return write_image(image, path)


def plate_picture(image: np.ndarray, view: View, layout: MarkerLayout, path: Path) -> Path:
    """Draw the markers' outlines and the axes in a frame, where the calibration puts them: PNG.

    image: (h, w, 3) uint8 BGR. Returns `path`. OSError: it cannot be written.
    """
    drawn = image.copy()
    for corners in layout.corners_m:
        points = view.pixel_from_plate(np.column_stack((corners, np.zeros(4))))
        outline = np.rint(16 * points).astype(np.int32)
        cv2.polylines(drawn, [outline], True, (0, 200, 0), 1, cv2.LINE_AA, 4)
    ends = view.pixel_from_plate(np.array([(0, 0, 0), (0.05, 0, 0), (0, 0.05, 0)]))
    middle, x, y = (tuple(np.rint(end).astype(int).tolist()) for end in ends)
    cv2.arrowedLine(drawn, middle, x, (40, 40, 220), 2, cv2.LINE_AA)
    cv2.arrowedLine(drawn, middle, y, (40, 160, 40), 2, cv2.LINE_AA)
    return write_image(drawn, path)


@our_style()
def camera_figure(lens: CameraCalibration, path: Path, source: str) -> Path:
    """Draw uncertainty and half-set difference on the plate [mm], and each picture's rms [px].

    source: "simulated" or "measured". Returns `path`, a PNG file. OSError: it cannot be written.
    """
    figure, (left, middle, right) = subplots(1, 3, figsize=(10, 3.2))
    reach = (-130, 130, -130, 130)
    titles = ("standard deviation on the plate", "difference of two half sets")
    for axes, values, title in zip(
        (left, middle), (lens.std_map_mm, lens.half_map_mm), titles, strict=True
    ):
        if values is None:
            continue
        shown = axes.imshow(values, origin="lower", extent=reach, interpolation="bilinear")
        figure.colorbar(shown, ax=axes, shrink=0.82, label="mm")
        axes.set(title=title, xlabel="x [mm]", ylabel="y [mm]")
        axes.grid(False)
    right.bar(range(len(lens.view_rms_px)), lens.view_rms_px, color="#1f4fd8")
    right.axhline(lens.rms_px, color="0.4", lw=1)
    right.set(title="fit of each picture", xlabel="picture", ylabel="rms [px]")
    return save(figure, path, source)


@our_style()
def servo_figure(
    ramped: Trace, pulsed: Trace, record: ServoRecord, path: Path, source: str
) -> Path:
    """Draw the ramps with their breakaway volts, and the pulses with the fitted model.

    source: "simulated" or "measured". Returns `path`, a PNG file. OSError: it cannot be written.
    """
    figure, rows = subplots(2, 2, figsize=(9, 6))
    for a, (name, axis) in enumerate((("x", record.x), ("y", record.y))):
        left, right = rows[a]
        for move in moves(ramped, a):
            n = move.driven
            left.plot(move.volts[:n], np.degrees(move.theta_rad[:n]), lw=0.8, color="#1f4fd8")
        for value in (axis.breakaway_negative_V, axis.breakaway_positive_V):
            left.axvline(value.value, color="#d62728", lw=1)
        left.set(xlabel="ramp [V]", ylabel=f"angle moved, {name} [degrees]")
        model = (axis.gain_rad_s_V, axis.time_constant_s, axis.offset_V, axis.friction_V)
        for move in moves(pulsed, a):
            right.plot(move.t_s, np.degrees(move.theta_rad), lw=0.8, color="#1f4fd8")
            told = pulse_angle(move, *(value.value for value in model))
            right.plot(move.t_s, np.degrees(told), lw=0.8, color="#d62728", ls="--")
        right.set(xlabel="time [s]", title="pulses, model dashed", xlim=(0, 0.4))
    return save(figure, path, source)


@our_style()
def angle_figure(followed: Followed, expected: np.ndarray, path: Path, source: str) -> Path:
    """Draw what servos that take an angle were told, where they were seen and where the fit puts
    them: steps on the left, slow motion on the right.

    expected: angles (m, 2) [rad] of the fit at the times seen; source: "simulated" or "measured".
    Returns `path`, a PNG file. OSError: it cannot be written.
    """
    figure, rows = subplots(2, 2, figsize=(9, 6))
    for a, name in enumerate("xy"):
        told = followed.told_rad[:, a]
        first = followed.t_s[int(np.argmax(told != 0))]
        slow = first + 3.3  # after the first six steps
        for axes, (begin, end) in zip(rows[a], ((first, slow), (slow, slow + 10)), strict=True):
            at = (followed.t_s >= begin - 0.1) & (followed.t_s <= end)
            seen = (followed.seen_s >= begin - 0.1) & (followed.seen_s <= end)
            axes.plot(followed.t_s[at], np.degrees(told[at]), lw=0.8, color="0.6", label="told")
            dots = np.degrees(followed.seen_rad[seen, a])
            axes.plot(followed.seen_s[seen], dots, ".", ms=2, color="#1f4fd8", label="seen")
            line = np.degrees(expected[seen, a])
            axes.plot(followed.seen_s[seen], line, "--", lw=0.8, color="#d62728", label="fit")
            axes.set(xlabel="time [s]", ylabel=f"servo angle, {name} [degrees]")
    rows[0][0].legend()
    return save(figure, path, source)


def _ball_and_servo(axes, run: Rolling, name: str) -> None:
    axes.plot(run.seen_s, 1e3 * run.x_m, ".", ms=2, color="#1f4fd8")
    axes.set_ylabel(f"ball {name} [mm]")
    other = axes.twinx()
    other.plot(run.t_s, np.degrees(run.theta_rad), lw=0.5, color="0.5")
    other.set_ylabel("servo [degrees]")
    other.grid(False)


@our_style()
def time_figure(wiggle: Wiggle, record: TimingRecord, rig: Rig, path: Path, source: str) -> Path:
    """Draw the sines of the plate's tilt by the markers and by the delayed encoders over time.

    source: "simulated" or "measured". Returns `path`, a PNG file. OSError: it cannot be written.
    """
    figure, rows = subplots(2, 1, figsize=(8, 5), sharex=True)
    told = expected_sines(wiggle, record, rig)
    for a, axes in enumerate(rows):
        axes.plot(wiggle.stamp_s, wiggle.sines[:, a], ".", ms=3, color="#1f4fd8", label="markers")
        axes.plot(wiggle.stamp_s, told[:, a], lw=0.8, color="#d62728", label="encoders, delayed")
        axes.set(ylabel=f"sine of the tilt, {'xy'[a]}")
    rows[0].legend()
    delay = record.delay_s
    rows[0].set_title(
        f"delay {1e3 * delay.value:.2f} ms, 95 % {1e3 * delay.low:.2f} to {1e3 * delay.high:.2f}"
    )
    rows[1].set_xlabel("time [s]")
    return save(figure, path, source)


@our_style()
def level_figure(runs: Sequence[Rolling], record: LevelRecord, path: Path, source: str) -> Path:
    """Draw ball [mm] and servo angle [degrees] over time on both axes; runs: one for each axis.

    source: "simulated" or "measured". Returns `path`, a PNG file. OSError: it cannot be written.
    """
    figure, rows = subplots(2, 1, figsize=(8, 5), sharex=True)
    for axes, run, name in zip(rows, runs, ("x", "y"), strict=True):
        _ball_and_servo(axes, run, name)
        slope = record.slope_rad[name]
        axes.set_title(
            f"{name}: slope {np.degrees(slope.value):+.3f} degrees "
            f"({np.degrees(slope.low):+.3f} to {np.degrees(slope.high):+.3f})"
        )
    rows[1].set_xlabel("time [s]")
    return save(figure, path, source)


@our_style()
def save(figure, path: Path, source: str) -> Path:
    """Mark a figure with its source, write it as `path`. OSError: it cannot be."""
    from experiments.reports.figures import SOURCES

    figure.text(0.995, 0.005, SOURCES[source], ha="right", va="bottom", fontsize=9, color="0.4")
    return write_figure(figure, path)
