"""Many plants at once: LANES of them side by side, one vector instruction for all.

A block is one array in which the lanes of each number lie next to each other and `lane` is the
innermost index. The equations are those of `step.py`, called with one lane's numbers inside the
innermost loop, which the compiler turns into vector instructions (512 bits where the machine has
them). It reorders nothing, so a run gives the same bits here and in `plant.advance`. Lanes of a
block share the step, the shaft model and the walls; a discrepancy (`discrepancy.py`) and effects of
a lab's own (`own_equations.py`) have no lanes.
"""

from collections.abc import Sequence
from math import inf, nan

import numpy as np

from rig.compiled import compiled, inlined
from rig.plant.constants import COSTLY, LANES, ROWS, cheap_constants_of, constants_of, rows_of
from rig.plant.plant import BALL as PLANT_BALL
from rig.plant.plant import BALL_W, SEEN_T, SPIN, late_row, sight
from rig.plant.shaft import EXACT
from rig.plant.step import (
    ball_step,
    cogged,
    commanded,
    delivered,
    drive_step,
    held_ball,
    off_plate,
    tilt,
)

# Rows of a block after the constants: both axes' state, the ball's, inputs.
X, Y, BALL = ROWS, ROWS + 8, ROWS + 16
COMMAND_X, COMMAND_Y, PUSH_X, PUSH_Y, HELD, FALLEN, BEFORE_X, BEFORE_Y, NOW = range(
    BALL + 5, BALL + 14
)
BLOCK_ROWS = BALL + 14
EARLY_S = 1e-9  # far more than times are rounded by, far less than a step


@inlined
def _axis(b, row, lane):
    i = row * LANES + lane
    return (
        b[i],
        b[i + LANES],
        b[i + 2 * LANES],
        b[i + 3 * LANES],
        b[i + 4 * LANES],
        b[i + 5 * LANES],
        b[i + 6 * LANES],
        b[i + 7 * LANES],
    )


@inlined
def _ball(b, lane):
    i = BALL * LANES + lane
    return b[i], b[i + LANES], b[i + 2 * LANES], b[i + 3 * LANES], b[i + 4 * LANES]


@inlined
def _put(b, row, lane, values):
    i = row * LANES + lane
    for k in range(len(values)):
        b[i + k * LANES] = values[k]


@inlined
def _lane_step(b, c, lane):
    now = b[NOW * LANES + lane]
    axis_x, axis_y, ball = _axis(b, X, lane), _axis(b, Y, lane), _ball(b, lane)
    held, fallen = b[HELD * LANES + lane] != 0.0, b[FALLEN * LANES + lane] != 0.0
    load_x = 0.0 if held or fallen else c.weight[0]
    load_y = 0.0 if held or fallen else c.weight[1]
    volts_x = cogged(c, 0, delivered(c, 0, b[COMMAND_X * LANES + lane], now), axis_x[2])
    volts_y = cogged(c, 1, delivered(c, 1, b[COMMAND_Y * LANES + lane], now), axis_y[2])
    axis_x = drive_step(c, 0, volts_x, load_x * ball[0], axis_x)
    axis_y = drive_step(c, 1, volts_y, load_y * ball[1], axis_y)
    motion = tilt(c, axis_x[4], axis_x[5], axis_y[4], axis_y[5])
    rolled = ball_step(c, now, b[PUSH_X * LANES + lane], b[PUSH_Y * LANES + lane], motion, ball)
    resting = held_ball(c, motion, ball)
    done = resting if held else rolled
    done = ball if fallen else done
    _put(b, X, lane, axis_x)
    _put(b, Y, lane, axis_y)
    _put(b, BALL, lane, done)
    b[FALLEN * LANES + lane] = 1.0 if fallen or off_plate(c, done) else 0.0


@compiled
def _cheap_step(b, step_s):
    for lane in range(LANES):
        _lane_step(b, cheap_constants_of(b, lane, step_s, EXACT, 0), lane)


@compiled
def _full_step(b, step_s, shaft_model, walls):
    for lane in range(LANES):
        _lane_step(b, constants_of(b, lane, step_s, shaft_model, walls), lane)


@compiled
def _command(b, plants, history, into_tick_s, ticks_s):
    """Volts that reach the amplifiers' far side `into_tick_s` after the tick, lane by lane."""
    for lane in range(LANES):
        p = plants[lane]
        for a in range(2):
            back = late_row(history.shape[1], p.input_delay_delay_s[a], into_tick_s, ticks_s)
            volts_x, volts_y = history[lane, back, 0], history[lane, back, 1]
            b[(COMMAND_X + a) * LANES + lane] = commanded(p, a, volts_x, volts_y)


