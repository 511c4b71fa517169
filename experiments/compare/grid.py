"""The grid of a comparison as data (backlashes, frictions, courses, conditions, faults) and the
runs of its cells. In the TOML file conditions are `arms` and backlashes `plays`.
"""

from dataclasses import asdict, dataclass, replace
from importlib.resources import files
from pathlib import Path

from pydantic import Field, ValidationError

from experiments.runs.assemble import another_unit, play_rad
from experiments.runs.protocol import read_protocol
from experiments.runs.runner import RunRequest
from rig.control.controllers import COMPENSATORS
from rig.files import StrictModel, first_error_line, known_names, toml_of
from rig.parameters import Drive, Gains, Rig
from rig.rigfile import from_dict, to_dict

NO_FAULT = ""
KEPT = (  # of MEASURES, of every run; one of them is compared
    "settled_error",
    "servo_activity",
    "servo_rms",
    "settled_spread",
    "cycle_amplitude",
    "distance",
    "settled_distance",
)


class Backlash(StrictModel):
    """Backlash of gear and joint, the same on both axes [degrees at the servo of two rods].

    gear_deg, joint_deg: full widths; the offsets: middles of the play.
    """

    gear_deg: float = Field(default=0.0, ge=0, le=10)
    joint_deg: float = Field(default=0.0, ge=0, le=10)
    gear_offset_deg: float = 0.0
    joint_offset_deg: float = 0.0


class Friction(StrictModel):
    """Change of the table's friction.

    effects: added to the table's own, name -> axis -> key -> value; without: names of effects taken
    away; drive: replaced numbers of the rig file's [drive].
    """

    effects: dict[str, dict[str, dict[str, float]]] = {}
    without: list[str] = []
    drive: dict[str, float] = {}


class GridCourse(StrictModel):
    """A protocol of the grid and the frictions that it is run with (none named: all).

    duration_s: None for the protocol's own.
    """

    protocol: str
    duration_s: float | None = Field(default=None, gt=1, le=600)
    frictions: list[str] = []


class Retuned(StrictModel):
    """Gains of a PID without compensator that replace the table's own, as in
    `rig.parameters.Gains`.
    """

    proportional_rad_m: float = Field(gt=0)
    derivative_rad_s_m: float = Field(gt=0)


class Fault(StrictModel):
    """What the controller does not know.

    play_factor: factor on its estimate of the play; camera_late_s: further delay of the camera;
    camera_rate: factor on the camera's rate.
    """

    play_factor: float = Field(default=1.0, ge=0, le=5)
    camera_late_s: float = Field(default=0.0, ge=0, le=0.1)
    camera_rate: float = Field(default=1.0, gt=0, le=1)


class Robustness(StrictModel):
    """Faults by name that the controllers do not know of; plays: names of the backlashes, and
    protocol, that they are run with.
    """

    plays: list[str] = []
    protocol: str = "hold"
    faults: dict[str, Fault] = {}


class PaperCell(StrictModel):
    """The cell that stands for the paper's claim, by names of the grid."""

    play: str
    friction: str
    protocol: str


class Grid(StrictModel):
    """A comparison as its TOML file says it; unknown keys are errors.

    seeds: paired seeds for each cell, from `first_seed` on; measure: compared number, one of
    KEPT; arms: conditions; plays: backlashes; retuned: PIDs compared at equal servo activity;
    paper: the cell that stands for the paper's claim.
    """

    title: str
    seeds: int = Field(ge=6, le=1000)
    first_seed: int = Field(default=7000, ge=0)
    measure: str = "settled_error"
    arms: list[str] = Field(min_length=2)
    paper: PaperCell
    plays: dict[str, Backlash] = Field(min_length=1)
    frictions: dict[str, Friction] = Field(min_length=1)
    courses: list[GridCourse] = Field(min_length=1)
    retuned: list[Retuned] = []
    robustness: Robustness = Robustness()


@dataclass(frozen=True)
class Cell:
    """One cell of the grid, by names of the grid; fault "": none."""

    play: str
    friction: str
    protocol: str
    fault: str = NO_FAULT

    @property
    def key(self) -> str:
        """The names joined by " | ", which identify the cell in results.json."""
        return " | ".join(part for part in asdict(self).values() if part)


def read_grid(path: Path | None, *, takes_angle: bool = False) -> Grid:
    """The grid of a TOML file; None: the shipped one, of servos that take volts or an angle.

    ValueError (one line): the file is missing, no TOML, or has a wrong key, value or name.
    """
    shipped = "position.toml" if takes_angle else "default.toml"
    source = path or Path(str(files("experiments") / "grids" / shipped))
    if not source.is_file():
        raise ValueError(f"grid file {source} not found")
    try:
        grid = Grid.model_validate(toml_of(source))
    except ValidationError as error:
        raise ValueError(f"{source}: {first_error_line(error, Grid)}") from None
    except ValueError as error:
        raise ValueError(f"{source}: {error}") from None
    _check(grid, str(source))
    return grid


