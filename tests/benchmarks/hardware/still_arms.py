"""Frozen encoders, blocked arms and healthy tables before the loop's monitor, all from one seed.

    python tests/benchmarks/hardware/still_arms.py --runs 120 --seed 1

Each run draws a table, which is homed as `rig home` does it, and what it does: balance, follow a
circle, follow squares on the servos. A third stays healthy, on tables that are worse than when they
were homed: friction twice as large, play of 3 degrees in gear and joint, gain and time constant
another unit's. Of the others an encoder freezes or an arm is held at a drawn moment. Prints a table
of false alarms, of the time until 0 V and of how far the arm had gone. Exit code 1 where a healthy
table was stopped or a frozen encoder let an arm come to its stop.
"""

import argparse
import sys
from dataclasses import dataclass, replace
from math import degrees, inf, pi, radians

import numpy as np

from experiments.runs.assemble import another_unit, known, load_rig
from experiments.runs.hardware import rehearse_home
from rig.course import Course
from rig.loop.loop import Loop
from rig.parameters import Rig
from rig.safety.levelling import LevelOnExit
from rig.safety.monitor import MonitorLimits
from rig.simulation.simulator import SimulatedTable
from rig.table import Reading

KINDS = ("healthy", "encoder frozen", "arm held")
WAYS = ("hold", "balance", "circle", "squares 0.03", "squares 0.1")
RUN_S = 4.0
BY_STALL = "stall"


class Spoilt(LevelOnExit):
    """A simulated table one of whose axes is spoilt from spoilt_s [s] on; arm_rad: where it went,
    by tick; pushed_s: when volts were last asked for that axis."""

    def __init__(
        self,
        rig: Rig,
        seed: int,
        start_m: tuple[float, float],
        kind: str,
        axis: int,
        spoilt_s: float,
    ) -> None:
        self._inner = SimulatedTable(rig, np.random.default_rng(seed), start_m=start_m)
        self.period_s, self.voltage_limit_V = self._inner.period_s, self._inner.voltage_limit_V
        self._kind, self._axis, self._spoilt_s = kind, axis, spoilt_s
        self._kept: float | None = None
        self.level_s = 0.0
        self.t_s, self.arm_rad, self.pushed_s = 0.0, [0.0], 0.0

    @property
    def is_spoilt(self) -> bool:
        return self.t_s >= self._spoilt_s

    def read(self) -> Reading:
        reading = self._inner.read()
        self.t_s = reading.t_s
        self.arm_rad.append(float(self._inner.truth()["arm_rad"][self._axis]))
        if not self.is_spoilt or self._kind != "encoder frozen":
            return reading
        theta = list(reading.theta_rad)
        self._kept = theta[self._axis] if self._kept is None else self._kept
        theta[self._axis] = self._kept
        return replace(reading, theta_rad=(theta[0], theta[1]))

    def drive(self, volts: tuple[float, float]) -> None:
        given = list(volts)
        self.pushed_s = self.t_s if given[self._axis] else self.pushed_s
        if self.is_spoilt and self._kind == "arm held":  # a hand takes what the motor gives
            given[self._axis] = 0.0
        self._inner.drive((given[0], given[1]))

    def close(self) -> None:
        self._inner.close()


def course(way: str) -> tuple[Course, tuple[float, float]]:
    """What a run asks for, and where its ball lies at first [m]."""
    n = round(500 * RUN_S)
    t_s, still = np.arange(n) / 500, np.zeros((n, 2))
    if way == "circle":
        turns = 2 * pi * t_s[:, None] / 8 + np.array([pi / 2, 0.0])
        return Course(0.05 * np.sin(turns), still, (0.05, 0.0)), (0.05, 0.0)
    if way.startswith("squares"):
        side = float(way.split()[1]) * np.where(t_s % 1.0 < 0.5, 1.0, -1.0)
        return Course(np.column_stack([side, side]), still, (0.0, 0.0), 0.0, True), (0.0, 0.0)
    start = (-0.08, 0.06) if way == "balance" else (0.0, 0.0)
    return Course(still, still, start), start


