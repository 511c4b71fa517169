"""Exported tables against our simulator: `uv run python tests/benchmarks/plant/exported_models.py`.

Prints the table of experiments/export/README.md: the same volts or angles for 2 s on our simulator,
in MuJoCo (from the XML) and in FMPy (from the FMU); greatest differences, the ball's RMS, and how
far our own table without its play moves from it. A minute.
"""

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

from experiments.runs.assemble import load_rig
from tests.support.exported_models import (
    MORE,
    MOST,
    apart,
    course,
    in_fmi,
    in_mujoco,
    ours,
    with_effects,
)

START = (0.01, -0.02)


def row(name: str, rig, *, mujoco: bool = True) -> str:
    """One line of the table."""
    driven = course(rig)
    own = ours(rig, driven, START)
    rigid = replace(rig, effects={k: v for k, v in rig.effects.items() if "backlash" not in k})
    parts = [apart(ours(rigid, driven, START), own)]
    with tempfile.TemporaryDirectory() as folder:
        parts += [apart(in_mujoco(rig, driven, Path(folder), START), own) if mujoco else None]
        parts += [apart(in_fmi(rig, driven, Path(folder), START), own)]
    cells = [
        "-"
        if one is None
        else " / ".join(
            f"{one[key]:.3g}" for key in ("arm_mrad", "plate_mrad", "ball_mm", "ball_rms_mm")
        )
        for one in parts
    ]
    return f"| {name} | {cells[1]} | {cells[2]} | {cells[0]} |"


def main() -> None:
    argparse.ArgumentParser(description=__doc__).parse_args()
    default = load_rig(Path("default"))
    print("| table | MuJoCo | FMU | without its play |\n|---|---|---|---|")
    print(row("default", default))
    print(row("default without effects", replace(default, effects={})))
    print(row("15 effects", with_effects(default, MOST)))
    print(row("22 effects", with_effects(default, MOST, MORE), mujoco=False))
    for name in ("hobby-two-servos", "bus-servos", "three-arms"):
        rig = load_rig(Path(name))
        print(row(name, rig))
        if name != "bus-servos":
            print(row(f"{name} without play", replace(rig, effects={})))
    for effect, axes in MOST.items():
        print(row(f"default with {effect} alone", with_effects(default, {effect: axes})))


if __name__ == "__main__":
    main()
