"""The steps of `rig calibrate` as tasks for a worker process. Everything here can be pickled."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from experiments.dashboard.session.tasks import CaptionedPicture
from experiments.dashboard.session.worker_process import ProgressSender
from rig.files import write_whole
from rig.parameters import Rig

CALIBRATION_STEPS = ("camera", "table", "time", "level", "servo", "play")
SHEET = ("11x8", 24.0, 18.0, "DICT_5X5_50")
CAPTIONS = {
    "coverage.png": "Coverage: corners seen over the image",
    "residuals.png": "Residuals: how the pictures fit so far",
    "camera.png": "The lens: how sure, and each picture's fit",
}
NOT_REAL = {
    "servo": "gain and time constant of a real table's motors come from its runs: record `steps`, "
    "then Gap",
    "play": "a real table's play is found from its runs: record `steps`, then Gap",
}


def steps_of(rig: Rig, *, real: bool) -> tuple[str, ...]:
    """Steps that the rig's table allows, in their order; real: it is no virtual one.

    Where nobody measures the servos' angles the camera's delay shows with theirs alone, and level
    and play are seen through their answer: servos come first. Those of a real table are measured
    from its runs, if they take an angle.
    """
    steps = list(CALIBRATION_STEPS)
    if not rig.servo.has_angle:
        steps = ["camera", "table", "servo", "level", "play"]
    possible = {"servo"} if rig.servo.takes_angle else set()
    return tuple(s for s in steps if not (real and s in NOT_REAL and s not in possible))


@dataclass(frozen=True)
class CalibrationRequest:
    """A step of `rig calibrate` for the virtual table or, with `rig_file`, for a real one.

    A real table is measured through its camera and from recorded `runs`, newest first; square_mm
    and plate_marker_mm: sizes on the printed sheets, as measured.
    """

    step: str
    rig: Rig
    out: Path
    seed: int = 1
    rig_file: Path | None = None
    runs: tuple[Path, ...] = ()
    square_mm: float = SHEET[1]
    plate_marker_mm: float = 24.0


def calibration_step(
    request: CalibrationRequest, progress: ProgressSender
) -> list[CaptionedPicture]:
    """Do one step and return its pictures; those of the lens are also sent while they grow.

    The result is kept in `request.out`. ValueError, OSError: why the step was refused.
    """
    from experiments.calibrate.folder import table_file
    from rig.rigfile import write_rig

    _check_possible(request)
    step, out = request.step, request.out
    out.mkdir(parents=True, exist_ok=True)
    file = request.rig_file
    if file is None:
        file = out / table_file(step)
        write_rig(request.rig, file)
    progress(step, 0, 1)
    if step in ("camera", "table"):
        _measure_optics(request, file, progress)
    else:
        _measure_motion(request, file, progress)
    progress(step, 1, 1)
    names = {"camera": ("coverage.png", "residuals.png", "camera.png"), "table": ("plate.png",)}
    pictures = [out / name for name in names.get(step, (f"{step}.png",))]
    return [
        CaptionedPicture(path, CAPTIONS.get(path.name) or f"{step}: data and fit")
        for path in pictures
        if path.is_file()
    ]


def _check_possible(request: CalibrationRequest) -> None:
    """ValueError: no such step, or a real table that cannot do it."""
    step = request.step
    if step not in CALIBRATION_STEPS:
        raise ValueError(f"no step '{step}'; known: {', '.join(CALIBRATION_STEPS)}")
    if request.rig_file is None:
        return
    if step in NOT_REAL and step not in steps_of(request.rig, real=True):
        raise ValueError(NOT_REAL[step])
    if step in ("camera", "table") and not request.rig.table.camera:
        raise ValueError("the rig file names no camera: set table.camera")
    if step in ("time", "level", "servo") and not request.runs:
        raise ValueError(f"{step} is measured from recorded runs: record one with the ball first")


def _measure_optics(request: CalibrationRequest, file: Path, progress: ProgressSender) -> None:
    """The steps camera and table, through the camera of a real table or the virtual one."""
    from experiments.calibrate import camera

    source = request.rig.table.camera if request.rig_file is not None else None
    squares, square_mm, marker_mm, book = SHEET
    marker_mm = request.square_mm * marker_mm / square_mm
    sheet = camera.sheet_of(squares, request.square_mm, marker_mm, book)

    def show(pictures: Sequence[Path]) -> None:
        progress.show([CaptionedPicture(path, CAPTIONS[path.name]) for path in pictures])

    if request.step == "camera":
        camera.calibrate_camera(
            source,
            file,
            request.out,
            sheet=sheet,
            distance_m=0.75,
            most=40,
            seconds=180.0,
            seed=request.seed,
            shown=show,
        )
        return
    camera.calibrate_table(
        source,
        file,
        request.out,
        frames=12,
        plate_marker_mm=request.plate_marker_mm,
        layout_file=None,
        sheet=sheet,
        seed=request.seed,
    )


def _measure_motion(request: CalibrationRequest, file: Path, progress: ProgressSender) -> None:
    """The steps time, level, servo and play, from recorded runs or on the virtual table."""
    from experiments.calibrate import backlash, motion

    step, out, seed = request.step, request.out, request.seed
    if step == "time":
        run = request.runs[0] if request.runs else None
        motion.calibrate_time(run, None, file, out, seconds=6.0, seed=seed)
    elif step == "level":
        motion.calibrate_level(request.runs, file, out, seconds=40.0, seed=seed)
    elif step == "servo":
        newest = request.runs[:1] if request.rig.servo.has_angle else request.runs
        motion.calibrate_servo(newest, file, out, seed=seed)
    else:
        backlash.calibrate_backlash(file, out, seed=seed, progress=progress)


def print_sheets(rig: Rig, out: Path, progress: ProgressSender) -> Path:
    """Draw the sheets for lens and plate as PDF; returns the path of a ZIP file with them in `out`.

    ValueError: the plate or its markers do not fit; OSError: `out` cannot be written.
    """
    from io import BytesIO
    from zipfile import ZipFile

    from experiments.calibrate.camera import make_sheets, sheet_of
    from rig.rigfile import write_rig

    progress("drawing the sheets", 0, 1)
    out.mkdir(parents=True, exist_ok=True)
    write_rig(rig, out / "table.toml")
    made = make_sheets(
        out / "table.toml", out, paper="a4", sheet=sheet_of(*SHEET), plate_marker_mm=24.0
    )
    with BytesIO() as file:
        with ZipFile(file, "w") as packed:
            for page in made:
                packed.write(page, page.name)
        write_whole(out / "sheets.zip", file.getvalue())
    return out / "sheets.zip"
