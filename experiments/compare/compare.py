"""`rig compare`: every condition in every cell of a grid, on paired seeds; resumable.

The unit of work is a condition in a cell: all its seeds at once in the batch kernel, in which a
run has the same bits whatever runs beside it; any number of workers share the units. What is
finished is kept line by line in `rows.jsonl`, under a key that holds everything that decides it, so
an interrupted comparison goes on where it stopped and a changed rig, grid, protocol or program
starts afresh.
"""

import hashlib
import json
import shlex
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path

from experiments.analysis.metrics import run_metrics
from experiments.analysis.numbers import completed_measures
from experiments.compare.grid import (
    KEPT,
    Cell,
    Grid,
    cells,
    read_grid,
    retuned_names,
    run_requests,
)
from experiments.compare.statistics import (
    against,
    correct_p_values,
    equal_activity_rival,
    mean,
)
from experiments.progress import ProgressCall
from experiments.records.run_folder import write_results
from experiments.runs.assemble import load_rig
from experiments.runs.protocol import read_protocol
from experiments.runs.runner import simulate_in_blocks
from experiments.workers import results_of
from rig.files import file_bytes
from rig.parameters import Rig
from rig.rigfile import to_record

ROWS_FILE = "rows.jsonl"


def _measured(request, result) -> dict[str, float]:
    found = completed_measures(run_metrics(result.log), result.outcome)
    return {name: found[name] for name in KEPT}


def condition_rows(rig: Rig, grid: dict, cell: dict, condition: str) -> list[dict[str, float]]:
    """Simulate a condition in a cell: for each seed one row of the measures KEPT.

    The values are NaN in a run that did not complete. grid, cell: plain data, as `model_dump` and
    `asdict` make it, so that any worker can take them. ValueError: the cell's table or protocol is
    impossible.
    """
    wanted = run_requests(rig, Grid.model_validate(grid), Cell(**cell), condition)
    return simulate_in_blocks(wanted, _measured)


def _sources() -> str:
    """Hash of the program's own files."""
    root, digest = Path(__file__).parents[2], hashlib.sha256()
    for path in sorted([*(root / "rig").rglob("*.py"), *(root / "experiments").rglob("*.py")]):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _key(common: str, cell: Cell, condition: str) -> str:
    return hashlib.sha256(f"{common} {cell.key} {condition}".encode()).hexdigest()[:24]


def _kept(
    path: Path, note: Callable[[str], None] = lambda text: None
) -> dict[str, list[dict[str, float]]]:
    """What an earlier try finished; a line that was cut off, or is none of ours, counts for
    nothing, and how many those are is told to `note`. ValueError: no file of our own.
    """
    if path.is_symlink():
        raise ValueError(f"{path} is a link: remove it, or choose another --out")
    found, lost = {}, 0
    try:
        lines = file_bytes(path, None).splitlines() if path.exists() else []
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    for line in lines:
        try:
            one = json.loads(line)
            if not all(set(row) == set(KEPT) for row in one["rows"]):
                raise KeyError("other measures")
            found[one["key"]] = [{name: float(row[name]) for name in row} for row in one["rows"]]
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            lost += 1
    if lost:
        note(f"{lost} of {len(lines)} lines of {path} cannot be read: what they held is run again")
    return found


def plan(grid: Grid) -> list[tuple[Cell, str]]:
    """Every (cell, condition) to run; the retuned PIDs only in cells without a fault."""
    kin = retuned_names(grid)
    return [
        (cell, condition)
        for cell in cells(grid)
        for condition in [*grid.arms, *(kin if not cell.fault else ())]
    ]


