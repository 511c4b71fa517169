"""Whole closed-loop runs in compiled code: controller, sensors and plant of the tick-by-tick loop.

A simulator is a function of its arguments: state, parameters, targets, pushes and every random
number come in; one row a tick goes out. Runs are independent, so a batch is split over threads
(the kernel holds no lock) and the answer does not depend on how many.
"""

from dataclasses import dataclass
from math import ceil

import numpy as np

from rig.compiled import compiled, inlined
from rig.control import tick
from rig.control.tick import BLIND, HOLD, control_tick, fill_row
from rig.course import BLIND_LIMIT_S, RELEASE_LIMIT_S, Course
from rig.log import COLUMNS, Log
from rig.parameters import ANGLE_MARGIN_RAD, Rig
from rig.plant import own_equations, plant, plant_record
from rig.plant.plant import SEEN_T
from rig.safety.limits import Braking, limit, limit_angle
from rig.simulation import statistical_camera
from rig.simulation.simulator import camera_numbers, read_drives, table_tick
from rig.simulation.statistical_camera import deliver, look, next_exposure
from rig.table import R_THETA, R_TIME, R_VARIANCE, READING_SIZE

ENDINGS = ("completed", "ball lost", "limit", "not released")
BALL_LOST, LIMIT, NOT_RELEASED = 1, 2, 3


