"""Many tables one tick at a time, steered from outside: what a `Loop` with a user's controller does
on a `SimulatedTable`, bit for bit, for n tables in one call.

The agent commands where a user's controller would: as soon as the ball has been seen, and not
while it is out of sight (the plate is levelled then). Tables of one step, shaft model and walls
stand in blocks of LANES, as in `batch`; a few, and those that have no lanes there, run one by one
in the same compiled call.
"""

from dataclasses import dataclass
from math import ceil

import numpy as np

from rig.compiled import compiled, inlined
from rig.control import tick
from rig.control.controllers import WITHOUT
from rig.control.seen import COLUMN, SEEN_SIZE, fill_seen
from rig.control.tick import RUN
from rig.course import BLIND_LIMIT_S, Course
from rig.parameters import Rig
from rig.plant import plant, plant_record
from rig.plant.constants import LANES
from rig.plant.plant import STATE_ROWS
from rig.simulation import statistical_camera
from rig.simulation.batch import act, show_drives
from rig.simulation.simulate import (
    BALL_LOST,
    TICK_BUFFERS,
    Draws,
    bound,
    broken_off,
    expose,
    measure,
    tick_buffers,
)
from rig.simulation.simulator import table_tick
from rig.simulation.statistical_camera import CAMERA, next_exposure
from rig.simulation.vectorized_plants import (
    BALL,
    BLOCK_ROWS,
    FALLEN,
    advance_block,
    is_costly,
    is_delayed,
    put_lane,
)

GOING, COMPLETED = -1, 0  # of a table's ending; the others are indices of `simulate.ENDINGS`
FEW = 3  # chosen: fewer tables than this are faster one by one than in lanes


@inlined
def _command(i, buffer, state, q, wanted):
    """The agent's command in place of the built-in one, where a user controller would be asked."""
    if state.phase == RUN and state.estimate.frames > 0:
        buffer.commanded[0], buffer.commanded[1] = wanted[i, 0], wanted[i, 1]
    bound(q, state, buffer)


@inlined
def _sense(i, k, s, p, q, state, camera, tick_s, targets, tachometer, buffer, seen):
    """What table i shows at tick k, into row i of `seen`; returns how the tick ends the episode."""
    for a in range(2):
        buffer.target[a], buffer.noise[a] = targets[i, k, a], tachometer[i, k, a]
    measure(k, s, p, q, state, camera, tick_s, buffer)
    fill_seen(seen[i], state, q, buffer.reading, buffer.target, buffer.applied)
    return broken_off(q, state, tick_s, buffer)


@compiled
def _step_alone(
    one,
    end,
    s,
    plants,
    q,
    history,
    states,
    cameras,
    buffers,
    targets,
    tachometer,
    draws,
    tick_s,
    seen,
    wanted,
    ticks,
    endings,
):
    """Move those of the tables from `one` to before `end` that are going by one tick, in turn.

    s (n, STATE_ROWS, 2), plants (n,), history (n, h, 2), states, cameras, buffers (n,): the tables;
    q: settings of their observers; targets (n, m, 2), tachometer (n, m, 2), draws (n, k, 3): of
    each tick and exposure; seen (n, SEEN_SIZE), ticks (n,), -1 before the first, and endings (n,):
    come out; wanted (n, 2): volts or angles.
    """
    for i in range(one, end):
        if endings[i] != GOING:
            continue
        p, state, camera, buffer, fallen = plants[i], states[i], cameras[i], buffers[i], False
        if ticks[i] >= 0:
            _command(i, buffer, state, q, wanted)
            t, due = ticks[i] * tick_s, next_exposure(camera)
            fallen = table_tick(
                s[i], p, history[i], buffer.applied, 0.0, 0.0, False, t, tick_s, due, buffer.seen
            )
            expose(camera, p, fallen, draws, i, buffer)
        ticks[i] += 1
        ending = _sense(
            i, ticks[i], s[i], p, q, state, camera, tick_s, targets, tachometer, buffer, seen
        )
        endings[i] = BALL_LOST if fallen else ending


