"""Guess the hidden play: a person against the analysis, on the demo's table.

The person is told how far the ball of the demo's `free-release` run swings, and how far it would
with plays of known size; the analysis has the same runs.
"""

from collections.abc import Mapping, Sequence
from math import degrees, radians
from pathlib import Path

import numpy as np

from experiments.analysis.samples import ball_samples
from experiments.gap.beside import Place
from experiments.gap.demo import demo_plant
from experiments.records.recording import read_run
from experiments.runs.protocol import read_protocol
from experiments.runs.runner import RunRequest, simulate_run
from rig.log import Log
from rig.parameters import Rig

LEAST_DEG, MOST_DEG = 0.5, 3.0  # what is hidden; below it nothing shows by eye
EXAMPLES_DEG = (0.5, 1.0, 2.0, 3.0)
SETTLED_S = 8.0  # at the end of the run: the ball swings evenly


def draw_plays(seed: int) -> dict[str, float]:
    """Joint plays of x and y [rad] to hide, evenly from LEAST_DEG to MOST_DEG."""
    drawn = np.random.default_rng([seed, 71]).uniform(LEAST_DEG, MOST_DEG, 2)
    return {axis: radians(play) for axis, play in zip("xy", drawn, strict=True)}


def swing_cm(log: Log) -> tuple[float, float]:
    """How far the ball swings to each side of its mean in the last SETTLED_S, x and y [cm]: that of
    the sine with the same RMS; NaN where it was not seen.
    """
    ball = ball_samples(log)
    if not len(ball.t_s):
        return float("nan"), float("nan")
    late = ball.xy_m[ball.t_s > ball.t_s[-1] - SETTLED_S]
    x, y = 100 * np.sqrt(2.0) * np.nanstd(late, axis=0)
    return float(x), float(y)


def clues(runs: Sequence[Path], *, seed: int) -> list[str]:
    """What a person is told of the demo's recorded runs: the swing, and that of known plays.

    seed: of the examples. OSError, ValueError: a run cannot be read.
    """
    x, y = swing_cm(read_run(next(run for run in runs if "free-release" in run.name)).log)
    lines = [f"The ball swings by {x:.2f} cm in x and {y:.2f} cm in y. It would, with a play of"]
    for play in EXAMPLES_DEG:
        plant = demo_plant(dict.fromkeys("xy", radians(play)))
        request = RunRequest(
            plant, read_protocol("free-release"), "without", seed, Path(), kind=Rig()
        )
        u, v = swing_cm(simulate_run(request).log)
        lines.append(f"  {play:.1f} degrees: by {u:.2f} and {v:.2f} cm")
    return lines


def score(
    hidden: Mapping[str, float], guess_deg: Mapping[str, float], found: Mapping[Place, float]
) -> list[str]:
    """Who was nearer, axis by axis; hidden: plays [rad]; guess_deg: the person's; found: the sizes
    [rad] of all that the analysis named.
    """
    lines = []
    for axis, play_rad in hidden.items():
        true, yours = degrees(play_rad), guess_deg[axis]
        size = found.get(("joint_backlash", axis, "play_rad"))
        theirs = "nothing" if size is None else f"{degrees(size):.2f}"
        off = abs(yours - true), float("inf") if size is None else abs(degrees(size) - true)
        nearer = "you are nearer" if off[0] < off[1] else "the analysis is nearer"
        lines.append(
            f"{axis}: hidden {true:.2f}, you {yours:.2f}, the analysis {theirs} degrees: {nearer}"
        )
    return lines
