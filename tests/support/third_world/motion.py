"""Where plate, ball, hand and leaves are at each frame; the plate chases a ball that rolls."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tests.support.third_world.plan import SIDE_M, Plan
from tests.support.third_world.scene import PLATE_Z_M, THICK_M

STEP_S = 0.002
G = 9.81 * 5 / 7  # of a solid ball that rolls
OUT_OF_SIGHT = np.array((0.0, 0.0, -5.0))
MOST_TILT = math.radians(9.0)


@dataclass(frozen=True)
class Moment:
    """One frame: the plate's turn (3, 3), the ball's centre and speed [m], its turn (3, 3), the
    finger tips' and the leaves' places [m]."""

    t_s: float
    plate: np.ndarray
    ball: np.ndarray
    speed: np.ndarray
    turn: np.ndarray
    hand: np.ndarray
    leaves: list[np.ndarray]


@dataclass
class _Roll:
    """Plane motion: place, speed, tilt (2,) of the plate along x and y, and the ball's turn."""

    xy: np.ndarray
    speed: np.ndarray
    tilt: np.ndarray
    turn: np.ndarray


def moments(plan: Plan, rng: np.random.Generator) -> Iterator[Moment]:
    """The film's frames in order."""
    reach = _reach(plan)
    roll = _Roll(rng.uniform(-0.6, 0.6, 2) * reach, np.zeros(2), np.zeros(2), _turned(rng))
    target, next_s, t = roll.xy.copy(), plan.rest_s, 0.0
    leave = 0.4 * plan.seconds
    phase = rng.uniform(0, 2 * math.pi, 4)
    put = rng.uniform(-0.5, 0.5, 2) * reach
    for k in range(round(plan.seconds * plan.fps)):
        while t < k / plan.fps:
            if t >= next_s:
                target = rng.uniform(-0.8, 0.8, 2) * reach
                next_s = t + float(rng.uniform(0.5, 1.1))
            if t >= plan.rest_s:
                _roll_on(roll, target, plan.radius_m)
            t += STEP_S
        plate = _tilted(roll.tilt)
        xy, lift, hand = roll.xy, 0.0, OUT_OF_SIGHT
        if plan.kind == "rolls out and in":
            xy = _gone(plan, xy, t, leave)
        elif plan.kind == "taken and put down":
            xy, lift, hand = _carried(plan, roll, put, t, leave)
        elif plan.kind in ("hand", "sleeve of its colour"):
            hand = _waving(reach, t, phase)
        up = PLATE_Z_M + THICK_M / 2
        centre = plate @ np.array((*xy, plan.radius_m)) + np.array((0, 0, up + lift))
        speed = plate @ np.array((*roll.speed, 0.0))
        yield Moment(k / plan.fps, plate, centre, speed, roll.turn, hand, _leaves(t, phase))


def _reach(plan: Plan) -> float:
    """Half the way [m] that plate and image leave the ball."""
    seen = 0.5 * plan.size[1] / plan.focal_px * plan.away_m * math.sin(plan.lift_rad)
    return max(0.02, min(0.36 * SIDE_M, seen - 1.3 * plan.radius_m - 0.02))


def _roll_on(roll: _Roll, target: np.ndarray, radius_m: float) -> None:
    """One step of the ball, and of the plate, which follows a PD law with a lag of 60 ms."""
    wish = np.clip(2.2 * (target - roll.xy) - 0.9 * roll.speed, -MOST_TILT, MOST_TILT)
    roll.tilt += STEP_S / 0.06 * (wish - roll.tilt)
    roll.speed += STEP_S * (G * np.sin(roll.tilt) - 0.15 * roll.speed)
    roll.xy = roll.xy + STEP_S * roll.speed
    roll.turn = _about((-roll.speed[1], roll.speed[0], 0.0), STEP_S / radius_m) @ roll.turn


def _gone(plan: Plan, xy: np.ndarray, t: float, leave: float) -> np.ndarray:
    """It shoots out of sight for a quarter of the film, and comes back the way it went."""
    back = leave + 0.25 * plan.seconds
    off = 0.0
    if leave < t < back + 0.3:
        off = min(1.5 * (t - leave), 1.5 * max(0.0, back + 0.3 - t))
    return xy + np.array((min(off, 0.6), 0.0))


def _carried(
    plan: Plan, roll: _Roll, put: np.ndarray, t: float, leave: float
) -> tuple[np.ndarray, float, np.ndarray]:
    """(place, lift, finger tips): a hand comes, takes it away and puts it down elsewhere."""
    back = leave + 0.35 * plan.seconds
    if t < leave:
        far = min(0.35, 0.8 * (leave - t))
        return roll.xy, 0.0, _tips(roll.xy, far, plan)
    if t < back:
        roll.xy, roll.speed = put.copy(), np.zeros(2)
        held = min(t - leave, back - t)
        xy = roll.xy + 0.9 * held * np.array((0.8, 0.35))
        return xy, 0.5 * held, _tips(xy, 0.0, plan) + np.array((0, 0, 0.5 * held))
    return roll.xy, 0.0, _tips(roll.xy, min(0.35, 0.8 * (t - back)), plan)


def _tips(xy: np.ndarray, far: float, plan: Plan) -> np.ndarray:
    top = PLATE_Z_M + 1.6 * plan.radius_m
    return np.array((xy[0] + 0.9 * far, xy[1] + 0.4 * far, top + 0.3 * far))


def _waving(reach: float, t: float, phase: np.ndarray) -> np.ndarray:
    """A hand about the ball's side of the plate, at times above the ball."""
    x = 0.6 * reach + 0.06 * math.sin(2.2 * t + phase[0])
    return np.array((x, 0.07 * math.sin(1.4 * t + phase[1]), PLATE_Z_M + 0.06))


def _leaves(t: float, phase: np.ndarray) -> list[np.ndarray]:
    """Places of three leaves that blow over the table again and again."""
    return [
        np.array(
            (
                0.3 - ((0.5 + 0.15 * k) * t + phase[k] / 6) % 0.6,
                0.06 * (k - 1) + 0.03 * math.sin(5 * t + phase[k]),
                PLATE_Z_M + 0.05,
            )
        )
        for k in range(3)
    ]


def _tilted(tilt: np.ndarray) -> np.ndarray:
    """Turn (3, 3) of a plate whose slope makes a ball roll towards +x, +y for positive tilts."""
    return _about((0.0, 1.0, 0.0), float(tilt[0])) @ _about((-1.0, 0.0, 0.0), float(tilt[1]))


def _turned(rng: np.random.Generator) -> np.ndarray:
    return _about(rng.standard_normal(3), float(rng.uniform(1.0, 3.0)))


def _about(axis, angle: float) -> np.ndarray:
    """Rodrigues' formula; the axis counts with its length."""
    vector = np.asarray(axis, float)
    size = float(np.linalg.norm(vector))
    if size * abs(angle) < 1e-12:
        return np.eye(3)
    x, y, z = vector / size
    cross = np.array(((0, -z, y), (z, 0, -x), (-y, x, 0)))
    turn = size * angle
    return np.eye(3) + math.sin(turn) * cross + (1 - math.cos(turn)) * cross @ cross
