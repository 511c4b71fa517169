"""A run folder's name and small files: run.json (start and stop record), truth.json; and the
folder of results with its results.json.

run.json is a start record (all known before) that the end completes with a stop record (outcome,
reason, rows, duration); outcome null: the run is on, or was killed.
"""

import errno
import json
import math
import os
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, is_dataclass
from datetime import UTC, datetime, timedelta
from functools import cache
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import numpy as np

from rig.files import as_unicode, freed, json_of, naming, write_whole

SCHEMA = 1
SOURCES = ("simulated", "measured")
START_KEYS = ("source", "protocol", "arm", "seed", "rig", "calibration", "versions", "created")
RESERVE_BYTES = 8192
RESULT_KEYS = {"source", "verdict", "size_px"}
LONGEST_RESULTS = 1 << 28  # bytes; chosen: ten times those of a comparison on a thousand seeds
# What a record may be read as; any of them may be null.
KINDS = {
    "outcome": (str,),
    "reason": (str,),
    "rows": (int,),
    "seed": (int,),
    "duration_s": (float, int),
    "rig": (dict,),
    "arm": (str,),
    "created": (str,),
    "rejected": (str,),
    "by_hand": (list,),
}


def file_name(words: str) -> str:
    """Return `words` as the name of a file or folder on any system, which leads nowhere else."""
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", words).lstrip(".") or "_"


def new_run_folder(parent: Path, protocol: str, arm: str, now: datetime | None = None) -> Path:
    """Make and return `<UTC time>-<protocol>-<arm>` in `parent`, with -2, -3... if it exists.

    Characters that some file systems refuse become `_`. now: with time zone, default the present
    time. OSError: the folder cannot be made.
    """
    stamp = (now or datetime.now(UTC)).astimezone(UTC).strftime("%Y%m%dT%H%M%S")
    name = file_name(f"{stamp}-{protocol}-{arm}")
    count = 1
    while True:
        folder = Path(parent) / (name if count == 1 else f"{name}-{count}")
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            count += 1
        else:
            return folder


def clock_note(parent: Path, now: datetime | None = None) -> str:
    """A sentence where a run of `parent` bears a time that is still to come; "" where none does.

    now: with time zone, default the present time, which may lag by a minute.
    """
    latest = (now or datetime.now(UTC)).astimezone(UTC) + timedelta(minutes=1)
    stamp = latest.strftime("%Y%m%dT%H%M%S")
    runs = (path.name for path in Path(parent).glob("*/") if re.match(r"\d{8}T\d{6}-", path.name))
    newest = max(runs, default="")
    if newest[: len(stamp)] <= stamp:
        return ""
    return (
        f"note: {newest} is of a time to come: is this computer's clock right? Runs are taken in "
        "the order of their times, by rig watch and the dashboard, too"
    )


def write_truth(folder: Path | str, truth: dict) -> None:
    """Write truth.json, the simulated plant's true values, which only scorers open. OSError: it
    cannot be written.
    """
    replace_json(Path(folder) / "truth.json", plain(truth))


def refuse_second_run(folder: Path) -> None:
    """Raise FileExistsError if `folder` holds a run."""
    if any((folder / name).exists() for name in ("run.json", "samples.mcap")):
        raise FileExistsError(f"{folder} holds a run already: choose another folder")


def start_record(start: dict) -> dict:
    """Content of run.json before the end of a run: schema, `start`, versions and time of start.

    Entries of START_KEYS that `start` lacks are null. ValueError: "source" is not one of SOURCES.
    """
    if start.get("source") not in SOURCES:
        raise ValueError(f"source of a run: {' or '.join(SOURCES)}, not {start.get('source')!r}")
    now = datetime.now(UTC).isoformat()
    known = {"versions": _versions(), "created": now, **start}
    record = {"schema": SCHEMA, **{key: known.get(key) for key in START_KEYS}, **known}
    return plain({**record, "outcome": None})


def stop_record(
    start: dict, outcome: str, reason: str, rows: int, duration_s: float | None
) -> dict:
    """Content of run.json after the end of a run: its start record and how it ended.

    duration_s: time of the last row, None without rows.
    """
    stop = {"outcome": outcome, "reason": reason, "rows": rows, "duration_s": duration_s}
    return plain({**start, **stop})


EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
LAST = datetime(2262, 1, 1, tzinfo=UTC)  # in ns since 1970 its year is the last of 63 bits


def nanoseconds(created: str) -> int:
    """Time of `created`, an ISO date, in ns since 1970 UTC. ValueError: no ISO date, without time
    zone, or one that a recording's 64 bits do not hold.
    """
    time = datetime.fromisoformat(created)
    if time.tzinfo is None:
        raise ValueError(f"created: {created} has no time zone; write it like 2026-11-20T10:15:02Z")
    if not EPOCH <= time < LAST:
        raise ValueError(f"created: {created} is not from {EPOCH.year} on and before {LAST.year}")
    return (time - EPOCH) // timedelta(microseconds=1) * 1000


@cache
def _versions() -> dict[str, str]:
    """Return what the numbers of a run may depend on."""
    import platform
    from importlib.metadata import PackageNotFoundError, version

    found = {"python": platform.python_version(), "platform": platform.platform()}
    for package in ("balancing-table-rig", "numpy", "numba", "scipy", "opencv-python-headless"):
        with suppress(PackageNotFoundError):
            found[package] = version(package)
    return found


def plain(value: Any) -> Any:
    """`value` as JSON can hold it: arrays and sets as lists, dataclasses as dicts, paths as text.

    Numbers that are not finite become "inf", "-inf" or "nan", and of text only Unicode stays
    (`as_unicode`).
    """
    if isinstance(value, dict):
        return {as_unicode(key): plain(item) for key, item in value.items()}
    if isinstance(value, str | Path):
        return as_unicode(value)
    if isinstance(value, list | tuple | set):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)  # which float() and pydantic read back
    return value


def replace_json(path: Path, content: dict) -> None:
    """Write a JSON file so that a reader sees the old file or the new one, never a part; what was
    reserved for it is used up.

    ValueError: `content` holds a number that is not finite. OSError: the old file stays.
    """
    text = json.dumps(content, indent=2, allow_nan=False) + "\n"
    write_whole(path, text.encode(), room=_room_of(path))


def reserve(path: Path) -> None:
    """Reserve RESERVE_BYTES on the disk for the next `replace` of the small file `path`.

    OSError: there is no room.
    """
    with naming(path):
        freed(_room_of(path)).write_bytes(b" " * RESERVE_BYTES)


def _room_of(path: Path) -> Path:
    return path.with_name(path.name + ".part")


def read_meta(folder: Path) -> dict:
    """Read run.json of a run folder.

    ValueError: no JSON, no record of a run, or of a newer version. FileNotFoundError: there is
    none.
    """
    try:
        meta = json_of(folder / "run.json")
    except ValueError as error:
        raise ValueError(f"run.json: {error}") from None
    if not isinstance(meta, dict) or not isinstance(meta.get("schema"), int):
        raise ValueError("run.json has no schema number")
    if meta["schema"] > SCHEMA:
        raise ValueError(
            f"run.json has schema {meta['schema']}, this program knows {SCHEMA}: update"
        )
    _check_meta(meta)
    return meta


def protocol_of(meta: dict) -> dict:
    """The protocol of a run's record; of one that is known by a word alone, its name; {}: none."""
    found = meta.get("protocol")
    return found if isinstance(found, dict) else {"name": str(found)} if found else {}


def _check_meta(meta: dict) -> None:
    """ValueError where a value that others compute with is of another kind; what every record has
    is null where it is missing.
    """
    if meta.get("source") not in SOURCES:
        raise ValueError(f"run.json: source is {meta.get('source')!r}, not {' or '.join(SOURCES)}")
    for key, kinds in KINDS.items():
        value = meta.get(key)
        if value is not None and (not isinstance(value, kinds) or isinstance(value, bool)):
            raise ValueError(f"run.json: {key} = {value!r} is no {kinds[0].__name__}")
    if (meta.get("rows") or 0) < 0:
        raise ValueError(f"run.json: rows = {meta['rows']} must be 0 or more")
    for key in (*START_KEYS, "outcome"):
        meta.setdefault(key, None)
    try:
        nanoseconds(meta["created"])
    except (TypeError, ValueError) as error:
        raise ValueError(f"run.json: created = {meta['created']!r} ({error})") from None


