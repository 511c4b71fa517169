"""Read Parquet tables, alone or as a LeRobot data set."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from experiments.importing.recording import (
    MAX_CELLS,
    BadFileError,
    Stream,
    check_size,
    once_each,
)
from experiments.records.parquet_files import numbers_of
from rig.files import json_of

MAX_WIDTH = 64  # chosen: a longer list in a cell is a picture, no set of signals


def read_parquet(path: Path) -> list[Stream]:
    """Read the numbers of a Parquet file as one stream; lists become a column each."""
    table = _table(path)
    columns = _numbers(table, {})
    if not columns:
        raise BadFileError("it holds no column of numbers")
    units = {
        field.name: field.metadata[b"unit"].decode(errors="replace")
        for field in table.schema
        if field.metadata and b"unit" in field.metadata and field.name in columns
    }
    left = [
        f"{name} ({column.type})"
        for name, column in zip(table.column_names, table.columns, strict=True)
        if not any(part == name or part.startswith(f"{name}[") for part in columns)
    ]
    notes = (f"left out, no numbers or lists of one length: {', '.join(left[:6])}",)
    return [Stream(columns, units, notes=notes if left else ())]


def read_lerobot(folder: Path) -> list[Stream]:
    """Read the state, actions and time of a LeRobot data set (versions 2 and 3) as one stream.

    Names of the elements are those of meta/info.json; episodes are sessions. BadFileError: there
    is no data, or info.json is none.
    """
    try:
        info = json_of(folder / "meta" / "info.json")
        features = dict(info["features"])
    except (ValueError, KeyError, TypeError, OSError) as error:
        raise BadFileError(f"meta/info.json is not that of a LeRobot data set ({error})") from error
    files = sorted((folder / "data").rglob("*.parquet"))
    if not files:
        raise BadFileError("the LeRobot data set has no data/*/*.parquet: fetch its data files")
    parts: dict[str, list[np.ndarray]] = {}
    rows = 0
    for file in files:
        table = _table(file)
        rows += table.num_rows
        check_size(rows, max(len(parts), 1))
        for part, numbers in _numbers(table, features).items():
            parts.setdefault(part, []).append(numbers)
    columns = {name: np.concatenate(numbers) for name, numbers in parts.items()}
    part_only = [name for name, values in columns.items() if len(values) != rows]
    columns = {name: values for name, values in columns.items() if len(values) == rows}
    notes = _notes(info.get("total_frames"), rows, part_only)
    _refuse_copies(columns, len(files))
    given = "timestamp" in columns
    rate_hz = info.get("fps")
    if not given and isinstance(rate_hz, int | float) and rate_hz > 0 and "frame_index" in columns:
        columns["timestamp"] = columns["frame_index"] / rate_hz
    for name in ("index", "frame_index", "task_index"):
        columns.pop(name, None)
    return [
        Stream(
            columns,
            {"timestamp": "s"},
            "timestamp" if "timestamp" in columns else None,
            "episode_index" if "episode_index" in columns else None,
            notes,
        )
    ]


def _notes(total: Any, rows: int, part_only: list[str]) -> tuple[str, ...]:
    """What to say of a data set's files; total: the frames that its info.json counts; part_only:
    columns that not every file has.
    """
    notes = []
    if isinstance(total, int) and rows < total:
        notes.append(f"{rows} of {total} frames of the data set are there: data files are missing")
    if part_only:
        notes.append(f"left out, not in every data file: {', '.join(part_only[:6])}")
    return tuple(notes)


def _refuse_copies(columns: dict[str, np.ndarray], files: int) -> None:
    """BadFileError where several files hold a frame of an episode twice: it would count twice."""
    if files < 2 or not {"episode_index", "frame_index"} <= columns.keys():
        return
    frames = np.column_stack((columns["episode_index"], columns["frame_index"]))
    twice = len(frames) - len(np.unique(frames, axis=0))
    if twice:
        raise BadFileError(
            f"its data files hold {twice} frames twice: copies, or files of another data set; keep "
            "those of one"
        )


def _table(path: Path) -> Any:
    """The table of one Parquet file. BadFileError: damaged or too large."""
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            check_size(file.metadata.num_rows, file.metadata.num_columns)
            return file.read(columns=numbers_of(file, MAX_CELLS)).flatten()
    except BadFileError:
        raise
    except Exception as error:  # of damaged bytes pyarrow raises its own, OSError and others
        raise BadFileError(f"{path.name} is not readable as Parquet ({error})") from error


def _numbers(table: Any, features: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """The numbers (n,) of a table by name; features: of a LeRobot data set. BadFileError: a name
    stands twice."""
    pairs = zip(table.column_names, table.columns, strict=True)
    return once_each(
        part for name, column in pairs for part in _columns(name, column, features.get(name))
    )


def _columns(name: str, column: Any, feature: Any) -> Iterator[tuple[str, np.ndarray]]:
    """Yield a column's numbers (n,), or those of every element of its lists of one length."""
    import pyarrow as pa
    import pyarrow.compute as pc

    kind = column.type
    plain = (pa.types.is_floating, pa.types.is_integer, pa.types.is_boolean, pa.types.is_decimal)
    if pa.types.is_timestamp(kind):
        yield name, column.cast(pa.timestamp("us")).cast(pa.int64()).to_numpy() / 1e6
    elif any(is_number(kind) for is_number in plain):
        yield name, column.cast(pa.float64(), safe=False).to_numpy().astype(np.float64)
    elif (
        pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind) or pa.types.is_large_list(kind)
    ):
        if not (pa.types.is_floating(kind.value_type) or pa.types.is_integer(kind.value_type)):
            return
        lengths = set(pc.call_function("list_value_length", [column]).unique().to_pylist())
        width = next(iter(lengths), 0)
        if len(lengths) != 1 or not width or width > MAX_WIDTH:
            return
        flat = pc.call_function("list_flatten", [column])
        flat = flat.cast(pa.float64(), safe=False).to_numpy()
        names = _element_names(feature, width)
        for i, values in enumerate(flat.reshape(-1, width).T):
            yield f"{name}.{names[i]}" if names else f"{name}[{i}]", np.array(values)


def _element_names(feature: Any, width: int) -> list[str]:
    """Names of a LeRobot feature's elements: a list, or a dictionary of one list."""
    names = feature.get("names") if isinstance(feature, dict) else None
    if isinstance(names, dict):
        names = next(iter(names.values()), None)
    if isinstance(names, list) and len(names) == width and len(set(map(str, names))) == width:
        return [str(name) for name in names]
    return []