@compiled
def _see(b, plants, t, exposures_s, buffers):
    """Fill `seen` of the buffers whose exposure has come; returns how long after the tick's begin
    the next one is."""
    due = inf
    for lane in range(LANES):
        p, exposure_s, seen = plants[lane], exposures_s[lane], buffers[lane].seen
        now = b[NOW * LANES + lane]
        if not np.isnan(seen[SEEN_T]):
            continue
        if exposure_s > now + p.step_s:
            due = min(due, exposure_s - t[lane] - EARLY_S)
            continue
        axis_x, axis_y, ball = _axis(b, X, lane), _axis(b, Y, lane), _ball(b, lane)
        motion = tilt(p, axis_x[4], axis_x[5], axis_y[4], axis_y[5])
        x, y = b[BEFORE_X * LANES + lane], b[BEFORE_Y * LANES + lane]
        shown = sight(p, now, exposure_s, x, y, motion, ball)
        for k in range(7):
            seen[k] = shown[k]
    return due


@compiled
def advance_block(b, plants, history, costly, delayed, t, ticks_s, exposures_s, buffers):
    """Move LANES plants over one control tick: `plant.advance` for a block b (BLOCK_ROWS * LANES,).

    plants (LANES,) of dtype PLANT; history (LANES, n, 2): volts applied, newest first; costly: some
    lane is (`is_costly`); delayed: some lane delays its volts (`is_delayed`); t (LANES,), ticks_s:
    begin of the tick by each lane's clock and its length [s]; exposures_s (LANES,): the
    next exposures, inf for none; buffers (LANES,): with a field `seen` (7,), filled in as by
    `plant.advance`. Pushes, held and fallen balls stand in the block's rows; a ball that falls is
    marked there.
    """
    p, due = plants[0], inf
    h = p.step_s
    for lane in range(LANES):
        buffers[lane].seen[SEEN_T] = nan
        due = min(due, exposures_s[lane] - t[lane] - EARLY_S)
        if off_plate(plants[lane], _ball(b, lane)):
            b[FALLEN * LANES + lane] = 1.0
    for i in range(int(round(ticks_s / h))):
        for lane in range(LANES):
            b[NOW * LANES + lane] = t[lane] + i * h
        if i == 0 or delayed:
            _command(b, plants, history, (i + 0.5) * h, ticks_s)
        seeing = due <= (i + 1) * h
        if seeing:
            for k in range(2 * LANES):
                b[BEFORE_X * LANES + k] = b[BALL * LANES + k]
        if costly:
            _full_step(b, h, p.shaft_model, p.walls)
        else:
            _cheap_step(b, h)
        if seeing:
            due = _see(b, plants, t, exposures_s, buffers)


def block_of(plants: np.ndarray, balls_m: Sequence[Sequence[float]]) -> np.ndarray:
    """Return a block (BLOCK_ROWS * LANES,) of tables at rest.

    plants (LANES,) of dtype PLANT; balls_m (LANES, 2): where each ball is placed [m].
    """
    b = np.zeros((BLOCK_ROWS, LANES))
    b[:ROWS], b[BALL : BALL + 2] = rows_of(plants), np.transpose(balls_m)
    return b.ravel()


def put_lane(b: np.ndarray, lane: int, p: np.record, s: np.ndarray) -> None:
    """Put a plant with the record p (dtype PLANT) in the state s (STATE_ROWS, 2) into a lane of the
    block b (BLOCK_ROWS * LANES,), on the plate.
    """
    column = b.reshape(BLOCK_ROWS, LANES)[:, lane]
    column[ROWS:] = 0.0
    column[:ROWS] = rows_of(np.array([p]))[:, 0]
    for a, first in enumerate((X, Y)):
        column[first : first + 8] = s[:8, a]
    column[BALL : BALL + 5] = *s[PLANT_BALL], *s[BALL_W], s[SPIN, 0]


def is_costly(p: np.record) -> bool:
    """Whether a plant has what `_cheap_step` leaves out.

    That is an effect with a sine, an exponential or a root a step, another shaft model than the
    exact one, or walls. p: record PLANT.
    """
    return bool(any(np.any(p[name]) for name in COSTLY) or p["shaft_model"] != EXACT or p["walls"])


def is_delayed(p: np.record) -> bool:
    """Whether a plant's volts are delayed. p: record PLANT."""
    return bool(np.any(p["input_delay_delay_s"] > 0))
