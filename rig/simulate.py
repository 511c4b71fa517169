"""Whole closed-loop runs in compiled code: the pilot, sensors and plant of the tick-by-tick loop.

A simulator is a function of its arguments: state, parameters, targets, pushes and every random
number come in; one row a tick goes out. Runs are independent, so a batch is split over threads
(the kernel holds no lock) and the answer does not depend on how many.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from os import cpu_count

import numpy as np

from rig import pilot, plant, statistical_camera
from rig.compiled import compiled
from rig.limits import limit
from rig.log import COLUMNS, Log
from rig.parameters import Rig
from rig.pilot import BLIND, pilot_tick
from rig.rows import fill_row
from rig.sensors import read_drives
from rig.signals import READING_SIZE, R_THETA, R_TIME, R_VARIANCE
from rig.statistical_camera import deliver, look, next_exposure

BLIND_TICKS_S = 1.0  # a ball unseen for so long ends the run


@dataclass(frozen=True, eq=False)
class Course:
    """What a run is asked to do, tick by tick: targets (n, 2) [m], pushes (n, 2) [m/s2].

    `start_m` is where the ball is placed; it is held for `hold_s` and then let go (0: free at once).
    """

    targets_m: np.ndarray
    pushes_m_s2: np.ndarray
    start_m: tuple[float, float] = (0.0, 0.0)
    hold_s: float = 0.0


@dataclass(frozen=True, eq=False)
class Draws:
    """Every random number of a run: camera (k, 3) normal, normal, uniform; tachometers (n, 2)."""

    camera: np.ndarray
    tachometer: np.ndarray


def draw(rng: np.random.Generator, ticks: int, frames: int) -> Draws:
    """Draw a run's numbers; a table that draws them block by block gets the same ones."""
    noise, drop, tachometer = rng.spawn(3)
    camera = np.empty((frames, 3))
    camera[:, :2] = noise.standard_normal((frames, 2))
    camera[:, 2] = drop.random(frames)
    return Draws(camera, tachometer.standard_normal((ticks, 2)))


@compiled
def _run(s, p, q, flight, camera, targets, pushes, hold_s, tick_s, eyes, tachometer, rows):
    """Fill `rows` (n, columns) tick by tick; returns how many are filled (n, less when lost)."""
    n = targets.shape[0]
    history = np.zeros((plant.HISTORY_TICKS, 2))
    reading, seen = np.full(READING_SIZE, np.nan), np.full(7, np.nan)
    wish, applied, covariance = np.zeros(2), np.zeros(2), np.zeros(3)
    blind = 0
    for k in range(n):
        t = k * tick_s
        reading[R_TIME] = t
        read_drives(s, p, tachometer[k], reading)
        deliver(camera, reading)
        pilot_tick(flight, q, reading, targets[k], applied, wish)
        for a in range(2):
            applied[a] = limit(wish[a], reading[R_THETA + a], q.voltage_limit, q.angle_limit)
        covariance[0] = covariance[2] = reading[R_VARIANCE]
        pushed = 1.0 if pushes[k, 0] != 0.0 or pushes[k, 1] != 0.0 else 0.0
        fill_row(rows[k], flight, reading, covariance, targets[k], pushed, wish, applied)
        blind = blind + 1 if flight.phase == BLIND else 0
        if blind * tick_s > BLIND_TICKS_S:
            return k + 1
        for i in range(plant.HISTORY_TICKS - 1, 0, -1):
            history[i, 0], history[i, 1] = history[i - 1, 0], history[i - 1, 1]
        history[0, 0], history[0, 1] = applied[0], applied[1]
        lost = plant.advance(
            s, p, history, t, tick_s, pushes[k, 0], pushes[k, 1], t < hold_s,
            next_exposure(camera), seen,
        )  # fmt: skip
        if lost:
            return k + 1
        look(camera, p, seen, eyes[min(camera.frame, eyes.shape[0] - 1)])
    return n


@dataclass(frozen=True, eq=False)
class Simulated:
    """A simulated run: its log and how it ended (completed | ball lost)."""

    log: Log
    outcome: str


def simulate(rig: Rig, known: Rig, arm: int, course: Course, draws: Draws) -> Simulated:
    """One closed-loop run of the plant `rig` under a controller that knows `known` (no effects)."""
    q = pilot.settings(known, arm)
    flight = pilot.start(q, held=course.hold_s > 0)
    rows = np.full((len(course.targets_m), len(COLUMNS)), np.nan)
    filled = _run(
        plant.rest(course.start_m), plant.pack(rig), q, flight,
        statistical_camera.start(known.camera.rate_hz),
        np.ascontiguousarray(course.targets_m), np.ascontiguousarray(course.pushes_m_s2),
        course.hold_s, 1 / known.control_rate_hz, draws.camera, draws.tachometer, rows,
    )  # fmt: skip
    return Simulated(
        Log.from_rows(rows[:filled]), "completed" if filled == len(rows) else "ball lost"
    )


def simulate_many(
    jobs: Sequence[Callable[[], Simulated]], *, done: Callable[[], None] | None = None
) -> list[Simulated]:
    """Run jobs (calls of `simulate` with bound arguments) on all cores, in order."""

    def one(job: Callable[[], Simulated]) -> Simulated:
        result = job()
        if done is not None:
            done()
        return result

    with ThreadPoolExecutor(cpu_count() or 1) as pool:
        return list(pool.map(one, jobs))
