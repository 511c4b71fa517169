"""How fast the simulator is: `uv run python tests/benchmarks/plant/speed.py --out speed.json`.

Ratios from one run, contenders in turn, CPU time (wall time where cores are compared); a minute.
The same equations in C, in numpy and in MuJoCo; a batch of 1000 tables; the vector unit's limit.
"""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numba
import numpy as np

from experiments.benchmark.engines.mujoco_engine.table import MujocoTable
from experiments.runs.assemble import another_unit, known, load_rig
from rig.compiled import compiled
from rig.control.controllers import WITH
from rig.course import Course
from rig.plant import plant, plant_record
from rig.plant.constants import LANES
from rig.simulation import vectorized_plants
from rig.simulation.batch import simulate_many
from rig.simulation.simulate import TICK_BUFFERS, Task, draw, simulate
from tests.benchmarks.plant.speed_c import C, builds, pack_state
from tests.benchmarks.plant.speed_numpy import Tables
from tests.support.mujoco_engine.comparison import Start

TICK_S, STEPS = 0.002, 20
RUN_TICKS, BATCH_TICKS, SETS = 500, 500, 1000
ROUNDS = 9
START = (0.03, -0.02)
COLD = """
import time
import numpy as np
from rig.parameters import Rig
from rig.simulation.simulate import draw, simulate
from rig.course import Course
rig, way = Rig(), Course(np.zeros((50, 2)), np.zeros((50, 2)))
simulate(rig, rig, 0, way, draw(np.random.default_rng(0), rig, way))
print(time.process_time())
"""
RIG = load_rig(None)
T = TICK_S * np.arange(RUN_TICKS)
VOLTS = np.column_stack([np.sin(20 * T) + 0.13, np.sin(17 * T) + 0.1])


@compiled
def one_run(s, p, history, volts, seen):
    """The product's plant under given volts."""
    for k in range(volts.shape[0]):
        history[0, 0], history[0, 1] = volts[k, 0], volts[k, 1]
        t = k * TICK_S
        if plant.advance(s, p, history, t, TICK_S, 0.0, 0.0, False, np.inf, seen):
            return k
    return volts.shape[0]


@compiled
def one_block(b, plants, history, volts, never, buffers):
    """LANES plants under the same volts."""
    now = np.zeros(LANES)
    for k in range(volts.shape[0]):
        now[:] = k * TICK_S
        for lane in range(LANES):
            history[lane, 0, 0], history[lane, 0, 1] = volts[k, 0], volts[k, 1]
        vectorized_plants.advance_block(
            b, plants, history, False, False, now, TICK_S, never, buffers
        )


class Run:
    """One table under VOLTS by each contender; every call returns its final state."""

    def __init__(self) -> None:
        self.p = plant_record.pack(RIG)

    def product(self) -> np.ndarray:
        s, seen = plant.rest(START), np.full(7, np.nan)
        one_run(s, self.p, plant_record.no_volts(RIG), VOLTS, seen)
        return pack_state(s)

    def c(self, build: C) -> np.ndarray:
        state = pack_state(plant.rest(START))
        build.run(self.p, state, VOLTS, STEPS)
        return state


class Batch:
    """SETS tables of the kind under the first BATCH_TICKS of VOLTS."""

    def __init__(self) -> None:
        self.plants = [plant_record.pack(another_unit(RIG, i)) for i in range(SETS)]
        self.blocks = [
            np.array(self.plants[i : i + LANES]) for i in range(0, SETS - LANES + 1, LANES)
        ]

    def _block(self, plants: np.ndarray) -> np.ndarray:
        b = vectorized_plants.block_of(plants, [START] * LANES)
        never, history = np.full(LANES, np.inf), np.zeros((LANES, 2, 2))
        one_block(b, plants, history, VOLTS[:BATCH_TICKS], never, np.zeros(LANES, TICK_BUFFERS))
        return b.reshape(-1, LANES)[vectorized_plants.BALL : vectorized_plants.BALL + 2].T

    def lanes(self, cores: int = 1) -> np.ndarray:
        """Final balls (SETS, 2) from blocks of LANES."""
        if cores == 1:
            return np.concatenate([self._block(plants) for plants in self.blocks])
        with ThreadPoolExecutor(cores) as pool:
            return np.concatenate(list(pool.map(self._block, self.blocks)))

    def scalar(self) -> np.ndarray:
        """The same one by one."""
        history, seen, out = np.zeros((2, 2)), np.full(7, np.nan), []
        for p in self.plants:
            s = plant.rest(START)
            one_run(s, p, history, VOLTS[:BATCH_TICKS], seen)
            out.append(s[plant.BALL].copy())
        return np.array(out)


