"""Does the proposed next experiment really separate two names? In simulation, on runs of its own.

`python tests/benchmarks/gap/next_experiments.py` (about 10 min on one core). Pairs of names that
a short log may leave open, each 1.5 to 4 times its smallest amplitude. For each pair the workflow
proposes a protocol from the shipped ones; then the table has the one name, then the other, the
protocol is run with noise, start and targets drawn anew, and both names are fitted to the log:
separated is what the true name wins by the margin that `rig gap` asks for.
"""

import argparse

import numpy as np
from joblib import Parallel, delayed

from calibration.gap.decision_rule import RIVAL_MARGIN
from calibration.gap.next_experiment import propose, record, separation
from experiments.analysis.statistics import wilson
from experiments.blind.sizes import factor, smallest
from experiments.gap.protocol_choices import experiment_menu
from experiments.runs.protocol import course, read_protocol
from rig.effects import BY_NAME
from rig.parameters import Rig

PAIRS = (
    ("coulomb_friction", "dead_zone"), ("coulomb_friction", "stribeck_friction"),
    ("level_offset", "level_drift"), ("linkage_quadratic", "transmission_ripple"),
    ("linkage_quadratic", "linkage_cubic"), ("viscous_drag", "rolling_resistance"),
    ("joint_backlash", "rolling_resistance"), ("camera_scale", "linkage_cubic"),
    ("camera_scale", "lens_distortion"), ("camera_yaw", "cross_coupling"),
    ("gain_asymmetry", "voltage_offset"), ("gain_drift", "supply_sag"),
    ("plate_bowl", "viscous_drag"), ("input_delay", "dead_zone"),
    ("voltage_offset", "cogging"), ("camera_delay", "viscous_drag"),
)  # fmt: skip
LIMIT_S = 30.0


def _hidden(name: str, rng: np.random.Generator) -> dict:
    effect = BY_NAME[name]
    size = smallest(name) * factor(rng, (1.5, 4.0))
    first = {"dead_zone": "half_width_V"}.get(name, effect.parameters[0].key)
    pairs = {first: size}
    if name in ("cogging", "transmission_ripple"):
        turns = 24.0 if name == "cogging" else 10.0
        pairs = {effect.parameters[0].key: size, "phase_rad": 0.7, "periods_per_turn": turns}
    if name == "stribeck_friction":
        pairs["speed_rad_s"] = 0.1
    return {name: {effect.axes[0]: pairs}}


def one(pair: tuple[str, str], seed: int) -> tuple[tuple[str, str], str, list[bool]]:
    """The pair, the protocol proposed ("" for none), and for each truth whether it separated."""
    rng = np.random.default_rng(seed)
    rig = Rig()
    effects = tuple(_hidden(name, rng) for name in pair)
    plan = propose(rig, (effects[0], effects[1]), experiment_menu(rig, seed=seed), seed=seed)
    if plan is None:
        return pair, "", []
    protocol = read_protocol(plan.protocol)
    shorter = protocol.model_copy(update={"duration_s": min(protocol.duration_s, LIMIT_S)})
    found = []
    for j in (0, 1):
        way = course(shorter, rig, seed + 1000 + j)
        run = record(rig, effects[j], way, rng)
        found.append(separation(run.log, way, rig, effects[j], effects[1 - j]) >= RIVAL_MARGIN)
    return pair, plan.protocol, found


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--draws", type=int, default=2, help="of the sizes, a pair")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    jobs = [
        (p, options.seed + 100 * d + i) for d in range(options.draws) for i, p in enumerate(PAIRS)
    ]
    results = Parallel(options.jobs, return_as="generator")(delayed(one)(*job) for job in jobs)
    right = total = none = 0
    print("| pair | protocol | true first | true second |\n|---|---|---|---|", flush=True)
    for pair, protocol, found in results:
        words = ["separated" if ok else "no" for ok in found] or ["-", "-"]
        print(
            f"| {pair[0]}, {pair[1]} | {protocol or 'none tells'} | {' | '.join(words)} |",
            flush=True,
        )
        right, total, none = right + sum(found), total + len(found), none + (not protocol)
    share = wilson(right, total)
    print(
        f"separated {right} of {total} ({100 * share.low:.0f} to {100 * share.high:.0f} %); "
        f"no protocol proposed for {none} of {len(jobs)}"
    )


if __name__ == "__main__":
    main()
