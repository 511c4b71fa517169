"""Write a run's log for other programs: CSV, Parquet or MAT (version 5), under the same names.

All rows are written, those before the ball's release too (`phase` tells them apart). A column of
the contract's first seven is always there; another one only where it holds a number. A blank is
an empty cell in CSV, null in Parquet, NaN in MAT.
"""

import csv
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np

from rig.files import naming, part_of
from rig.log import COLUMNS, INDEX, NAMES, Log

ALWAYS = NAMES[: INDEX["ball_y_m"] + 1]


def export_run(run_folder: Path | str, out_path: Path | str) -> Path:
    """Write the log of a run folder to `out_path` (.csv, .parquet or .mat); return that path.

    ValueError: another suffix, no place for a file, or no readable run; FileNotFoundError: no run
    in the folder; OSError: the file cannot be written.
    """
    from experiments.records.recording import read_run  # brings the loop and its compiler

    check_place(Path(out_path))  # a wrong name is said before a long run is read
    return export_log(read_run(run_folder).log, out_path)


def check_place(out_path: Path) -> None:
    """ValueError: no log can be written there, by its suffix or as it is no place for a file."""
    writer_of(out_path)
    parent = out_path.parent
    if out_path.is_dir() or (os.path.lexists(parent) and not parent.is_dir()):  # also a lost link
        raise ValueError(f"{out_path}: not a place for a file; name another")


def export_log(log: Log, out_path: Path | str) -> Path:
    """Write `log` to `out_path` (.csv, .parquet or .mat), whole or not at all; return that path.

    ValueError: another suffix. OSError: it cannot be written there.
    """
    out_path = Path(out_path)
    write = writer_of(out_path)
    columns = {name: log[name] for name in NAMES if name in ALWAYS or log.has(name)}
    out_path.parent.mkdir(parents=True, exist_ok=True)
    part = part_of(out_path)
    try:
        with naming(out_path):
            write(part, columns)
            part.replace(out_path)
    except BaseException:
        with suppress(OSError):
            part.unlink()
        raise
    return out_path


def writer_of(path: Path) -> Callable[[Path, dict[str, np.ndarray]], None]:
    """Return what writes a file of `path`'s suffix. ValueError: nothing does."""
    writers = {".csv": _write_csv, ".parquet": _write_parquet, ".mat": _write_mat}
    if path.suffix.lower() not in writers:
        raise ValueError(f"{path.name}: a log is exported as {', '.join(writers)}; name it so")
    return writers[path.suffix.lower()]


def _write_csv(path: Path, columns: dict[str, np.ndarray]) -> None:
    """Write numbers as Python's `repr`, the shortest text that reads back exactly."""
    cells = [
        ["" if number != number else repr(number) for number in column.tolist()]
        for column in columns.values()
    ]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*cells, strict=True))


def _write_parquet(path: Path, columns: dict[str, np.ndarray]) -> None:
    """Write columns of doubles; unit and meaning are the fields' metadata."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    about = {column.name: column for column in COLUMNS}
    fields = [
        pa.field(
            name, pa.float64(), metadata={"unit": about[name].unit, "meaning": about[name].meaning}
        )
        for name in columns
    ]
    arrays = [pa.array(column, pa.float64(), from_pandas=True) for column in columns.values()]
    pq.write_table(pa.Table.from_arrays(arrays, schema=pa.schema(fields)), path)


def _write_mat(path: Path, columns: dict[str, np.ndarray]) -> None:
    """Write one column vector (n, 1) a name."""
    from scipy.io import savemat

    with path.open("wb") as file:
        savemat(file, columns, format="5", do_compression=True, oned_as="column")