def lost_words(meta: Mapping[str, Any]) -> str:
    """How many rows of a run are missing, "" where none is. meta: its run.json."""
    loop = meta.get("loop")
    lost = loop.get("lost_rows") if isinstance(loop, dict) else None
    if not isinstance(lost, int) or lost <= 0:
        return ""
    return f"{lost} rows are missing: they were not written in time (a disk that stood still)"


def writable(folder: Path) -> Path:
    """Make `folder` where missing, check that it can be written, and return it.

    NotADirectoryError: it is a file, or a link to nothing; PermissionError: it cannot be written
    (one line each); OSError: there is no room.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # A fixed name may be somebody's link elsewhere.
        with naming(folder), TemporaryFile(dir=folder) as probe:
            probe.write(b"x")
    except FileExistsError:
        what = "is a file" if folder.exists() else "is a link to nothing"
        raise NotADirectoryError(f"--out {folder}: {what}; name a folder") from None
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise
        raise PermissionError(
            f"--out {folder}: cannot be written ({error.strerror}); choose another folder"
        ) from None
    return folder


def refuse_input(option: str, file: Path, inputs: Sequence[Path], what: str = "recording") -> None:
    """ValueError (one line) where the file that an option names to be written is, or lies in, one
    of the files and folders that the command reads; what: these are."""
    for one in filter(Path.exists, inputs):
        if file.exists() and one.samefile(file):
            raise ValueError(f"{option} {file}: is the {what} itself; name another file")
        if one.resolve() in file.resolve().parents:
            raise ValueError(f"{option} {file}: lies in the {what} {one}; name another file")


def refuse_twice(paths: Sequence[Path]) -> None:
    """ValueError where one file or folder is named twice: it would count twice."""
    seen = set()
    for path in paths:
        place = os.path.realpath(path)  # which a loop of links does not stop
        if place in seen:
            raise ValueError(f"{path} is named twice: give it once, or it would count twice")
        seen.add(place)


def refuse_other(path: Path, what: str, ours: Callable[[dict], bool]) -> None:
    """ValueError (one line) where a file lies at `path`, at which `what` is to be written, that is
    no JSON object which `ours` knows."""
    if path.is_dir():
        raise ValueError(f"{path}: a folder lies where {what} to be written; name another --out")
    if not path.is_file():
        return
    with suppress(ValueError, OSError):
        found = json_of(path, LONGEST_RESULTS)
        if isinstance(found, dict) and ours(found):
            return
    raise ValueError(f"{path}: a file of yours lies where {what} to be written; name another --out")


def _is_results(found: dict) -> bool:
    """Whether this is a results.json of a command here: most say their source or verdict, a film
    its size, scores of a benchmark the share that was wrong and sure, by entry."""
    entries = (one for one in found.values() if isinstance(one, dict))
    return bool(found.keys() & RESULT_KEYS) or any("confident wrong" in one for one in entries)


def refuse_other_results(folder: Path) -> None:
    """ValueError (one line) where `folder` holds a results.json that no command here has made."""
    refuse_other(folder / "results.json", "the results are", _is_results)


def results_folder(folder: Path) -> Path:
    """`writable`, for a command that will write results.json: called before its work, whose result
    could not be written. ValueError: as of `refuse_other_results`.
    """
    made = writable(folder)
    refuse_other_results(made)
    return made


def write_results(folder: Path, results: dict) -> Path:
    """Write results.json in `folder` and return its path; NaN and infinity become null.

    OSError: it cannot be written; ValueError: as of `refuse_other_results`.
    """
    refuse_other_results(folder)
    path = folder / "results.json"
    write_json(path, results)
    return path


def write_json(path: Path, results: dict) -> None:
    """Write a JSON file that is whole or not there; NaN and infinity become null.

    OSError: it cannot be written.
    """
    replace_json(path, _without_nan(plain(results)))


def _without_nan(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_without_nan(item) for item in value]
    return None if value in ("nan", "inf", "-inf") else value