TICK_BUFFERS = np.dtype(
    [
        ("reading", np.float64, (READING_SIZE,)),
        ("target", np.float64, (2,)),
        ("push", np.float64, (2,)),
        ("noise", np.float64, (2,)),  # of the tachometers
        ("commanded", np.float64, (2,)),
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
class Draws:
    """Every random number of a run.

    camera (k, 3), a row an exposure: two normal numbers and one uniform; tachometer (n, 2), a row a
    tick: normal numbers of both axes.
    """

    camera: np.ndarray
    tachometer: np.ndarray


def draw(rng: np.random.Generator, rig: Rig, course: Course) -> Draws:
    """Draw a run's numbers: those that a `SimulatedTable` with the same `rng` would draw."""
    ticks = _most_ticks(rig, course)
    frames = int(ticks / rig.control_rate_hz * rig.camera.rate_hz) + 2
    noise, drop, tachometer = rng.spawn(3)
    return Draws(camera_numbers(noise, drop, frames), tachometer.standard_normal((ticks, 2)))


def _most_ticks(rig: Rig, course: Course) -> int:
    waiting = course.hold_s + RELEASE_LIMIT_S if course.hold_s > 0 else 0.0
    return len(course.targets_m) + ceil(waiting * rig.control_rate_hz)


@inlined
def measure(k, s, p, q, state, camera, tick_s, buffer):
    """Put tick k's reading, and what the built-in controller commands, into the buffer.

    The arguments are those of `measure_and_control`.
    """
    reading = buffer.reading
    reading[R_TIME] = k * tick_s
    read_drives(s, p, buffer.noise, reading)
    deliver(camera, reading)
    control_tick(state, q, reading, buffer.target, buffer.applied, buffer.commanded)


@inlined
def bound(q, state, buffer):
    """Write what may be applied of the commanded volts or angles into the buffer's `applied`."""
    reading, applied, commanded = buffer.reading, buffer.applied, buffer.commanded
    for a in range(2):
        if q.takes_angle:
            applied[a] = limit_angle(commanded[a], applied[a], q.angle_limit)
            continue
        applied[a] = limit(
            commanded[a],
            reading[R_THETA + a],
            state.estimate.rate[a],
            applied[a],
            q.voltage_limit,
            q.angle_limit,
            q.slew,
            Braking(q.delay, q.time_constant, q.top_speed),
            0.0,
            state.estimate.free_rate[a],
        )


@inlined
def broken_off(q, state, tick_s, buffer):
    """How the tick's reading ends the run before its time, an index of ENDINGS, or -1."""
    for a in range(2):
        if abs(buffer.reading[R_THETA + a]) > q.angle_limit + ANGLE_MARGIN_RAD:
            return LIMIT
    buffer.blind = buffer.blind + 1 if state.phase == BLIND else 0
    return BALL_LOST if buffer.blind * tick_s > BLIND_LIMIT_S else -1


@compiled
def measure_and_control(k, s, p, q, state, camera, ticks, tick_s, buffer):
    """Run tick k up to the volts applied: sensors, controller, limits, row.

    s (STATE_ROWS, 2), p: the plant's state and record; q, state: settings and state of the
    controller; camera: record of `statistical_camera`; ticks: length of the course; tick_s: period
    [s]; buffer: record TICK_BUFFERS, whose inputs are loaded (`load_inputs`) and whose outputs are
    filled in. Returns how the run has ended, an index of ENDINGS, or -1 while it goes on.
    """
    reading, push = buffer.reading, buffer.push
    measure(k, s, p, q, state, camera, tick_s, buffer)
    if state.phase == HOLD:
        push[0] = push[1] = 0.0
    bound(q, state, buffer)
    buffer.covariance[0] = buffer.covariance[2] = reading[R_VARIANCE]
    pushed = 1.0 if push[0] != 0.0 or push[1] != 0.0 else 0.0
    fill_row(
        buffer.row,
        state,
        q,
        reading,
        buffer.covariance,
        buffer.target,
        pushed,
        buffer.commanded,
        buffer.applied,
    )
    ending = broken_off(q, state, tick_s, buffer)
    if ending >= 0:
        return ending
    if state.phase != HOLD:
        buffer.since_release += 1
    if buffer.since_release == ticks:
        return 1 if state.phase == BLIND else 0
    return -1


@inlined
def load_inputs(buffer, targets, pushes, tachometer, lane, k):
    """Copy tick k's inputs of one run into the buffer: target, push and the tachometers' noise.

    targets, pushes (lanes, n, 2), by the ticks since the release; tachometer (lanes, m, 2), by k;
    lane: number of the run in them. Copied number by number, as a view of an array costs more.
    """
    now = buffer.since_release
    for a in range(2):
        buffer.target[a] = targets[lane, now, a]
        buffer.push[a] = pushes[lane, now, a]
        buffer.noise[a] = tachometer[lane, k, a]


@inlined
def store_row(buffer, rows, lane, k):
    """Copy the buffer's row into rows[lane, k]; rows (lanes, m, len(COLUMNS))."""
    for i in range(rows.shape[2]):
        rows[lane, k, i] = buffer.row[i]


@inlined
def expose(camera, p, fallen, camera_draws, lane, buffer):
    """Take the exposure of a tick, if the buffer's `seen` holds one; a fallen ball is not seen.

    camera: record of `statistical_camera`; p: record PLANT; camera_draws (lanes, k, 3): as
    `Draws.camera`, a row an exposure, of which this run uses those of `lane`.
    """
    if np.isnan(buffer.seen[SEEN_T]):
        return
    if fallen:
        camera.frame += 1
        return
    for i in range(3):
        buffer.draws[i] = camera_draws[lane, camera.frame, i]
    look(camera, p, buffer.seen, buffer.draws)


@compiled
def _run(
    s,
    p,
    q,
    history,
    state,
    camera,
    targets,
    pushes,
    hold_s,
    tick_s,
    camera_draws,
    tachometer,
    buffer,
    rows,
):
    """Fill `rows` (1, m, columns) tick by tick; returns how many are filled and how it ended."""
    fallen, push = False, buffer.push
    for k in range(rows.shape[1]):
        load_inputs(buffer, targets, pushes, tachometer, 0, k)
        ending = measure_and_control(k, s, p, q, state, camera, targets.shape[1], tick_s, buffer)
        store_row(buffer, rows, 0, k)
        if ending >= 0:
            return k + 1, ending
        t, due = k * tick_s, next_exposure(camera)
        fallen = fallen | table_tick(
            s, p, history, buffer.applied, push[0], push[1], t < hold_s, t, tick_s, due, buffer.seen
        )
        expose(camera, p, fallen, camera_draws, 0, buffer)
    return rows.shape[1], NOT_RELEASED


@dataclass(frozen=True, eq=False)
class Simulated:
    """A simulated run: its log and its outcome, one of ENDINGS."""

    log: Log
    outcome: str


@dataclass(frozen=True, eq=False)
class Task:
    """Everything that decides one run.

    rig: the plant; known: what its controller knows (no effects); compensator: a number of
    `controllers.COMPENSATORS`; course: targets, pushes and start; draws: of `draw(rng, rig,
    course)`.
    """

    rig: Rig
    known: Rig
    compensator: int
    course: Course
    draws: Draws

    @property
    def ticks(self) -> int:
        """The most ticks that the run may take: those of its course and of the wait for the
        release.
        """
        return _most_ticks(self.known, self.course)

    def check(self) -> None:
        """Raise ValueError where plant and controller differ in their tick, or the draws are too
        few.
        """
        rig, known, draws = self.rig, self.known, self.draws
        if rig.control_rate_hz != known.control_rate_hz:
            raise ValueError(
                f"plant ticks at {rig.control_rate_hz:g} Hz, controller at "
                f"{known.control_rate_hz:g} Hz: give both the same control_rate_hz"
            )
        frames = int(self.ticks / rig.control_rate_hz * rig.camera.rate_hz)
        if len(draws.camera) < frames or len(draws.tachometer) < self.ticks:
            raise ValueError("draws are too few for this rig and course: take those of draw()")

    def controller(self) -> tuple[np.record, np.record]:
        """Return the controller's settings and its state at the start (`tick.settings`,
        `tick.start`).
        """
        q = tick.settings(self.known, self.compensator, servo_only=self.course.servo_only)
        return q, tick.start(q, held=self.course.hold_s > 0)


def simulate(rig: Rig, known: Rig, compensator: int, course: Course, draws: Draws) -> Simulated:
    """Return a closed-loop run of the plant `rig` under a controller that knows `known` alone.

    compensator: a number of `controllers.COMPENSATORS`; draws: of `draw(rng, rig, course)`.
    ValueError: `rig` and `known` differ in control_rate_hz, the draws are too few, or the rig's
    effects are not those of the catalogue. DivergedError: an effect of a lab's own gave no finite
    number.
    """
    task = Task(rig, known, compensator, course, draws)
    task.check()
    q, state = task.controller()
    rows = np.empty((1, task.ticks, len(COLUMNS)))
    targets, pushes = (
        np.ascontiguousarray(course.targets_m),
        np.ascontiguousarray(course.pushes_m_s2),
    )
    p = plant_record.pack(rig)
    filled, ending = _run(
        plant.rest(course.start_m, rig.linkage.height_m),
        p,
        q,
        plant_record.no_volts(rig),
        state,
        statistical_camera.start(rig.camera.rate_hz),
        targets[None],
        pushes[None],
        course.hold_s,
        1 / known.control_rate_hz,
        draws.camera[None],
        draws.tachometer[None],
        tick_buffers(),
        rows,
    )
    own_equations.check(p["own"], rig.own)
    return Simulated(Log.from_rows(rows[0, :filled]), ENDINGS[ending])


def tick_buffers() -> np.record:
    """Return the record TICK_BUFFERS of a run at its start: what it keeps from tick to tick."""
    one = np.zeros(1, TICK_BUFFERS)[0]
    one["reading"] = one["seen"] = one["row"] = np.nan
    return one
