"""A blind trial from end to end: draw, seal, make logs, analyse elsewhere, open, score, show."""

import secrets
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from experiments.blind.draws import EVERY, MIXTURE, Plan, plan_trials
from experiments.blind.following import follow
from experiments.blind.logs import LogMaker, write_logs
from experiments.blind.marks import Mark, mark
from experiments.blind.score import summary
from experiments.blind.seal import hash_of, open_seal, seal, sealed_hash
from experiments.blind.table import effects_markdown, failures_markdown, markdown, rows
from experiments.blind.trial import Trial
from experiments.blind.work import Answer, Packed, analyse, answers_of, pack, work
from experiments.console import ProgressCall, silent
from experiments.folders import write_results

ONTO_EACH = 2  # of every effect that can be hidden in a user's logs
Say = Callable[[str], None]


@dataclass(frozen=True)
class Means:
    """How the work is done: who answers, on how many processes or which cluster, what is kept, in
    which form logs travel (.csv, .parquet), what is shown."""

    answer: Answer = analyse
    jobs: int | None = None
    cluster: str | None = None
    keep_logs: bool = False
    make_log: LogMaker | None = None
    suffix: str = ".csv"
    say: Say = print
    progress: ProgressCall = silent


def maker(
    trials: Sequence[Trial],
    keep: Path | None = None,
    make_log: LogMaker | None = None,
    suffix: str = ".csv",
) -> Callable[[str], Packed]:
    """name -> the trial's logs, packed; with `keep` its folder of logs stays there."""
    by_name = {trial.name: trial for trial in trials}

    def make(name: str) -> Packed:
        if keep is not None:
            return pack(keep_logs(by_name[name], keep, make_log, suffix))
        with TemporaryDirectory(prefix="blind-") as place:
            write_logs(by_name[name], Path(place), make=make_log, suffix=suffix)
            return pack(Path(place))

    return make


def keep_logs(
    trial: Trial, keep: Path, make_log: LogMaker | None = None, suffix: str = ".csv"
) -> Path:
    """The trial's folder below `keep`, its logs made if they are not there yet."""
    folder = keep / trial.name
    if not folder.is_dir():
        part = keep / f".{trial.name}"
        write_logs(trial, part, make=make_log, suffix=suffix)
        part.rename(folder)
    return folder


def run_trials(
    trials: Sequence[Trial], out: Path, means: Means, *, first: int | None = None
) -> list[Mark]:
    """Seal the trials in `out`, analyse what is not answered there yet, open the seal, mark.

    first: ask only so many, in the sealed order, which says nothing of their kinds. Interrupted, it
    goes on next time. ValueError: other trials than these are sealed in `out`.
    """
    before = sealed_hash(out)
    if before not in (None, hash_of(trials)):
        raise ValueError(f"{out}: other trials are sealed there; choose another folder")
    digest = seal(trials, out)
    means.say(f"sealed truth of {len(trials)} trials: SHA-256 {digest}")
    keep = out / "logs" if means.keep_logs else None
    make = maker(trials, keep, means.make_log, means.suffix)
    answers = work(
        [t.name for t in trials[:first]], make, out / "answers",
        answer=means.answer, jobs=means.jobs, cluster=means.cluster, progress=means.progress,
    )  # fmt: skip
    return [
        mark(trial, answers[trial.name]["answer"], answers[trial.name]["seconds"])
        for trial in open_seal(out, digest)[:first]
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

    Without a seed one is drawn, or the folder goes on with what is sealed there. effects: only
    these, one at a time; pairs: two at once. With `onto` effects are hidden in those logs instead
    (`rig_file`: what is believed of their table). Writes results.json, table.md and figures in
    `out`; returns what results.json holds. ValueError: bad names, logs or cluster, another seal.
    """
    means = Means(answer, jobs, cluster, keep_logs, say=say, progress=progress)
    if onto:
        return _onto(onto, out, seed, rig_file, means)
    kinds = ("pair",) if pairs else ("single",) if effects else tuple(MIXTURE)
    digest = sealed_hash(out) if seed is None else None
    chosen = secrets.randbits(48) if seed is None else seed
    plan = Plan(trials, trials, chosen, tuple(effects) or EVERY, kinds, tuple(protocols))
    marks = run_trials(open_seal(out, digest) if digest else plan_trials(plan), out, means)
    return publish(marks, out, means, title="Blind trials, the house's own simulator")


def publish(
    marks: Sequence[Mark], out: Path, means: Means, *, title: str, right_goal: float = 0.99
) -> dict[str, Any]:
    """Ask the proposed next experiments, score, and write table, figures and results.json."""
    from experiments.blind.pictures import confusion_figure, power_figure

    results = summary(marks)
    results["next"] = follow(
        marks, out, answer=means.answer, jobs=means.jobs, cluster=means.cluster,
        make_log=means.make_log, progress=means.progress,
    )  # fmt: skip
    results |= {"source": "simulated", "title": title, "seal": sealed_hash(out)}
    lines = rows(results, right_goal=right_goal)
    text = f"# {title}\n\n{markdown(lines)}\n{effects_markdown(results)}"
    (out / "table.md").write_text(text, encoding="utf-8")
    (out / "failures.md").write_text(failures_markdown(marks), encoding="utf-8")
    if results["confusion"]:
        confusion_figure(results["confusion"], out / "confusion.png")
        power_figure(results["power"], out / "power.png")
    write_results(out, results)
    return results


def _onto(
    logs: Sequence[Path], out: Path, seed: int | None, rig_file: Path | None, means: Means
) -> dict[str, Any]:
    """Hide effects in these logs; how well they are named there."""
    from dataclasses import replace

    from experiments.blind.onto import draw_onto, onto_log, onto_markdown, onto_report

    digest = sealed_hash(out) if seed is None else None
    chosen = secrets.randbits(48) if seed is None else seed
    trials = (
        open_seal(out, digest)
        if digest
        else draw_onto(logs, seed=chosen, each=ONTO_EACH, rig_file=rig_file)
    )
    marks = run_trials(trials, out, replace(means, make_log=onto_log))
    answers = {name: one["answer"] for name, one in answers_of(out / "answers").items()}
    results = onto_report(marks, answers)
    results |= {"source": "measured", "seal": sealed_hash(out), "logs": [str(p) for p in logs]}
    (out / "table.md").write_text(onto_markdown(results), encoding="utf-8")
    write_results(out, results)
    return results