def all_rows(
    rig: Rig,
    grid: Grid,
    out: Path,
    *,
    jobs: int | None,
    cluster: str | None,
    progress: ProgressCall,
    note: Callable[[str], None] = lambda text: None,
) -> dict[str, dict[str, list]]:
    """Run what `out`/rows.jsonl does not hold yet; return cell key -> condition -> rows.

    A row holds the measures KEPT of one seed. jobs: processes, None for all cores; cluster: address
    of a Dask scheduler, or None; note: is told what was there. ValueError: no such cluster or
    protocol. OSError: the file cannot be written.
    """
    plain, data = to_record(rig), grid.model_dump()
    common = f"{_sources()} {json.dumps(plain, sort_keys=True)} {json.dumps(data, sort_keys=True)}"
    pairs = plan(grid)
    course = {
        name: read_protocol(name).model_dump_json() for name in {c.protocol for c, _ in pairs}
    }
    wanted = {_key(f"{common} {course[c.protocol]}", c, arm): (c, arm) for c, arm in pairs}
    path = out / ROWS_FILE
    there = _kept(path, note).items()
    kept = {key: rows for key, rows in there if key in wanted and len(rows) == grid.seeds}
    missing = [key for key in wanted if key not in kept]
    if kept:
        note(f"{len(kept)} of {len(wanted)} arms in cells are kept from an earlier call ({path})")
    progress("arms in cells", len(kept), len(wanted))
    calls = [(key, (rig, data, asdict(wanted[key][0]), wanted[key][1])) for key in missing]
    with path.open("a", encoding="utf-8") as file:
        if file.tell() and not path.read_bytes().endswith(b"\n"):
            file.write("\n")
        for key, rows in results_of(_keyed, calls, jobs=jobs, cluster=cluster):
            kept[key] = rows
            file.write(json.dumps({"key": key, "rows": rows}) + "\n")
            file.flush()
            progress("arms in cells", len(kept), len(wanted))
    table: dict[str, dict[str, list]] = {}
    for key, (cell, condition) in wanted.items():
        table.setdefault(cell.key, {})[condition] = kept[key]
    return table


def _keyed(key: str, call: tuple) -> tuple[str, list]:
    return key, condition_rows(*call)


def judge(grid: Grid, table: dict[str, dict[str, list]]) -> list[dict]:
    """Every cell with the means of its conditions and their tests; table as of `all_rows`.

    Each condition is tested against "without" and, in cells without a fault, against the best rival
    of equal servo activity. P-values are corrected over all tests (Holm).
    """
    found, tests, kin = [], [], retuned_names(grid)
    for number, cell in enumerate(cells(grid)):
        rows, conditions = table[cell.key], {}
        for k, condition in enumerate(a for a in grid.arms if a != "without"):
            seed = (grid.first_seed, number, k)
            one = against(rows, condition, "without", grid.measure, seed)
            tests.append(one)
            conditions[condition] = {"against_without": one}
            if not cell.fault:
                rival = equal_activity_rival(rows, condition, kin, grid.measure)
                equal = against(rows, condition, rival, grid.measure, (*seed, 1))
                tests.append(equal)
                conditions[condition]["at_equal_activity"] = equal
        for condition in rows:
            numbers = {name: mean(rows, condition, name) for name in KEPT}
            conditions.setdefault(condition, {})["means"] = numbers
        found.append(asdict(cell) | {"key": cell.key, "arms": conditions})
    correct_p_values(tests)
    return found


def number_of_tests(grid: Grid) -> int:
    """How many tests `judge` makes."""
    return sum((len(grid.arms) - 1) * (1 if cell.fault else 2) for cell in cells(grid))


def run_comparison(
    rig_file: Path | None,
    out: Path,
    *,
    grid_file: Path | None = None,
    seeds: int | None = None,
    jobs: int | None = None,
    cluster: str | None = None,
    progress: ProgressCall,
    note: Callable[[str], None] = lambda text: None,
) -> dict:
    """Make the whole comparison in `out` (results.json, figures, report.html); return the results.

    rig_file, grid_file: None for the shipped ones; seeds: paired seeds for each cell, None for the
    grid's own; jobs, cluster, note: see `all_rows`. ValueError, FileNotFoundError: a mistake in rig
    or grid file, or no such cluster.
    """
    from experiments.compare.report import write_report
    from experiments.compare.words import few_seeds_words, words

    rig = load_rig(rig_file)
    grid = read_grid(grid_file, takes_angle=rig.servo.takes_angle)
    if seeds is not None:
        grid = grid.model_copy(update={"seeds": seeds})
    for line in few_seeds_words(number_of_tests(grid), grid.seeds):
        note(line)
    table = all_rows(rig, grid, out, jobs=jobs, cluster=cluster, progress=progress, note=note)
    judged = judge(grid, table)
    results = {
        "source": "simulated",
        "title": grid.title,
        "measure": grid.measure,
        "seeds": grid.seeds,
        "grid": grid.model_dump(),
        "cells": judged,
        "rows": table,
    }
    results["words"] = words(results)
    write_results(out, results)
    named = {"--rig": rig_file, "--grid": grid_file, "--seeds": seeds, "--out": out}
    options = [word for name, value in named.items() if value is not None for word in (name, value)]
    write_report(results, rig, grid, out, shlex.join(["rig", "compare", *map(str, options)]))
    return results


def sizes(grid: Grid) -> Sequence[int]:
    """(number of cells, of pairs of condition and cell, of runs) of a grid."""
    pairs = plan(grid)
    return len(cells(grid)), len(pairs), len(pairs) * grid.seeds
