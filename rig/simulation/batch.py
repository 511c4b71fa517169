"""Many closed-loop runs at once: each its own controller and sensors, their plants in lanes.

A run gives the same bits as `simulate.simulate` makes of it alone. Runs of one kind (control rate,
step, shaft model, walls) share blocks of LANES; a plant with an unnamed term, an effect of a lab's
own, or with servos that take an angle, runs alone.
"""

from collections.abc import Sequence

import numpy as np

from rig.compiled import compiled, inlined
from rig.log import COLUMNS, Log
from rig.plant import own_equations, plant_record
from rig.plant.constants import LANES, UNIFORM
from rig.plant.plant import ARM, MOTOR_RATE, STATE_ROWS
from rig.simulation import statistical_camera
from rig.simulation.simulate import (
    ENDINGS,
    NOT_RELEASED,
    Simulated,
    Task,
    expose,
    load_inputs,
    measure_and_control,
    simulate,
    store_row,
    tick_buffers,
)
from rig.simulation.statistical_camera import next_exposure
from rig.simulation.vectorized_plants import (
    FALLEN,
    HELD,
    PUSH_X,
    PUSH_Y,
    X,
    advance_block,
    block_of,
    is_costly,
    is_delayed,
)


@compiled
def _run_block(
    b,
    plants,
    q,
    history,
    states,
    cameras,
    buffers,
    costly,
    delayed,
    targets,
    pushes,
    lengths,
    hold_s,
    tick_s,
    camera_draws,
    tachometer,
    rows,
    filled,
    endings,
):
    """`simulate._run` for LANES runs; filled and endings (LANES,) come out.

    A lane whose ending is not -1 at the start is empty. lengths (LANES, 2): of its course, of its
    rows; history (LANES, n, 2), targets and pushes (LANES, n, 2), camera_draws (LANES, k, 3).
    """
    exposures_s, s, t = np.full(LANES, np.inf), np.zeros((STATE_ROWS, 2)), np.zeros(LANES)
    for k in range(rows.shape[1]):
        running, t[:] = 0, k * tick_s
        for lane in range(LANES):
            exposures_s[lane] = np.inf
            if endings[lane] >= 0:
                continue
            if k == lengths[lane, 1]:
                endings[lane] = NOT_RELEASED
                continue
            buffer = buffers[lane]
            show_drives(s, b, lane)
            load_inputs(buffer, targets, pushes, tachometer, lane, k)
            ticks = lengths[lane, 0]
            endings[lane] = measure_and_control(
                k, s, plants[lane], q[lane], states[lane], cameras[lane], ticks, tick_s, buffer
            )
            store_row(buffer, rows, lane, k)
            filled[lane] = k + 1
            act(b, history, lane, buffer, t[lane] < hold_s[lane])
            if endings[lane] < 0:
                running += 1
                exposures_s[lane] = next_exposure(cameras[lane])
        if running == 0:
            return
        advance_block(b, plants, history, costly, delayed, t, tick_s, exposures_s, buffers)
        for lane in range(LANES):
            fallen = b[FALLEN * LANES + lane] != 0.0
            expose(cameras[lane], plants[lane], fallen, camera_draws, lane, buffers[lane])


@inlined
def show_drives(s, b, lane):
    """Copy what a lane's encoders and tachometers see out of the block b into s (STATE_ROWS, 2)."""
    for a in range(2):
        s[MOTOR_RATE, a] = b[(X + 8 * a + MOTOR_RATE) * LANES + lane]
        s[ARM, a] = b[(X + 8 * a + ARM) * LANES + lane]


@inlined
def act(b, history, lane, buffer, held):
    """Hand what the tick's command and the operator do to the plant in a lane of the block b.

    history (LANES, n, 2): volts applied, newest first; buffer: record TICK_BUFFERS with the volts
    applied and the push; held: the ball is held in its place.
    """
    b[PUSH_X * LANES + lane], b[PUSH_Y * LANES + lane] = buffer.push[0], buffer.push[1]
    b[HELD * LANES + lane] = 1.0 if held else 0.0
    for a in range(2):
        for i in range(history.shape[1] - 1, 0, -1):
            history[lane, i, a] = history[lane, i - 1, a]
        history[lane, 0, a] = buffer.applied[a]