def by_numpy(plants, ticks: int) -> np.ndarray:
    tables = Tables(plants)
    tables.ball = np.zeros_like(tables.ball) + np.array(START)[:, None]
    for pair in VOLTS[:ticks]:
        for _ in range(STEPS):
            tables.step(pair)
    return tables.ball.T


def cpu_s(work: Callable[[], object]) -> float:
    begin = time.process_time()
    work()
    return time.process_time() - begin


def wall_s(work: Callable[[], object]) -> float:
    begin = time.perf_counter()
    work()
    return time.perf_counter() - begin


def in_turn(contenders: dict[str, tuple[Callable[[], object], float]], clock=cpu_s) -> dict:
    """Steps per second (ROUNDS,) of each contender: (work, how many steps it is)."""
    for work, _ in contenders.values():
        work()  # compiles, fills caches
    speeds = {name: [] for name in contenders}
    for _ in range(ROUNDS):
        for name, (work, steps) in contenders.items():
            speeds[name].append(steps / clock(work))
    return {name: np.array(found) for name, found in speeds.items()}


def agree(name: str, found: np.ndarray, want: np.ndarray, tolerance: float) -> None:
    """A comparison of speeds is void where the contenders do not compute the same."""
    worst = float(np.abs(found - want).max())
    if not worst < tolerance:
        raise SystemExit(f"{name} differs from the product by {worst:.2g} (limit {tolerance:g})")


def line(what: str, speeds: dict, over: str, under: str, goal: str) -> dict:
    """Print one ratio: of the medians, with the range over the rounds."""
    ratios = speeds[over] / speeds[under]
    middle = float(np.median(speeds[over]) / np.median(speeds[under]))
    print(f"| {what} | {middle:.2f} ({ratios.min():.2f} to {ratios.max():.2f}) | {goal} |",
          flush=True)  # fmt: skip
    return {"ratio": middle, "low": float(ratios.min()), "high": float(ratios.max())}


def single(rivals: dict[str, C]) -> tuple[dict, dict]:
    """One run: product, C builds, MuJoCo."""
    run, n = Run(), RUN_TICKS * STEPS
    contenders = {"product": (run.product, n)}
    for name, build in rivals.items():
        agree(name, run.c(build), run.product(), 1e-7)
        contenders[name] = (lambda build=build: run.c(build), n)

    def mujoco() -> None:
        table = MujocoTable(RIG, np.random.default_rng(0), start_m=Start(START).xy_m)
        for pair in VOLTS[:50]:
            table.advance(pair)

    contenders["MuJoCo"] = (mujoco, 50 * STEPS)
    return in_turn(contenders), contenders


def vector_limit(fast: C, batch_speed: np.ndarray) -> dict:
    """How many vector instructions a block's step has, and what the unit could do with them."""
    again = numba.njit(error_model="numpy")(
        vectorized_plants._cheap_step.py_func
    )  # the cache has no listing
    again(vectorized_plants.block_of(Batch().blocks[0], [START] * LANES), 1e-4)
    ((_, text),) = again.inspect_asm().items()
    arithmetic = r"\tv(?:add|sub|mul|div|sqrt|max|min|fn?m(?:add|sub)\d+)pd\t.*%zmm"
    instructions = len(re.findall(arithmetic, text))
    slow = len(re.findall(r"\tv(?:div|sqrt)pd\t.*%zmm", text))
    others = len(re.findall(r"\tv\w+\t.*%zmm", text)) - instructions
    rounds = 3_000_000
    per_s = max(fast.multiply_adds(rounds) / 8 / cpu_s(lambda: fast.multiply_adds(rounds))
                for _ in range(5))  # fmt: skip
    if not instructions:
        return {}
    limit = per_s * LANES / instructions
    share = float(np.median(batch_speed)) / limit
    print(
        f"\nVector unit: {per_s / 1e9:.1f} G multiply-adds of 8 numbers a second; a step "
        f"of {LANES} tables has {instructions} vector operations ({slow} divisions and roots) "
        f"and {others} moves, comparisons and selections: {limit / 1e6:.0f} M steps/s at "
        f"most, {100 * share:.0f} % of it reached."
    )
    return {"per_s": per_s, "operations": instructions, "slow": slow, "others": others,
            "limit": limit, "share": share}  # fmt: skip


