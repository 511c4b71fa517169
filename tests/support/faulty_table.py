"""A simulated table with faults on purpose, which writes down every volt it was given."""

import numpy as np

from experiments.runs.assemble import known, load_rig
from rig.course import Course
from rig.loop.loop import Loop
from rig.safety.levelling import LevelOnExit
from rig.simulation.simulator import SimulatedTable
from rig.table import Reading

TABLE = load_rig(None)
FAULT_S = 0.6


class FaultyTable(LevelOnExit):
    """`spoil(reading)` replaces every reading from FAULT_S on; `driven` is (t_s, x_V, y_V)."""

    def __init__(self, spoil=lambda reading: reading, start_m=(-0.08, 0.06)) -> None:
        self.inner = SimulatedTable(TABLE, np.random.default_rng(1), start_m=start_m)
        self.period_s, self.voltage_limit_V = self.inner.period_s, self.inner.voltage_limit_V
        self.spoil, self.t_s, self.closed = spoil, 0.0, False
        self.driven: list[tuple[float, float, float]] = []

    def read(self) -> Reading:
        reading = self.inner.read()
        self.t_s = reading.t_s
        return self.spoil(reading) if self.t_s >= FAULT_S else reading

    def drive(self, volts: tuple[float, float]) -> None:
        self.driven.append((self.t_s, *volts))
        self.inner.drive(volts)

    def close(self) -> None:
        self.closed = True
        self.inner.close()

    def arm(self) -> np.ndarray:
        return self.inner.truth()["arm_rad"]


def course(seconds: float = 2.0) -> Course:
    n = round(seconds * 500)
    return Course(np.zeros((n, 2)), np.zeros((n, 2)), (-0.08, 0.06))


def run(table: FaultyTable, **more):
    rows: list[np.ndarray] = []
    keep = more.pop("keep", lambda row: None)

    def both(row: np.ndarray) -> None:
        rows.append(row.copy())
        keep(row)

    with table:
        ending = Loop(table, known(TABLE), 0, course(), keep=both, **more).run()
    return ending, rows
