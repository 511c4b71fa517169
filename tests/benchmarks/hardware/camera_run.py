"""How well does the loop balance on what a camera saw? `rig home` and `rig run` as programs on a
served virtual table, pictures over HTTP, the real vision chain, all in real time.

    python tests/benchmarks/hardware/camera_run.py [RUNS]

Wants a quiet machine with two cores to itself. Prints each run's outcome, how far what was seen lay
from the truth and how old it was; exit code 1 where no run was completed.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

from tests.support.rig_lab import Lab
from tests.support.virtual_film import measured_and_true, newer


def told(run, folder: Path) -> str:
    """One line: outcome, observations, their error and age."""
    outcome, log = f"{run.meta['outcome']} ({run.meta.get('reason', '')})", run.log
    exposed, t_s = log["ball_exposed_s"], log["t_s"]
    new = newer(exposed)
    if new.sum() < 2:
        return f"{outcome}: no ball was seen"
    pairs, age_ms = measured_and_true(log, folder), 1000 * (t_s - exposed)[new]
    off_mm = 1000 * (pairs[:, :2] - pairs[:, 2:])
    last_mm = 1000 * np.hypot(*pairs[-20:, 2:].T).max()
    return (
        f"{outcome}: {len(pairs)} observations, {np.sqrt(np.mean(off_mm**2)):.2f} mm rms off, "
        f"{np.median(age_ms):.0f} ms old (p99 {np.quantile(age_ms, 0.99):.0f}), "
        f"in the end within {last_mm:.0f} mm"
    )


def main(runs: int) -> int:
    with Lab(film=True) as lab:
        code, out, error = lab.call("home", "--yes")
        print(out + error, end="", flush=True)
        for _ in range(runs if code == 0 else 0):
            words = ("--out", str(lab.out), "--arm", "with", "--yes")
            _, _, error = lab.call("run", lab.protocol(6.0), *words)
            print(error, end="", flush=True)
        done = lab.runs() if (lab.out / "runs").exists() else []
        for run in done:
            print(told(run, lab.folder), flush=True)
    return int(not any(run.meta["outcome"] == "completed" for run in done))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("runs", type=int, nargs="?", default=3)
    sys.exit(main(parser.parse_args().runs))
