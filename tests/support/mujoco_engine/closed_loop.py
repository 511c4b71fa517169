"""The product's own pilot on both tables: free releases, the same gains, the same estimators."""

from dataclasses import dataclass, replace

import numpy as np

from experiments.analysis.limit_cycle import limit_cycle
from experiments.analysis.samples import ball_samples
from experiments.benchmark.engines.mujoco_engine.mechanism import Build
from experiments.benchmark.engines.mujoco_engine.table import MujocoTable
from experiments.runs.assemble import known, load_rig, with_play
from rig.control.controllers import COMPENSATORS
from rig.course import Course
from rig.log import Log
from rig.loop.loop import Loop
from rig.parameters import Rig
from rig.simulation.simulate import draw, simulate

TICK_S = 0.002
START_M = (-0.13, 0.13)
CALM_S = 3.0  # the release is over, three cycles and more are left of 15 s
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
    done = simulate(rig, known(rig), COMPENSATORS[arm], course, draws)
    if done.outcome != "completed":
        raise RuntimeError(done.outcome)
    return done.log


def on_mujoco(rig: Rig, arm: str, seconds: float, seed: int, *, build: Build = COARSE) -> Log:
    """The same loop on the MuJoCo table, tick by tick through the seam."""
    course, rows = release(seconds), []
    table = MujocoTable(rig, np.random.default_rng(seed), build=build, start_m=START_M)
    loop = Loop(
        table, known(rig), COMPENSATORS[arm], course, keep=lambda row: rows.append(row.copy())
    )
    ending = loop.run()
    if ending.outcome != "completed":
        raise RuntimeError(f"{ending.outcome}: {ending.reason}")
    return Log.from_rows(np.array(rows))


@dataclass(frozen=True)
class Cell:
    """Means over runs and axes of one arm on one table; `cycling` axes have a limit cycle."""

    amplitude_mm: float
    period_s: float
    spread_mm: float
    servo_mrad: float
    gear_deg: float
    joint_deg: float
    cycling: int


def cell(logs: list[Log]) -> Cell:
    """Medians of plays, means of the rest; amplitude and period of those axes that cycle at all.

    Everything from CALM_S on: a fixed time, so that what counts as settled decides nothing.
    """
    cycles, spread, servo, plays = [], [], [], []
    for log in logs:
        ball = ball_samples(log)
        ball = ball.where(ball.t_s >= CALM_S)
        found = [(c.amplitude_m, c.period_s) for c in limit_cycle(ball)]
        cycles += [pair for pair in found if not np.isnan(pair[0])]
        spread.append(np.sqrt(ball.xy_m.var(axis=0).sum()))
        late = log["t_s"] >= CALM_S
        servo += [log[f"theta_{a}_rad"][late].std() for a in "xy"]
        names = [f"estimated_{p}_play_{a}_rad" for p in ("gear", "joint") for a in "xy"]
        plays.append(np.degrees([log[name][-1] for name in names]).reshape(2, 2))
    amplitude, period = np.mean(cycles, axis=0) if cycles else (np.nan, np.nan)
    gear, joint = np.median(np.swapaxes(plays, 0, 1).reshape(2, -1), axis=1)
    return Cell(
        1e3 * float(amplitude),
        float(period),
        1e3 * float(np.mean(spread)),
        1e3 * float(np.mean(servo)),
        float(gear),
        float(joint),
        cycling=len(cycles),
    )
