"""Closed-loop logs of the MuJoCo table: the arguments, draws and columns of the foreign table's."""

from math import ceil
from typing import Any

import numpy as np

from experiments.benchmark.engines.foreign import table as foreign_table
from experiments.benchmark.engines.foreign.parts import Course, Eye, Odd, Pilot, Plant, packed
from experiments.benchmark.engines.foreign.plant import (
    COUNT_RAD,
    HALF_M,
    RADIUS_M,
    VOLTS_HOLD_S,
    _look,
    _pilot,
)
from experiments.benchmark.engines.mujoco_engine.hidden import BLOCK_S, STEP_S, HiddenTable, Moved


class _Camera:
    """Takes the course's frames and hands each over when its time has come."""

    def __init__(self, eye: Eye, frames: np.ndarray) -> None:
        self._record, self._frames, self._delay = packed(eye), frames, eye.delay
        self._shots, self._taken, self._given = np.zeros((len(frames), 3)), 0, 0

    def look(self, t: float, h: float, before: Moved, after: Moved) -> None:
        """Take the frame exposed between t and t + h, if there is one."""
        while self._taken < len(self._frames) and self._frames[self._taken, 0] <= t + h:
            part = (self._frames[self._taken, 0] - t) / h
            x, y = before.xy_m + part * (after.xy_m - before.xy_m)
            _look(self._record, self._frames[self._taken], x, y, self._shots[self._taken])
            self._taken += 1

    def newest(self, t: float) -> np.ndarray | None:
        """Position and claimed time of exposure (3,) of the newest frame now in use."""
        found = None
        while self._given < self._taken and self._shots[self._given, 2] + self._delay <= t + 1e-9:
            if self._frames[self._given, 3] == 0.0:
                found = self._shots[self._given]
            self._given += 1
        return found


def _drive(table: HiddenTable, camera: _Camera, pilot: Pilot, course: Course) -> np.ndarray:
    """Rows of the run, (n, 13) as the foreign table's; fewer where the ball fell."""
    n, dt, h = len(course.target), course.dt, course.dt / course.sub
    record, steps = packed(pilot), ceil(h / STEP_S - 1e-9)
    rows, commands = np.full((n, 13), np.nan), np.zeros((2, n))
    volts, now = np.zeros(2), Moved(course.ball[:2], course.ball[2:4], RADIUS_M)
    seen = course.ball[:2].copy()
    memory = np.array([seen, np.zeros(2)])
    for i in range(n):
        t, row = i * dt, rows[i]
        frame = camera.newest(t)
        if frame is not None:
            seen[:] = row[5:7] = frame[:2]
            row[12] = frame[2]
        theta = np.floor(table.table.angles()[1] / COUNT_RAD + 0.5) * COUNT_RAD
        _pilot(record, dt, course.target[i], seen, memory, theta, course.has_ball, volts)
        commands[:, i] = volts
        row[0], row[1:3], row[3:5], row[7:9] = t, volts, theta, table.motor_speeds()
        row[9:11], row[11] = course.target[i], float(course.push[i].any())
        for j in range(course.sub):
            start = t + j * h
            at = table.volts(commands, dt, start, h) + course.volts_noise[int(start / VOLTS_HOLD_S)]
            push = course.push[i] + course.kicks[i * course.sub + j] / h
            before, now = now, table.move(at, push, now, start, steps)
            camera.look(start, h, before, now)
        if np.abs(now.xy_m).max() > HALF_M or now.height_m < 0.5 * RADIUS_M:
            return rows[: i + 1]
    return rows


def run(plant: Plant, eye: Eye, odd: Odd, pilot: Pilot, course: Course) -> np.ndarray:
    """Rows (n, 13) of a course on the mechanism, in the order of the foreign table's COLUMNS."""
    h = course.dt / course.sub
    start = course.ball if course.has_ball else None
    table = HiddenTable(plant, odd, start, h / ceil(h / STEP_S - 1e-9))
    frames = course.frames if course.has_ball else course.frames[:0]
    return _drive(table, _Camera(eye, frames), pilot, course)


def make_log(protocol: str, *, seed: int, **options: Any) -> dict[str, np.ndarray]:
    """As `foreign_table.make_log`, whose `hidden` gives the truth; about 3 s for 30 s of log.

    Dry friction is never below the mechanism's own 0.012 V; plays start in their middle.
    """
    return foreign_table.make_log(protocol, seed=seed, mechanism=run, step_s=BLOCK_S, **options)
