"""The learned policy beside the PID, on `rig run`.

`uv run python tests/benchmarks/gym/learned_policy.py` prints the table of rig/gym/README.md: the
protocol experiments/own_controllers/learned.toml on tables that no training saw, each seed with
every arm. Three minutes.
"""

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from experiments.analysis.metrics import RunMetrics, run_metrics
from experiments.records.recording import read_run
from experiments.runs.assemble import another_unit, load_rig
from experiments.runs.protocol import read_protocol
from experiments.runs.runs import run_protocol
from rig.parameters import Rig
from tests.support import ROOT

PLAN = read_protocol(str(ROOT / "experiments/own_controllers/learned.toml"))
ARMS, SEEDS = {"own": "learned", "without": "PID", "with": "PID with the backlash model"}, 10
MEASURES: dict[str, Callable[[RunMetrics], float]] = {
    "error RMS [mm]": lambda m: 1e3 * m.settled.error_rms_m,
    "spread [mm]": lambda m: 1e3 * m.settled.spread_m,
    "servo RMS [deg]": lambda m: float(np.degrees(np.hypot(*m.servo_rms_rad))),
    "settled after [s]": lambda m: m.settling_s,
    "volts RMS [V]": lambda m: float(np.hypot(*m.voltage_rms_V)),
}


def measured(rig: Rig, seed: int, repetitions: int) -> dict[str, list[RunMetrics]]:
    """Metrics of every arm's runs; a run that is not completed is a SystemExit."""
    found: dict[str, list[RunMetrics]] = {arm: [] for arm in ARMS}
    with tempfile.TemporaryDirectory() as folder:
        how = {"out": Path(folder), "seed": seed, "repetitions": repetitions}
        for done in run_protocol(rig, PLAN, arms=list(ARMS), **how):
            run = read_run(done.folder)
            if done.ending.outcome != "completed":
                raise SystemExit(f"{done.folder.name}: {done.ending.outcome}")
            found[run.meta["arm"]].append(run_metrics(run.log))
    return found


def rows(name: str, found: dict[str, list[RunMetrics]]) -> list[str]:
    """Lines of the table: medians, least and most."""
    lines = []
    for arm, runs in found.items():
        cells = []
        for measure in MEASURES.values():
            values = np.array([measure(m) for m in runs])
            cells.append(f"{np.median(values):.3g} ({values.min():.3g} to {values.max():.3g})")
        lines.append(f"| {name} | {ARMS[arm]} | {' | '.join(cells)} |")
    return lines


def main() -> None:
    argparse.ArgumentParser(description=__doc__).parse_args()
    print(f"| table | controller | {' | '.join(MEASURES)} |\n|{'---|' * (2 + len(MEASURES))}")
    default = load_rig(None)
    print("\n".join(rows("the default one", measured(default, 1, SEEDS))))
    units: dict[str, list[RunMetrics]] = {arm: [] for arm in ARMS}
    for seed in range(SEEDS):
        for arm, runs in measured(another_unit(default, seed), seed, 1).items():
            units[arm] += runs
    print("\n".join(rows("others of its kind", units)))


if __name__ == "__main__":
    main()
