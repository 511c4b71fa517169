"""Read MAT files, version 5 to 7.3: variables, structs in structs, Simulink's structures with time.

MATLAB's own objects (table, timeseries, Simulink's Dataset) are stored in a form that only MATLAB
reads; the line that refuses them says what to save instead.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from experiments.importing.names import hint
from experiments.importing.recording import (
    MAX_CELLS,
    MIN_ROWS,
    TWICE,
    BadFileError,
    Stream,
    check_size,
)
from experiments.importing.units import canonical
from experiments.records.mat_files import check_chunks, check_inflated, in_file, members

MAX_WIDTH = 64  # chosen: a wider matrix is a picture
# What an item takes of the room, however often a file links to it; chosen: 50 000 of them, some
# seconds' work.
CELLS_AN_ITEM = MAX_CELLS // 50_000
TIME_NAMES = ("time", "t", "t_s", "tout", "timestamp", "zeit")
_CURE = (
    "save a struct instead, as of table2struct(T, 'ToScalar', true), struct('time', ts.Time, "
    "'x', ts.Data), or Simulink's format 'Structure with time'"
)


def read_matlab(path: Path) -> list[Stream]:
    """Read every array of MIN_ROWS or more, as a shorter one is a gain or a setting; one stream a
    struct that has a time of its own.

    BadFileError: damaged, too large, or it holds nothing but MATLAB's own objects.
    """
    with path.open("rb") as file:
        head = file.read(128)
    if b"MATLAB 7.3" in head or head.startswith(b"\x89HDF"):
        tree, objects = hdf5_tree(path, "a MAT file of version 7.3")
    else:
        tree, objects = _version_5(path)
    streams = [stream for stream in streams_of(tree) if len(stream)]
    if not streams:
        if objects:
            raise BadFileError(f"it holds MATLAB objects ({', '.join(objects[:3])}): {_CURE}")
        raise BadFileError(f"it holds no array of {MIN_ROWS} rows or more")
    return streams


def _version_5(path: Path) -> tuple[dict[str, Any], list[str]]:
    """Variables of a file of version 5 or older as nested dictionaries, and objects left out."""
    from scipy.io import loadmat

    try:
        check_inflated(path, 8 * MAX_CELLS)
        found = loadmat(path, appendmat=False, simplify_cells=True, spmatrix=False)
    except Exception as error:  # of damaged bytes scipy raises whatever it meets
        raise BadFileError(f"not readable as a MAT file ({error})") from error
    tree = {name: value for name, value in found.items() if not name.startswith("__")}
    objects = [n for n, v in tree.items() if type(v).__name__ in ("MatlabOpaque", "MatlabFunction")]
    if "__function_workspace__" in found and not objects:
        objects = [n for n, v in tree.items() if isinstance(v, dict) and {"s0", "arr"} <= set(v)]
        objects = objects or ["an object"]
    return {name: value for name, value in tree.items() if name not in objects}, objects


def hdf5_tree(path: Path, kind: str) -> tuple[dict[str, Any], list[str]]:
    """Variables of an HDF5 file, as one of version 7.3 is, and objects left out; kind: in words."""
    import h5py

    objects: list[str] = []
    try:
        with h5py.File(path, "r") as file:
            return _group(file, objects, [MAX_CELLS], 0), objects
    except BadFileError:
        raise
    except Exception as error:  # of damaged bytes h5py raises whatever it meets
        raise BadFileError(f"not readable as {kind} ({error})") from error


def _group(group: Any, objects: list[str], room: list[int], depth: int) -> dict[str, Any]:
    found = {}
    for name, value in members(group):
        found[name] = _item(name, value, objects, room, depth)
    return found


def _item(name: str, value: Any, objects: list[str], room: list[int], depth: int) -> Any:
    """A dataset or group of HDF5 as what MATLAB meant; arrays lie there transposed.

    room: [cells that may still be read]. Of other types nothing is read: many texts may be one.
    """
    import h5py

    if depth > 20:
        raise BadFileError(f"{name} is nested more than 20 deep")
    room[0] -= CELLS_AN_ITEM
    if not hasattr(value, "dtype"):
        _check_room(room)
        return _group(value, objects, room, depth + 1)
    if "MATLAB_object_decode" in value.attrs and value.dtype.kind != "O":
        objects.append(name)
        return None
    room[0] -= value.size
    _check_room(room)
    check_chunks(value, name)
    if h5py.check_ref_dtype(value.dtype) is h5py.Reference:  # cells and arrays of structs
        parts = [in_file(value.file, name, value.file[ref]) for ref in np.ravel(value[()])]
        return [_item(name, part, objects, room, depth + 1) for part in parts]
    fields = value.dtype.names or ()
    if fields and set(fields) != {"real", "imag"}:  # a table's rows, not MATLAB's complex numbers
        return {field: value[field] for field in fields if value.dtype[field].kind in "fiub"}
    if value.attrs.get("MATLAB_empty", 0) or value.dtype.kind not in "fiub":
        return None
    if value.attrs.get("MATLAB_class") == b"char":
        return "".join(map(chr, np.ravel(value[()])))
    return np.transpose(value[()])


def _check_room(room: list[int]) -> None:
    """BadFileError: more was to be read than there was room for."""
    if room[0] < 0:
        check_size(MAX_CELLS + 1, 1)


def streams_of(tree: Mapping[str, Any]) -> Iterator[Stream]:
    """Yield the streams of arrays by name and of those nested in them."""
    return _streams("", tree)


def _streams(name: str, tree: Mapping[str, Any]) -> Iterator[Stream]:
    """Yield the streams of a struct and of the structs in it; what has no time joins its parent."""
    columns: dict[str, np.ndarray] = {}
    time = None
    for key, value in _captured(_simulink(tree)).items():
        full = f"{name}.{key}" if name else key
        if isinstance(value, list):
            if trials := _trials(full, value):
                yield trials
                continue
            value = _listed(value)
        if isinstance(value, Mapping):
            for stream in _streams(full, value):
                if stream.time is None:
                    columns |= stream.columns
                else:
                    yield stream
            continue
        for part, numbers in _columns(full, value):
            columns[part] = numbers
            named = key.lower() in TIME_NAMES
            if part == full and (named or (time is None and _is_time(key, numbers))):
                time = part
    if time is None:
        by_length: dict[int, dict[str, np.ndarray]] = {}
        for part, numbers in columns.items():
            by_length.setdefault(len(numbers), {})[part] = numbers
        for group in by_length.values():
            yield Stream(group)
    else:
        rows = len(columns[time])
        yield Stream({k: v for k, v in columns.items() if len(v) == rows}, time=time)
        rest = {k: v for k, v in columns.items() if len(v) != rows}
        if rest:
            yield from _streams("", rest)


def _trials(name: str, parts: list[Any]) -> Stream | None:
    """The structs of an array of which each holds the signals of one trial, one after the other,
    with a column that numbers them; None where they are none."""
    each = [list(_streams(name, one)) if isinstance(one, Mapping) else [] for one in parts]
    if len(parts) < 2 or any(len(one) != 1 or one[0].time is None for one in each):
        return None
    streams = [one[0] for one in each]
    if len({tuple(stream.columns) for stream in streams}) > 1:
        return None
    session = f"{name}.trial"
    columns = {k: np.concatenate([s.columns[k] for s in streams]) for k in streams[0].columns}
    columns[session] = np.repeat(np.arange(len(streams)) + 1.0, [len(one) for one in streams])
    return Stream(columns, time=streams[0].time, session=session)


def _listed(parts: list[Any]) -> Any:
    """What a cell or an array of structs holds: fields of n moments, or the numbers (n, k) of n
    moments, as version 7.3 keeps a field, NaN where one has fewer than k; None for words; else the
    parts by their numbers."""
    if len(parts) < MIN_ROWS or not all(map(_is_moment, parts)):
        return {str(i + 1): one for i, one in enumerate(parts)}
    if any(isinstance(one, Mapping) for one in parts):
        moments = [one if isinstance(one, Mapping) else {} for one in parts]
        return {
            key: [one.get(key) for one in moments] for key in {k: 0 for m in moments for k in m}
        }
    if any(isinstance(one, str) for one in parts):
        return None
    each = [np.empty(0) if one is None else np.ravel(one) for one in parts]
    table = np.full((len(each), max(map(len, each))), np.nan)
    for row, one in zip(table, each, strict=True):
        row[: len(one)] = one
    return table


def _is_moment(part: Any) -> bool:
    """Whether it is one moment's: nothing, few numbers, words, or a struct of these."""
    if isinstance(part, Mapping):
        return all(map(_is_moment, part.values()))
    if isinstance(part, np.ndarray):
        return part.size <= MAX_WIDTH and part.dtype.kind in "fiub"
    return part is None or isinstance(part, np.number | int | float | str)


