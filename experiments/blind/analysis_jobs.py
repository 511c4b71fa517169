"""The analyses: in other processes, which see the logs and the rig file of a trial and no more.

A trial travels as the bytes of its folder; the worker unpacks them where only they are. One JSON
file a trial, so that a run that was interrupted goes on where it stopped. The answers do not depend
on how many processes, or on which machine, they were made.
"""

import json
from collections.abc import Callable, Iterable, Iterator
from os import cpu_count
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

from experiments.console import ProgressCall, silent

Answer = Callable[[Path], dict[str, Any]]
Packed = dict[str, bytes]
Task = tuple[str, Packed]
FAILED = "failed"


def analyse(folder: Path) -> dict[str, Any]:
    """What `rig gap` says of the logs (log-*) and the rig file (rig.toml) in a folder."""
    from experiments.gap import investigate  # pyright: ignore

    rig_file = folder / "rig.toml"
    logs = sorted(folder.glob("log-*"))
    return investigate(logs, rig_file if rig_file.is_file() else None, quick=True).to_json()


def pack(folder: Path) -> Packed:
    """The files of a folder by name."""
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir()) if path.is_file()}


def answer_packed(task: Task, answer: Answer) -> tuple[str, dict[str, Any]]:
    """In the worker: unpack, answer; an error is an answer too ("failed"), Ctrl-C is not."""
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
    """Every answer that stands in `folder`, by trial; half-written files do not count."""
    return {
        path.stem: json.loads(path.read_text(encoding="utf-8"))
        for path in sorted(folder.glob("*.json"))
    }


def work(
    names: Iterable[str],
    make: Callable[[str], Packed],
    folder: Path,
    *,
    answer: Answer = analyse,
    jobs: int | None = None,
    cluster: str | None = None,
    progress: ProgressCall = silent,
) -> dict[str, dict[str, Any]]:
    """Answer every trial of `names` that has no file in `folder` yet; all answers by name.

    make(name): the logs of a trial, packed; it runs in this process. jobs: processes (default: one
    a core); cluster: address of a Dask scheduler instead.
    """
    folder.mkdir(parents=True, exist_ok=True)
    names = list(names)
    there = {path.stem for path in folder.glob("*.json")}
    left = [name for name in names if name not in there]
    done = len(names) - len(left)
    progress("analyses", done, len(names))
    tasks = ((name, make(name)) for name in left)
    finished = _on_cluster(tasks, answer, cluster) if cluster else _here(tasks, answer, jobs)
    for name, result in finished if left else ():
        part = folder / f"{name}.part"
        part.write_text(json.dumps(result), encoding="utf-8")
        part.replace(folder / f"{name}.json")
        done += 1
        progress("analyses", done, len(names))
    found = answers_of(folder)
    return {name: found[name] for name in names}


def _here(tasks: Iterable[Task], answer: Answer, jobs: int | None) -> Iterator[tuple[str, dict]]:
    """Fresh processes on this machine; results as they come. Logs are made a few trials ahead."""
    from joblib import Parallel, delayed, parallel_config

    with parallel_config("loky", n_jobs=jobs or cpu_count() or 1, inner_max_num_threads=1):
        parallel = Parallel(return_as="generator_unordered", pre_dispatch="3*n_jobs")
        yield from parallel(delayed(answer_packed)(task, answer) for task in tasks)  # pyright: ignore


def _on_cluster(tasks: Iterable[Task], answer: Answer, address: str) -> Iterator[tuple[str, dict]]:
    """The processes of a Dask cluster; never more than three trials a process on their way."""
    client = dask_client(address)
    try:
        from distributed import as_completed  # pyright: ignore[reportMissingImports]

        tasks = iter(tasks)
        room = 3 * max(1, sum(client.nthreads().values()))
        running = as_completed()
        for task in tasks:
            running.add(client.submit(answer_packed, task, answer, pure=False))
            room -= 1
            if room == 0:
                break
        for future in running:
            yield future.result()
            for task in tasks:
                running.add(client.submit(answer_packed, task, answer, pure=False))
                break
    finally:
        client.close()


def dask_client(address: str) -> Any:
    """A client of the cluster. ValueError: Dask is not installed, or nobody answers there."""
    try:
        from distributed import Client  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise ValueError(
            f"--cluster {address}: Dask is not installed; install the extra 'cluster'"
        ) from None
    try:
        return Client(address, timeout="10s")
    except (OSError, ValueError) as error:
        line = " ".join(str(error).split())
        raise ValueError(f"--cluster {address}: no Dask scheduler there ({line})") from None
