"""Whole closed-loop runs in compiled code: the pilot, sensors and plant of the tick-by-tick loop.

A simulator is a function of its arguments: state, parameters, targets, pushes and every random
number come in; one row a tick goes out. Runs are independent, so a batch is split over threads
(the kernel holds no lock) and the answer does not depend on how many.
"""

from dataclasses import dataclass
from math import ceil

import numpy as np

from rig import pilot, plant, plant_record, statistical_camera
from rig.compiled import compiled, inlined
from rig.limits import limit
from rig.log import COLUMNS, Log
from rig.parameters import ANGLE_MARGIN_RAD, Rig
from rig.pilot import BLIND, HOLD, pilot_tick
from rig.plant import SEEN_T
from rig.rows import fill_row
from rig.sensors import read_drives
from rig.signals import R_THETA, R_TIME, R_VARIANCE, READING_SIZE
from rig.simulator import camera_numbers, table_tick
from rig.statistical_camera import deliver, look, next_exposure

BLIND_LIMIT_S = 1.0  # a ball unseen for so long ends the run
RELEASE_LIMIT_S = 3.0  # in a simulation, a release not detected by then ends the run
ENDINGS = ("completed", "ball lost", "limit", "not released")
NOT_RELEASED = 3


DESK = np.dtype(
    [
        ("reading", np.float64, (READING_SIZE,)),
        ("target", np.float64, (2,)),
        ("push", np.float64, (2,)),
        ("noise", np.float64, (2,)),  # of the tachometers
        ("wish", np.float64, (2,)),
        ("applied", np.float64, (2,)),
        ("covariance", np.float64, (3,)),
        ("row", np.float64, (len(COLUMNS),)),
        ("seen", np.float64, (7,)),
        ("draws", np.float64, (3,)),  # of an exposure
        ("blind", np.int64),
        ("since_release", np.int64),
    ]
)


@dataclass(frozen=True, eq=False)
class Course:
    """What a run is asked to do from its release on, tick by tick.

    targets_m (n, 2): where the ball should be (servo angles [rad] in a run on the servos alone);
    pushes_m_s2 (n, 2): the hand's pushes; start_m: where the ball is placed; it is held for
    `hold_s` and then let go (0: free from the start). operator: the steps that a person is asked
    for (place, hold, release, push); placed is a ball within tolerance_m of its start.
    """

    targets_m: np.ndarray
    pushes_m_s2: np.ndarray
    start_m: tuple[float, float] = (0.0, 0.0)
    hold_s: float = 0.0
    servo_only: bool = False
    tolerance_m: float = 0.015
    operator: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Draws:
    """Every random number of a run: camera (k, 3) normal, normal, uniform; tachometers (n, 2)."""

    camera: np.ndarray
    tachometer: np.ndarray


def draw(rng: np.random.Generator, rig: Rig, course: Course) -> Draws:
    """Draw a run's numbers: those that a `SimulatedTable` with the same rng would draw."""
    ticks = _most_ticks(rig, course)
    frames = int(ticks / rig.control_rate_hz * rig.camera.rate_hz) + 2
    noise, drop, tachometer = rng.spawn(3)
    return Draws(camera_numbers(noise, drop, frames), tachometer.standard_normal((ticks, 2)))


def _most_ticks(rig: Rig, course: Course) -> int:
    waiting = course.hold_s + RELEASE_LIMIT_S if course.hold_s > 0 else 0.0
    return len(course.targets_m) + ceil(waiting * rig.control_rate_hz)


@compiled
def think(k, s, p, q, flight, camera, ticks, tick_s, desk):
    """Tick k up to the volts applied: sensors, pilot, limits, row. Returns how the run has ended,
    an index of ENDINGS or -1. What comes and goes lies on the desk (DESK); ticks: of the course.
    """
    reading, applied, wish, push = desk.reading, desk.applied, desk.wish, desk.push
    reading[R_TIME] = k * tick_s
    read_drives(s, p, desk.noise, reading)
    deliver(camera, reading)
    pilot_tick(flight, q, reading, desk.target, applied, wish)
    if flight.phase == HOLD:
        push[0] = push[1] = 0.0
    runaway = False
    for a in range(2):
        applied[a] = limit(
            wish[a], reading[R_THETA + a], flight.belief.rate[a], applied[a],
            q.voltage_limit, q.angle_limit, q.slew,
        )  # fmt: skip
        runaway = runaway or abs(reading[R_THETA + a]) > q.angle_limit + ANGLE_MARGIN_RAD
    desk.covariance[0] = desk.covariance[2] = reading[R_VARIANCE]
    pushed = 1.0 if push[0] != 0.0 or push[1] != 0.0 else 0.0
    fill_row(desk.row, flight, q, reading, desk.covariance, desk.target, pushed, wish, applied)
    if runaway:
        return 2
    desk.blind = desk.blind + 1 if flight.phase == BLIND else 0
    if desk.blind * tick_s > BLIND_LIMIT_S:
        return 1
    if flight.phase != HOLD:
        desk.since_release += 1
    if desk.since_release == ticks:
        return 1 if flight.phase == BLIND else 0
    return -1


