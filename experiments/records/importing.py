"""Read a log from a run folder, CSV, Parquet or MAT file, whoever wrote it, and check it.

Names are those of `rig.log.COLUMNS`. Needed are `t_s` and one of `theta_*_rad` and `ball_*_m`;
what else is missing, or unknown and left out, stands in the log's `notes`.
"""

import csv
from array import array
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from experiments.records.csv_files import blocks_of, lines_of
from experiments.records.exporting import ALWAYS
from experiments.records.mat_files import read_mat
from experiments.records.recording import read_run
from experiments.records.row_checks import check_finite, check_order, which
from experiments.records.run_folder import lost_words
from rig.log import COMMANDS, INDEX, NAMES, Log

ONE_OF = ("theta_x_rad", "theta_y_rad", "ball_x_m", "ball_y_m")
FEW = 0.01  # share of rows that may lack an angle or a voltage and are then left out
RESTART_STEPS = 10  # back in time, in usual steps: less is a clock that stutters; chosen
GAPLESS = tuple(name for name in ALWAYS if name.startswith(("theta", "voltage")))
MOST_ROWS = 10_000_000  # of a log; chosen: 2.6 GB of memory, five hours and a half at 500 Hz


def read_log(path: Path | str) -> Log:
    """Read and check the log at `path`: a run folder (or its samples.mcap), .csv, .parquet, .mat.

    Columns are those of `rig.log.COLUMNS` in SI units; notes on what is missing or left out stand
    in the log's `notes`. FileNotFoundError: nothing is there. ValueError (one line): not readable,
    a column is missing, a time is missing or does not grow, a value is infinite, or an angle or a
    voltage is missing in more than 1 % of the rows.
    """
    path = Path(path)
    if path.name == "samples.mcap":
        path = path.parent
    if path.is_dir():
        run = read_run(path)
        notes = [note for note in (run.part, lost_words(run.meta)) if note]
        return _checked(path, run.log.columns, notes)
    if not path.exists():
        raise FileNotFoundError(f"{path} does not exist")
    if path.suffix.lower() not in READERS:
        raise ValueError(f"{path}: a log is a run folder or a file {', '.join(READERS)}")
    return _checked(path, *_read(path))


def read_logs(path: Path | str) -> list[Log]:
    """The logs of a file or run folder, as `read_log`: one for each time that `t_s` starts anew by
    more than RESTART_STEPS of its usual steps, as where several runs were put into one file."""
    path = Path(path)
    if path.is_dir() or path.suffix.lower() not in READERS or not path.exists():
        return [read_log(path)]
    columns, notes = _read(path)
    t_s = columns.get("t_s")
    with np.errstate(over="ignore", invalid="ignore"):  # times that are no numbers: `_checked`
        steps = np.diff(t_s) if t_s is not None and t_s.dtype.kind == "f" else np.zeros(0)
    usual = float(np.median(np.abs(steps))) if len(steps) and np.isfinite(steps).all() else np.inf
    cuts = np.flatnonzero(steps < -RESTART_STEPS * usual) + 1
    edges = [0, *cuts, None]
    runs = [slice(a, b) for a, b in pairwise(edges)]
    return [
        _checked(path, {name: values[own] for name, values in columns.items()}, notes)
        for own in runs
    ]


def refuse_same_rows(logs: Sequence[Log], names: Sequence[str]) -> None:
    """ValueError: two of the logs, called `names`, hold the same rows, which would count twice."""
    for i, log in enumerate(logs):
        for j in range(i):
            if np.array_equal(log.rows, logs[j].rows, equal_nan=True):
                raise ValueError(
                    f"{names[j]} and {names[i]} hold the same rows: give every log once"
                )


def _read(path: Path) -> tuple[dict[str, np.ndarray], list[str]]:
    """The columns of a file, known ones as (n,) float64, and what to say of them. ValueError: it is
    not readable, or such a one holds something else.
    """
    if not path.is_file():
        raise ValueError(f"{path} is no file but a pipe or a device, which may have no end")
    try:
        columns = READERS[path.suffix.lower()](path)
    except (ValueError, csv.Error) as error:
        raise ValueError(f"{path}: {' '.join(str(error).split())}") from error
    rows = max((np.size(columns[name]) for name in columns if name in INDEX), default=0)
    if rows > MOST_ROWS:
        raise ValueError(f"{path}: it has {rows} rows (limit: {MOST_ROWS}): cut the log in parts")
    unknown = [name for name in columns if name not in INDEX]
    try:
        columns = {
            name: _numbers(name, values) if name in INDEX else np.empty(0)
            for name, values in columns.items()
        }
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    return columns, [f"unknown columns left out: {', '.join(unknown)}"] if unknown else []


def _checked(path: Path, columns: Mapping[str, Any], notes: list[str]) -> Log:
    """Return the log of the known `columns` ((n,) each). ValueError: it cannot be worked with."""
    try:
        known = {name: _numbers(name, columns[name]) for name in NAMES if name in columns}
        _check_names(list(columns), known)
        log = Log.from_columns(known)
        check_order(log["t_s"])
        log, bridged = _bridged(log)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    notes = [*notes, *bridged]
    told = any(log.has(name) for name in COMMANDS)  # no volts there, and seldom an angle read back
    needed = [name for name in ALWAYS if not told or name.startswith(("t_s", "ball"))]
    missing = [name for name in needed if not log.has(name)]
    if missing:
        notes = [*notes, f"no values of {', '.join(missing)}: what needs them is skipped"]
    return Log(log.rows, tuple(notes))


