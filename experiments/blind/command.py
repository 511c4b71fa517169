"""A blind trial from end to end: draw, seal, make logs, analyse elsewhere, open, score, show."""

import secrets
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from experiments.blind.analysis_jobs import (
    Analysis,
    Packed,
    analyse,
    answers_of,
    pack_folder,
    run_analyses,
)
from experiments.blind.draws import ALL_EFFECTS, MIXTURE, TrialPlan, plan_trials
from experiments.blind.follow_up_experiment import follow_up_trials
from experiments.blind.logs import LogMaker, write_logs
from experiments.blind.results_table import effects_markdown, failures_markdown, markdown, rows
from experiments.blind.score_summary import summary
from experiments.blind.seal import hash_of, open_seal, seal, sealed_hash
from experiments.blind.trial import BlindTrial
from experiments.blind.trial_score import TrialScore, score_trial
from experiments.progress import ProgressCall, silent
from experiments.records.run_folder import write_results
from rig.files import write_whole

INJECTED_EACH = 2  # of every effect that can be hidden in a user's logs
Say = Callable[[str], None]


@dataclass(frozen=True)
class AnalysisOptions:
    """How trials are analysed.

    answer: the analysis of a folder; jobs: number of processes (None: one per core); cluster:
    address of a Dask scheduler to use instead; keep_logs: keep the logs in the output folder;
    make_log: simulator of the logs (None: `logs.make_log`); suffix: format of the logs, ".csv" or
    ".parquet"; say, progress: receive messages and progress.
    """

    answer: Analysis = analyse
    jobs: int | None = None
    cluster: str | None = None
    keep_logs: bool = False
    make_log: LogMaker | None = None
    suffix: str = ".csv"
    say: Say = print
    progress: ProgressCall = silent


def maker(
    trials: Sequence[BlindTrial],
    keep: Path | None = None,
    make_log: LogMaker | None = None,
    suffix: str = ".csv",
) -> Callable[[str], Packed]:
    """A function from a trial's name to its packed logs, made when asked for.

    keep: folder in which the trial's folder of logs stays (None: logs are made in a temporary
    folder); make_log, suffix: as of `logs.write_logs`. The function raises what `logs.write_logs`
    raises, and KeyError for an unknown name.
    """
    by_name = {trial.name: trial for trial in trials}

    def make(name: str) -> Packed:
        if keep is not None:
            return pack_folder(keep_logs(by_name[name], keep, make_log, suffix))
        with TemporaryDirectory(prefix="blind-") as place:
            write_logs(by_name[name], Path(place), make=make_log, suffix=suffix)
            return pack_folder(Path(place))

    return make


def keep_logs(
    trial: BlindTrial, keep: Path, make_log: LogMaker | None = None, suffix: str = ".csv"
) -> Path:
    """The trial's folder below `keep`; its logs are made unless the folder exists.

    Raises what `logs.write_logs` raises.
    """
    folder = keep / trial.name
    if not folder.is_dir():
        part = keep / f".{trial.name}"
        write_logs(trial, part, make=make_log, suffix=suffix)
        part.rename(folder)
    return folder