@compiled
def _step_blocks(
    blocks,
    costly,
    delayed,
    plants,
    q,
    history,
    states,
    cameras,
    buffers,
    targets,
    tachometer,
    draws,
    tick_s,
    seen,
    wanted,
    ticks,
    endings,
):
    """The same in blocks (n/LANES, BLOCK_ROWS * LANES); costly, delayed: some plant is."""
    exposures_s, t = np.full(LANES, np.inf), np.zeros(LANES)
    s = np.zeros((STATE_ROWS, 2))
    for block in range(blocks.shape[0]):
        b, first = blocks[block], block * LANES
        now = history[first : first + LANES]
        for lane in range(LANES):
            i = first + lane
            t[lane], exposures_s[lane] = ticks[i] * tick_s, np.inf
            if endings[i] == GOING:
                _command(i, buffers[i], states[i], q, wanted)
                act(b, now, lane, buffers[i], False)
                exposures_s[lane] = next_exposure(cameras[i])
        among = plants[first : first + LANES], buffers[first : first + LANES]
        advance_block(b, among[0], now, costly, delayed, t, tick_s, exposures_s, among[1])
        for lane in range(LANES):
            i = first + lane
            if endings[i] != GOING:
                continue
            p, state, camera, buffer = plants[i], states[i], cameras[i], buffers[i]
            fallen = b[FALLEN * LANES + lane] != 0.0
            expose(camera, p, fallen, draws, i, buffer)
            ticks[i] += 1
            show_drives(s, b, lane)
            ending = _sense(
                i, ticks[i], s, p, q, state, camera, tick_s, targets, tachometer, buffer, seen
            )
            endings[i] = BALL_LOST if fallen else ending


@dataclass(frozen=True, eq=False)
class Start:
    """How a table begins: the plant, where the ball lies, targets (m, 2) [m] and its draws."""

    rig: Rig
    course: Course
    draws: Draws

    def check(self, known: Rig, ticks: int) -> None:
        """Raise ValueError where it does not fit tables of `ticks` ticks under `known`."""
        if self.rig.control_rate_hz != known.control_rate_hz:
            raise ValueError("plant and controller differ in control_rate_hz: give both the same")
        if len(self.course.targets_m) < ticks or len(self.draws.tachometer) < ticks:
            raise ValueError(f"a course of {ticks} ticks is needed: `most_ticks` of the episode")
        if self.course.hold_s > 0 or self.course.servo_only:
            raise ValueError("hold_s and servo_only are for runs, not for tables that are stepped")


def most_ticks(rig: Rig, steps: int) -> int:
    """Return how many ticks an episode of `steps` steps may take, with the wait for the ball."""
    return steps + ceil(BLIND_LIMIT_S * rig.control_rate_hz) + 2