def _numbers(name: str, values: Any) -> np.ndarray:
    """Return a column as (n,) float64. ValueError: it is no column of real numbers."""
    values = np.asarray(values)
    if values.dtype.kind not in "fiub" or sum(size != 1 for size in values.shape) > 1:
        raise ValueError(f"{name} is no column of numbers (it is {values.dtype} {values.shape})")
    return values.reshape(-1).astype(np.float64)


def _check_names(names: list[str], known: dict[str, np.ndarray]) -> None:
    """ValueError where `t_s` or every angle and position is missing."""
    there = f"there are: {', '.join(names) or 'none'}"
    if "t_s" not in known:
        raise ValueError(f"no column t_s (time in s); {there}")
    if len(known["t_s"]) == 0:
        raise ValueError("the log has no rows")
    if all(name not in known or np.isnan(known[name]).all() for name in ONE_OF):
        full = ", ".join(name for name, values in known.items() if not np.isnan(values).all())
        raise ValueError(f"no values in any of {', '.join(ONE_OF)}; one is needed; there: {full}")


def _bridged(log: Log) -> tuple[Log, list[str]]:
    """Return the log without the few rows where an angle or a voltage is blank, and what to say.

    Such a row becomes a gap in time: the voltage before it holds until the row after it. ValueError
    where a value is infinite, or where too many rows are blank to be called a few.
    """
    blank = np.zeros(len(log), bool)
    for name in ALWAYS:
        check_finite(name, log[name])
        bad = np.flatnonzero(np.isnan(log[name]))
        if name in GAPLESS and FEW * len(log) < len(bad) < len(log):
            raise ValueError(
                f"{name} is blank in {which(bad)} (limit: {100 * FEW:g} % of the rows): "
                "give it in every row, or leave the column out"
            )
        if name in GAPLESS and len(bad) < len(log):
            blank[bad] = True
    if not blank.any():
        return log, []
    rows = np.flatnonzero(blank)
    note = f"left out {which(rows)} of {len(log)}, where an angle or a voltage is blank"
    return log.where(~blank), [note]


def _read_csv(path: Path) -> dict[str, np.ndarray]:
    """Read columns of a CSV file with a header; separators: comma, semicolon, tab.

    A block of rows at a time: cells of text take many times what their numbers do.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            header = next(lines_of(file), "")
            file.seek(0)
            lines = csv.reader(lines_of(file), delimiter=max(",;\t", key=header.count))
            names = [name.strip() for name in next(lines, [])]
            if twice := sorted(name for name, times in Counter(names).items() if times > 1):
                told = ", ".join(twice)
                raise ValueError(f"a column's name stands twice: {told}; rename one of them")
            known = {name: array("d") for name in names if name in INDEX}
            count = 0
            for block in blocks_of(lines, len(names)):
                rows = _whole_rows(block, len(names), lines.line_num)
                count += len(rows)
                if count > MOST_ROWS:
                    raise ValueError(f"it has more than {MOST_ROWS} rows: cut the log in parts")
                for name, cells in zip(names, zip(*rows, strict=True), strict=True) if rows else ():
                    if name in known:
                        known[name].extend(_parsed(name, cells, count - len(rows)))
    except UnicodeDecodeError as error:
        raise ValueError("it is no text in UTF-8: save it as CSV UTF-8") from error
    except csv.Error as error:  # in the header
        raise ValueError(f"not readable as a table ({error})") from error
    return {name: np.array(known.get(name, ())) for name in names}


def _whole_rows(block: list[list[str]], width: int, last_line: int) -> list[list[str]]:
    """The rows of a block that are not blank. ValueError: one has not `width` cells."""
    for i, cells in enumerate(block):
        if len(cells) not in (0, width):
            line = last_line - len(block) + i + 1
            raise ValueError(f"line {line} has {len(cells)} cells, not {width}")
    return [cells for cells in block if cells]


def _parsed(name: str, cells: tuple[str, ...], before: int) -> np.ndarray:
    """Return the numbers (n,) of a column's cells, NaN where blank; before: rows before them."""
    numbers = np.full(len(cells), np.nan)
    for i, cell in enumerate(cells):
        if cell and not cell.isspace():
            try:
                if "_" in cell:  # which Python would leave out
                    raise ValueError(cell)
                numbers[i] = float(cell)
            except ValueError as error:
                raise ValueError(
                    f"row {before + i + 1}: {name} is {cell!r}, no number (decimal point, no unit)"
                ) from error
    return numbers


def _read_parquet(path: Path) -> dict[str, np.ndarray]:
    """Read the columns of a Parquet file; null becomes NaN."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    from experiments.records.parquet_files import numbers_of

    try:
        # One file, whatever the folders around it are called.
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            names, rows = file.schema_arrow.names, file.metadata.num_rows
            if rows > MOST_ROWS:  # which a file of some kB can hold: equal values take no room
                raise ValueError(f"it has {rows} rows (limit: {MOST_ROWS}): cut the log in parts")
            known = [name for name in names if name in INDEX]
            numbers = numbers_of(file, MOST_ROWS * len(INDEX))
            if others := sorted(set(known) - set(numbers)):
                raise ValueError(f"column '{others[0]}' holds no numbers")
            table = file.read(columns=known)
        return {
            name: table[name].cast(pa.float64()).to_numpy() if name in INDEX else np.empty(0)
            for name in names
        }
    except (pa.ArrowException, OSError, KeyError) as error:
        if getattr(error, "errno", None):  # of damaged bytes it is an OSError without
            raise
        raise ValueError(f"not readable as Parquet ({error})") from error


READERS = {".csv": _read_csv, ".parquet": _read_parquet, ".mat": read_mat}
