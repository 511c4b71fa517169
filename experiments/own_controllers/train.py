"""Find the weights of linear_policy.py by the cross-entropy method: a plain evolution.

    uv run --extra gym python experiments/own_controllers/train.py --out linear_policy.json

Every candidate balances the ball on tables drawn from the intervals of a `rig gap` answer, the same
tables for all candidates of a generation; the best quarter gives the next generation's mean and
spread. The table's own effects are not used: what is not in the answer, the training does not know.
"""

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from linear_policy import INPUTS, actions

from experiments.runs.assemble import load_rig
from rig.gym import BalancingTables

HERE = Path(__file__).parent
CANDIDATES, TABLES, ELITE = 64, 4, 16
SPREAD = np.array([8.0, 4.0, 2.0, 0.1, 0.05, 0.05])  # chosen: full volts at the size of each input
LEAST = 0.02  # of SPREAD: added, so that the search does not freeze early


def returns(envs: BalancingTables, weights: np.ndarray, seeds: list[int]) -> np.ndarray:
    """Mean reward a tick of candidates with these weights (c, 2, 6); a lost ball earns no more.

    envs: c tables a seed, in the order of the candidates.
    """
    seen, _ = envs.reset(seed=seeds * len(weights))
    each = np.repeat(weights, len(seeds), axis=0)
    total, going = np.zeros(len(each)), np.ones(len(each), bool)
    ticks = 0
    while going.any():
        seen, rewards, terminated, truncated, _ = envs.step(actions(each, seen))
        total += np.where(going, rewards, 0.0)
        going &= ~(terminated | truncated)
        ticks += 1
    return total.reshape(len(weights), -1).mean(axis=1) / ticks


def train(envs: BalancingTables, generations: int, seed: int) -> np.ndarray:
    """Return the mean weights (2, 6) of the last generation."""
    rng = np.random.default_rng(seed)
    mean, spread = np.zeros((2, len(INPUTS))), np.tile(SPREAD, (2, 1))
    for generation in range(generations):
        weights = mean + spread * rng.standard_normal((CANDIDATES, *mean.shape))
        found = returns(envs, weights, rng.integers(2**31, size=TABLES).tolist())
        best = weights[np.argsort(found)[-ELITE:]]
        mean = best.mean(axis=0)
        spread = best.std(axis=0) + LEAST * SPREAD * (1 - generation / generations)
        print(f"{generation:3d}  best {found.max():.4f}  median {np.median(found):.4f}", flush=True)
    return mean


def main() -> None:
    """Train and write the weights."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rig", type=Path, help="rig file (default: the shipped default table)")
    parser.add_argument("--gap", type=Path, default=HERE / "gap.json", help="answer of rig gap")
    parser.add_argument("--generations", type=int, default=60)
    parser.add_argument("--seconds", type=float, default=8.0, help="of an episode")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    envs = BalancingTables(
        CANDIDATES * TABLES,
        replace(load_rig(given.rig), effects={}),
        randomise=given.gap,
        seconds=given.seconds,
    )
    began_s = time.monotonic()
    weights = train(envs, given.generations, given.seed)
    took_s = time.monotonic() - began_s
    words = {"inputs": INPUTS, "weights": weights.round(4).tolist(), "seed": given.seed}
    given.out.write_text(json.dumps(words, indent=1) + "\n", encoding="utf-8")
    print(f"{given.out}: {given.generations} generations in {took_s:.0f} s")


if __name__ == "__main__":
    main()
