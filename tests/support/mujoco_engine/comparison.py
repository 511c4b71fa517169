"""The same volts into both engines: one trajectory each, channel by channel."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from experiments.benchmark.engines.mujoco_engine.mechanism import Build
from experiments.benchmark.engines.mujoco_engine.table import MujocoTable
from rig.parameters import Ball, Drive, Rig
from rig.plant import plant, plant_record
from rig.plant.ball import velocity

TICK_S = 0.002
DEGREE = np.pi / 180


@dataclass(frozen=True)
class Start:
    """Where a run begins: both servos at rest, the ball rolling on the plate."""

    xy_m: Sequence[float] = (0.0, 0.0)
    velocity_m_s: Sequence[float] = (0.0, 0.0)
    spin_rad_s: float = 0.0
    theta_rad: Sequence[float] = (0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Rows one tick apart: angles and positions (n, 2) [rad, m], spin (n,) [rad/s]."""

    t_s: np.ndarray
    motor_rad: np.ndarray
    arm_rad: np.ndarray
    plate_rad: np.ndarray
    ball_m: np.ndarray
    velocity_m_s: np.ndarray
    spin_rad_s: np.ndarray


def _trajectory(rows: list) -> Trajectory:
    each = [np.array(column) for column in zip(*rows, strict=True)]
    return Trajectory(TICK_S * np.arange(len(rows)), *each)


def by_product(
    rig: Rig, volts: np.ndarray, start: Start, *, step_s: float = plant_record.STEP_S
) -> Trajectory:
    """The product's plant under `volts` (n, 2); n + 1 rows, fewer when the ball falls."""
    p, s = plant_record.pack(rig, step_s=step_s), plant.rest()
    s[[plant.MOTOR, plant.ARM, plant.PLATE]] = start.theta_rad
    s[plant.BALL], s[plant.BALL_W] = start.xy_m, start.velocity_m_s
    s[plant.SPIN, 0] = start.spin_rad_s
    history, seen, rows = plant_record.no_volts(rig), np.full(7, np.nan), []
    for k in range(len(volts) + 1):
        s_x, s_y, o1, o2 = plant.plate_motion(s, p)
        v = velocity(s[plant.BALL_W, 0], s[plant.BALL_W, 1], o1, o2, p["radius"])
        angles = [s[row].copy() for row in (plant.MOTOR, plant.ARM)]
        rows.append((*angles, np.arcsin([s_x, s_y]), s[plant.BALL].copy(), v, s[plant.SPIN, 0]))
        if k == len(volts):
            break
        history[1:] = history[:-1].copy()
        history[0] = volts[k]
        if plant.advance(s, p, history, k * TICK_S, TICK_S, 0.0, 0.0, False, np.inf, seen):
            break
    return _trajectory(rows)


def by_mujoco(
    rig: Rig, volts: np.ndarray, start: Start, *, build: Build | None = None
) -> Trajectory:
    """The MuJoCo table under the same volts."""
    table = MujocoTable(
        rig,
        np.random.default_rng(0),
        build=build,
        start_m=start.xy_m,
        velocity_m_s=start.velocity_m_s,
        spin_rad_s=start.spin_rad_s,
        theta_rad=start.theta_rad,
    )
    rows = []
    for pair in [*volts, None]:
        xyz, v, spin = table.ball()
        motor, arm, _ = table.angles().copy()
        rows.append((motor, arm, np.arcsin(table.sines()), xyz[:2], v[:2], spin))
        if pair is not None:
            table.advance(pair)
    return _trajectory(rows)


@dataclass(frozen=True)
class Gap:
    """RMS and largest difference of two trajectories."""

    motor_rad: tuple[float, float]
    arm_rad: tuple[float, float]
    plate_rad: tuple[float, float]
    ball_m: tuple[float, float]
    spin_rad_s: tuple[float, float]


def gap(one: Trajectory, other: Trajectory) -> Gap:
    """Differences over the time that both have."""
    n = min(len(one.t_s), len(other.t_s))
    found = {}
    for name in Gap.__dataclass_fields__:
        d = getattr(one, name)[:n] - getattr(other, name)[:n]
        found[name] = (float(np.sqrt(np.mean(d**2))), float(np.abs(d).max()))
    return Gap(**found)


def multisine(seconds: float = 2.0, *, volts: float = 2.0, both: bool = True) -> np.ndarray:
    """Volts (n, 2), smooth: four frequencies an axis, all cosines, so that angles start at 0."""
    t = TICK_S * (np.arange(round(seconds / TICK_S)) + 0.5)
    hz = np.array([[1.0, 1.7, 2.9, 5.1], [1.3, 2.1, 3.3, 4.7]])
    sign = np.array([1, -1, 1, -1]) / 2
    v = np.stack([(sign * np.cos(2 * np.pi * t[:, None] * f)).sum(1) for f in hz], axis=1)
    return volts * v * (1.0, 1.0 if both else 0.0)


def steps(seconds: float = 2.0, *, volts: float = 1.0, both: bool = True) -> np.ndarray:
    """Volts (n, 2): up, down for twice as long, up again; the other axis out of step."""
    t = TICK_S * np.arange(round(seconds / TICK_S))
    x = volts * np.where((t / 0.3).astype(int) % 4 % 3 == 0, 1.0, -1.0)
    y = volts * np.where((t / 0.22).astype(int) % 4 % 3 == 0, -1.0, 1.0)
    return np.column_stack([x, y * (1.0 if both else 0.0)])


def table_with(
    *, gear_deg: float = 0.0, joint_deg: float = 0.0, hollow: bool = True, dry: bool = True
) -> Rig:
    """The nominal rig with this play on both axes; `dry`: with its assumed dry friction."""
    rig = Rig(ball=Ball(hollow=hollow))
    effects = {}
    for place, degrees in (("gear", gear_deg), ("joint", joint_deg)):
        if degrees:
            effects[f"{place}_backlash"] = {a: {"play_rad": degrees * DEGREE} for a in "xy"}
    if dry:
        return replace(rig, effects=effects)
    return replace(rig, effects=effects, drive=Drive(arm_friction_nm=0.0, joint_friction_nm=0.0))


TABLES = {
    "no friction, no play": table_with(dry=False),
    "friction": table_with(),
    "gear play 1 deg": table_with(gear_deg=1.0),
    "gear play 2 deg": table_with(gear_deg=2.0),
    "joint play 1.5 deg": table_with(joint_deg=1.5),
    "joint play 2 deg": table_with(joint_deg=2.0),
    "both plays": table_with(gear_deg=1.0, joint_deg=1.5),
    "solid ball": table_with(hollow=False),
}
