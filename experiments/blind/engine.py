"""A closed-loop run in which something acts that the catalogue does not know.

The compiled tick of `rig.simulation.simulate` with a disturbance between command and plant: process
noise, and one *stranger* of `uncatalogued_effects` whose push or volts depend on the plant's state.
Both are constant over a tick. Without them the rows are those of `rig.simulation.simulate`, bit for
bit. The equations stand in this file, apart from
`rig/discrepancy.py`, because what is used to explain a log must not be what made it.
"""

from math import exp, pi, sin, sqrt

import numpy as np

from rig.compiled import compiled
from rig.course import Course
from rig.log import COLUMNS, Log
from rig.parameters import GRAVITY_M_S2, Rig
from rig.plant import plant, plant_record
from rig.plant.plant import ARM, BALL, BALL_W, SPIN, plate_motion
from rig.simulation import statistical_camera
from rig.simulation.simulate import (
    ENDINGS,
    NOT_RELEASED,
    Draws,
    Simulated,
    Task,
    expose,
    load_inputs,
    measure_and_control,
    store_row,
    tick_buffers,
)
from rig.simulation.simulator import table_tick
from rig.simulation.statistical_camera import next_exposure

NONE, DENT, RHYTHM, ONCE, UNBALANCED, CABLE, DRAUGHT = range(7)
STRANGER = np.dtype(
    [("kind", np.int64), ("axis", np.int64), ("size", np.float64), ("width_m", np.float64)]
    + [("hz", np.float64), ("phase_rad", np.float64), ("from_s", np.float64)]
    + [("to_s", np.float64), ("bend_rad", np.float64), ("drag_1_m", np.float64)]
    + [(name, np.float64, (2,)) for name in ("place_m", "direction")]
    + [("heavy_side", np.float64, (3,))]
)


@compiled
def _dent(g, x, y, out):
    """A hollow or a magnet: pull towards a place, largest (`size`, m/s2) at `width_m` from it."""
    dx, dy = (x - g.place_m[0]) / g.width_m, (y - g.place_m[1]) / g.width_m
    pull = g.size * exp(0.5 - 0.5 * (dx * dx + dy * dy))
    out[0] -= pull * dx
    out[1] -= pull * dy


@compiled
def _unbalanced(g, own, p, v_x, v_y, spin, dt, out):
    """Mass centre off the middle by size * radius, in direction own (3,), turning with the ball.

    The energy m g e own_z and rolling without slip give k g (e/r) own_xy; own' = omega x own with
    omega = (-v_y/r, v_x/r, spin).
    """
    pull = p.factor * GRAVITY_M_S2 * g.size
    out[0] += pull * own[0]
    out[1] += pull * own[1]
    w_x, w_y = -v_y / p.radius, v_x / p.radius
    u_x, u_y, u_z = own[0], own[1], own[2]
    u_x, u_y, u_z = (
        u_x + dt * (w_y * u_z - spin * u_y),
        u_y + dt * (spin * u_x - w_x * u_z),
        u_z + dt * (w_x * u_y - w_y * u_x),
    )
    length = sqrt(u_x * u_x + u_y * u_y + u_z * u_z)
    own[0], own[1], own[2] = u_x / length, u_y / length, u_z / length


@compiled
def _draught(g, x, y, v_x, v_y, out):
    """Air that blows at `size` m/s over one side of the plate: c |u - v| (u - v), c = drag_1_m.

    The side begins at the line through `place_m` across `direction`, softly over 1 cm; the drag of
    still air is everywhere.
    """
    depth = (x - g.place_m[0]) * g.direction[0] + (y - g.place_m[1]) * g.direction[1]
    share = 1.0 / (1.0 + exp(-depth / 0.01))
    # The wind blows across the line, towards the other side.
    u_x, u_y = -g.size * share * g.direction[0] - v_x, -g.size * share * g.direction[1] - v_y
    force = g.drag_1_m * sqrt(u_x * u_x + u_y * u_y)
    out[0] += force * u_x
    out[1] += force * u_y


