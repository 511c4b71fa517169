"""`rig calibrate sheet`, `camera` and `table`: sheets to print, the lens, the level plate."""

from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from pathlib import Path

import numpy as np
import typer
from pydantic import ValidationError

from calibration.bundle import lens_record, markers_record, plate_record
from calibration.camera.camera_shift import FIXED_IDS, fixed_markers
from calibration.camera.lens import (
    MIN_VIEWS,
    CameraCalibration,
    calibrate_images,
    calibrate_views,
)
from calibration.camera.pages import write_pdf, write_png
from calibration.camera.pictures import refuse_blurred_pictures, refuse_wrong_sheet
from calibration.camera.plate import level_pose
from calibration.camera.prints import sheet_files
from calibration.camera.sheet import CalibrationError, Sheet, SheetView
from calibration.camera.virtual import sheet_pictures
from calibration.records import MarkersRecord
from experiments.calibrate.filmed import files_of
from experiments.calibrate.folder import CalibrationFolder, Source
from experiments.calibrate.pictures import camera_figure, coverage_picture, plate_picture
from experiments.calibrate.views import ViewPicker, pick
from experiments.calibrate.watch import Growing
from experiments.own_camera import opened, with_camera
from experiments.records.run_folder import writable
from experiments.runs.assemble import load_rig, virtual_renderer
from rig.files import first_error_line, json_of
from rig.foreign_trial import Tells
from rig.parameters import Rig
from vision.frames import Frame
from vision.plate.markers import MarkerLayout, default_layout
from vision.sources.sources import check_address, open_source
from vision.view import View

VIRTUAL_PICTURES = 24
DISTANCE_M = 0.05, 20.0  # of the plate from the camera; chosen


def sheet_of(squares: str, square_mm: float, marker_mm: float, dictionary: str) -> Sheet:
    """The calibration sheet that the command's options describe.

    squares: columns x rows, such as "11x8"; dictionary: OpenCV's name of the markers. ValueError:
    the options describe no sheet.
    """
    try:
        columns, rows = (int(part) for part in squares.lower().split("x"))
    except ValueError:
        raise ValueError(f"--squares {squares}: write columns x rows, for example 11x8") from None
    return Sheet(columns, rows, square_mm / 1e3, marker_mm / 1e3, dictionary)


def make_sheets(
    rig_file: Path | None, out: Path, *, paper: str, sheet: Sheet, plate_marker_mm: float
) -> list[Path]:
    """Write the sheets to print: charuco.pdf, plate.pdf, fixed.pdf, and their pages as PNG.

    Returns the paths of the PDF files. The PNG files have 300 dots an inch. paper: "a4", "a3",
    "letter", "legal" or "tabloid". ValueError: the paper is unknown or too small, or the rig file
    is wrong; OSError: `out` cannot be written.
    """
    side_m = load_rig(rig_file).linkage.side_m
    layout = default_layout(side_m, plate_marker_mm / 1e3)
    pages = sheet_files(sheet, layout, side_m, paper, FIXED_IDS)
    folder = writable(out)
    for name, some in pages.items():
        write_pdf(list(some), folder / f"{name}.pdf")
        for number, page in enumerate(some, 1):
            write_png(page, folder / (f"{name}.png" if len(some) == 1 else f"{name}-{number}.png"))
        typer.echo(f"{folder / name}.pdf: {len(some)} page(s) of {paper}")
    width, height = (1e3 * size for size in sheet.size_m)
    typer.echo(
        f"print at 100 % (not fitted to the page) and measure the ruler: the board is {width:g} x "
        f"{height:g} mm, squares of {1e3 * sheet.square_m:g} mm; tell rig calibrate what you "
        "measure (--square-mm, --marker-mm, --plate-marker-mm)"
    )
    return [folder / f"{name}.pdf" for name in pages]


