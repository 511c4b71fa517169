"""One telling case of a comparison, tick by tick: what the arms did and what they believed."""

from dataclasses import dataclass
from math import radians

import numpy as np

from experiments.assemble import simulated_table
from experiments.compare_grid import Cell, Grid, cells, orders
from experiments.protocol import course
from experiments.runner import arm_number
from rig.hands import SimulatedHand
from rig.log import Log
from rig.loop import Loop
from rig.parameters import Rig


@dataclass(frozen=True, eq=False)
class Traced:
    """A run with what a log does not hold, on axis x: the servo's reference, the true plate angle,
    the adaptive break points (n, 2) [rad]."""

    log: Log
    reference_rad: np.ndarray
    plate_rad: np.ndarray
    believed_rad: np.ndarray


@dataclass(frozen=True, eq=False)
class Case:
    title: str
    joint_rad: float
    offset_rad: float
    runs: dict[str, Traced]


def traced(order) -> Traced:
    """An order's run through the loop, watched from inside."""
    way = course(order.protocol, order.rig, order.seed)
    table = simulated_table(order.rig, way, order.seed, None)
    rows, inside = [], []

    def keep(row: np.ndarray) -> None:
        control = loop.pilot["control"]
        rows.append(row.copy())
        c = control["arms"]["adaptive"]["c"][0]
        inside.append((control["reference"][0], table.truth()["plate_rad"][0], c[0], c[1]))

    with table:
        loop = Loop(table, order.believed, arm_number(order.arm), way,
                    hand=SimulatedHand(table, way.hold_s), keep=keep)  # fmt: skip
        loop.run()
    seen = np.array(inside)
    return Traced(Log.from_rows(np.array(rows)), seen[:, 0], seen[:, 1], seen[:, 2:])


def telling_case(results: dict, rig: Rig, grid: Grid) -> Case:
    """The cell held at the centre in which an arm gains most; its arms with the first seed."""
    held = [c for c in results["cells"] if not c["fault"] and c["protocol"] == "hold"]

    def gain(cell: dict) -> float:
        tests = [a["against_without"]["effect"] for a in cell["arms"].values()
                 if "against_without" in a]  # fmt: skip
        return float(np.nanmax(tests))

    told = max(held or results["cells"], key=gain)
    cell = next(c for c in cells(grid) if c.key == told["key"])
    runs = {arm: traced(_first(rig, grid, cell, arm)) for arm in _shown(told, grid)}
    play = grid.plays[cell.play]
    return Case(cell.key, radians(play.joint_deg), radians(play.joint_offset_deg), runs)


def _shown(told: dict, grid: Grid) -> list[str]:
    """Without, the two best, and the adaptive inverses (for what they learn)."""
    gains = {arm: a["against_without"]["effect"] for arm, a in told["arms"].items()
             if "against_without" in a}  # fmt: skip
    ranked = sorted(gains, key=lambda arm: -np.nan_to_num(gains[arm], nan=-9.0))[:2]
    learning = [arm for arm in ("with", "adaptive", "adaptive-asymmetric") if arm in grid.arms]
    return list(dict.fromkeys(["without", *ranked, *learning]))


def _first(rig: Rig, grid: Grid, cell: Cell, arm: str):
    return orders(rig, grid, cell, arm)[0]
