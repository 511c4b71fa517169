"""`rig report RUN...`: figures and numbers of any recorded runs, simulated or measured."""

from collections.abc import Sequence
from pathlib import Path
from shlex import quote

import numpy as np

from experiments.analysis.alike import Both, both_methods, difference_words, groups
from experiments.analysis.comparison import (
    HEAD,
    comparison_rows,
    comparison_sentence,
    part_words,
    told_words,
)
from experiments.analysis.metrics import NUMBERS_TOLD
from experiments.analysis.numbers import (
    Recorded,
    recorded,
    resting_centroid_cm,
    resting_centroids_cm,
    run_numbers,
)
from experiments.analysis.regime import regime_of_record, rig_of_record
from experiments.analysis.samples import run_part
from experiments.progress import ProgressCall, silent
from experiments.records.made_with import Entries, entries, of_table
from experiments.records.recording import read_run
from experiments.records.row_checks import check_rows
from experiments.records.run_folder import lost_words, protocol_of, refuse_twice, write_results
from experiments.reports import figures
from experiments.reports.figures import SOURCES, save
from experiments.reports.report import (
    ORDER,
    RUN_HEAD,
    SETTLED,
    SETTLED_PART,
    Block,
    Picture,
    Pictures,
    Section,
    Table,
    made_words,
    recompute_section,
    run_row,
    write_page,
)

_WHOLE = ("completed", "done")
COLOURS = "Blue: without play compensation; red: with it; green: what is wanted."
RUNS_A_TABLE = 5  # columns of a table of numbers; chosen: A4 is no wider
NAMED = 3  # protocols in a title; chosen: a line


def _readable(
    folders: Sequence[Path], progress: ProgressCall
) -> tuple[list[Recorded], list[dict], list[str]]:
    """The runs that can be shown, run.json of each, and notes on those that are left out or are a
    part. Errors as of `report_runs`.
    """
    refuse_twice(folders)
    runs, notes, metas = [], [], []
    for i, folder in enumerate(folders, 1):
        run = read_run(folder)
        progress("reading runs", i, len(folders))
        if "rejected" in run.meta:
            notes.append(f"{run.folder.name} was rejected: {run.meta['rejected']}.")
            continue
        outcome = str(run.meta.get("outcome"))
        if not len(run_part(run.log)):
            why = "all of its rows are lost" if outcome in _WHOLE else _how(run.meta)
            notes.append(f"{run.folder.name} has nothing to show: {why}.")
            continue
        if outcome not in _WHOLE or run.meta["truncated"]:
            why = _how(run.meta) if outcome not in _WHOLE else run.part
            short = "is still being recorded" if run.growing else f"did not run to its end ({why})"
            notes.append(f"{run.folder.name} {short}: its numbers are those of a part.")
        if lost := lost_words(run.meta):
            notes.append(f"{run.folder.name}: {lost}.")
        servo_only = bool(protocol_of(run.meta).get("servo_only"))
        try:
            check_rows(run.log)
            rig_of_record(run.meta.get("rig") or {})
        except ValueError as error:
            raise ValueError(f"{folder}: {error}") from None
        runs.append(recorded(run.folder, run.log, outcome, servo_only=servo_only))
        metas.append(run.meta)
    if not runs:
        raise ValueError("no run to report: " + (" ".join(notes) or "name run folders"))
    return runs, metas, notes


