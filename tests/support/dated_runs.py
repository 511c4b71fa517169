"""Run folders of one table, a day apart, simulated at the batch kernel's speed."""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from experiments.records.recording import write_run
from rig import COMPENSATORS, Course, Rig, draw, simulate_many
from rig.log import Log
from rig.rigfile import to_record
from rig.simulation.simulate import Task

SECONDS, EVERY_S = 12.0, 2.0
FIRST_DAY = datetime(2026, 3, 1, 9, 0, tzinfo=UTC)


def step_logs(tables: Sequence[Rig], seed: int) -> list[Log]:
    """A run of random steps on each table, its controller without a model of play."""
    rng, tasks = np.random.default_rng(seed), []
    for table in tables:
        each = round(EVERY_S * table.control_rate_hz)
        points = rng.uniform(-0.045, 0.045, (round(SECONDS / EVERY_S), 2))
        targets = np.repeat(points, each, axis=0)
        course = Course(targets, np.zeros_like(targets))
        known = Rig(servo=table.servo, drive=table.drive)
        numbers = draw(rng, table, course)
        tasks.append(Task(table, known, COMPENSATORS["without"], course, numbers))
    runs = simulate_many(tasks)
    assert all(run.outcome == "completed" for run in runs)
    return [run.log for run in runs]


def write_runs(folder: Path, logs: Sequence[Log], rig: Rig, *, first_day: int = 0) -> list[Path]:
    """A run folder for each log, with the rig file that the controller knew."""
    made = []
    for day, log in enumerate(logs, first_day):
        created = FIRST_DAY + timedelta(days=day)
        path = folder / f"{created:%Y%m%dT%H%M%SZ}-steps-without"
        start = {"source": "simulated", "protocol": {"name": "steps"}, "arm": "without"}
        start |= {"seed": day, "rig": to_record(rig), "created": created.isoformat()}
        write_run(path, start, log, outcome="completed")
        made.append(path)
    return made
