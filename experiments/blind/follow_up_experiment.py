"""The proposed next experiment of undecided trials: run on the hidden table, and analysed."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from experiments.blind.analysis_jobs import Analysis, Packed, analyse, pack_folder, run_analyses
from experiments.blind.logs import LogMaker, write_logs
from experiments.blind.score_summary import share
from experiments.blind.trial import BlindTrial
from experiments.blind.trial_score import TrialScore, score_trial
from experiments.progress import ProgressCall, silent
from experiments.runs.protocol import shipped


def follow_up_trials(
    scores: Sequence[TrialScore],
    out: Path,
    *,
    answer: Analysis = analyse,
    jobs: int | None = None,
    cluster: str | None = None,
    make_log: LogMaker | None = None,
    progress: ProgressCall = silent,
) -> dict[str, Any]:
    """Analyse undecided trials again with one more log, of the protocol that the answer proposes.

    Chosen are undecided trials whose answer holds the truth and proposes a shipped protocol.
    Returns two shares of them (see `score_summary.share`): "separated" (now entirely right) and
    "wrong name". The answers are kept in out/answers-next. ValueError: no cluster. OSError: `out`
    cannot be written.
    """
    open_ = [
        m for m in scores if m.verdict == "undecided" and m.truth_among and m.follow_up in shipped()
    ]
    later = {m.trial.name: _one_more(m.trial, m.follow_up) for m in open_}

    def make(name: str) -> Packed:
        with TemporaryDirectory(prefix="blind-") as place:
            write_logs(later[name], Path(place), make=make_log)
            return pack_folder(Path(place))

    answers = run_analyses(
        later,
        make,
        out / "answers-next",
        answer=answer,
        jobs=jobs,
        cluster=cluster,
        progress=progress,
    )
    again = [score_trial(trial, answers[name]["answer"]) for name, trial in later.items()]
    return {
        "separated": share(again, lambda m: m.right),
        "wrong name": share(again, lambda m: bool(m.extra)),
    }


def _one_more(trial: BlindTrial, protocol: str) -> BlindTrial:
    """The trial with one more log of the same table."""
    seed = trial.seeds[0] + 1
    return replace(trial, protocols=(*trial.protocols, protocol), seeds=(*trial.seeds, seed))
