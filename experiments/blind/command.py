"""A blind trial from end to end: draw, seal, make logs, analyse elsewhere, open, score."""

import secrets
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from experiments.blind.draws import EVERY, MIXTURE, Plan, plan_trials
from experiments.blind.logs import LogMaker, write_logs
from experiments.blind.marks import Mark, mark
from experiments.blind.score import summary
from experiments.blind.seal import hash_of, open_seal, seal, sealed_hash
from experiments.blind.trial import Trial
from experiments.blind.work import Answer, Packed, analyse, pack, work
from experiments.console import ProgressCall, silent
from experiments.folders import write_results

Say = Callable[[str], None]


def maker(
    trials: Sequence[Trial], keep: Path | None = None, make_log: LogMaker | None = None
) -> Callable[[str], Packed]:
    """name -> the trial's logs, packed; with `keep` its folder of logs stays there."""
    by_name = {trial.name: trial for trial in trials}

    def make(name: str) -> Packed:
        if keep is not None:
            write_logs(by_name[name], keep / name, make=make_log)
            return pack(keep / name)
        with TemporaryDirectory(prefix="blind-") as place:
            write_logs(by_name[name], Path(place), make=make_log)
            return pack(Path(place))

    return make


def run_trials(
    trials: Sequence[Trial],
    out: Path,
    *,
    answer: Answer = analyse,
    jobs: int | None = None,
    cluster: str | None = None,
    keep_logs: bool = False,
    make_log: LogMaker | None = None,
    say: Say = print,
    progress: ProgressCall = silent,
) -> list[Mark]:
    """Seal the trials in `out`, analyse what is not answered there yet, open the seal, mark.

    ValueError: other trials than these are sealed in `out`.
    """
    before = sealed_hash(out)
    if before not in (None, hash_of(trials)):
        raise ValueError(f"{out}: other trials are sealed there; choose another folder")
    digest = seal(trials, out)
    say(f"sealed truth of {len(trials)} trials: SHA-256 {digest}")
    make = maker(trials, out / "logs" if keep_logs else None, make_log)
    answers = work(
        [t.name for t in trials], make, out / "answers",
        answer=answer, jobs=jobs, cluster=cluster, progress=progress,
    )  # fmt: skip
    return [
        mark(trial, answers[trial.name]["answer"], answers[trial.name]["seconds"])
        for trial in open_seal(out, digest)
    ]


def blind_trial(
    *,
    trials: int,
    out: Path,
    seed: int | None = None,
    effects: Sequence[str] = (),
    pairs: bool = False,
    protocols: Sequence[str] = ("steps", "battery"),
    onto: Sequence[Path] = (),
    rig_file: Path | None = None,
    cluster: str | None = None,
    jobs: int | None = None,
    answer: Answer = analyse,
    keep_logs: bool = False,
    say: Say = print,
    progress: ProgressCall = silent,
) -> dict[str, Any]:
    """`rig gap --blind-trial`: `trials` with something hidden and as many with nothing.

    Without a seed one is drawn; the same folder goes on with what is sealed there. With `onto`
    effects are hidden in those logs instead. Writes results.json; returns what it holds.
    """
    kinds = ("single",) if effects else tuple(MIXTURE)
    plan = Plan(
        trials, trials, secrets.randbits(48) if seed is None else seed,
        tuple(effects) or EVERY, ("pair",) if pairs else kinds, tuple(protocols),
    )  # fmt: skip
    digest = sealed_hash(out) if seed is None else None
    drawn = open_seal(out, digest) if digest else plan_trials(plan)
    marks = run_trials(
        drawn, out, answer=answer, jobs=jobs, cluster=cluster, keep_logs=keep_logs, say=say,
        progress=progress,
    )  # fmt: skip
    results = {"source": "simulated", "seal": sealed_hash(out), "own": summary(marks)}
    write_results(out, results)
    return results
