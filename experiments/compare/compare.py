"""`rig compare`: every arm in every cell of a grid, paired seeds, any number of workers, resumable.

The unit of work is an arm in a cell: all its seeds at once in the batch kernel, in which a run has
the same bits whatever runs beside it. What is finished is kept line by line in `rows.jsonl`, under
a key that holds everything that decides it, so an interrupted comparison goes on where it stopped
and a changed rig, grid or program starts afresh.
"""

import hashlib
import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from os import cpu_count
from pathlib import Path

from experiments.assemble import load_rig
from experiments.compare_grid import Cell, Grid, cells, orders, read_grid, retuned_names
from experiments.compare_statistics import against, correct, equal_activity_rival, mean
from experiments.console import ProgressCall
from experiments.folders import write_results
from experiments.metrics import run_metrics
from experiments.numbers import completed_measures
from experiments.runner import simulate_in_blocks
from rig.parameters import Rig
from rig.rigfile import from_dict, to_dict

KEPT = ("settled_error", "servo_activity", "servo_rms", "settled_spread", "cycle_amplitude",
        "distance", "settled_distance")  # fmt: skip
ROWS_FILE = "rows.jsonl"


def _measured(order, result) -> dict[str, float]:
    found = completed_measures(run_metrics(result.log), result.outcome)
    return {name: found[name] for name in KEPT}


def work(rig: dict, grid: dict, cell: dict, arm: str) -> list[dict[str, float]]:
    """The rows of an arm in a cell, one a seed; plain data in and out, for any worker."""
    wanted = orders(from_dict(rig), Grid.model_validate(grid), Cell(**cell), arm)
    return simulate_in_blocks(wanted, _measured)


def _sources() -> str:
    """Hash of the program's own files."""
    root, digest = Path(__file__).parents[1], hashlib.sha256()
    for path in sorted([*(root / "rig").rglob("*.py"), *(root / "experiments").glob("*.py")]):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _key(common: str, cell: Cell, arm: str) -> str:
    return hashlib.sha256(f"{common} {cell.key} {arm}".encode()).hexdigest()[:24]


def _kept(path: Path) -> dict[str, list[dict[str, float]]]:
    """What an earlier try finished; a line that was cut off counts for nothing."""
    found = {}
    for line in path.read_text(encoding="utf-8").splitlines() if path.is_file() else ():
        try:
            one = json.loads(line)
            found[one["key"]] = one["rows"]
        except (ValueError, KeyError, TypeError):
            continue
    return found


def plan(grid: Grid) -> list[tuple[Cell, str]]:
    """Every (cell, arm); the retuned kin only where nothing is wrong besides."""
    kin = retuned_names(grid)
    return [
        (cell, arm)
        for cell in cells(grid)
        for arm in [*grid.arms, *(kin if not cell.fault else ())]
    ]


def all_rows(
    rig: Rig, grid: Grid, out: Path, *, jobs: int | None, cluster: str | None,
    progress: ProgressCall,
) -> dict[str, dict[str, list]]:  # fmt: skip
    """Cell key -> arm -> rows, from what is kept and what had to be run."""
    plain, data = to_dict(rig), grid.model_dump()
    common = f"{_sources()} {json.dumps(plain, sort_keys=True)} {json.dumps(data, sort_keys=True)}"
    wanted = {_key(common, cell, arm): (cell, arm) for cell, arm in plan(grid)}
    path = out / ROWS_FILE
    kept = {key: rows for key, rows in _kept(path).items() if key in wanted}
    missing = [key for key in wanted if key not in kept]
    progress("arms in cells", len(kept), len(wanted))
    calls = [(key, (plain, data, asdict(wanted[key][0]), wanted[key][1])) for key in missing]
    with path.open("a", encoding="utf-8") as file:
        if file.tell() and not path.read_bytes().endswith(b"\n"):
            file.write("\n")
        for key, rows in _run(calls, jobs, cluster):
            kept[key] = rows
            file.write(json.dumps({"key": key, "rows": rows}) + "\n")
            file.flush()
            progress("arms in cells", len(kept), len(wanted))
    table: dict[str, dict[str, list]] = {}
    for key, (cell, arm) in wanted.items():
        table.setdefault(cell.key, {})[arm] = kept[key]
    return table


def _keyed(key: str, call: tuple) -> tuple[str, list]:
    return key, work(*call)


def _run(
    calls: Iterable[tuple[str, tuple]], jobs: int | None, cluster: str | None
) -> Iterator[tuple[str, list]]:
    """Results as they come, from processes here or those of a Dask cluster."""
    if cluster is not None:
        from experiments.blind.work import dask_client

        client = dask_client(cluster)
        try:
            from distributed import as_completed  # pyright: ignore[reportMissingImports]

            waiting = as_completed([client.submit(_keyed, *call, pure=False) for call in calls])
            for future in waiting:
                yield future.result()
        finally:
            client.close()
        return
    count = jobs or cpu_count() or 1
    if count == 1:
        yield from (_keyed(*call) for call in calls)
        return
    from joblib import Parallel, delayed, parallel_config

    with parallel_config("loky", n_jobs=count, inner_max_num_threads=1):
        parallel = Parallel(return_as="generator_unordered", pre_dispatch="3*n_jobs")
        yield from parallel(delayed(_keyed)(*call) for call in calls)  # pyright: ignore


def judge(grid: Grid, table: dict[str, dict[str, list]]) -> list[dict]:
    """Every cell with its arms' means, tests against "without" and at equal servo activity."""
    found, tests, kin = [], [], retuned_names(grid)
    for number, cell in enumerate(cells(grid)):
        rows, arms = table[cell.key], {}
        for k, arm in enumerate(a for a in grid.arms if a != "without"):
            seed = (grid.first_seed, number, k)
            one = against(rows, arm, "without", grid.measure, seed)
            tests.append(one)
            arms[arm] = {"against_without": one}
            if not cell.fault:
                rival = equal_activity_rival(rows, arm, kin, grid.measure)
                equal = against(rows, arm, rival, grid.measure, (*seed, 1))
                tests.append(equal)
                arms[arm]["at_equal_activity"] = equal
        for arm in rows:
            numbers = {name: mean(rows, arm, name) for name in KEPT}
            arms.setdefault(arm, {})["means"] = numbers
        found.append(asdict(cell) | {"key": cell.key, "arms": arms})
    correct(tests)
    return found


def compare(
    rig_file: Path | None, out: Path, *, grid_file: Path | None = None, seeds: int | None = None,
    jobs: int | None = None, cluster: str | None = None, progress: ProgressCall,
) -> dict:  # fmt: skip
    """The whole comparison into `out`: results.json, figures, report.html; returns the results."""
    from experiments.compare_report import write_report
    from experiments.compare_words import words

    rig, grid = load_rig(rig_file), read_grid(grid_file)
    if seeds is not None:
        grid = grid.model_copy(update={"seeds": seeds})
    table = all_rows(rig, grid, out, jobs=jobs, cluster=cluster, progress=progress)
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
    write_report(results, rig, grid, out)
    return results


def sizes(grid: Grid) -> Sequence[int]:
    """Cells, arms in cells and runs of a grid."""
    pairs = plan(grid)
    return len(cells(grid)), len(pairs), len(pairs) * grid.seeds
