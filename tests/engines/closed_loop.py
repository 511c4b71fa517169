"""The product's own pilot on both tables: free releases, the same gains, the same estimators."""

from dataclasses import dataclass, replace

import numpy as np
from mujoco_mechanism import Build
from mujoco_table import MujocoTable

from experiments.assemble import known, load_rig, with_play
from experiments.metrics import RunMetrics, run_metrics
from rig.controllers import ARMS
from rig.log import Log
from rig.loop import Loop
from rig.parameters import Rig
from rig.simulate import Course, draw, simulate

TICK_S = 0.002
START_M = (-0.13, 0.13)
COARSE = Build(step_s=2e-4)


def default_table(gear_deg: float, joint_deg: float) -> Rig:
    """The default table, as measured on real units, with this play on both axes."""
    wide = np.radians([gear_deg, joint_deg])
    return with_play(load_rig(None), gear_rad=float(wide[0]), joint_rad=float(wide[1]))


def quiet(rig: Rig) -> Rig:
    """The same table whose camera and tachometers have no noise (encoders still count)."""
    camera = replace(rig.camera, noise_m=0.0)
    return replace(rig, camera=camera, servo=replace(rig.servo, tachometer_noise_rad_s=0.0))


def release(seconds: float) -> Course:
    n = round(seconds / TICK_S)
    return Course(np.zeros((n, 2)), np.zeros((n, 2)), START_M)


def on_product(rig: Rig, arm: str, seconds: float, seed: int) -> Log:
    """A run of the product's simulator. RuntimeError: it was not completed."""
    course = release(seconds)
    draws = draw(np.random.default_rng(seed), rig, course)
    done = simulate(rig, known(rig), ARMS[arm], course, draws)
    if done.outcome != "completed":
        raise RuntimeError(done.outcome)
    return done.log


def on_mujoco(rig: Rig, arm: str, seconds: float, seed: int, *, build: Build = COARSE) -> Log:
    """The same loop on the MuJoCo table, tick by tick through the seam."""
    course, rows = release(seconds), []
    table = MujocoTable(rig, np.random.default_rng(seed), build=build, start_m=START_M)
    loop = Loop(table, known(rig), ARMS[arm], course, keep=lambda row: rows.append(row.copy()))
    ending = loop.run()
    if ending.outcome != "completed":
        raise RuntimeError(f"{ending.outcome}: {ending.reason}")
    return Log.from_rows(np.array(rows))


@dataclass(frozen=True)
class Cell:
    """Means over runs and axes of one arm on one table, and how many runs."""

    amplitude_mm: float
    period_s: float
    spread_mm: float
    servo_mrad: float
    gear_deg: float
    joint_deg: float
    runs: int


def cell(logs: list[Log]) -> Cell:
    """Medians of plays, means of the rest; an axis without a limit cycle has no part in its own."""
    found: list[RunMetrics] = [run_metrics(log) for log in logs]
    cycles = np.array([[(c.amplitude_m, c.period_s) for c in m.cycle] for m in found])
    amplitude, period = np.nanmean(cycles.reshape(-1, 2), axis=0)
    return Cell(
        amplitude_mm=1e3 * float(amplitude),
        period_s=float(period),
        spread_mm=1e3 * float(np.mean([m.settled.spread_m for m in found])),
        servo_mrad=1e3 * float(np.mean([m.servo_activity_rad for m in found])),
        gear_deg=float(np.degrees(np.median([m.gear_play_rad for m in found]))),
        joint_deg=float(np.degrees(np.median([m.joint_play_rad for m in found]))),
        runs=len(found),
    )