def report_runs(folders: Sequence[Path], out: Path, *, progress: ProgressCall = silent) -> Path:
    """Write report.html and results.json of run folders in `out`; return the page's path.

    Rejected runs and runs that never began are left out with a note. FileNotFoundError, ValueError:
    a folder is no readable run, or no run can be shown; OSError: `out` cannot be written.
    """
    runs, metas, notes = _readable(folders, progress)
    runs, metas = _in_order(runs, metas)
    sources = sorted({SOURCES[meta["source"]] for meta in metas})
    numbers = [run_numbers(run) for run in runs]
    made = [entries(run.folder, meta) for run, meta in zip(runs, metas, strict=True)]
    tables = groups([of_table(one) for one in made])
    titles = [_title(meta, tables[i] if any(tables) else None) for i, meta in enumerate(metas)]
    sections = []
    for i, (run, meta) in enumerate(zip(runs, metas, strict=True)):
        progress("drawing", i, len(runs))
        sections.append(_run_section(i + 1, titles[i], run, meta, out))
    progress("drawing", len(runs), len(runs))
    rows = [run_row(title, found) for title, found in zip(titles, numbers, strict=True)]
    both, more = _both(runs, metas, made)
    notes += [*_table_words(made, tables), *more]
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
        title=_page_title(metas),
        source=", ".join(sources),
        answer=comparison_sentence(*both),
        summary=notes,
        made=made_words(*_about(metas)),
        sections=[
            *_comparison(both, out, metas[0]),
            Section("Numbers of each run", [*_numbers(rows, told=all(both)), *_regimes(metas)]),
            *sections,
            recompute_section(
                "The log behind every number, as a table, typed in the folder where the runs are:",
                "\n".join(map(_export_command, runs)),
            ),
        ],
    )


def _how(meta: dict) -> str:
    """How a run ended, and why."""
    reason = meta.get("reason")
    return f"outcome {meta.get('outcome')}" + (f": {reason}" if reason else "")


def _in_order(runs: list[Recorded], metas: list[dict]) -> tuple[list[Recorded], list[dict]]:
    """Runs and their run.json by protocol, seed and controller: without stands before with."""
    names = list(dict.fromkeys(map(_name, metas)))

    def place(i: int) -> tuple[int, int, int]:
        arm = metas[i]["arm"]
        at = ORDER.index(arm) if arm in ORDER else len(ORDER)
        return names.index(_name(metas[i])), metas[i]["seed"] or 0, at

    order = sorted(range(len(runs)), key=place)
    return [runs[i] for i in order], [metas[i] for i in order]


def _regimes(metas: list[dict]) -> list[Block]:
    """What friction does to the loose plate, once for every table."""
    return list(dict.fromkeys(regime_of_record(meta.get("rig")) for meta in metas))


def _page_title(metas: list[dict]) -> str:
    """The runs' protocols, as far as a line holds them, and how many runs they are."""
    names = list(dict.fromkeys(map(_name, metas)))
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return f"{', '.join(names[:NAMED])}{more}: {len(metas)} run{'s' if len(metas) > 1 else ''}"


def _title(meta: dict, table: int | None) -> str:
    """Protocol, controller and seed of a run; and the number of its table where there are more."""
    seed = "" if meta["seed"] is None else f", seed {meta['seed']}"
    number = "" if table is None else f", table {table + 1}"
    return f"{_name(meta)}, {meta['arm']}{seed}{number}"


def _table_words(made: list[Entries], tables: list[int]) -> list[str]:
    """In what every other table differs from the first."""
    firsts = [of_table(made[tables.index(i)]) for i in range(max(tables) + 1)]
    return [
        f"Table {i} differs from table 1 in {difference_words(firsts[0], one)}."
        for i, one in enumerate(firsts[1:], 2)
    ]


def _export_command(run: Recorded) -> str:
    """Command that writes a run as a table, for the folder that holds it."""
    name = run.folder.resolve().name
    return f"rig export {quote(name)} --out {quote(f'{name}.csv')}"


