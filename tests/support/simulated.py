"""What the tests of the table share: a plant moved by given volts, usual courses, quiet rigs."""

from dataclasses import replace
from math import radians

import numpy as np

from rig.course import Course
from rig.parameters import Ball, Drive, Rig, Servo
from rig.plant import plant, plant_record
from rig.simulation import simulate

TICK_S = 0.002
DEGREE = radians(1)

# No dry friction in bearings and joints, a ball without weight: each axis is its equations alone.
SMOOTH = Drive(arm_friction_nm=0.0, joint_friction_nm=0.0)
WEIGHTLESS = Ball(mass_kg=0.0)


def smooth_rig(*, drive: Drive = SMOOTH, effects=None, **more) -> Rig:
    """A rig without dry friction whose ball does not load the plate."""
    return Rig(drive=drive, ball=WEIGHTLESS, effects=effects or {}, **more)


def moved(
    rig: Rig, volts, *, state=None, held=False, step_s=plant_record.STEP_S, pushes=None, t_s=0.0
):
    """States (ticks + 1, STATE_ROWS, 2) of a plant under volts (ticks, 2); shorter when lost."""
    p = plant_record.pack(rig, step_s=step_s)
    s = plant.rest() if state is None else state.copy()
    history, seen = plant_record.no_volts(rig), np.full(7, np.nan)
    states = [s.copy()]
    for k, pair in enumerate(np.asarray(volts, float)):
        history[1:] = history[:-1].copy()
        history[0] = pair
        push = (0.0, 0.0) if pushes is None else pushes[k]
        t = t_s + k * TICK_S
        lost = plant.advance(s, p, history, t, TICK_S, push[0], push[1], held, np.inf, seen)
        states.append(s.copy())
        if lost:
            break
    return np.array(states)


def constant_volts(x: float, y: float, seconds: float) -> np.ndarray:
    return np.tile([x, y], (round(seconds / TICK_S), 1))


def ball_state(xy=(0.0, 0.0), v=(0.0, 0.0)) -> np.ndarray:
    """A table at rest with a rolling ball (a plate at rest: w = v)."""
    s = plant.rest(xy)
    s[plant.BALL_W] = v
    return s


def tilted(state: np.ndarray, theta_x: float, theta_y: float) -> np.ndarray:
    """The same with both servos, arms and plate at the given angles [rad], at rest."""
    s = state.copy()
    for row in (plant.MOTOR, plant.ARM, plant.PLATE):
        s[row] = theta_x, theta_y
    return s


def random_steps(rng, seconds: float, *, reach_m: float = 0.06, every_s: float = 2.0):
    """A course of random targets, a new one every `every_s`."""
    n = round(seconds / TICK_S)
    each = round(every_s / TICK_S)
    points = rng.uniform(-reach_m, reach_m, (n // each + 1, 2))
    return Course(np.repeat(points, each, axis=0)[:n], np.zeros((n, 2)))


def free_release(seconds: float, start_m=(-0.13, 0.13)):
    n = round(seconds / TICK_S)
    return Course(np.zeros((n, 2)), np.zeros((n, 2)), start_m)


def run(rig: Rig, arm: int, course: Course, seed: int, known: Rig | None = None):
    """A closed-loop run; the controller knows the rig without its effects unless told."""
    draws = simulate.draw(np.random.default_rng(seed), rig, course)
    return simulate.simulate(rig, known or replace(rig, effects={}), arm, course, draws)


def realistic(gear_deg=1.0, joint_deg=1.0, gear_offset_rad=0.0, joint_offset_rad=0.0, **more):
    """A table as measured on real units: friction, offsets, level error and play on both axes."""
    pair = {"x": 1.0, "y": 1.0}
    effects = {
        "coulomb_friction": {"x": {"friction_V": 0.0522}, "y": {"friction_V": 0.0092}},
        "voltage_offset": {"x": {"offset_V": -0.1305}, "y": {"offset_V": -0.0995}},
        "level_offset": {a: {"slope_rad": 0.1 * DEGREE} for a in pair},
        "gear_backlash": {
            a: {"play_rad": gear_deg * DEGREE, "offset_rad": gear_offset_rad} for a in pair
        },
        "joint_backlash": {
            a: {"play_rad": joint_deg * DEGREE, "offset_rad": joint_offset_rad} for a in pair
        },
    }
    servo = Servo(gain_rad_s_V=1.735, time_constant_s=0.046, tachometer_scale=0.01, **more)
    return Rig(servo=servo, effects=effects)
