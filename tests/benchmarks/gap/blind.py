"""The blind trials of the README, one engine at a time; interrupted, it goes on where it stopped.

`python tests/benchmarks/gap/blind.py --out out/blind` (60 min on two cores): 1500 trials with
something hidden and 1500 with nothing, in the house's own simulator. `--engine foreign` and
`--engine mujoco` hide the same in two tables that share no code with it, `--engine camera` behind
rendered frames; their numbers stand apart. `--weak N` adds trials below the amplitudes that count
(the power curve), `--beside N` trials of each protocol that is not part of the goals.
"""

import argparse
import secrets
from pathlib import Path

from joblib import Parallel, delayed

from experiments.blind.command import AnalysisOptions, keep_logs, publish, run_trials
from experiments.blind.draws import TrialPlan, plan_trials
from experiments.blind.results_table import rows, show
from experiments.blind.seal import open_seal, sealed_hash
from experiments.blind.trial import BlindTrial
from experiments.cli.console import bars

BESIDE = ("pushed", "free-release", "sine-sweep", "circle", "slow-triangle", "hold")  # own: all
GOALS = {"own": 0.99, "foreign": 0.99, "mujoco": 0.95, "camera": 0.99}


def asked() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--engine", choices=tuple(GOALS), default="own")
    parser.add_argument("--trials", type=int, default=1500)
    parser.add_argument("--nothing", type=int, help="default: as many as --trials")
    parser.add_argument("--first", type=int, help="ask only so many of the sealed ones")
    parser.add_argument("--weak", type=int, default=0)
    parser.add_argument("--beside", type=int, default=0)
    parser.add_argument("--seed", type=int, help="default: drawn, and sealed with the truth")
    parser.add_argument("--out", type=Path, default=Path("out/blind"))
    parser.add_argument("--jobs", type=int)
    parser.add_argument("--cluster", help="address of a Dask scheduler")
    return parser.parse_args()


def drawn(options: argparse.Namespace, seed: int) -> list[BlindTrial]:
    """Every trial that was asked for; the parts have names and seeds of their own."""
    if options.engine == "camera":
        from experiments.blind.through_camera import VARIANTS, draw_camera_trials

        return draw_camera_trials(seed, -(-options.trials // len(VARIANTS)))
    nothing = options.trials if options.nothing is None else options.nothing
    parts = {"": TrialPlan(options.trials, nothing, seed)}
    if options.weak:
        parts["weak-"] = TrialPlan(options.weak, 0, seed + 1, kinds=("weak",))
    beside = BESIDE if options.engine == "own" else BESIDE[:4]
    for i, protocol in enumerate(beside if options.beside else ()):
        plan = TrialPlan(options.beside, 0, seed + 2 + i, kinds=("single",), protocols=(protocol,))
        parts[f"{protocol}-"] = plan
    make = plan_trials
    if options.engine != "own":
        from tests.support.blind_logs import trials_for

        def make(plan: TrialPlan) -> list[BlindTrial]:
            return trials_for(options.engine, plan)

    from dataclasses import replace

    return [replace(t, name=part + t.name) for part, plan in parts.items() for t in make(plan)]


def main() -> None:
    options = asked()
    out = options.out / options.engine
    make_log = None
    if options.engine == "camera":
        from experiments.blind.through_camera import camera_log as make_log
    elif options.engine != "own":
        from tests.support.blind_logs import other_log as make_log
    digest = sealed_hash(out) if options.seed is None else None
    seed = secrets.randbits(48) if options.seed is None else options.seed
    trials = open_seal(out, digest) if digest else drawn(options, seed)
    slow = options.engine in ("mujoco", "camera")
    with bars() as progress:
        means = AnalysisOptions(
            jobs=options.jobs, cluster=options.cluster, keep_logs=slow, make_log=make_log,
            suffix=".parquet", progress=progress,
        )  # fmt: skip
        if slow:  # logs that cost more than their analysis are made in parallel, and kept
            jobs = Parallel(n_jobs=options.jobs or 2, return_as="generator_unordered")
            wanted = trials[: options.first]
            made = jobs(delayed(keep_logs)(t, out / "logs", make_log, means.suffix) for t in wanted)
            for k, _ in enumerate(made):
                progress("logs", k + 1, len(wanted))
        scores = run_trials(trials, out, means, first=options.first)
        title = f"Blind trials, engine: {options.engine}"
        results = publish(scores, out, means, title=title, right_goal=GOALS[options.engine])
    show(rows(results, right_goal=GOALS[options.engine]), title)
    print(f"table: {out / 'table.md'}   figures: {out / 'confusion.png'}, {out / 'power.png'}")


if __name__ == "__main__":
    main()
