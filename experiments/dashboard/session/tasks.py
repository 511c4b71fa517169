"""Work of the page for a worker process: figures, report, gap. Everything here can be pickled."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.dashboard.session.worker_process import ProgressSender

if TYPE_CHECKING:
    from experiments.gap.closed_loop_replay import ModelComparison

MOST_LISTED = 40  # runs; chosen: a list on the page is no longer
RUNS_OF_FIG14 = 4  # of either method: the paper's figure shows eight


@dataclass(frozen=True)
class CaptionedPicture:
    """A picture file with a sentence on what it shows."""

    path: Path
    caption: str


@dataclass(frozen=True)
class RunSummary:
    """A recorded run in a list of runs: what its run.json says.

    method: the compensator; centroid_cm: mean position (x, y) of the ball, None where not computed.
    """

    folder: Path
    protocol: str
    method: str
    seed: int | None
    outcome: str
    centroid_cm: tuple[float, float] | None = None


def list_runs(parent: Path, most: int = MOST_LISTED) -> list[RunSummary]:
    """At most `most` run folders of `parent`, newest first; runs that cannot be read are
    left out.
    """
    from experiments.records.run_folder import read_meta

    rows = []
    folders = parent.iterdir() if parent.is_dir() else ()
    for folder in sorted((f for f in folders if (f / "run.json").is_file()), reverse=True):
        try:
            meta = read_meta(folder)
        except (OSError, ValueError):
            continue
        protocol = meta.get("protocol")
        name = protocol.get("name", "?") if isinstance(protocol, dict) else str(protocol)
        outcome = str(meta.get("outcome") or "unfinished")
        rows.append(RunSummary(folder, str(name), str(meta.get("arm")), meta.get("seed"), outcome))
        if len(rows) == most:
            break
    return rows


@dataclass(frozen=True)
class DrawnFigures:
    """Figures of runs, and the runs with their centroids."""

    pictures: list[CaptionedPicture]
    rows: list[RunSummary]


def draw_figures(rows: Sequence[RunSummary], out: Path, progress: ProgressSender) -> DrawnFigures:
    """Draw the figures of the paper that these runs of one protocol (newest first) allow.

    Fig. 10 and 11, or 12 and 13, need a completed run of either method, Fig. 14 four of either.
    OSError, ValueError: a run cannot be read, or `out` cannot be written.
    """
    from experiments.analysis.numbers import centroid_cm, recorded
    from experiments.records.recording import read_run

    completed: dict[str, list] = {"without": [], "with": []}
    counted, sources = [], set()
    for i, row in enumerate(rows):
        progress("reading runs", i, len(rows))
        stored = read_run(row.folder)
        servo_only = bool((stored.meta.get("protocol") or {}).get("servo_only"))
        run = recorded(row.folder, stored.log, row.outcome, servo_only=servo_only)
        sources.add(str(stored.meta.get("source")))
        xy = np.full(2, np.nan) if servo_only else centroid_cm(run)
        centroid = (float(xy[0]), float(xy[1])) if np.isfinite(xy).all() else None
        counted.append(replace(row, centroid_cm=centroid))
        if centroid is not None and row.method in completed and row.outcome == "completed":
            completed[row.method].append(run)
    out.mkdir(parents=True, exist_ok=True)
    source = sources.pop() if len(sources) == 1 else "simulated"
    progress("drawing", 0, 1)
    pictures = _figures_of(completed, rows[0].protocol == "pushed", out, source)
    progress("drawing", 1, 1)
    return DrawnFigures(pictures, counted)


def _figures_of(
    completed: dict[str, list], pushed: bool, out: Path, source: str
) -> list[CaptionedPicture]:
    """The figures that the completed runs of both methods allow, as files in `out`."""
    from experiments.analysis.numbers import centroid_cm
    from experiments.reports import figures

    a, b = completed["without"], completed["with"]
    drawn: list[tuple[Any, str, str]] = []
    if a and b and pushed:
        drawn = [
            (
                figures.pushed_scatter(a[0].log, centroid_cm(a[0]), "without"),
                "fig12",
                "Fig. 12: the pushed ball, without the model",
            ),
            (
                figures.pushed_scatter(b[0].log, centroid_cm(b[0]), "with"),
                "fig13",
                "Fig. 13: the pushed ball, with the model",
            ),
        ]
    elif a and b:
        centres = {"without": centroid_cm(a[0]), "with": centroid_cm(b[0])}
        drawn = [
            (
                figures.release_scatter(a[0].log, b[0].log, centres),
                "fig10",
                "Fig. 10: where the ball was, with and without the model",
            ),
            (figures.servo_over_time(a[0].log, b[0].log), "fig11", "Fig. 11: servo angles"),
        ]
        n = RUNS_OF_FIG14
        if min(len(a), len(b)) >= n:
            eight = figures.eight_runs([run.log for run in a[:n]], [run.log for run in b[:n]])
            drawn.append((eight, "fig14", "Fig. 14: eight runs"))
    elif a or b:
        method, run = ("without", a[0]) if a else ("with", b[0])
        colour = figures.WITH if method == "with" else figures.WITHOUT
        caption = f"The ball, {method} the model; the other arm is still to come"
        drawn = [
            (figures.pushed_scatter(run.log, centroid_cm(run), method), "ball", caption),
            (figures.ball_of_run(run.log, colour), "ball-time", "Ball over time"),
        ]
    return [
        CaptionedPicture(figures.save(figure, out, name, source), caption)
        for figure, name, caption in drawn
    ]


def report_of_runs(folders: Sequence[Path], out: Path, progress: ProgressSender) -> Path:
    """Write the report page of run folders into `out`; returns its path.

    ValueError, OSError (one line): a run cannot be read, or `out` cannot be written. progress: not
    used.
    """
    from experiments.records.run_folder import writable
    from experiments.reports.report_runs import report_runs

    return report_runs(list(folders), writable(out))


@dataclass(frozen=True, eq=False)
class GapAnswer:
    """What the page shows of `rig gap`.

    verdict, sentence, lines: the answer in words; report: the page gap.html. plate_map: x edges (n
    + 1,) and y edges (m + 1,) [m] of the cells, and the size of the mean error in them (m, n) in
    noise floors, NaN where there is no data; None without a map. models: the model before and after
    naming beside a recorded run; None where nothing was named.
    """

    verdict: str
    sentence: str
    lines: list[str]
    report: Path
    pictures: list[CaptionedPicture]
    plate_map: tuple[np.ndarray, np.ndarray, np.ndarray] | None
    models: "ModelComparison | None"


GAP_PICTURES = {
    "gap-shrinking": "The gap, effect by effect (1 = a perfect model)",
    "ranking": "The likeliest names",
    "gap-over-state-ball": "Where the ball's model is wrong",
}


def hidden_words() -> str:
    """A sentence on the backlash that the demo hid, for whoever wants to judge the answer."""
    from experiments.gap.demo import DEMO_PLAY_RAD

    sizes = ", ".join(f"{a} {degrees(play):.2f}" for a, play in DEMO_PLAY_RAD.items())
    return f"What was hidden, which the analysis did not know: joint play of {sizes} degrees."


def find_gap(
    logs: Sequence[Path] | None, out: Path, seed: int, progress: ProgressSender
) -> GapAnswer:
    """Analyse recorded runs (logs None: those of the demo with a hidden backlash) as `rig gap`
    does; the report is written in `out`. seed: of the demo's runs.

    OSError, ValueError: a run cannot be read, or `out` cannot be written.
    """
    from experiments.gap.closed_loop_replay import compare_models
    from experiments.gap.demo import demo_runs
    from experiments.gap.gap import investigate
    from experiments.gap.input import read_evidence
    from experiments.gap.report import write_findings
    from experiments.gap.summary import summary_lines
    from experiments.records.run_folder import writable

    folder = writable(out)
    paths = list(logs) if logs is not None else demo_runs(folder, seed=seed, progress=progress)
    findings = investigate(paths, None, progress=progress)
    progress("report", 0, 1)
    report = write_findings(findings, folder, names=[path.name for path in paths])
    pictures = [
        CaptionedPicture(folder / f"{name}.png", caption)
        for name, caption in GAP_PICTURES.items()
        if (folder / f"{name}.png").is_file()
    ]
    models = None
    if findings.rig_before and findings.rig_after and findings.effects:
        progress("both models, side by side", 0, 1)
        models = compare_models(read_evidence(paths), findings.rig_before, findings.rig_after)
    lines = summary_lines(findings)[1:]
    if findings.next_experiment is None:
        lines.append("next nothing more has to be measured to tell names apart")
    if logs is None:
        lines.insert(0, hidden_words())
    plate_map = _plate_map(findings.maps)
    return GapAnswer(
        findings.verdict, findings.sentence, lines, report, pictures, plate_map, models
    )


def _plate_map(maps: Sequence[Any]) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Cell edges and size of the mean error of the first map (see `GapAnswer`)."""
    if not maps:
        return None
    first = maps[0]
    size = np.where(first.count > 0, np.hypot(*np.moveaxis(first.mean, -1, 0)), np.nan)
    return np.asarray(first.x_edges), np.asarray(first.y_edges), size
