"""How often `rig calibrate play`'s 95 % intervals hold the truth: 200 random simulated rigs.

`python tests/benchmarks/calibration/play_calibration.py --rigs 200 --out play.jsonl`;
resumable: rigs that are in the file are not made again.
"""

import argparse
import json
from dataclasses import replace
from math import degrees, radians
from pathlib import Path

import numpy as np

from experiments.analysis.statistics import wilson
from experiments.calibrate.backlash import measure
from experiments.runs.assemble import another_unit, known, load_rig, with_play
from rig.parameters import Rig


def random_rig(seed: int) -> tuple[Rig, Rig]:
    """A table and what its lab believes: play 0.3 to 3 degrees in gear and joint, friction and
    noise drawn at random about what the rig file says."""
    rng, kind = np.random.default_rng([seed, 77]), load_rig(None)
    gear, joint = radians(rng.uniform(0.3, 3.0)), radians(rng.uniform(0.3, 3.0))
    rubbing = np.exp(0.3 * rng.standard_normal())
    drive = replace(
        kind.drive,
        arm_friction_nm=kind.drive.arm_friction_nm * rubbing,
        joint_friction_nm=kind.drive.joint_friction_nm * rubbing,
    )
    camera = replace(kind.camera, noise_m=float(rng.uniform(1e-4, 6e-4)))
    servo = replace(kind.servo, tachometer_noise_rad_s=float(rng.uniform(0.002, 0.01)))
    table = with_play(replace(kind, camera=camera, servo=servo), gear_rad=gear, joint_rad=joint)
    if seed % 2:
        aside = 0.5 * gear * rng.uniform(0.3, 0.9) * rng.choice((-1.0, 1.0))
        for pairs in table.effects["gear_backlash"].values():
            pairs["offset_rad"] = float(aside)
    unit = another_unit(replace(table, drive=replace(drive)), seed)
    drawn = replace(unit.drive, arm_friction_nm=drive.arm_friction_nm,
                    joint_friction_nm=drive.joint_friction_nm)  # fmt: skip
    return replace(unit, drive=drawn), known(kind)


def one(seed: int) -> list[dict]:
    table, believed = random_rig(seed)
    truth = {
        "gear": table.effects["gear_backlash"]["x"]["play_rad"],
        "joint": table.effects["joint_backlash"]["x"]["play_rad"],
    }
    truth |= {"gear without tachometer": truth["gear"], "whole": truth["gear"] + truth["joint"]}
    found = measure(table, believed, seed)
    rows = []
    for what, by_axis in found.plays.items():
        for axis, play in by_axis.items():
            low, high = play.interval_rad
            rows.append({"seed": seed, "what": what, "axis": axis, "truth": truth[what],
                         "value": play.width_rad, "low": low, "high": high,
                         "one_sided": bool(seed % 2), "symmetric": play.symmetric})  # fmt: skip
    return rows


def main() -> None:
    options = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options.add_argument("--rigs", type=int, default=200)
    options.add_argument("--out", type=Path, default=Path("play_calibration.jsonl"))
    chosen = options.parse_args()
    lines = chosen.out.read_text().splitlines() if chosen.out.is_file() else []
    done = {json.loads(line)["seed"] for line in lines}
    with chosen.out.open("a", encoding="utf-8") as file:
        for seed in range(chosen.rigs):
            if seed not in done:
                file.write("".join(json.dumps(row) + "\n" for row in one(seed)))
                file.flush()
    summary([json.loads(line) for line in chosen.out.read_text().splitlines()])


def summary(rows: list[dict]) -> None:
    """Print coverage, typical error and width by what was measured."""
    print("| what | n | hold the truth (95 %) | RMS error [deg] | bias | median half width |")
    print("|---|---|---|---|---|---|")
    for what in dict.fromkeys(row["what"] for row in rows):
        those = [row for row in rows if row["what"] == what]
        held = sum(row["low"] <= row["truth"] <= row["high"] for row in those)
        share = wilson(held, len(those))
        off = np.degrees([row["value"] - row["truth"] for row in those])
        half = np.median([degrees(row["high"] - row["low"]) / 2 for row in those])
        print(f"| {what} | {len(those)} | {100 * share.value:.0f} % ({100 * share.low:.0f} to "
              f"{100 * share.high:.0f}) | {np.sqrt(np.mean(off**2)):.3f} | {off.mean():+.3f} | "
              f"{half:.3f} |")  # fmt: skip
    for aside, name in ((False, "symmetric"), (True, "one-sided")):
        told = [row["symmetric"] != aside for row in rows
                if row["one_sided"] == aside and row["symmetric"] is not None]  # fmt: skip
        if told:
            print(f"\nmiddle seen, {name}: told so in {sum(told)} of {len(told)}")


if __name__ == "__main__":
    main()
