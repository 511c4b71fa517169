"""The page of `rig watch`: the answer, one line a run, the history of every watched parameter."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from calibration.gap.report.units import shown_unit, sig
from calibration.watch.run_estimates import unit_of
from experiments.picture_files import our_style, subplots
from experiments.records.run_folder import write_results
from experiments.reports.figures import CENTRE, WITH, WITHOUT, save
from experiments.reports.report import (
    Picture,
    Pictures,
    Section,
    Table,
    recompute_section,
    write_page,
)
from experiments.watch.watch import ACCEPTED, CHANGED, SKIPPED, UNCHANGED, Watch, rate_words
from experiments.watch.words import as_json, parameter_words, run_words, sentence

HEAD = ("run", "recorded", "state", "what is said of it", "statistic")
MARKS = {CHANGED: "fails", UNCHANGED: "holds", SKIPPED: "undecided"}
COLUMNS = 3  # panels side by side; chosen: readable on A4
NAMED = 6  # skipped runs of the head; chosen: some lines
HALF_WIDTH = 1.96  # standard deviations of a 95 % interval


def write_watch(found: Watch, out: Path, *, command: str) -> Path:
    """Write report.html, history.png, history.svg and results.json in `out`; returns the page's
    path. OSError: it cannot be written."""
    write_results(out, as_json(found))
    sources = {(one.run.meta or {}).get("source") for one in found.runs if one.state == ACCEPTED}
    source = "measured" if "measured" in sources else "simulated"
    picture = save(history(found), out, "history", source)
    return write_page(
        out / "report.html",
        title=f"Watch of {found.folder.resolve().name}",
        source=source,
        answer=f"{sentence(found)[:1].upper()}{sentence(found)[1:]}.",
        summary=[
            f"{len(found.parameters)} parameters are watched; the threshold of the statistic is "
            f"{found.threshold:.2f}, for "
            f"{rate_words()}.",
            *_skipped_words(found),
        ],
        sections=[
            Section("Runs", [_runs(found)], "What does each run say, beside those before it?"),
            Section(
                "History of the parameters",
                [
                    Pictures(
                        [
                            Picture(
                                picture,
                                "Each run's estimate with its 95 % interval from that run alone. "
                                "Green: accepted runs and their mean; red: from the run on in "
                                "which a change begins; dashed: what the rig file says, if it "
                                "lies in the picture. Healthy tables vary by more than the "
                                "intervals; the statistic knows by how much.",
                            )
                        ],
                        wide=True,
                    )
                ],
            ),
            Section("What would be seen", [_smallest(found)]),
            recompute_section(
                "A table that was repaired is judged anew from the run that is accepted:",
                f"{command}\n{command} --accept RUN",
            ),
        ],
    )


def _skipped_words(found: Watch) -> list[str]:
    """A sentence on the runs that were not judged, and why; none where all were."""
    why = [
        f"{one.run.name} ({run_words(found, one)})" for one in found.runs if one.state == SKIPPED
    ]
    if not why:
        return []
    more = f", and {len(why) - NAMED} more (table)" if len(why) > NAMED else ""
    return [f"Skipped: {', '.join(why[:NAMED])}{more}."]


def _runs(found: Watch) -> Table:
    rows = [
        [
            one.run.name,
            str((one.run.meta or {}).get("created") or "")[:16].replace("T", " "),
            one.state,
            run_words(found, one),
            f"{abs(one.strongest.z):.2f}" if one.strongest else "",
        ]
        for one in found.runs
    ]
    marks = {i: MARKS[one.state] for i, one in enumerate(found.runs) if one.state in MARKS}
    return Table(HEAD, rows, words=4, marks=marks)


def _smallest(found: Watch) -> Table:
    rows = []
    for j, parameter in enumerate(found.parameters):
        unit, factor = shown_unit(unit_of(parameter), parameter.key)
        value = factor * _accepted(found, j)
        rows.append(
            [parameter_words(parameter), unit, sig(value), sig(factor * found.smallest[j], 2)]
        )
    head = ("parameter", "unit", "accepted runs", "smallest change")
    caption = (
        "The mean of the accepted runs, and the smallest lasting change from it that five further "
        "runs would show with even chances."
    )
    return Table(head, rows, caption, words=2)


def _accepted(found: Watch, column: int) -> float:
    """The mean of the accepted runs' estimates of a parameter; NaN where they tell nothing."""
    accepted = sum(one.state == ACCEPTED for one in found.runs)
    told = found.values[:accepted, column]
    told = told[np.isfinite(told)]
    return float(told.mean()) if len(told) else float("nan")


@our_style()
def history(found: Watch) -> Figure:
    """Every watched parameter over the runs that count, with intervals; changes in red."""
    p = len(found.parameters)
    lines = -(-p // COLUMNS)
    figure, axes = subplots(
        lines, COLUMNS, figsize=(9.6, 1.7 * lines + 0.6), sharex=True, squeeze=False
    )
    accepted = sum(one.state == ACCEPTED for one in found.runs)
    since = {change.parameter: change.since for change in found.changes}
    runs = np.arange(len(found.values))
    for j, parameter in enumerate(found.parameters):
        axis = axes.flat[j]
        unit, factor = shown_unit(unit_of(parameter), parameter.key)
        values, half = factor * found.values[:, j], factor * HALF_WIDTH * found.stds[:, j]
        begin = since.get(j, len(runs))
        for part, colour in (
            (runs < accepted, CENTRE),
            ((runs >= accepted) & (runs < begin), WITHOUT),
            ((runs >= accepted) & (runs >= begin), WITH),
        ):
            axis.errorbar(
                runs[part] + 1, values[part], half[part], fmt="o", ms=3, lw=0.8, color=colour
            )
        if np.isfinite(mean := factor * _accepted(found, j)):
            axis.axhline(mean, color=CENTRE, lw=0.9)
        known, limits = factor * parameter.nominal, axis.get_ylim()
        axis.axhline(known, color="0.35", lw=0.9, ls="--")
        axis.set_ylim(limits)  # a change is seen, however far the rig file is off
        axis.set_title(
            f"{parameter_words(parameter)}{f' [{unit}]' if unit else ''}, rig file {sig(known)}",
            fontsize=9,
        )
    for axis in axes.flat[p:]:
        axis.set_visible(False)
    for axis in axes[-1]:
        axis.set_xlabel("run (skipped ones left out)")
    return figure