def calibrate_camera(
    source: str | None,
    rig_file: Path | None,
    out: Path,
    *,
    sheet: Sheet,
    distance_m: float,
    most: int,
    seconds: float,
    seed: int,
    shown: Callable[[list[Path]], None] | None = None,
) -> CameraCalibration:
    """Measure the lens and keep it in `out`, with camera.png and coverage.png beside it.

    source: a folder of images, a video or a camera; None: the virtual camera, its pictures drawn
    from `seed`. distance_m: about the distance of the plate. `most` pictures are taken from a video
    or camera, a live one for at most `seconds`. shown: called with pictures of coverage and
    residuals as they grow. CalibrationError: the pictures are refused; only coverage.png is written
    then. ValueError, OSError: a folder or source that cannot be used.
    """
    _check_distance(distance_m)
    rig = load_rig(rig_file)
    folder = CalibrationFolder(out, _kind(source), rig)
    layout = default_layout(rig.linkage.side_m)
    if source is None or any(path.is_dir() for path in files_of(source)):
        growing = Growing(folder.path, sheet, shown) if shown else None
        shots = []
        for image in _virtual_shots(rig, sheet, seed) if source is None else _pictures(source):
            shots.append(image)
            if growing:
                growing.add(image)
        lens = calibrate_images(shots, sheet, distance_m=distance_m, layout=layout)
    else:
        lens = _from_frames(source, folder, sheet, distance_m, most, seconds, shown)
    pictures = [
        coverage_picture(lens.views, _size(lens), folder.path / "coverage.png"),
        camera_figure(lens, folder.path / "camera.png", folder.draft.source),
    ]
    folder.keep(
        "lens",
        data=files_of(source),
        pictures=pictures,
        warnings=lens.warnings,
        lens=lens_record(lens),
        plate=None,
        fixed=None,
    )
    fx = lens.camera.pinhole[0]
    typer.echo(
        f"lens: {len(lens.view_index)} pictures, rms {lens.rms_px:.3f} px, focal length {fx:.1f} "
        f"+- {lens.std['fx']:.1f} px, on the plate {lens.plate_std_mm:.3f} mm uncertain, half sets "
        f"{lens.half_set_mm:.3f} mm apart, {lens.coverage:.0%} of the image covered"
    )
    if not lens.scale_checked:
        typer.echo(
            "the lens does not depend on the squares' size, the plate's place may: let the sheet "
            "lie flat on the plate in one picture here or in rig calibrate table to check it"
        )
    return lens


def _check_distance(distance_m: float) -> None:
    least, most = DISTANCE_M
    if not least <= distance_m <= most:
        raise ValueError(
            f"--distance-mm {1e3 * distance_m:g}: must be {1e3 * least:g} to {1e3 * most:g}, about "
            "what a ruler tells from the camera to the plate"
        )


def _size(lens: CameraCalibration) -> tuple[int, int]:
    return lens.camera.width_px, lens.camera.height_px


def _kind(source: str | None) -> Source:
    """Where the frames come from. FileNotFoundError: nothing is there."""
    if source is None:
        return "simulated"
    check_address(source)
    return "measured"


def _virtual_shots(rig: Rig, sheet: Sheet, seed: int) -> Iterator[np.ndarray]:
    made = virtual_renderer(rig, np.random.default_rng([seed, 6]))
    yield from sheet_pictures(made, sheet, VIRTUAL_PICTURES, np.random.default_rng([seed, 7]))


def _pictures(source: str) -> Iterator[np.ndarray]:
    with open_source(source) as frames:
        for frame in frames:
            yield frame.image


def _from_frames(
    source: str,
    folder: CalibrationFolder,
    sheet: Sheet,
    distance_m: float,
    most: int,
    seconds: float,
    shown: Callable[[list[Path]], None] | None,
) -> CameraCalibration:
    """The lens from a video or a live camera, with a coverage picture that grows meanwhile."""

    def seen(tells: Tells) -> tuple[list[SheetView], list[np.ndarray], tuple[int, int]]:
        growing = Growing(folder.path, sheet, tells.say) if shown else None

        def show(picker: ViewPicker, frame: Frame, kept: bool) -> None:
            if growing:
                growing.look(frame.image, picker.views)
            elif live and kept:
                coverage_picture(picker.views, picker.size, folder.path / "coverage.png")
            if live and kept:
                typer.echo(f"picture {len(picker.views)} of {most}", err=True)

        with opened(source, tells) as frames:
            live = frames.live
            found = pick(frames, sheet, most=most, seconds=seconds if live else None, show=show)
        return found.views, found.samples, found.size

    views, samples, size = with_camera(source, seen, heard=shown or (lambda told: None))
    if not samples:
        raise CalibrationError(f"{source}: no frames")
    refuse_wrong_sheet(samples, sheet)
    if len(views) < MIN_VIEWS:
        refuse_blurred_pictures(samples, len(views))
    return calibrate_views(views, sheet, size, distance_m=distance_m)


