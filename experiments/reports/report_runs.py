"""`rig report RUN...`: figures and numbers of any recorded runs, simulated or measured."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from experiments.analysis.numbers import Recorded, centroid_cm, recorded, run_numbers
from experiments.analysis.regime import regime_of_record
from experiments.analysis.samples import run_part
from experiments.records.recording import read_run
from experiments.records.run_folder import write_results
from experiments.reports import figures
from experiments.reports.figures import SOURCES, save
from experiments.reports.report import (
    RUN_HEAD,
    Picture,
    Pictures,
    Section,
    Table,
    recompute_section,
    run_row,
    write_page,
)

_WHOLE = ("completed", "done")


def _refuse_twice(folders: Sequence[Path]) -> None:
    """ValueError where one run is named twice: it would count twice."""
    places = [folder.resolve() for folder in folders]
    for folder, place in zip(folders, places, strict=True):
        if places.count(place) > 1:
            raise ValueError(f"{folder} is given twice: it would count twice")


def report_runs(folders: Sequence[Path], out: Path) -> Path:
    """Write report.html and results.json of run folders in `out`; return the page's path.

    Rejected runs and runs that never began are left out with a note. FileNotFoundError, ValueError:
    a folder is no readable run, or no run can be shown; OSError: `out` cannot be written.
    """
    _refuse_twice(folders)
    runs, notes, metas = [], [], []
    for folder in folders:
        run = read_run(folder)
        if "rejected" in run.meta:
            notes.append(f"{run.folder.name} was rejected: {run.meta['rejected']}.")
            continue
        outcome = str(run.meta.get("outcome"))
        if not len(run_part(run.log)):
            notes.append(f"{run.folder.name} never ran (outcome {outcome}): nothing to show.")
            continue
        if outcome not in _WHOLE or run.meta["truncated"]:
            notes.append(
                f"{run.folder.name} did not run to its end (outcome {outcome}): "
                "its numbers are those of a part."
            )
        protocol = run.meta.get("protocol")
        servo_only = isinstance(protocol, dict) and bool(protocol.get("servo_only"))
        runs.append(recorded(run.folder, run.log, outcome, servo_only=servo_only))
        metas.append(run.meta)
    if not runs:
        raise ValueError("no run to report: " + (" ".join(notes) or "name run folders"))
    sources = sorted({SOURCES[meta["source"]] for meta in metas})
    numbers = [run_numbers(run) for run in runs]
    sections = [_run_section(run, meta, out) for run, meta in zip(runs, metas, strict=True)]
    rows = [
        run_row(f"{_name(meta)} {meta['arm']}", found)
        for meta, found in zip(metas, numbers, strict=True)
    ]
    write_results(
        out,
        {
            "source": metas[0]["source"] if len(sources) == 1 else "mixed",
            "notes": notes,
            "runs": [
                {"protocol": _name(meta), "arm": meta["arm"], "seed": meta["seed"]}
                | {"outcome": meta.get("outcome"), "regime": regime_of_record(meta.get("rig"))}
                | found
                for meta, found in zip(metas, numbers, strict=True)
            ],
        },
    )
    return write_page(
        out / "report.html",
        title=f"{len(runs)} recorded run{'s' if len(runs) > 1 else ''}",
        source=", ".join(sources),
        summary=notes,
        sections=[
            Section("Numbers", [Table(RUN_HEAD, rows)]),
            *sections,
            recompute_section("`rig export RUN --out F.csv` gives the log behind every number."),
        ],
    )


def _name(meta: dict) -> str:
    protocol = meta.get("protocol")
    return str(protocol.get("name")) if isinstance(protocol, dict) else str(protocol)


def _run_section(run: Recorded, meta: dict, out: Path) -> Section:
    """Ball over time and on the plate, servos over time of one run."""
    colour = figures.colour_of(str(meta["arm"]))
    drawn = {"servo": figures.servo_of_run(run.log, colour)}
    if np.isfinite(run.metrics.distance_m):
        side = 100 * meta["rig"]["linkage"]["plate_side_m"] if meta.get("rig") else 27.5
        drawn = {
            "ball": figures.ball_of_run(run.log, colour),
            "plate": figures.pushed_scatter(run.log, centroid_cm(run), f"{meta['arm']}", side),
        } | drawn
    captions = {"ball": "Ball over time.", "plate": "Ball on the plate."}
    told = figures.servo_word(run.log) == "command"
    captions["servo"] = "Angles that the servos were told." if told else "Servo angles."
    shown = [
        Picture(save(figure, out, f"{run.folder.name}-{name}", meta["source"]), captions[name])
        for name, figure in drawn.items()
    ]
    title = f"{_name(meta)}, {meta['arm']}, seed {meta['seed']}"
    return Section(title, [regime_of_record(meta.get("rig")), Pictures(shown)])
