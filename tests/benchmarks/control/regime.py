"""Where the plate keeps its place inside the joint's play.

`python tests/benchmarks/control/regime.py` (1 min). Assumed values decide it (joint friction and
stiffness, plate inertia): they are swept one by one on the default table with 1.5 degrees of joint
play. Does a ball 10 cm out pull a resting plate to its side, and what does the joint's observer
say of a closed-loop run?
"""

import argparse
from dataclasses import replace
from math import degrees

import numpy as np

from experiments.runs.assemble import known, load_rig
from experiments.runs.protocol import course, read_protocol
from rig.control.controllers import COMPENSATORS
from rig.estimation.joint_observer import KEEPS
from rig.loop.loop import Loop
from rig.parameters import Rig
from rig.plant import plant, plant_record
from rig.simulation.operator import SimulatedOperator
from rig.simulation.simulator import SimulatedTable

SWEEPS = {
    "joint_friction_nm": (0.0, 1e-4, 3e-4, 6e-4, 1e-3, 3e-3, 1e-2, 2e-2, 4e-2),
    "joint_stiffness_nm_rad": (3.0, 10.0, 30.0, 100.0),
    "plate_inertia_kg_m2": (3.2e-5, 6.4e-5, 1.3e-4),
}


def dropped(rig: Rig) -> float:
    """Share of the half play [-1, 1] to which a held servo's plate moves under a ball 10 cm out."""
    p, s, seen = plant_record.pack(rig), plant.rest((0.1, 0.0)), np.full(7, np.nan)
    history = plant_record.no_volts(rig)
    for k in range(500):
        s[plant.BALL], s[plant.BALL_W] = (0.1, 0.0), 0.0
        s[plant.MOTOR] = s[plant.ARM] = s[plant.MOTOR_RATE] = s[plant.ARM_RATE] = 0.0
        plant.advance(s, p, history, k * 0.002, 0.002, 0.0, 0.0, False, np.inf, seen)
    return float(s[plant.PLATE, 0] / (0.5 * rig.effects["joint_backlash"]["x"]["play_rad"]))


def believed(rig: Rig, seed: int) -> tuple[float, float]:
    """After 30 s of steps: the observer's probability that the plate keeps its place, and the lost
    motion it then believes [deg] (play and wind-up)."""
    way = course(read_protocol("steps"), rig, seed)
    table = SimulatedTable(rig, np.random.default_rng(seed), start_m=way.start_m)
    loop = Loop(
        table, known(rig), COMPENSATORS["with"], way, operator=SimulatedOperator(table, 0.0)
    )
    loop.run()
    joint = loop.state["backlash"]["joint"]
    return float(np.mean(joint["keeps"])), degrees(2 * float(np.median(joint["mean"][KEEPS, :, 3])))


def main() -> None:
    argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0]).parse_args()
    rig = load_rig(None)
    print("| assumed value | a ball 10 cm out moves the plate by | says it keeps | lost motion |")
    print("|---|---|---|---|")
    for name, values in SWEEPS.items():
        for value in values:
            swept = replace(rig, drive=replace(rig.drive, **{name: value}))
            keeps, lost = np.median([believed(swept, seed) for seed in range(4)], axis=0)
            moved = f"{dropped(swept):+.2f} of the half play"
            print(f"| {name} = {value:g} | {moved} | {keeps:.2f} | {lost:.2f} deg |", flush=True)


if __name__ == "__main__":
    main()
