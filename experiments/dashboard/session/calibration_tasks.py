"""The steps of `rig calibrate` as the page asks for them; in a worker process, picklable."""

from dataclasses import dataclass
from pathlib import Path

from experiments.dashboard.desk import Tell
from experiments.dashboard.tasks import Shown
from rig.parameters import Rig

CALIBRATION_STEPS = ("camera", "table", "time", "level", "servo", "play")
SHEET = ("11x8", 24.0, 18.0, "DICT_5X5_50")
CAPTIONS = {
    "coverage.png": "Coverage: corners seen over the image",
    "residuals.png": "Residuals: how the pictures fit so far",
    "camera.png": "The lens: how sure, and each picture's fit",
}
NOT_REAL = {
    "servo": "a real table's gain and time constant come from its runs: record `steps`, then Gap",
    "play": "a real table's play is found from its runs: record `steps`, then Gap",
}


@dataclass(frozen=True)
class Measure:
    """A step of `rig calibrate`: of the virtual table, or (rig_file) of a real one through its
    camera and these recorded runs, newest first. *_mm: of the prints, as measured."""

    step: str
    rig: Rig
    out: Path
    seed: int = 1
    rig_file: Path | None = None
    runs: tuple[Path, ...] = ()
    square_mm: float = SHEET[1]
    plate_marker_mm: float = 24.0


def calibrate(what: Measure, tell: Tell) -> list[Shown]:
    """One step; its pictures, growing meanwhile. ValueError, OSError: refused, why."""
    from experiments import calibrate_camera as seeing
    from experiments import calibrate_motion as moving
    from experiments import calibrate_play as playing
    from rig.rigfile import write_rig

    step, out, seed, file = what.step, what.out, what.seed, what.rig_file
    source = what.rig.table.camera if file is not None else None
    out.mkdir(parents=True, exist_ok=True)
    if file is None:
        file = out / "table.toml"
        write_rig(what.rig, file)
    elif step in NOT_REAL:
        raise ValueError(NOT_REAL[step])
    elif step in ("camera", "table") and not source:
        raise ValueError("the rig file names no camera: set table.camera")
    elif step in ("time", "level") and not what.runs:
        raise ValueError(f"{step} is measured from recorded runs: record one with the ball first")
    squares, square_mm, marker_mm, book = SHEET
    printed = what.square_mm, what.square_mm * marker_mm / square_mm
    sheet = seeing.sheet_of(squares, *printed, book)
    tell(step, 0, 1)
    if step == "camera":
        seeing.camera(
            source, file, out, sheet=sheet, distance_m=0.75, most=40, seconds=180.0, seed=seed,
            shown=lambda pictures: tell.show([Shown(p, CAPTIONS[p.name]) for p in pictures]),
        )  # fmt: skip
    elif step == "table":
        seeing.table(source, file, out, frames=12, plate_marker_mm=what.plate_marker_mm,
                     layout_file=None, sheet=sheet, seed=seed)  # fmt: skip
    elif step == "time":
        run = what.runs[0] if what.runs else None
        moving.time(run, None, file, out, seconds=6.0, seed=seed)
    elif step == "level":
        moving.level(what.runs, file, out, seconds=40.0, seed=seed)
    elif step == "servo":
        moving.servo(file, out, seed=seed)
    elif step == "play":
        playing.play(file, out, seed=seed)
    else:
        raise ValueError(f"no step '{step}'; known: {', '.join(CALIBRATION_STEPS)}")
    tell(step, 1, 1)
    names = {"camera": ("coverage.png", "residuals.png", "camera.png"), "table": ("plate.png",)}
    pictures = [out / name for name in names.get(step, (f"{step}.png",))]
    known = CAPTIONS.get
    return [Shown(p, known(p.name) or f"{step}: data and fit") for p in pictures if p.is_file()]


def print_sheets(rig: Rig, out: Path, tell: Tell) -> Path:
    """The sheets for lens and plate as PDF, in one file to download."""
    from zipfile import ZipFile

    from experiments.calibrate_camera import make_sheets, sheet_of
    from rig.rigfile import write_rig

    tell("drawing the sheets", 0, 1)
    out.mkdir(parents=True, exist_ok=True)
    write_rig(rig, out / "table.toml")
    make_sheets(out / "table.toml", out, paper="a4", sheet=sheet_of(*SHEET), plate_marker_mm=24.0)
    with ZipFile(out / "sheets.zip", "w") as packed:
        for page in sorted(out.glob("*.pdf")):
            packed.write(page, page.name)
    return out / "sheets.zip"
