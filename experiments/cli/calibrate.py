"""The commands `rig calibrate ...`: every number that a rig needs, with the data it came from."""

from pathlib import Path
from typing import Annotated

import typer

calibrate = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Measure camera, plate, delay and servos. One folder holds one calibration.",
)

RigOption = Annotated[
    Path | None, typer.Option("--rig", help="rig.toml; without it the default virtual table.")
]
OutOption = Annotated[Path, typer.Option("--out", help="The calibration's folder; it grows.")]
SeedOption = Annotated[int, typer.Option(min=0, help="Seed of the virtual table and camera.")]
OUT = Path("out/calibration")

Squares = Annotated[str, typer.Option(help="Columns x rows of the printed sheet.")]
SquareMm = Annotated[float, typer.Option(help="Side of a square, as measured on the print.")]
MarkerMm = Annotated[float, typer.Option(help="Side of a marker in a square.")]
Dictionary = Annotated[str, typer.Option(help="OpenCV's name of the sheet's markers.")]
PlateMarkerMm = Annotated[float, typer.Option(help="Side of the plate's markers.")]


@calibrate.command()
def sheet(
    rig: RigOption = None,
    out: OutOption = Path("out/sheets"),
    paper: Annotated[str, typer.Option(help="a4, a3, letter, legal or tabloid.")] = "a4",
    squares: Squares = "11x8",
    square_mm: SquareMm = 24.0,
    marker_mm: MarkerMm = 18.0,
    dictionary: Dictionary = "DICT_5X5_50",
    plate_marker_mm: PlateMarkerMm = 24.0,
) -> None:
    """Sheets to print at 100 %. The board for the lens, the markers for the plate and beside it."""
    from experiments.calibrate import camera as work

    board = work.sheet_of(squares, square_mm, marker_mm, dictionary)
    work.make_sheets(rig, out, paper=paper, sheet=board, plate_marker_mm=plate_marker_mm)


@calibrate.command()
def camera(
    source: Annotated[
        str | None,
        typer.Argument(help="Image folder, video or camera address; none: the virtual camera."),
    ] = None,
    rig: RigOption = None,
    out: OutOption = OUT,
    squares: Squares = "11x8",
    square_mm: SquareMm = 24.0,
    marker_mm: MarkerMm = 18.0,
    dictionary: Dictionary = "DICT_5X5_50",
    distance_mm: Annotated[
        float, typer.Option(help="About how far the plate is from the camera.")
    ] = 750.0,
    pictures: Annotated[int, typer.Option(min=15, help="Most pictures from a video.")] = 40,
    seconds: Annotated[
        float, typer.Option(min=1, max=86400, help="Longest wait for a live camera.")
    ] = 180.0,
    seed: SeedOption = 1,
) -> None:
    """The lens, from pictures of the printed sheet. Refuses what would not be trusted."""
    from experiments.calibrate import camera as work

    board = work.sheet_of(squares, square_mm, marker_mm, dictionary)
    work.calibrate_camera(
        source,
        rig,
        out,
        sheet=board,
        distance_m=distance_mm / 1e3,
        most=pictures,
        seconds=seconds,
        seed=seed,
    )


@calibrate.command()
def table(
    source: Annotated[
        str | None,
        typer.Argument(help="Frames of the level plate: folder, video, camera; none: virtual."),
    ] = None,
    rig: RigOption = None,
    out: OutOption = OUT,
    frames: Annotated[
        int, typer.Option(min=3, max=1000, help="How many frames are looked at.")
    ] = 12,
    plate_marker_mm: PlateMarkerMm = 24.0,
    layout: Annotated[
        Path | None, typer.Option(help="JSON with dictionary, ids and corners_m of own markers.")
    ] = None,
    squares: Squares = "11x8",
    square_mm: SquareMm = 24.0,
    marker_mm: MarkerMm = 18.0,
    dictionary: Dictionary = "DICT_5X5_50",
    seed: SeedOption = 1,
) -> None:
    """Where the level plate is, from its markers. With the lens's sheet lying flat on the plate
    the print's scale is checked, too."""
    from experiments.calibrate import camera as work

    board = work.sheet_of(squares, square_mm, marker_mm, dictionary)
    work.calibrate_table(
        source,
        rig,
        out,
        frames=frames,
        plate_marker_mm=plate_marker_mm,
        layout_file=layout,
        sheet=board,
        seed=seed,
    )


@calibrate.command(name="time")
def time_(
    run: Annotated[
        Path | None, typer.Argument(help="Run folder or log of a wiggle; none: virtual table.")
    ] = None,
    video: Annotated[
        str | None, typer.Option(help="The run's frames (its clock); else the ball tells.")
    ] = None,
    rig: RigOption = None,
    out: OutOption = OUT,
    seconds: Annotated[
        float, typer.Option(min=3, max=3600, help="Length of the virtual wiggle.")
    ] = 6.0,
    seed: SeedOption = 1,
) -> None:
    """How late the camera's frames are stamped, against the encoders."""
    from experiments.calibrate import motion as work

    work.calibrate_time(run, video, rig, out, seconds=seconds, seed=seed)


@calibrate.command()
def level(
    runs: Annotated[
        list[Path] | None,
        typer.Argument(help="Runs in which the ball is led about; none: virtual table."),
    ] = None,
    rig: RigOption = None,
    out: OutOption = OUT,
    seconds: Annotated[
        float, typer.Option(min=12, max=3600, help="Length of the virtual run.")
    ] = 40.0,
    seed: SeedOption = 1,
) -> None:
    """How far from level the plate is at servo angle zero. And whether angles push the ball the
    right way."""
    from experiments.calibrate import motion as work

    work.calibrate_level(runs or [], rig, out, seconds=seconds, seed=seed)


@calibrate.command()
def servo(
    runs: Annotated[
        list[Path] | None,
        typer.Argument(help="Runs of servos that take an angle; none: virtual table."),
    ] = None,
    video: Annotated[
        str | None, typer.Option(help="A run's frames (its clock): the plate's markers tell.")
    ] = None,
    rig: RigOption = None,
    out: OutOption = OUT,
    seed: SeedOption = 1,
) -> None:
    """Motors: volts, gain, signs; servos told an angle: lag, limits.

    Of motors that are given volts: breakaway volts, gain, time constant and signs, in both
    directions, without a ball.

    Of servos that take an angle: lag, dead time, limits and dead band from the angle that they read
    back, or from the plate's markers in frames; else lag and dead time from a ball that is led
    about.
    """
    from experiments.calibrate import motion as work
    from experiments.cli.console import bars

    with bars() as progress:
        work.calibrate_servo(runs or [], rig, out, seed=seed, video=video, progress=progress)


@calibrate.command()
def play(
    rig: RigOption = None,
    out: OutOption = OUT,
    seed: SeedOption = 1,
    motor_only: Annotated[
        bool, typer.Option("--motor-only", help="Tachometer and volts alone.")
    ] = False,
) -> None:
    """How much play, where, and whether it is symmetric. Plans and runs its own motion."""
    from experiments.calibrate import backlash as work

    work.calibrate_backlash(rig, out, seed=seed, motor_only=motor_only)
