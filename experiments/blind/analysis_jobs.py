"""The analyses of blind trials, in other processes that see logs and rig file of a trial alone.

A trial travels as the bytes of its folder, which the worker unpacks in a folder of its own. Each
answer is one JSON file, so an interrupted run goes on where it stopped. The answers depend neither
on the number of processes nor on the machine.
"""

import json
from collections.abc import Callable, Iterable
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

from experiments.progress import ProgressCall, silent
from experiments.workers import results_of
from rig.files import file_bytes, json_of, write_whole

Analysis = Callable[[Path], dict[str, Any]]
Packed = dict[str, bytes]
Task = tuple[str, Packed]
FAILED = "failed"
LONGEST_PACKED = 1 << 28  # bytes of a file of a trial; chosen: a hundred times a usual log


def analyse(folder: Path) -> dict[str, Any]:
    """The JSON data of `rig gap` for the logs (log-*) and the rig file (rig.toml) in a folder.

    Without the closed loop (`quick` of `investigate`). Without a rig file the nominal rig is that
    of the run folders, else the shipped one. ValueError, FileNotFoundError: the logs or the rig
    file cannot be read.
    """
    from experiments.gap.gap import investigate  # pyright: ignore

    rig_file = folder / "rig.toml"
    logs = sorted(folder.glob("log-*"))
    return investigate(logs, rig_file if rig_file.is_file() else None, quick=True).to_json()


def pack_folder(folder: Path) -> Packed:
    """The contents of a folder's files, by file name. ValueError: a file is longer than
    LONGEST_PACKED; OSError: one cannot be read.
    """
    files = [path for path in sorted(folder.iterdir()) if path.is_file()]
    try:
        return {path.name: file_bytes(path, LONGEST_PACKED) for path in files}
    except ValueError as error:
        raise ValueError(f"{folder}: a file in it is {error}") from None


def analyse_packed(task: Task, answer: Analysis) -> tuple[str, dict[str, Any]]:
    """The name of a trial, and its answer with the duration [s]; runs in the worker process.

    task: name and packed folder, which is unpacked into a temporary folder; answer: the analysis.
    An `Exception` in the analysis becomes an answer with the verdict "failed" and the error as its
    sentence; a KeyboardInterrupt passes.
    """
    name, packed = task
    start = perf_counter()
    with TemporaryDirectory(prefix="blind-") as place:
        folder = Path(place)
        for file, content in packed.items():
            (folder / file).write_bytes(content)
        try:
            found = answer(folder)
        except Exception as error:
            line = " ".join(f"{type(error).__name__}: {error}".split())
            found = {"verdict": FAILED, "sentence": line, "effects": []}
    return name, {"answer": found, "seconds": perf_counter() - start}


def answers_of(folder: Path) -> dict[str, dict[str, Any]]:
    """Every finished answer in `folder` by trial name: {"answer": JSON of the analysis, "seconds":
    [s]}. ValueError (one line): a file there holds no such thing.
    """
    return {path.stem: _answer_in(path) for path in sorted(folder.glob("*.json"))}


def _answer_in(path: Path) -> dict[str, Any]:
    try:
        found = json_of(path)
        seconds = found["seconds"]
        if not isinstance(found["answer"], dict) or not isinstance(seconds, int | float):
            raise TypeError
    except (KeyError, TypeError):
        raise ValueError(f"{path}: no answer with its seconds; remove it") from None
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    return found


def run_analyses(
    names: Iterable[str],
    make: Callable[[str], Packed],
    folder: Path,
    *,
    answer: Analysis = analyse,
    jobs: int | None = None,
    cluster: str | None = None,
    progress: ProgressCall = silent,
) -> dict[str, dict[str, Any]]:
    """Analyse every trial of `names` without an answer file in `folder`; return all answers by
    name.

    make: packs the logs of a trial, in this process; folder: made if missing, holds one JSON file
    per answer, see `answers_of`; answer: the analysis, run in the workers; jobs: number of
    processes (default: one per core); cluster: address of a Dask scheduler to use instead of
    processes. ValueError: no cluster at that address. OSError: `folder` cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    names = list(names)
    there = {path.stem for path in folder.glob("*.json")}
    left = [name for name in names if name not in there]
    done = len(names) - len(left)
    progress("analyses", done, len(names))
    tasks = (((name, make(name)), answer) for name in left)
    for name, result in results_of(analyse_packed, tasks, jobs=jobs, cluster=cluster):
        write_whole(folder / f"{name}.json", json.dumps(result).encode())
        done += 1
        progress("analyses", done, len(names))
    found = answers_of(folder)
    return {name: found[name] for name in names}