def _is_time(key: str, numbers: np.ndarray) -> bool:
    """Whether an array is the time of its group: by its name, and it grows."""
    return hint(key).role == "time" and bool(np.all(np.diff(numbers) > 0))


def _simulink(tree: Mapping[str, Any]) -> Mapping[str, Any]:
    """The fields of Simulink's 'Structure with time' (time, signals.values, .label), by label."""
    if "time" not in tree or "signals" not in tree:
        return tree
    parts = _structs(tree["signals"], "values")
    found: dict[str, Any] = {"time": tree["time"]}
    for i, part in enumerate(parts):
        if isinstance(part, Mapping) and "values" in part:
            label = part.get("label")
            label = label if isinstance(label, str) and label else f"signal{i + 1}"
            found[label if label not in found else f"{label}{i + 1}"] = part["values"]
    return found


def _captured(tree: Mapping[str, Any]) -> Mapping[str, Any]:
    """The fields of a capture of dSPACE's ControlDesk (X, Y with .Name, .Data, .Unit), by name and
    unit; of several X each with the signals that it is the time of."""
    times, signals = (_parts_with_data(tree.get(key)) for key in "XY")
    if not times or not signals:
        return tree
    groups: list[dict[str, Any]] = [{str(one["Name"]): one["Data"]} for one in times]
    for one in signals:
        at = int(np.ravel(one.get("XIndex", 1))[0]) - 1 if len(times) > 1 else 0
        if not 0 <= at < len(groups):
            raise BadFileError(f"{one['Name']} is of X number {at + 1}, and there are {len(times)}")
        unit = one.get("Unit")
        known = isinstance(unit, str) and canonical(unit) is not None
        name = f"{one['Name']} [{unit}]" if known else str(one["Name"])
        if name in groups[at]:
            raise BadFileError(TWICE.format(name))
        groups[at][name] = one["Data"]
    return groups[0] if len(groups) == 1 else {str(i + 1): one for i, one in enumerate(groups)}


