"""The grid of a comparison as data: plays, frictions, courses, arms, faults; its cells' runs."""

import tomllib
from dataclasses import asdict, dataclass, replace
from importlib.resources import files
from math import radians
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from experiments.assemble import another_unit
from experiments.numbers import MEASURES
from experiments.protocol import read_protocol
from experiments.runner import Order
from rig.controllers import ARMS
from rig.parameters import Gains, Rig
from rig.rigfile import from_dict, to_dict

NO_FAULT = ""


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Play(_Strict):
    """Full widths at the servo and where their middles lie [degrees]; both axes alike."""

    gear_deg: float = Field(default=0.0, ge=0, le=10)
    joint_deg: float = Field(default=0.0, ge=0, le=10)
    gear_offset_deg: float = 0.0
    joint_offset_deg: float = 0.0


class Friction(_Strict):
    """Effects added to and taken from the table's own; `drive`: other numbers of [drive]."""

    effects: dict[str, dict[str, dict[str, float]]] = {}
    without: list[str] = []
    drive: dict[str, float] = {}


class Course(_Strict):
    """A protocol, its length if another, and the frictions it is run with (none: all)."""

    protocol: str
    duration_s: float | None = Field(default=None, gt=1, le=600)
    frictions: list[str] = []


class Retuned(_Strict):
    """Gains of the PID alone."""

    proportional_rad_m: float = Field(gt=0)
    derivative_rad_s_m: float = Field(gt=0)


class Fault(_Strict):
    """What is wrong besides: the play estimate, the camera's unknown lateness, its rate."""

    play_factor: float = Field(default=1.0, ge=0, le=5)
    camera_late_s: float = Field(default=0.0, ge=0, le=0.1)
    camera_rate: float = Field(default=1.0, gt=0, le=1)


class Robustness(_Strict):
    plays: list[str] = []
    protocol: str = "hold"
    faults: dict[str, Fault] = {}


class Place(_Strict):
    play: str
    friction: str
    protocol: str


class Grid(_Strict):
    """A comparison. `paper`: the cell that stands for the paper's claim."""

    title: str
    seeds: int = Field(ge=6, le=1000)
    first_seed: int = Field(default=7000, ge=0)
    measure: str = "settled_error"
    arms: list[str] = Field(min_length=2)
    paper: Place
    plays: dict[str, Play] = Field(min_length=1)
    frictions: dict[str, Friction] = Field(min_length=1)
    courses: list[Course] = Field(min_length=1)
    retuned: list[Retuned] = []
    robustness: Robustness = Robustness()


@dataclass(frozen=True)
class Cell:
    """One place of the map, by names of the grid; fault "" is none."""

    play: str
    friction: str
    protocol: str
    fault: str = NO_FAULT

    @property
    def key(self) -> str:
        return " | ".join(part for part in asdict(self).values() if part)


def read_grid(path: Path | None) -> Grid:
    """The grid of a TOML file or the shipped one. ValueError (one line) on any mistake."""
    source = path or Path(str(files("experiments") / "grids" / "default.toml"))
    if not source.is_file():
        raise ValueError(f"grid file {source} not found")
    try:
        grid = Grid.model_validate(tomllib.loads(source.read_text(encoding="utf-8")))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{source}: not a TOML file ({error})") from None
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise ValueError(f"{source}: {where}: {first['msg']}") from None
    _check(grid, str(source))
    return grid


def _check(grid: Grid, label: str) -> None:
    """Every name means something; the arm "without", against which all stand, is there."""
    for arm in grid.arms:
        if arm not in ARMS:
            raise ValueError(f"{label}: unknown arm '{arm}'; known: {', '.join(ARMS)}")
    if "without" not in grid.arms:
        raise ValueError(f"{label}: arms lack 'without', against which all others are compared")
    if grid.measure not in MEASURES:
        raise ValueError(f"{label}: measure = '{grid.measure}'; known: {', '.join(MEASURES)}")
    names = [
        *((p, grid.plays, "play") for p in [*grid.robustness.plays, grid.paper.play]),
        *((f, grid.frictions, "friction") for c in grid.courses for f in c.frictions),
        (grid.paper.friction, grid.frictions, "friction"),
    ]
    for name, known, what in names:
        if name not in known:
            raise ValueError(f"{label}: unknown {what} '{name}'; known: {', '.join(known)}")


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
    """Names of the arms "without" with other gains."""
    return [f"retuned {g.proportional_rad_m:g}, {g.derivative_rad_s_m:g}" for g in grid.retuned]


def table_of(rig: Rig, grid: Grid, cell: Cell) -> Rig:
    """The kind of table that the cell has: play, friction, and what is wrong with its camera."""
    play, friction = grid.plays[cell.play], grid.frictions[cell.friction]
    effects = {name: by for name, by in rig.effects.items() if name not in friction.without}
    for where in ("gear", "joint"):
        width, off = getattr(play, f"{where}_deg"), getattr(play, f"{where}_offset_deg")
        pair = {"play_rad": radians(width), "offset_rad": radians(off)}
        effects[f"{where}_backlash"] = {"x": pair, "y": dict(pair)}
    effects |= friction.effects
    fault = grid.robustness.faults.get(cell.fault, Fault())
    if fault.camera_late_s:
        effects["camera_delay"] = {"xy": {"extra_s": fault.camera_late_s}}
    camera = replace(rig.camera, rate_hz=rig.camera.rate_hz * fault.camera_rate)
    drive = replace(rig.drive, **friction.drive)
    return from_dict(to_dict(replace(rig, effects=effects, camera=camera, drive=drive)))


def orders(rig: Rig, grid: Grid, cell: Cell, arm: str) -> list[Order]:
    """The runs of an arm in a cell, one a seed: the same units and draws for every arm."""
    kind = table_of(rig, grid, cell)
    course = next((c for c in grid.courses if c.protocol == cell.protocol), None)
    plan = read_protocol(cell.protocol)
    if course is not None and course.duration_s is not None:
        plan = plan.model_copy(update={"duration_s": course.duration_s})
    believed, name = kind, arm
    fault = grid.robustness.faults.get(cell.fault, Fault())
    if fault.play_factor != 1.0:
        believed = replace(kind, play=replace(kind.play, factor=fault.play_factor))
    if arm in retuned_names(grid):
        name = "without"
        believed = replace(believed, gains=_gains(kind.gains, grid, arm))
    seeds = range(grid.first_seed, grid.first_seed + grid.seeds)
    return [Order(another_unit(kind, s), plan, name, s, Path(), kind=believed) for s in seeds]


def _gains(gains: Gains, grid: Grid, arm: str) -> Gains:
    return replace(gains, **grid.retuned[retuned_names(grid).index(arm)].model_dump())