def run_trials(
    trials: Sequence[BlindTrial], out: Path, means: AnalysisOptions, *, first: int | None = None
) -> list[TrialScore]:
    """Seal the trials in `out`, analyse those without an answer, open the seal; return the scores.

    first: analyse and score only so many, in the sealed order, which does not depend on the kinds.
    A later call continues an interrupted one. ValueError: `out` holds the seal of other trials, the
    seal is broken, or no cluster is at that address. OSError: `out` cannot be written.
    """
    before = sealed_hash(out)
    if before not in (None, hash_of(trials)):
        raise ValueError(f"{out}: other trials are sealed there; choose another folder")
    digest = seal(trials, out)
    means.say(f"sealed truth of {len(trials)} trials: SHA-256 {digest}")
    keep = out / "logs" if means.keep_logs else None
    make = maker(trials, keep, means.make_log, means.suffix)
    answers = run_analyses(
        [t.name for t in trials[:first]],
        make,
        out / "answers",
        answer=means.answer,
        jobs=means.jobs,
        cluster=means.cluster,
        progress=means.progress,
    )
    return [
        score_trial(trial, answers[trial.name]["answer"], answers[trial.name]["seconds"])
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
    answer: Analysis = analyse,
    keep_logs: bool = False,
    say: Say = print,
    progress: ProgressCall = silent,
) -> dict[str, Any]:
    """Run `rig gap --blind-trial`: as many trials with something hidden as with nothing, `trials`
    each.

    seed: None continues the trials sealed in `out`, or draws a seed where none are; effects: hide
    one of these at a time (empty: all kinds of `draws.MIXTURE`); pairs: hide two at once;
    protocols: names, or "battery"; onto: recorded logs to hide effects in instead of simulating,
    with `rig_file` as the nominal rig of their table; the others as of `AnalysisOptions`. Writes
    results.json and table.md in `out`, for simulated trials also failures.md and figures; returns
    what results.json holds.

    ValueError, FileNotFoundError: unknown effects or protocols, logs or a rig file that cannot be
    read, no cluster, or `out` holds the seal of other trials. OSError: `out` cannot be written.
    """
    means = AnalysisOptions(answer, jobs, cluster, keep_logs, say=say, progress=progress)
    if onto:
        return _injected_trials(onto, out, seed, rig_file, means)
    kinds = ("pair",) if pairs else ("single",) if effects else tuple(MIXTURE)
    digest = sealed_hash(out) if seed is None else None
    chosen = secrets.randbits(48) if seed is None else seed
    plan = TrialPlan(trials, trials, chosen, tuple(effects) or ALL_EFFECTS, kinds, tuple(protocols))
    scores = run_trials(open_seal(out, digest) if digest else plan_trials(plan), out, means)
    return publish(scores, out, means, title="Blind trials, the house's own simulator")


def publish(
    scores: Sequence[TrialScore],
    out: Path,
    means: AnalysisOptions,
    *,
    title: str,
    right_goal: float = 0.99,
) -> dict[str, Any]:
    """Run the proposed next experiments; write table, figures and results.json in `out`.

    title: heading of the table; right_goal: as of `results_table.rows`. Returns what results.json
    holds: the numbers of `score_summary.summary`, and next, source, title, seal. OSError: `out`
    cannot be written. ValueError: no cluster.
    """
    from experiments.blind.figures import confusion_figure, power_figure

    results = summary(scores)
    results["next"] = follow_up_trials(
        scores,
        out,
        answer=means.answer,
        jobs=means.jobs,
        cluster=means.cluster,
        make_log=means.make_log,
        progress=means.progress,
    )
    results |= {"source": "simulated", "title": title, "seal": sealed_hash(out)}
    lines = rows(results, right_goal=right_goal)
    text = f"# {title}\n\n{markdown(lines)}\n{effects_markdown(results)}"
    write_whole(out / "table.md", text.encode())
    write_whole(out / "failures.md", failures_markdown(scores).encode())
    if results["confusion"]:
        confusion_figure(results["confusion"], out / "confusion.png")
        power_figure(results["power"], out / "power.png")
    write_results(out, results)
    return results


def _injected_trials(
    logs: Sequence[Path], out: Path, seed: int | None, rig_file: Path | None, means: AnalysisOptions
) -> dict[str, Any]:
    """Hide effects in these logs; return how well they are named there."""
    from dataclasses import replace

    from experiments.blind.injected_trials import (
        draw_injected_trials,
        injected_log,
        injection_markdown,
        injection_report,
    )

    digest = sealed_hash(out) if seed is None else None
    chosen = secrets.randbits(48) if seed is None else seed
    trials = (
        open_seal(out, digest)
        if digest
        else draw_injected_trials(logs, seed=chosen, each=INJECTED_EACH, rig_file=rig_file)
    )
    scores = run_trials(trials, out, replace(means, make_log=injected_log))
    answers = {name: one["answer"] for name, one in answers_of(out / "answers").items()}
    results = injection_report(scores, answers)
    results |= {"source": "measured", "seal": sealed_hash(out), "logs": [str(p) for p in logs]}
    write_whole(out / "table.md", injection_markdown(results).encode())
    write_results(out, results)
    return results