def worse(rig: Rig) -> Rig:
    """The table with twice the friction and 3 degrees of play in gear and joint."""
    effects = {name: {a: dict(v) for a, v in by.items()} for name, by in rig.effects.items()}
    for axis in ("x", "y"):
        for name in ("gear_backlash", "joint_backlash"):
            effects[name] = effects.get(name, {}) | {axis: {"play_rad": radians(3.0)}}
        friction = effects["coulomb_friction"][axis]
        friction["friction_V"] = 2 * friction["friction_V"]
    drive = replace(
        rig.drive,
        arm_friction_nm=2 * rig.drive.arm_friction_nm,
        joint_friction_nm=2 * rig.drive.joint_friction_nm,
    )
    return replace(rig, effects=effects, drive=drive)


@dataclass(frozen=True)
class Result:
    """How a run ended: outcome, seconds [s] and way of the arm [rad] from the fault to 0 V, its
    widest angle [rad]; inf, 0 and 0 where nobody saw it."""

    kind: str
    way: str
    outcome: str
    after_s: float
    gone_rad: float
    at_rad: float


def one(seed: int, number: int) -> Result:
    """One run, the same for the same arguments."""
    rng = np.random.default_rng([seed, number])
    kind, way = KINDS[number % 3], WAYS[int(rng.integers(len(WAYS)))]
    axis, spoilt_s = int(rng.integers(2)), float(rng.uniform(0.5, RUN_S - 2.0))
    compensator = int(rng.integers(2)) if not way.startswith("squares") else 0
    unit = load_rig(None) if rng.random() < 0.5 else another_unit(load_rig(None), number)
    breakaway_V = rehearse_home(unit).breakaway_V
    limits = MonitorLimits.of_rig(known(load_rig(None)), breakaway_V)
    true = worse(unit) if kind == "healthy" and rng.random() < 0.7 else unit
    asked, start_m = course(way)
    spoilt_s = inf if kind == "healthy" else spoilt_s
    table = Spoilt(true, number, start_m, kind, axis, spoilt_s)
    with table:
        outcome = (
            Loop(table, known(load_rig(None)), compensator, asked, limits=limits).run().outcome
        )
    if outcome != BY_STALL or kind == "healthy":
        return Result(kind, way, outcome, inf, 0.0, 0.0)
    begin = round(spoilt_s / table.period_s)
    went = np.array(table.arm_rad[begin:])
    after_s = max(table.pushed_s + table.period_s - spoilt_s, 0.0)
    return Result(kind, way, outcome, after_s, float(np.ptp(went)), float(np.abs(went).max()))


def table_of(results: list[Result]) -> str:
    """The figures, a line a kind and way."""
    lines = [f"{'':16}{'':14}runs  stalls  other ends  seconds to 0 V    way [deg]  widest [deg]"]
    for kind in KINDS:
        for way in WAYS:
            of = [r for r in results if (r.kind, r.way) == (kind, way)]
            seen = [r for r in of if r.outcome == BY_STALL]
            others = sum(r.outcome not in (BY_STALL, "completed") for r in of)
            figures = ""
            if seen and kind != "healthy":
                late = sorted(r.after_s for r in seen)
                figures = f"{late[len(late) // 2]:.2f}, worst {late[-1]:.2f}"
                figures += f"  {degrees(max(r.gone_rad for r in seen)):9.1f}"
                figures += f"  {degrees(max(r.at_rad for r in seen)):12.1f}"
            lines.append(f"{kind:16}{way:14}{len(of):4}  {len(seen):6}  {others:10}  {figures}")
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=120)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    results, bad = [], 0
    for number in range(arguments.runs):
        found = one(arguments.seed, number)
        results.append(found)
        false = found.kind == "healthy" and found.outcome == BY_STALL
        if false or (found.kind == "encoder frozen" and found.at_rad > 0.6):
            bad += 1
            print(f"seed {arguments.seed}, run {number}: {found}", flush=True)
    print(table_of(results))
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
