"""The demo of `rig gap`: runs of a virtual table with a joint play that its rig file lacks."""

from collections.abc import Mapping
from dataclasses import replace
from math import degrees
from pathlib import Path

from experiments.progress import ProgressCall, silent
from experiments.runs.protocol import read_protocol
from experiments.runs.runner import RunRequest, keep_simulated, simulate_run
from rig.parameters import Rig

DEMO_PLAY_RAD = {"x": 0.035, "y": 0.020}  # 2.0 and 1.1 degrees at the servo shaft


def hidden_words(plays_rad: Mapping[str, float] = DEMO_PLAY_RAD) -> str:
    """A sentence on the joint plays (axis -> full width) that a demo hid."""
    sizes = ", ".join(f"{axis} {degrees(play):.2f}" for axis, play in plays_rad.items())
    where = "Hidden in the demo's simulated table, unknown to the analysis"
    return f"{where}: joint play {sizes} deg."


def demo_plant(plays_rad: Mapping[str, float]) -> Rig:
    """The demo's table with these joint plays (axis -> full width at the servo)."""
    plays = {axis: {"play_rad": play} for axis, play in plays_rad.items()}
    return replace(Rig(), effects={"joint_backlash": plays})


def demo_runs(
    out: Path,
    *,
    seed: int,
    plays_rad: Mapping[str, float] = DEMO_PLAY_RAD,
    progress: ProgressCall = silent,
) -> list[Path]:
    """Record the runs `steps`, `sine-sweep` and `free-release` in out/runs; return their folders.

    Simulated with joint plays (axis -> full width) that the recorded rig file lacks, and the seeds
    `seed` to `seed` + 2. OSError: the folder cannot be written.
    """
    nominal, plant = Rig(), demo_plant(plays_rad)
    runs = []
    for i, name in enumerate(("steps", "sine-sweep", "free-release")):
        progress("recording the demo's runs", i, 3)
        request = RunRequest(
            plant, read_protocol(name), "without", seed + i, out / "runs", kind=nominal
        )
        runs.append(keep_simulated(request, simulate_run(request)))
    progress("recording the demo's runs", 3, 3)
    return runs
