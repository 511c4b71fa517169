"""Which logs a set holds: how many of each engine and kind, and what is drawn for each of them."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib.util import find_spec
from itertools import product
from pathlib import Path

import numpy as np

from experiments.benchmark.logs import TABLE
from experiments.blind import sizes, uncatalogued_effects
from experiments.blind.draws import ALL_EFFECTS, TrialPlan, draw_trial
from experiments.blind.sizes import smallest
from experiments.blind.trial import BlindTrial
from experiments.runs.assemble import load_rig
from rig.effects import BY_NAME, effects_of
from rig.parameters import Rig

# Chosen: half of the logs come from engines that share no equation with the product.
ENGINES = {"own": 0.3, "foreign": 0.3, "mujoco": 0.2, "positions": 0.2}
POSITION_TABLES = ("hobby-two-servos", "bus-servos", "three-arms")
# A limit has no smallest amplitude before the speeds in use are known.
POSITION_EFFECTS = tuple(e.name for e in effects_of("position") if e.name != "rate_limit")
PROTOCOLS = ("steps", "pushed", "sine-sweep")  # 24 to 30 s; all move servos and ball


@dataclass(frozen=True)
class Kind:
    """A kind of log: its share of the set, the kind of trial, and the sizes of what is hidden."""

    share: float
    trial: str
    factors: tuple[float, float] = sizes.FACTORS


# By the words of the table of results.
KINDS: dict[str, Kind] = {
    "one effect, real size": Kind(0.22, "single", sizes.REAL_FACTORS),
    "one effect, small": Kind(0.18, "single"),
    "two effects": Kind(0.15, "pair", sizes.REAL_FACTORS),
    "five effects": Kind(0.10, "five", sizes.REAL_FACTORS),
    "an effect without a name": Kind(0.15, "stranger"),
    "healthy": Kind(0.20, "nothing"),
}


@dataclass(frozen=True)
class Case:
    """A log to be made: number (from 1), engine (a key of `ENGINES`), kind (a key of `KINDS`)."""

    number: int
    engine: str
    kind: str


def cases_of(logs: int, seed: int, engines: Mapping[str, float] = ENGINES) -> list[Case]:
    """The logs of a set in random order, in the shares of `engines` and `KINDS`.

    The order depends on the seed alone, so that it tells nothing. Every cell gets its share rounded
    down, the largest remainders one more.
    """
    cells = list(product(engines, KINDS))
    wanted = np.array([logs * engines[e] * KINDS[k].share for e, k in cells])
    wanted *= logs / wanted.sum()
    counts = np.floor(wanted).astype(int)
    order = np.argsort(counts - wanted, kind="stable")
    counts[order[: logs - counts.sum()]] += 1
    listed = [cell for cell, n in zip(cells, counts, strict=True) for _ in range(n)]
    shuffled = np.random.default_rng([seed, 0]).permutation(len(listed))
    return [Case(i + 1, *listed[place]) for i, place in enumerate(shuffled)]


def engines_here() -> dict[str, float]:
    """The engines that this machine can run: all of `ENGINES`, without MuJoCo where it is not
    installed.
    """
    there = find_spec("mujoco") is not None
    return {name: share for name, share in ENGINES.items() if name != "mujoco" or there}


def draw_case(case: Case, seed: int, attempt: int = 0) -> BlindTrial:
    """The trial of a case, drawn with the generator [seed, number + 100000 attempt].

    attempt: from 0; another one draws everything anew, for a log whose ball fell off at once.
    """
    kind = KINDS[case.kind]
    plan = _plan(case, seed)
    reach = tuple(name for name in plan.effects if _reaches(name, kind.factors[0]))
    plan = replace(plan, effects=reach, factors=kind.factors)
    trial = draw_trial(plan, case.number + 100_000 * attempt, kind.trial)
    engine = "own" if case.engine == "positions" else case.engine
    return replace(trial, name=f"case-{case.number:04d}", engine=engine)


def _plan(case: Case, seed: int) -> TrialPlan:
    """What is drawn for this engine: the table, and what may be hidden in it."""
    plan = TrialPlan(0, 0, seed, protocols=PROTOCOLS, runs=1, table=TABLE)
    if case.engine != "positions":
        return replace(plan, effects=ALL_EFFECTS)
    table = _position_table(POSITION_TABLES[case.number % len(POSITION_TABLES)])
    others = tuple(name for name in uncatalogued_effects.NAMES if name != "cable")  # pulls in volts
    return replace(plan, effects=POSITION_EFFECTS, strangers=others, table=table)


def _reaches(name: str, factor: float) -> bool:
    """Whether the effect's sensible range goes so far (a saturation follows the volts in use)."""
    return name == "saturation" or BY_NAME[name].parameters[0].high >= factor * smallest(name)


@cache
def _position_table(name: str) -> Rig:
    return load_rig(Path(name))


def engine_of(trial: BlindTrial) -> str:
    """The trial's engine as a key of `ENGINES`."""
    return "positions" if trial.plant["servo"]["kind"] == "position" else trial.engine


def kind_of(trial: BlindTrial) -> str:
    """The trial's kind as a key of `KINDS`."""
    low = sizes.REAL_FACTORS[0]
    for name, kind in KINDS.items():
        if kind.trial == trial.kind and (trial.kind != "single" or _is_real(trial, low, name)):
            return name
    raise ValueError(f"{trial.name}: a benchmark has no logs of kind '{trial.kind}'")


def _is_real(trial: BlindTrial, low: float, name: str) -> bool:
    return (trial.factor >= low) == (KINDS[name].factors[0] >= low)
