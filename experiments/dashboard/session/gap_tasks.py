"""Work of the tab Gap for a worker process, and its answers on disk. All of it can be pickled."""

import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.dashboard.session.tasks import CaptionedPicture
from experiments.dashboard.session.worker_process import ProgressSender
from rig.files import json_of, write_whole

if TYPE_CHECKING:
    from experiments.gap.closed_loop_replay import ModelComparison

ANSWER = "answer.json"


@dataclass(frozen=True)
class ShortAnswer:
    """What stays of an analysis when the program ends: the verdict in plain sentences, the table of
    `experiments.gap.beside`, more sentences, one on what the demo hid, "" of recorded runs, and how
    long it took [s], NaN of one of an earlier version.
    """

    sentences: list[str]
    table: list[list[str]]
    more: list[str] = field(default_factory=list)
    truth: str = ""
    took_s: float = nan

    @property
    def of_demo(self) -> bool:
        """Whether it is of the demo's runs: something was hidden in them."""
        return bool(self.truth)


@dataclass(frozen=True, eq=False)
class Clue:
    """What there is to guess the demo's hidden play from: its released ball, and in words how far
    it swings, and would with plays of known size."""

    picture: CaptionedPicture
    words: list[str]


@dataclass(frozen=True, eq=False)
class GapAnswer:
    """What the page shows of `rig gap`.

    short: the answer in words; report: the page gap.html. plate_map: x edges (n
    + 1,) and y edges (m + 1,) [m] of the cells, and the size of the mean error in them (m, n) in
    noise floors, NaN where there is no data; None without a map. models: the model before and after
    naming beside a recorded run; None where nothing was named.
    """

    short: ShortAnswer
    report: Path
    pictures: list[CaptionedPicture]
    plate_map: tuple[np.ndarray, np.ndarray, np.ndarray] | None
    models: "ModelComparison | None"


GAP_PICTURES = {
    "gap-shrinking": "The gap, effect by effect, on all data (1 = a perfect model)",
    "ranking": "The likeliest names",
    "gap-over-state-ball": "Where the ball's model is wrong",
}


def find_gap(
    logs: Sequence[Path] | None,
    out: Path,
    seed: int,
    calibration: Path,
    progress: ProgressSender,
) -> GapAnswer:
    """Analyse recorded runs (logs None: those of the demo with a hidden backlash) as `rig gap`
    does; the report is written in `out`, which is made. seed: of the demo's runs; calibration: a
    file that the answer is compared with, where it exists.

    FileExistsError: `out` is there already. OSError, ValueError: a run cannot be read, or `out`
    cannot be written.
    """
    from experiments.gap.closed_loop_replay import compare_models
    from experiments.gap.demo import demo_runs, hidden_words
    from experiments.gap.gap import investigate
    from experiments.gap.input import read_evidence
    from experiments.gap.report import origin_words, write_findings
    from experiments.records.run_folder import writable

    begin_s = time.monotonic()
    out.mkdir(parents=True)
    folder = writable(out)
    paths = list(logs) if logs is not None else demo_runs(folder, seed=seed, progress=progress)
    if logs is None:
        progress.show(clue(paths, folder, seed))
    findings = investigate(paths, None, threads=2, progress=progress)
    progress("report", 0, 1)
    report = write_findings(
        findings,
        folder,
        names=[path.name for path in paths],
        origin=origin_words(paths, demo=logs is None),
        remark=hidden_words() if logs is None else _advice(paths),
    )
    models = None
    if findings.rig_before and findings.rig_after and findings.effects:
        progress("both models, side by side", 0, 1)
        models = compare_models(read_evidence(paths), findings.rig_before, findings.rig_after)
    short = _short(findings, paths, calibration, demo=logs is None)
    short = replace(short, took_s=time.monotonic() - begin_s)
    write_whole(folder / ANSWER, json.dumps(asdict(short)).encode())
    return GapAnswer(short, report, pictures_of(folder), _plate_map(findings.maps), models)


def clue(runs: Sequence[Path], folder: Path, seed: int) -> Clue:
    """The clue of the demo's runs; its picture is written in `folder`. Errors as of `find_gap`."""
    from experiments.gap.guess import clues
    from experiments.records.recording import read_run
    from experiments.reports.figures import ball_of_run, colour_of, save

    released = next(run for run in runs if "free-release" in run.name)
    figure = ball_of_run(read_run(released).log, colour_of("without"))
    path = save(figure, folder, "guess", "simulated")
    return Clue(CaptionedPicture(path, "The demo's ball, let go"), clues(runs, seed=seed))


def _short(findings: Any, paths: Sequence[Path], calibration: Path, *, demo: bool) -> ShortAnswer:
    """The answer in sentences, and beside what is known otherwise."""
    from experiments.calibrate.folder import table_file
    from experiments.gap import beside
    from experiments.gap.demo import hidden_words
    from experiments.gap.short_answer import details, verdict

    found, truth = beside.found_values(findings), beside.true_values(paths)
    table = calibration.with_name(table_file("play"))
    known = {} if demo else beside.calibrated_values(calibration, table, truth)
    rows = beside.beside_rows(found, known, truth, findings.known)
    first = "" if demo else _advice(paths)
    said = verdict(findings, enough=not first, contradiction=beside.contradictions(rows))
    sentences = [*([first] if first else []), *said]
    of = [] if demo else [f"Of the runs {', '.join(path.name for path in paths)}."]
    more = details(findings, logs=len(paths)) + of
    return ShortAnswer(sentences, rows, more, hidden_words() if demo else "")


def _advice(runs: Sequence[Path]) -> str:
    """What to run first, where these runs do not suffice."""
    from experiments.gap.short_answer import advice
    from experiments.records.run_folder import protocol_of, read_meta

    return advice([protocol_of(read_meta(run)).get("name", "?") for run in runs])


def pictures_of(folder: Path) -> list[CaptionedPicture]:
    """The pictures of an analysis that the page shows."""
    return [
        CaptionedPicture(folder / f"{name}.png", caption)
        for name, caption in GAP_PICTURES.items()
        if (folder / f"{name}.png").is_file()
    ]


def _numbered(out: Path) -> list[tuple[int, Path]]:
    """Number and path of what is called gap-N in `out`."""
    return [(int(f.name[4:]), f) for f in out.glob("gap-*") if f.name[4:].isdecimal()]


def next_number(out: Path) -> int:
    """The number of an analysis to come: one above the highest in `out`."""
    return 1 + max((number for number, _ in _numbered(out)), default=0)


def newest_answer(out: Path) -> GapAnswer | None:
    """The newest analysis in the folders gap-N of `out`, without map and film; None: there is none
    that can be read.
    """
    for _, folder in sorted(_numbered(out), reverse=True):
        try:
            kept = json_of(folder / ANSWER)
            table = [list(map(str, row)) for row in kept["table"]]
            said, more = list(map(str, kept["sentences"])), list(map(str, kept.get("more", [])))
            truth, took_s = str(kept.get("truth", "")), float(kept.get("took_s", nan))
            short = ShortAnswer(said, table, more, truth, took_s)
        except (OSError, ValueError, KeyError, TypeError):
            continue
        return GapAnswer(short, folder / "gap.html", pictures_of(folder), None, None)
    return None


def _plate_map(maps: Sequence[Any]) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Cell edges and size of the mean error of the first map (see `GapAnswer`)."""
    if not maps:
        return None
    first = maps[0]
    size = np.where(first.count > 0, np.hypot(*np.moveaxis(first.mean, -1, 0)), np.nan)
    return np.asarray(first.x_edges), np.asarray(first.y_edges), size
