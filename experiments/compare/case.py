"""One cell of a comparison, tick by tick: what the compensators did and what they estimated."""

from dataclasses import dataclass

import numpy as np

from experiments.compare.grid import Cell, Grid, cells, run_requests
from experiments.runs.assemble import play_rad, simulated_table
from experiments.runs.protocol import course
from experiments.runs.runner import compensator_index
from rig.log import Log
from rig.loop.loop import Loop
from rig.parameters import Rig
from rig.simulation.operator import SimulatedOperator


@dataclass(frozen=True, eq=False)
class Traced:
    """A run of n ticks with signals of axis x that a log does not hold.

    reference_rad (n,): the servo's reference; plate_rad (n,): true plate angle at the servo;
    believed_rad (n, 2): break points of the adaptive inverse.
    """

    log: Log
    reference_rad: np.ndarray
    plate_rad: np.ndarray
    believed_rad: np.ndarray


@dataclass(frozen=True, eq=False)
class Case:
    """Runs of one cell by condition.

    joint_rad, offset_rad: width and middle of the joint's backlash.
    """

    title: str
    joint_rad: float
    offset_rad: float
    runs: dict[str, Traced]


def traced(request) -> Traced:
    """Make the run that `request`, a `RunRequest`, asks for, tick by tick, and keep what a log does
    not hold. ValueError: its protocol does not fit its rig.
    """
    way = course(request.protocol, request.rig, request.seed)
    table = simulated_table(request.rig, way, request.seed, None)
    rows, inside = [], []

    def keep(row: np.ndarray) -> None:
        control = loop.state["control"]
        rows.append(row.copy())
        c = control["compensators"]["adaptive"]["c"][0]
        inside.append((control["reference"][0], table.truth()["plate_rad"][0], c[0], c[1]))

    with table:
        loop = Loop(
            table,
            request.believed,
            compensator_index(request.arm),
            way,
            operator=SimulatedOperator(table, way.hold_s),
            keep=keep,
        )
        loop.run()
    seen = np.array(inside)
    return Traced(Log.from_rows(np.array(rows)), seen[:, 0], seen[:, 1], seen[:, 2:])


def telling_case(results: dict, rig: Rig, grid: Grid) -> Case:
    """Simulate again, with the first seed, the cell in which a condition gains most: of those
    without a fault on the protocol *hold* or, without such cells, of all. results: as of
    `run_comparison`.

    Its conditions are "without", the two best, and those that estimate the backlash.
    """
    held = [c for c in results["cells"] if not c["fault"] and c["protocol"] == "hold"]

    def gain(cell: dict) -> float:
        tests = [
            a["against_without"]["effect"] for a in cell["arms"].values() if "against_without" in a
        ]
        return max((t for t in tests if np.isfinite(t)), default=-np.inf)

    told = max(held or results["cells"], key=gain)
    cell = next(c for c in cells(grid) if c.key == told["key"])
    runs = {
        condition: traced(_first(rig, grid, cell, condition)) for condition in _shown(told, grid)
    }
    play = grid.plays[cell.play]
    widths = play_rad(rig, play.joint_deg), play_rad(rig, play.joint_offset_deg)
    return Case(cell.key, *widths, runs)


def _shown(told: dict, grid: Grid) -> list[str]:
    """Without, the two best, and the adaptive inverses (for what they learn)."""
    gains = {
        condition: a["against_without"]["effect"]
        for condition, a in told["arms"].items()
        if "against_without" in a
    }
    ranked = sorted(gains, key=lambda condition: -np.nan_to_num(gains[condition], nan=-9.0))[:2]
    learning = [
        condition
        for condition in ("with", "adaptive", "adaptive-asymmetric")
        if condition in grid.arms
    ]
    return list(dict.fromkeys(["without", *ranked, *learning]))


def _first(rig: Rig, grid: Grid, cell: Cell, condition: str):
    return run_requests(rig, grid, cell, condition)[0]