def starts() -> dict:
    """CPU seconds of a fresh process with one short run: with an empty cache, then from it."""
    with tempfile.TemporaryDirectory() as folder:
        env = os.environ | {"NUMBA_CACHE_DIR": folder, "PYTHONPYCACHEPREFIX": folder}
        env.pop("PYTHONDONTWRITEBYTECODE", None)

        def once() -> float:
            done = subprocess.run([sys.executable, "-c", COLD], env=env, capture_output=True,
                                  text=True, check=True)  # fmt: skip
            return float(done.stdout)

        return {"cold_s": once(), "cached_s": sorted(once() for _ in range(5))[2]}


def tasks(count: int, seconds: float) -> list[Task]:
    n = round(seconds / TICK_S)
    way, out = Course(np.zeros((n, 2)), np.zeros((n, 2)), START), []
    for i in range(count):
        rig = another_unit(RIG, i)
        out.append(Task(rig, known(RIG), WITH, way, draw(np.random.default_rng(i), rig, way)))
    return out


def main() -> None:
    options = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options.add_argument("--out", type=Path, help="write the numbers here (JSON)")
    chosen, results = options.parse_args(), {}
    with tempfile.TemporaryDirectory() as folder:
        rivals = builds(Path(folder))
        if not rivals:
            print("No gcc: the comparison with C is skipped.\n")
        results = compare(rivals)
    results["start"] = starts()
    print(f"\nFirst run of a process: {results['start']['cold_s']:.1f} s of CPU compiling, "
          f"{results['start']['cached_s']:.2f} s from the cache (goal 0.6).")  # fmt: skip
    if chosen.out:
        chosen.out.write_text(json.dumps(results, indent=1), encoding="utf-8")


def compare(rivals: dict[str, C]) -> dict:
    """All ratios, printed as they come."""
    batch, closed = Batch(), tasks(64, 2.0)
    agree("lanes", batch.lanes(), batch.scalar(), 1e-300)
    agree("numpy", by_numpy(batch.plants[:20], 20), by_numpy_truth(batch, 20), 1e-9)
    one, contenders = single(rivals)
    n = SETS * BATCH_TICKS * STEPS
    contenders = {k: v for k, v in contenders.items() if k != "MuJoCo"} | {
        "batch": (batch.lanes, n),
        "one by one": (batch.scalar, n),
        "numpy": (lambda: by_numpy(batch.plants, 1), SETS * STEPS),
        "closed batch": (lambda: simulate_many(closed), 64 * 1000 * STEPS),
        "closed one by one": (
            lambda: [
                simulate(t.rig, t.known, t.compensator, t.course, t.draws) for t in closed[:16]
            ],
            16 * 1000 * STEPS,
        ),
    }
    many = in_turn(contenders)
    both = {"1": (batch.lanes, n), "2": (lambda: batch.lanes(2), n)}
    cores, work = in_turn(both, wall_s), in_turn(both)  # steps a second; steps a CPU second
    found = {name: float(np.median(s)) for name, s in (one | many).items()}
    print("| M steps/s (median) |", " | ".join(f"{k} {v / 1e6:.3g}" for k, v in found.items()))
    print("\n| ratio | median (range) | goal |\n|---|---|---|")
    ratios = {}
    for name in rivals:
        ratios[f"one run / {name}"] = line(f"one run / {name}", one, "product", name, "0.8")
        ratios[f"batch / {name}"] = line(f"batch, a core / {name}", many, "batch", name, "3")
    for what, found_, over, under, goal in (
        ("one run / MuJoCo", one, "product", "MuJoCo", "20"),
        ("batch, a core / numpy", many, "batch", "numpy", "-"),
        ("batch, a core / one by one", many, "batch", "one by one", "-"),
        ("whole closed loops, batch / one by one", many, "closed batch", "closed one by one", "-"),
        ("batch, two cores / one", cores, "2", "1", "1.9"),
        ("the same by CPU seconds (idle cores; times 2)", work, "2", "1", "0.95"),
    ):
        ratios[what] = line(what, found_, over, under, goal)
    limit = vector_limit(next(iter(rivals.values())), many["batch"]) if rivals else {}
    return {"steps_per_s": found, "ratios": ratios, "vector_unit": limit}


def by_numpy_truth(batch: Batch, ticks: int) -> np.ndarray:
    """What the product makes of the same tables over `ticks`."""
    history, seen, out = np.zeros((2, 2)), np.full(7, np.nan), []
    for p in batch.plants[:20]:
        s = plant.rest(START)
        one_run(s, p, history, VOLTS[:ticks], seen)
        out.append(s[plant.BALL].copy())
    return np.array(out)


if __name__ == "__main__":
    main()
