"""The weights of LQG and MPC: 16 settings each, on seeds that no comparison uses.

`python tests/benchmarks/control/optimal_arms.py` (some minutes of one core). Each setting holds the
ball on the default table (experiments/rigs/default.toml) in --seeds runs of 16 s; told are the
ball's RMS distance over the last 8 s and the servos' RMS speed. A setting that loses a ball is out;
of the others the smallest error wins, for each arm alone.
"""

import argparse
import itertools
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[3]))

from experiments.runs.assemble import known, load_rig
from rig import COMPENSATORS, Course, draw, simulate_many
from rig.control.optimal import design
from rig.simulation.simulate import Task

FIRST_SEED, SECONDS = 5000, 16.0  # the shipped comparison begins at 7000
GRID = {
    "m": (0.01, 0.03),
    "volts": (1.0, 3.0),
    "ball_noise": (0.02, 0.1),
    "friction_noise": (0.3, 1.0),
}


def score(arm: str, seeds: int) -> tuple[float, float, int]:
    """Error [cm], servo speed [rad/s], lost balls of an arm at the weights that `design` has."""
    rig = load_rig(None)
    n = round(SECONDS * rig.control_rate_hz)
    still, tasks = np.zeros((n, 2)), []
    for seed in range(FIRST_SEED, FIRST_SEED + seeds):
        course = Course(still, still, start_m=(-0.1, 0.1), hold_s=0.5)
        numbers = draw(np.random.default_rng(seed), rig, course)
        tasks.append(Task(rig, known(rig), COMPENSATORS[arm], course, numbers))
    errors, speeds, lost = [], [], 0
    for run in simulate_many(tasks):
        if run.outcome != "completed":
            lost += 1
            continue
        late = run.log.where(slice(len(run.log) // 2, None))
        ball = np.column_stack([late["ball_x_m"], late["ball_y_m"]])
        errors.append(100 * np.sqrt(np.nanmean(ball**2) * 2))
        angles = np.column_stack([late["theta_x_rad"], late["theta_y_rad"]])
        smooth = angles[10:] - angles[:-10]
        speeds.append(float(np.sqrt(np.mean(smooth**2))) * rig.control_rate_hz / 10)
    return float(np.mean(errors or [np.inf])), float(np.mean(speeds or [np.inf])), lost


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--arms", nargs="+", default=["lqg", "mpc"])
    options = parser.parse_args()
    for arm in ("without", "with", "neural"):
        print(f"{arm}: {score(arm, options.seeds)}", flush=True)
    for arm in options.arms:
        best = None
        for values in itertools.product(*GRID.values()):
            setting = dict(zip(GRID, values, strict=True))
            design.WEIGHTS[arm] = design.Weights(**setting)
            found = score(arm, options.seeds)
            print(f"{arm} {setting}: {found}", flush=True)
            if found[2] == 0 and (best is None or found[0] < best[1][0]):
                best = setting, found
        print(f"{arm}: best {best}")


if __name__ == "__main__":
    main()
