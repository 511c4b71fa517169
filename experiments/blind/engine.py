"""A closed-loop run in which something acts that the catalogue does not know.

The same compiled pieces as `rig.simulate`, tick by tick, with room for a disturbance between them:
process noise, and one *stranger* of `strangers.py` whose push or volts depend on the plant's state.
Both are constant over a tick. Without them the rows are those of `rig.simulate.simulate`, bit for
bit. The equations stand in this file, apart from `rig/unknown.py`, because what is used to explain
a log must not be what made it.
"""

from math import exp, pi, sin, sqrt

import numpy as np

from rig import pilot, plant, plant_record, statistical_camera
from rig.compiled import compiled
from rig.limits import limit
from rig.log import COLUMNS, Log
from rig.parameters import ANGLE_MARGIN_RAD, GRAVITY_M_S2, Rig
from rig.pilot import BLIND, HOLD, pilot_tick
from rig.plant import ARM, BALL, BALL_W, SEEN_T, SPIN, plate_motion
from rig.rows import fill_row
from rig.sensors import read_drives
from rig.signals import R_THETA, R_TIME, R_VARIANCE, READING_SIZE
from rig.simulate import BLIND_LIMIT_S, ENDINGS, Course, Draws, Simulated
from rig.simulator import table_tick
from rig.statistical_camera import deliver, look, next_exposure

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
    """Add what the stranger does now to out (4,): pushes x, y [m/s2], volts x, y [V]."""
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
def _command(flight, q, reading, applied, wish):
    """Wished volts through the limits into `applied` (2,); True where a servo ran away."""
    runaway = False
    for a in range(2):
        applied[a] = limit(
            wish[a], reading[R_THETA + a], flight.belief.rate[a], applied[a],
            q.voltage_limit, q.angle_limit, q.slew,
        )  # fmt: skip
        runaway = runaway or abs(reading[R_THETA + a]) > q.angle_limit + ANGLE_MARGIN_RAD
    return runaway


@compiled
def _expose(camera, p, seen, eyes, fallen):
    """Take the tick's picture, if one was due; of a fallen ball there is none."""
    if np.isnan(seen[SEEN_T]):
        return
    if fallen:
        camera.frame += 1
    else:
        look(camera, p, seen, eyes[camera.frame])


@compiled
def _run(
    s, p, q, history, flight, camera, targets, pushes, noise, stranger, hold_s, tick_s, eyes,
    tachometer, rows,
):  # fmt: skip
    """Fill `rows` (m, columns); returns how many are filled and how it ended (`ENDINGS`)."""
    reading, seen = np.full(READING_SIZE, np.nan), np.full(7, np.nan)
    wish, applied, covariance = np.zeros(2), np.zeros(2), np.zeros(3)
    out, volts, own = np.zeros(4), np.zeros(2), stranger.heavy_side.copy()
    blind, since_release, fallen = 0, 0, False
    for k in range(rows.shape[0]):
        t = k * tick_s
        target, push = targets[since_release], pushes[since_release]
        reading[R_TIME] = t
        read_drives(s, p, tachometer[k], reading)
        deliver(camera, reading)
        pilot_tick(flight, q, reading, target, applied, wish)
        runaway = _command(flight, q, reading, applied, wish)
        covariance[0] = covariance[2] = reading[R_VARIANCE]
        held = flight.phase == HOLD
        pushed = 1.0 if not held and (push[0] != 0.0 or push[1] != 0.0) else 0.0
        fill_row(rows[k], flight, q, reading, covariance, target, pushed, wish, applied)
        blind = blind + 1 if flight.phase == BLIND else 0
        if runaway or blind * tick_s > BLIND_LIMIT_S:
            return k + 1, 2 if runaway else 1
        since_release += 0 if held else 1
        if since_release == targets.shape[0]:
            return k + 1, 1 if flight.phase == BLIND else 0
        out[:] = noise[k]
        meddle(stranger, own, s, p, t, tick_s, out)
        if not held:
            out[0], out[1] = out[0] + push[0], out[1] + push[1]
        volts[0], volts[1] = applied[0] + out[2], applied[1] + out[3]
        fallen = fallen | table_tick(
            s, p, history, volts, out[0], out[1], t < hold_s, t, tick_s, next_exposure(camera), seen
        )
        _expose(camera, p, seen, eyes, fallen)
    return rows.shape[0], 3


def no_stranger() -> np.record:
    return np.zeros(1, STRANGER)[0]


def disturbed(
    rig: Rig,
    known: Rig,
    arm: int,
    course: Course,
    draws: Draws,
    *,
    noise: np.ndarray,
    stranger: np.record | None = None,
) -> Simulated:
    """One closed-loop run as `rig.simulate.simulate`, disturbed.

    noise (ticks, 4): accelerations of the ball x, y [m/s2] and volts x, y [V], one row a tick, as
    long as `draws.tachometer`.
    """
    ticks = len(draws.tachometer)
    if noise.shape != (ticks, 4):
        raise ValueError(f"noise has shape {noise.shape}: it needs ({ticks}, 4)")
    q = pilot.settings(known, arm, servo_only=course.servo_only)
    rows = np.full((ticks, len(COLUMNS)), np.nan)
    filled, ending = _run(
        plant.rest(course.start_m), plant_record.pack(rig), q, plant_record.no_volts(rig),
        pilot.start(q, held=course.hold_s > 0), statistical_camera.start(rig.camera.rate_hz),
        np.ascontiguousarray(course.targets_m), np.ascontiguousarray(course.pushes_m_s2),
        np.ascontiguousarray(noise), no_stranger() if stranger is None else stranger,
        course.hold_s, 1 / known.control_rate_hz, draws.camera, draws.tachometer, rows,
    )  # fmt: skip
    return Simulated(Log.from_rows(rows[:filled]), ENDINGS[ending])