def _numbers(rows: list[list[str]], *, told: bool) -> list[Block]:
    """The runs' numbers, one column a run and a few runs a table: it fits a sheet of paper; told:
    what they mean stands under the comparison already."""
    tables: list[Block] = []
    count = -(-len(rows) // RUNS_A_TABLE)
    for first in range(0, len(rows), step := -(-len(rows) // count)):  # tables of one width
        some = rows[first : first + step]
        turned = [[RUN_HEAD[i], *(row[i] for row in some)] for i in range(1, len(RUN_HEAD))]
        head = ("", *(row[0] for row in some))
        meaning = SETTLED_PART if told else f"{SETTLED} {told_words(rows)}"
        caption = "" if tables else meaning
        tables.append(Table(head, turned, caption, words=len(some) + 1))
    return tables


def _both(runs: list[Recorded], metas: list[dict], made: list[Entries]) -> tuple[Both, list[str]]:
    """Completed, undisturbed, different runs of one protocol without and with play compensation,
    and notes on what is left out; empty lists where the runs are of several protocols.
    """
    if len({_name(meta) for meta in metas}) > 1:
        return ([], []), []
    counts = [
        i
        for i, (run, meta) in enumerate(zip(runs, metas, strict=True))
        if run.outcome in _WHOLE
        and not meta.get("by_hand")
        and np.isfinite(run.metrics.distance_m)
        and meta["arm"] in ("without", "with")
    ]
    return both_methods(
        [runs[i] for i in counts], [metas[i]["arm"] for i in counts], [made[i] for i in counts]
    )


def _comparison(both: Both, out: Path, meta: dict) -> list[Section]:
    """Without and with beside each other: figures of the first run of each, then the numbers;
    meta: run.json of a run."""
    if not all(both):
        return []
    without, with_ = both[0][0], both[1][0]
    drawn = {
        "Ball over time": figures.ball_over_time(without.log, with_.log),
        "Servo angles": figures.servo_over_time(without.log, with_.log),
        "Where the ball was": figures.release_scatter(
            without.log, with_.log, resting_centroids_cm(without, with_), _side_cm(meta)
        ),
    }
    shown = [
        Picture(
            save(figure, out, f"both-{name.split()[0].lower()}", str(meta["source"])),
            f"{name}.",
        )
        for name, figure in drawn.items()
    ]
    many = "; mean, and its 95 % interval over runs" if max(map(len, both)) > 1 else ""
    part = part_words([*both[0], *both[1]])
    rows = comparison_rows(*both)
    title = "Without and with play compensation"
    caption = f"The ball {part}{many}. {NUMBERS_TOLD} {told_words(rows)}"
    table = Table(HEAD, rows, caption, words=4)
    return [Section(title, [COLOURS, Pictures(shown, beside=True), table])]


def _about(metas: list[dict]) -> list[str]:
    """Protocol, table and time of the runs, and what was done to them by hand."""
    titles = dict.fromkeys((_name(m), str(protocol_of(m).get("title", ""))) for m in metas)
    said = [f"Protocol {name}: {title}" for name, title in titles]
    tables = {str(m.get("table") or "virtual") for m in metas}
    said.append(f"Table: {', '.join(sorted(tables))}")
    times = sorted(str(m["created"])[:16].replace("T", " ") for m in metas if m.get("created"))
    if times:
        until = f" to {times[-1]}" if times[-1] != times[0] else ""
        said.append(f"Recorded {times[0]}{until} UTC")
    said += [
        f"Disturbed by hand, not compared: {_name(m)} {m['arm']}, {what}"
        for m in metas
        for what in m.get("by_hand") or []
    ]
    return said


def _name(meta: dict) -> str:
    return str(protocol_of(meta).get("name"))


def _run_section(i: int, title: str, run: Recorded, meta: dict, out: Path) -> Section:
    """Ball over time and on the plate, servos over time of one run; i: its number in the report,
    since folders in two places may have one name."""
    colour = figures.colour_of(str(meta["arm"]))
    seen = np.isfinite(run.metrics.distance_m)
    drawn = {"ball": figures.ball_of_run(run.log, colour)} if seen else {}
    drawn["servo"] = figures.servo_of_run(run.log, colour)
    if seen:
        centre = resting_centroid_cm(run)
        drawn["plate"] = figures.pushed_scatter(run.log, centre, f"{meta['arm']}", _side_cm(meta))
    captions = {"ball": "Ball over time.", "plate": "Ball on the plate."}
    told = figures.servo_word(run.log) == "command"
    captions["servo"] = "Angles that the servos were told." if told else "Servo angles."
    shown = [
        Picture(save(figure, out, f"{i}-{run.folder.name}-{name}", meta["source"]), captions[name])
        for name, figure in drawn.items()
    ]
    return Section(title, [Pictures(shown, beside=True)])


def _side_cm(meta: dict) -> float:
    """Side of the plate that a run was made on [cm]."""
    return 100 * rig_of_record(meta.get("rig") or {}).linkage.side_m