@inlined
def lay_out(desk, targets, pushes, tachometer, lane, k):
    """Put a tick's inputs on the desk: by number, since a view of an array costs more than that."""
    now = desk.since_release
    for a in range(2):
        desk.target[a] = targets[lane, now, a]
        desk.push[a] = pushes[lane, now, a]
        desk.noise[a] = tachometer[lane, k, a]


@inlined
def file_away(desk, rows, lane, k):
    """The desk's row into rows[lane, k]."""
    for i in range(rows.shape[2]):
        rows[lane, k, i] = desk.row[i]


@inlined
def expose(camera, p, fallen, eyes, lane, desk):
    """The camera's part of a tick whose exposure, if any, is in the desk's `seen`."""
    if np.isnan(desk.seen[SEEN_T]):
        return
    if fallen:
        camera.frame += 1
        return
    for i in range(3):
        desk.draws[i] = eyes[lane, camera.frame, i]
    look(camera, p, desk.seen, desk.draws)


@compiled
def _run(s, p, q, history, flight, camera, targets, pushes, hold_s, tick_s, eyes, tachometer, desk,
         rows):  # fmt: skip
    """Fill `rows` (1, m, columns) tick by tick; returns how many are filled and how it ended."""
    fallen, push = False, desk.push
    for k in range(rows.shape[1]):
        lay_out(desk, targets, pushes, tachometer, 0, k)
        ending = think(k, s, p, q, flight, camera, targets.shape[1], tick_s, desk)
        file_away(desk, rows, 0, k)
        if ending >= 0:
            return k + 1, ending
        t, due = k * tick_s, next_exposure(camera)
        fallen = fallen | table_tick(
            s, p, history, desk.applied, push[0], push[1], t < hold_s, t, tick_s, due, desk.seen
        )
        expose(camera, p, fallen, eyes, 0, desk)
    return rows.shape[1], NOT_RELEASED


@dataclass(frozen=True, eq=False)
class Simulated:
    """A simulated run: its log and how it ended (one of ENDINGS)."""

    log: Log
    outcome: str


@dataclass(frozen=True, eq=False)
class Task:
    """Everything that decides one run: the plant, what its controller knows, arm, course, draws."""

    rig: Rig
    known: Rig
    arm: int
    course: Course
    draws: Draws

    @property
    def ticks(self) -> int:
        """As many as the run may take."""
        return _most_ticks(self.known, self.course)

    def check(self) -> None:
        """ValueError where plant and controller differ in their tick or the draws are too few."""
        rig, known, draws = self.rig, self.known, self.draws
        if rig.control_rate_hz != known.control_rate_hz:
            raise ValueError(
                f"plant ticks at {rig.control_rate_hz:g} Hz, controller at "
                f"{known.control_rate_hz:g} Hz: give both the same control_rate_hz"
            )
        frames = int(self.ticks / rig.control_rate_hz * rig.camera.rate_hz)
        if len(draws.camera) < frames or len(draws.tachometer) < self.ticks:
            raise ValueError("draws are too few for this rig and course: take those of draw()")

    def pilot(self) -> tuple[np.record, np.record]:
        """The pilot's settings and its state at the start."""
        q = pilot.settings(self.known, self.arm, servo_only=self.course.servo_only)
        return q, pilot.start(q, held=self.course.hold_s > 0)


def simulate(rig: Rig, known: Rig, arm: int, course: Course, draws: Draws) -> Simulated:
    """One closed-loop run of the plant `rig` under a controller that knows `known` (no effects).

    `draws` are those of `draw(rng, rig, course)`. ValueError where the two differ in their tick.
    """
    task = Task(rig, known, arm, course, draws)
    task.check()
    q, flight = task.pilot()
    rows = np.empty((1, task.ticks, len(COLUMNS)))
    targets, pushes = (
        np.ascontiguousarray(course.targets_m),
        np.ascontiguousarray(course.pushes_m_s2),
    )
    filled, ending = _run(
        plant.rest(course.start_m), plant_record.pack(rig), q, plant_record.no_volts(rig), flight,
        statistical_camera.start(rig.camera.rate_hz),
        targets[None], pushes[None], course.hold_s, 1 / known.control_rate_hz,
        draws.camera[None], draws.tachometer[None], desk(), rows,
    )  # fmt: skip
    return Simulated(Log.from_rows(rows[0, :filled]), ENDINGS[ending])


def desk() -> np.record:
    """What a run remembers from tick to tick, at its start."""
    one = np.zeros(1, DESK)[0]
    one["reading"] = one["seen"] = one["row"] = np.nan
    return one