def calibrate_table(
    source: str | None,
    rig_file: Path | None,
    out: Path,
    *,
    frames: int,
    plate_marker_mm: float,
    layout_file: Path | None,
    sheet: Sheet,
    seed: int,
) -> None:
    """Measure the pose of the level plate from `frames` frames of its markers; keep it in `out`.

    source: folder, video or camera; None: the virtual camera, its frames drawn from `seed`.
    layout_file: JSON of own markers (`calibration.records.MarkersRecord`); None: the printed ones
    of side `plate_marker_mm`. A `sheet` that lies on the plate checks the print's scale.
    CalibrationError: the frames are refused. ValueError: there is no lens yet, or the layout is
    wrong. OSError: a source or folder that cannot be used.
    """
    rig = load_rig(rig_file)
    folder = CalibrationFolder(out, _kind(source), rig)
    if folder.draft.lens is None:
        raise ValueError(f"{out} has no lens yet: run rig calibrate camera --out {out} first")
    camera_ = folder.draft.camera
    side_m = rig.linkage.side_m
    layout = _layout(layout_file) or default_layout(side_m, plate_marker_mm / 1e3)
    images = _level_frames(source, rig, frames, seed)
    pose = level_pose(images, camera_, layout, sheet)
    mm_per_px = 1e3 * float(pose.camera_from_plate[2, 3]) / camera_.pinhole[0]
    fixed = fixed_markers(images, layout, mm_per_px)
    picture = plate_picture(
        images[0], View(camera_, pose.camera_from_plate), layout, folder.path / "plate.png"
    )
    notes = []
    if fixed is None:
        notes.append(
            "no fixed markers beside the plate: a knocked camera will be seen by the plate's "
            "centre alone (rig calibrate sheet prints some)"
        )
    if pose.sheet_scale is None:
        notes.append(
            "the prints' scale was not checked: lay the lens's sheet flat on the plate and repeat"
        )
    folder.keep(
        "plate",
        data=[*files_of(source), *([layout_file] if layout_file else [])],
        pictures=[picture],
        warnings=notes if source is not None else (),
        plate=plate_record(pose, side_m),
        markers=markers_record(layout),
        ball_radius_m=rig.ball.radius_m,
        fixed=fixed,
    )
    typer.echo(
        f"plate: {pose.frames} frames, {1e3 * pose.camera_from_plate[2, 3]:.1f} mm away, markers "
        f"{pose.residual_mm:.3f} mm rms off the layout, {pose.scatter_mm:.3f} mm between frames"
        + (f", {len(fixed.ids)} fixed markers" if fixed else "")
    )


def _layout(path: Path | None) -> MarkerLayout | None:
    if path is None:
        return None
    if not path.is_file():
        raise FileNotFoundError(f"--layout {path}: no such file")
    try:
        record = MarkersRecord.model_validate(json_of(path))
    except ValidationError as error:
        raise ValueError(f"--layout {path}: {first_error_line(error, MarkersRecord)}") from None
    except ValueError as error:
        raise ValueError(f"--layout {path}: {error}") from None
    return MarkerLayout(np.array(record.ids), np.array(record.corners_m), record.dictionary)


def _level_frames(source: str | None, rig: Rig, frames: int, seed: int) -> Sequence[np.ndarray]:
    if source is None:
        made = virtual_renderer(rig, np.random.default_rng([seed, 8]))
        return [made.render(np.eye(3), None) for _ in range(frames)]

    def seen(tells: Tells) -> list[np.ndarray]:
        with opened(source, tells) as shots:
            return [frame.image for frame in islice(shots, frames)]

    return with_camera(source, seen)