@compiled
def meddle(g, own, s, p, t, dt, out):
    """Add what the uncatalogued effect does at time `t` [s] to out (4,).

    out: accelerations of the ball x, y [m/s2] and volts x, y [V]; g: `STRANGER` record; own (3,):
    direction of the ball's mass centre, a unit vector that turns by one tick `dt` [s]; s: the
    plant's state; p: its packed parameters. Rhythm: size sin(2 pi hz t + phase); once: size for
    from_s <= t < to_s; cable: volts -c size max(c theta - bend_rad, 0) with c = +-1, the side on
    which the cable is tight.
    """
    if g.kind == NONE:
        return
    x, y = s[BALL, 0], s[BALL, 1]
    _, _, o1, o2 = plate_motion(s, p)
    v_x, v_y = s[BALL_W, 0] - p.radius * o2, s[BALL_W, 1] + p.radius * o1
    if g.kind == DENT:
        _dent(g, x, y, out)
    elif g.kind == RHYTHM:
        now = g.size * sin(2.0 * pi * g.hz * t + g.phase_rad)
        out[0] += now * g.direction[0]
        out[1] += now * g.direction[1]
    elif g.kind == ONCE:
        if g.from_s <= t < g.to_s:
            out[0] += g.size * g.direction[0]
            out[1] += g.size * g.direction[1]
    elif g.kind == UNBALANCED:
        _unbalanced(g, own, p, v_x, v_y, s[SPIN, 0], dt, out)
    elif g.kind == CABLE:
        side = g.direction[g.axis]
        out[2 + g.axis] -= side * g.size * max(side * s[ARM, g.axis] - g.bend_rad, 0.0)
    elif g.kind == DRAUGHT:
        _draught(g, x, y, v_x, v_y, out)


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
    noise,
    stranger,
    hold_s,
    tick_s,
    camera_draws,
    tachometer,
    buffer,
    rows,
):
    """Fill `rows` (1, m, columns): `simulate._run` with a disturbance between command and plant.

    Returns how many rows are filled and how the run ended (an index of ENDINGS).
    """
    out, volts, own = np.zeros(4), np.zeros(2), stranger.heavy_side.copy()
    fallen, push, applied = False, buffer.push, buffer.applied
    for k in range(rows.shape[1]):
        load_inputs(buffer, targets, pushes, tachometer, 0, k)
        ending = measure_and_control(k, s, p, q, state, camera, targets.shape[1], tick_s, buffer)
        store_row(buffer, rows, 0, k)
        if ending >= 0:
            return k + 1, ending
        t, due = k * tick_s, next_exposure(camera)
        out[:] = noise[k]
        meddle(stranger, own, s, p, t, tick_s, out)
        push_x, push_y = out[0] + push[0], out[1] + push[1]
        volts[0], volts[1] = applied[0] + out[2], applied[1] + out[3]
        fallen = fallen | table_tick(
            s, p, history, volts, push_x, push_y, t < hold_s, t, tick_s, due, buffer.seen
        )
        expose(camera, p, fallen, camera_draws, 0, buffer)
    return rows.shape[1], NOT_RELEASED


def no_stranger() -> np.record:
    """A `STRANGER` record of zeros: no uncatalogued effect acts."""
    return np.zeros(1, STRANGER)[0]


def disturbed(
    rig: Rig,
    known: Rig,
    compensator: int,
    course: Course,
    draws: Draws,
    *,
    noise: np.ndarray,
    stranger: np.record | None = None,
) -> Simulated:
    """One closed-loop run with process noise and an uncatalogued effect, and how it ended.

    rig: the plant; known: the rig that controller and observers know; compensator: an entry of
    `rig.control.controllers.COMPENSATORS`; course: targets, pushes and start; draws: random numbers
    of camera and tachometer; noise (ticks, 4): accelerations of the ball x, y [m/s2] and volts x, y
    [V], one row per tick, as long as `draws.tachometer`; stranger: `STRANGER` record (None: no
    uncatalogued effect). With zero noise and no effect the rows are those of
    `rig.simulation.simulate`. ValueError: `noise` has another shape.
    """
    ticks = len(draws.tachometer)
    if noise.shape != (ticks, 4):
        raise ValueError(f"noise has shape {noise.shape}: it needs ({ticks}, 4)")
    task = Task(rig, known, compensator, course, draws)
    q, state = task.controller()
    rows = np.empty((1, ticks, len(COLUMNS)))
    filled, ending = _run(
        plant.rest(course.start_m, rig.linkage.height_m),
        plant_record.pack(rig),
        q,
        plant_record.no_volts(rig),
        state,
        statistical_camera.start(rig.camera.rate_hz),
        np.ascontiguousarray(course.targets_m)[None],
        np.ascontiguousarray(course.pushes_m_s2)[None],
        np.ascontiguousarray(noise),
        no_stranger() if stranger is None else stranger,
        course.hold_s,
        1 / known.control_rate_hz,
        draws.camera[None],
        draws.tachometer[None],
        tick_buffers(),
        rows,
    )
    return Simulated(Log.from_rows(rows[0, :filled]), ENDINGS[ending])
