"""Estimated against true play: `uv run python tests/benchmarks/control/play_estimates.py` (1 min).

The default table with other play, 20 other units of the kind each, arm "with"; both axes counted.
"""

import argparse
from dataclasses import replace
from itertools import product
from math import degrees, radians
from pathlib import Path

import numpy as np

from experiments.runs.assemble import another_unit, load_rig
from experiments.runs.protocol import read_protocol
from experiments.runs.runner import RunRequest, simulate_run
from rig.parameters import Rig

SEEDS = range(20)
PLAYS_DEG = (0.0, 0.5, 1.0, 2.0, 3.0)


def table(place: str, play_deg: float, offset_share: float) -> Rig:
    """The default table with this play in one place (offset in shares of the half width)."""
    rig = load_rig(None)
    width = radians(play_deg)
    values = {"play_rad": width, "offset_rad": 0.5 * offset_share * width}
    effects = dict(rig.effects) | {f"{place}_backlash": {"x": values, "y": dict(values)}}
    return replace(rig, effects=effects)


def estimates(rig: Rig, place: str, protocol: str) -> tuple[np.ndarray, np.ndarray]:
    """Widths and standard deviations at the end of each run, both axes [deg]."""
    plan, found = read_protocol(protocol), []
    for seed in SEEDS:
        log = simulate_run(RunRequest(another_unit(rig, seed), plan, "with", seed, Path())).log
        found += [
            [degrees(log[f"estimated_{place}_play{s}_{a}_rad"][-1]) for s in ("", "_std")]
            for a in "xy"
        ]
    width, std = np.array(found).T
    return width, std


def main() -> None:
    argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0]).parse_args()
    print("| play | place | protocol | off middle | median | median error | worst | stated std |")
    print("|---|---|---|---|---|---|---|---|")
    cases = product(("gear", "joint"), ("free-release", "steps"), (0.0, 0.6), PLAYS_DEG)
    for place, protocol, offset, play in cases:
        if offset and not play:
            continue
        width, std = estimates(table(place, play, offset), place, protocol)
        error = np.abs(width - play)
        print(
            f"| {play:g} deg | {place} | {protocol} | {offset:g} | {np.median(width):.2f} | "
            f"{np.median(error):.2f} | {error.max():.2f} | {np.median(std):.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