def _parts_with_data(value: Any) -> list[Mapping[str, Any]]:
    """The structs of an array, or the one there is, if each has a name and data; else none."""
    parts = _structs(value, "Data")
    told = (isinstance(one, Mapping) and {"Name", "Data"} <= one.keys() for one in parts)
    return parts if all(told) else []


def _structs(value: Any, field: str) -> list[Any]:
    """The structs of an array, or the one there is, each of which has such a field."""
    if isinstance(value, Mapping) and isinstance(value.get(field), list):
        return [  # version 7.3 keeps an array of structs as a struct of lists
            {k: v[i] for k, v in value.items() if isinstance(v, list) and i < len(v)}
            for i in range(len(value[field]))
        ]
    return list(value) if isinstance(value, list | np.ndarray) else [value]


def _columns(name: str, value: Any) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the columns of an array: a vector is one, a matrix one a column of its short side."""
    values = np.asarray(value) if isinstance(value, np.ndarray) else np.empty(0)
    if values.dtype.kind not in "fiub":
        return
    values = np.squeeze(values)
    if values.ndim == 2 and values.shape[0] < values.shape[1]:
        values = values.T  # as of Simulink's block To File: time in the first row
    if values.ndim not in (1, 2) or len(values) < MIN_ROWS:
        return
    if values.ndim == 1:
        yield name, values.astype(np.float64)
    elif values.shape[1] <= MAX_WIDTH:
        for i in range(values.shape[1]):
            yield f"{name}[{i + 1}]", values[:, i].astype(np.float64)