def _check(grid: Grid, label: str) -> None:
    """ValueError unless every name is known and "without", the reference of all tests, is there."""
    for condition in grid.arms:
        if condition not in COMPENSATORS:
            known = known_names(condition, COMPENSATORS)
            raise ValueError(f"{label}: unknown arm '{condition}'; {known}")
    if "without" not in grid.arms:
        raise ValueError(f"{label}: arms lack 'without', against which all others are compared")
    if grid.measure not in KEPT:
        known = known_names(grid.measure, KEPT)
        raise ValueError(f"{label}: measure = '{grid.measure}'; {known}")
    _check_once(grid, label)
    courses, drive = [c.protocol for c in grid.courses], Drive.__dataclass_fields__
    names = [
        (grid.paper.protocol, courses, "protocol of the paper"),
        *((key, drive, "key of drive") for f in grid.frictions.values() for key in f.drive),
        *((p, grid.plays, "play") for p in [*grid.robustness.plays, grid.paper.play]),
        *((f, grid.frictions, "friction") for c in grid.courses for f in c.frictions),
        (grid.paper.friction, grid.frictions, "friction"),
    ]
    for name, known, what in names:
        if name not in known:
            raise ValueError(f"{label}: unknown {what} '{name}'; {known_names(name, known)}")


def _check_once(grid: Grid, label: str) -> None:
    """ValueError where something counts twice, or its first for all, or a course has no ball."""
    lists = {
        "arm": grid.arms,
        "retuned PID": retuned_names(grid),
        "course of": [course.protocol for course in grid.courses],
    }
    for what, all_of_them in lists.items():
        for name in all_of_them:
            if all_of_them.count(name) > 1:
                raise ValueError(f"{label}: {what} '{name}' stands there twice: leave one out")
    if NO_FAULT in grid.robustness.faults:
        raise ValueError(f"{label}: a fault has no name: name it")
    for name in lists["course of"]:
        if read_protocol(name).servo_only:
            raise ValueError(f"{label}: protocol '{name}' is without a ball: nothing to compare")


def cells(grid: Grid) -> list[Cell]:
    """Every cell of the grid, those with a fault last."""
    plain = [
        Cell(play, friction, course.protocol)
        for course in grid.courses
        for play in grid.plays
        for friction in course.frictions or grid.frictions
    ]
    friction, protocol = next(iter(grid.frictions)), grid.robustness.protocol
    faulty = [
        Cell(play, friction, protocol, fault)
        for play in grid.robustness.plays
        for fault in grid.robustness.faults
    ]
    return plain + faulty


def retuned_names(grid: Grid) -> list[str]:
    """Names of the conditions "without" with retuned gains."""
    return [f"retuned {g.proportional_rad_m:g}, {g.derivative_rad_s_m:g}" for g in grid.retuned]


def table_of(rig: Rig, grid: Grid, cell: Cell) -> Rig:
    """Kind of table in a cell: the rig with the cell's play, friction and fault of the camera.

    ValueError: the rig file does not allow such a table.
    """
    play, friction = grid.plays[cell.play], grid.frictions[cell.friction]
    for name in friction.without:
        if name not in rig.catalogue:
            known = known_names(name, rig.catalogue)
            raise ValueError(
                f"friction '{cell.friction}' without: unknown effect '{name}'; {known}"
            )
    effects = {name: by for name, by in rig.effects.items() if name not in friction.without}
    if rig.servo.takes_angle and play.gear_deg:
        raise ValueError(
            f"play '{cell.play}' of the grid: servos that take an angle have no gear_deg"
        )
    for where in ("joint",) if rig.servo.takes_angle else ("gear", "joint"):
        width, off = getattr(play, f"{where}_deg"), getattr(play, f"{where}_offset_deg")
        pair = {"play_rad": play_rad(rig, width), "offset_rad": play_rad(rig, off)}
        effects[f"{where}_backlash"] = {"x": pair, "y": dict(pair)}
    effects |= friction.effects
    fault = grid.robustness.faults.get(cell.fault, Fault())
    if fault.camera_late_s:
        effects["camera_delay"] = {"xy": {"extra_s": fault.camera_late_s}}
    camera = replace(rig.camera, rate_hz=rig.camera.rate_hz * fault.camera_rate)
    drive = replace(rig.drive, **friction.drive)
    return from_dict(to_dict(replace(rig, effects=effects, camera=camera, drive=drive)), rig.own)


def run_requests(rig: Rig, grid: Grid, cell: Cell, condition: str) -> list[RunRequest]:
    """Runs of a condition in a cell, one for each seed.

    Every condition gets the same units (`another_unit`) and random numbers of a seed. ValueError:
    the rig file does not allow the cell's table, or its protocol is wrong.
    """
    kind = table_of(rig, grid, cell)
    course = next((c for c in grid.courses if c.protocol == cell.protocol), None)
    plan = read_protocol(cell.protocol)
    if course is not None and course.duration_s is not None:
        plan = plan.model_copy(update={"duration_s": course.duration_s})
    believed, name = kind, condition
    fault = grid.robustness.faults.get(cell.fault, Fault())
    if fault.play_factor != 1.0:
        believed = replace(kind, play=replace(kind.play, factor=fault.play_factor))
    if condition in retuned_names(grid):
        name = "without"
        believed = replace(believed, gains=_gains(kind.gains, grid, condition))
    seeds = range(grid.first_seed, grid.first_seed + grid.seeds)
    return [RunRequest(another_unit(kind, s), plan, name, s, Path(), kind=believed) for s in seeds]


def _gains(gains: Gains, grid: Grid, condition: str) -> Gains:
    return replace(gains, **grid.retuned[retuned_names(grid).index(condition)].model_dump())
