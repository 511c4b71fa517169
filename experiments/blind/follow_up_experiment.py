"""Does the proposed next experiment decide? Run it on the hidden table and ask again."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from experiments.blind.logs import LogMaker, write_logs
from experiments.blind.marks import Mark, mark
from experiments.blind.score import share
from experiments.blind.trial import Trial
from experiments.blind.work import Answer, Packed, analyse, pack, work
from experiments.console import ProgressCall, silent
from experiments.protocol import shipped


def follow(
    marks: Sequence[Mark],
    out: Path,
    *,
    answer: Answer = analyse,
    jobs: int | None = None,
    cluster: str | None = None,
    make_log: LogMaker | None = None,
    progress: ProgressCall = silent,
) -> dict[str, Any]:
    """Every undecided trial again with the log of the proposed protocol added to its own.

    Share of those in which the pair is then separated (all right), and of those named wrongly.
    """
    open_ = [m for m in marks if m.verdict == "undecided" and m.among and m.following in shipped()]
    later = {m.trial.name: _one_more(m.trial, m.following) for m in open_}

    def make(name: str) -> Packed:
        with TemporaryDirectory(prefix="blind-") as place:
            write_logs(later[name], Path(place), make=make_log)
            return pack(Path(place))

    answers = work(
        later, make, out / "answers-next", answer=answer, jobs=jobs, cluster=cluster,
        progress=progress,
    )  # fmt: skip
    again = [mark(trial, answers[name]["answer"]) for name, trial in later.items()]
    return {
        "separated": share(again, lambda m: m.right),
        "wrong name": share(again, lambda m: bool(m.extra)),
    }


def _one_more(trial: Trial, protocol: str) -> Trial:
    """The trial with one more log of the same table."""
    seed = trial.seeds[0] + 1
    return replace(trial, protocols=(*trial.protocols, protocol), seeds=(*trial.seeds, seed))