class SteppedTables:
    """n tables like `rig` under agents that know `rig.known`, for episodes of up to `steps` ticks.

    seen (n, SEEN_SIZE): what each agent sees (`control.seen`); endings (n,): GOING, or an index of
    `simulate.ENDINGS`; ticks (n,): by each table's clock.
    """

    def __init__(self, n: int, rig: Rig, steps: int) -> None:
        known, idle = rig.known, plant_record.pack(rig)
        self._rig, self._idle = rig, idle
        self.n, self._known, self._ticks = n, known, most_ticks(known, steps)
        self._lanes = n >= FEW and not (idle["position"] or idle["unknown"]["on"] or known.own)
        m = LANES * ceil(n / LANES) if self._lanes else n
        frames = int(self._ticks / known.control_rate_hz * known.camera.rate_hz) + 2
        self._tick_s = 1 / known.control_rate_hz
        self._q = tick.settings(known, WITHOUT)
        self._s = np.array([plant.rest()] * m)
        self._plants = np.array([idle] * m, plant_record.PLANT)
        self._history = np.array([plant_record.no_volts(known)] * m)
        self._states = np.zeros(m, tick.CONTROLLER_STATE)
        self._cameras = np.zeros(m, CAMERA)
        self._buffers = np.array([tick_buffers()] * m, TICK_BUFFERS)
        self._targets = np.zeros((m, self._ticks, 2))
        self._tachometer = np.zeros((m, self._ticks, 2))
        self._draws = np.zeros((m, frames, 3))
        self._seen, self._wanted = np.zeros((m, SEEN_SIZE)), np.zeros((m, 2))
        self._clock, self._endings = np.zeros(m, np.int64), np.full(m, COMPLETED)
        self._costly, self._delayed = np.zeros(m, np.bool_), np.zeros(m, np.bool_)
        self._blocks = np.zeros((m // LANES if self._lanes else 0, BLOCK_ROWS * LANES))
        for i in range(m if self._lanes else 0):
            put_lane(self._blocks[i // LANES], i % LANES, idle, self._s[i])
        self.seen, self.endings, self.ticks = self._seen[:n], self._endings[:n], self._clock[:n]

    def reset(self, i: int, start: Start) -> None:
        """Put table i at its start and let it run, level, until its ball has been seen.

        The start's rig is `rig` with other numbers of its effects and servos.
        ValueError: the start does not fit, `plant_record.pack` refuses its rig, or the ball is not
        seen within BLIND_LIMIT_S.
        """
        start.check(self._known, self._ticks)
        p = self._idle if start.rig is self._rig else plant_record.pack(start.rig)
        self._plants[i] = p
        self._s[i] = plant.rest(start.course.start_m, start.rig.linkage.height_m)
        self._room_for(plant_record.no_volts(start.rig))
        self._history[i] = 0.0
        self._states[i] = tick.start(self._q, held=False)
        self._cameras[i] = statistical_camera.start(start.rig.camera.rate_hz)
        self._buffers[i] = tick_buffers()
        self._targets[i] = start.course.targets_m[: self._ticks]
        self._tachometer[i] = start.draws.tachometer[: self._ticks]
        self._draws[i] = start.draws.camera[: self._draws.shape[1]]
        self._costly[i], self._delayed[i] = is_costly(p), is_delayed(p)
        self._clock[i], self._endings[i] = -1, GOING
        while self._endings[i] == GOING and self._states[i]["estimate"]["frames"] == 0:
            self._step_alone(i, i + 1)
        if self._endings[i] != GOING:
            raise ValueError(
                f"the ball was not seen within {BLIND_LIMIT_S:g} s: camera.dropout = "
                f"{start.rig.camera.dropout:g}; lower it"
            )
        if self._lanes:
            put_lane(self._blocks[i // LANES], i % LANES, p, self._s[i])

    def _room_for(self, history: np.ndarray) -> None:
        """Make the histories of volts as long as a table's delays need; zeros are added."""
        missing = len(history) - self._history.shape[1]
        if missing > 0:
            self._history = np.pad(self._history, ((0, 0), (0, missing), (0, 0)))

    def step(self, wanted: np.ndarray) -> None:
        """Move every table that is GOING by one tick; wanted (n, 2): volts, or angles [rad]."""
        self._wanted[: self.n] = wanted
        if not self._lanes:
            self._step_alone(0, self.n)
            return
        costly, delayed = bool(self._costly.any()), bool(self._delayed.any())
        _step_blocks(self._blocks, costly, delayed, *self._tables())

    def _step_alone(self, one: int, end: int) -> None:
        _step_alone(one, end, self._s, *self._tables())

    def _tables(self) -> tuple:
        """The arguments that both ways of stepping have in common."""
        return (
            self._plants,
            self._q,
            self._history,
            self._states,
            self._cameras,
            self._buffers,
            self._targets,
            self._tachometer,
            self._draws,
            self._tick_s,
            self._seen,
            self._wanted,
            self._clock,
            self._endings,
        )

    @property
    def balls_m(self) -> np.ndarray:
        """Where the balls truly are, (n, 2) [m]: for rewards and scorers, not for agents."""
        if not self._lanes:
            return self._s[: self.n, plant.BALL].copy()
        rows = self._blocks.reshape(-1, BLOCK_ROWS, LANES)[:, BALL : BALL + 2]
        return rows.transpose(0, 2, 1).reshape(-1, 2)[: self.n].copy()

    @property
    def applied(self) -> np.ndarray:
        """What was applied at the last tick, (n, 2): volts, or angles [rad]."""
        return self._buffers["applied"][: self.n]

    @property
    def targets_m(self) -> np.ndarray:
        """Where they should be, (n, 2) [m]."""
        return self.seen[:, COLUMN["target_m"] : COLUMN["target_m"] + 2]