def _stacked(arrays: Sequence[np.ndarray]) -> np.ndarray:
    """Arrays of one width on top of each other, zeros below the shorter ones."""
    longest = max(len(a) for a in arrays)
    out = np.zeros((LANES, longest, arrays[0].shape[1]))
    for lane, a in enumerate(arrays):
        out[lane, : len(a)] = a
    return out


def _records(ones: Sequence[np.record]) -> np.ndarray:
    """Records as one array (LANES,); the last one again in empty lanes."""
    return np.array([*ones, *[ones[-1]] * (LANES - len(ones))], ones[0].dtype)


def _simulate_block(tasks: Sequence[Task], plants: Sequence[np.record]) -> list[Simulated]:
    """At most LANES runs of one kind."""
    courses = [task.course for task in tasks]
    controllers = [task.controller() for task in tasks]
    lengths = np.zeros((LANES, 2), np.int64)
    lengths[: len(tasks)] = [(len(task.course.targets_m), task.ticks) for task in tasks]
    rows = np.empty((LANES, lengths[:, 1].max(), len(COLUMNS)))
    filled, endings = np.zeros(LANES, np.int64), np.full(LANES, NOT_RELEASED)
    endings[: len(tasks)] = -1
    hold_s = np.zeros(LANES)
    hold_s[: len(tasks)] = [course.hold_s for course in courses]
    starts = [course.start_m for course in courses]
    starts += starts[-1:] * (LANES - len(tasks))
    records = _records(plants)
    cameras = [statistical_camera.start(task.rig.camera.rate_hz) for task in tasks]
    _run_block(
        block_of(records, starts),
        records,
        _records([q for q, _ in controllers]),
        _stacked([plant_record.no_volts(task.rig) for task in tasks]),
        _records([state for _, state in controllers]),
        _records(cameras),
        _records([tick_buffers()] * LANES),
        any(map(is_costly, plants)),
        any(map(is_delayed, plants)),
        _stacked([course.targets_m for course in courses]),
        _stacked([course.pushes_m_s2 for course in courses]),
        lengths,
        hold_s,
        1 / tasks[0].known.control_rate_hz,
        _stacked([task.draws.camera for task in tasks]),
        _stacked([task.draws.tachometer for task in tasks]),
        rows,
        filled,
        endings,
    )
    logs = [Log.from_rows(rows[lane, : filled[lane]]) for lane in range(len(tasks))]
    return [Simulated(log, ENDINGS[end]) for log, end in zip(logs, endings, strict=False)]


def simulate_many(tasks: Sequence[Task]) -> list[Simulated]:
    """Return every task's run, in order; each has the same bits as `simulate` gives for it alone.

    The rows of all runs are in memory at once; the interpreter's lock is free while they are
    computed. ValueError: as `Task.check` and `plant_record.pack` raise it.
    """
    kinds: dict[tuple, list[int]] = {}
    plants, done = [plant_record.pack(task.rig) for task in tasks], {}
    for i, (task, p) in enumerate(zip(tasks, plants, strict=True)):
        task.check()
        if p["unknown"]["on"] or p["position"] or own_equations.acts(p["own"]):
            done[i] = simulate(task.rig, task.known, task.compensator, task.course, task.draws)
            continue
        kind = (task.known.control_rate_hz, *(float(p[name]) for name in UNIFORM))
        kinds.setdefault(kind, []).append(i)
    for members in kinds.values():
        members.sort(key=lambda i: (is_costly(plants[i]), tasks[i].ticks))
        for first in range(0, len(members), LANES):
            block = members[first : first + LANES]
            runs = _simulate_block([tasks[i] for i in block], [plants[i] for i in block])
            done.update(zip(block, runs, strict=True))
    return [done[i] for i in range(len(tasks))]
