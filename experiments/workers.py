"""The same work on many inputs: in processes of this machine, or in those of a Dask cluster."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from itertools import islice
from os import cpu_count
from typing import Any, TypeVar

from rig.loop.child_process import signals_held

T = TypeVar("T")
AHEAD = 2  # calls a process made before they are wanted; all of them fit in the queue of loky,
# which falls over what does not when it is ended (a KeyError of its thread)


def results_of(
    function: Callable[..., T],
    calls: Iterable[tuple],
    *,
    jobs: int | None = None,
    cluster: str | None = None,
) -> Iterator[T]:
    """Yield function(*call) of every call, in the order in which the calls finish.

    jobs: processes (default: one for each core; 1: this process alone); cluster: address of a Dask
    scheduler instead. `calls` may be a generator: it is asked for no more than two calls a
    process ahead. ValueError: Dask is not installed, or no scheduler answers there; OSError: it is
    gone in the midst of the work. An exception of `function` is raised again.
    """
    if cluster is not None:
        yield from _on_cluster(function, calls, cluster)
        return
    count = jobs or cpu_count() or 1
    if count == 1:
        yield from (function(*call) for call in calls)
        return
    from joblib import Parallel, delayed, parallel_config

    with parallel_config("loky", n_jobs=count, inner_max_num_threads=1):
        parallel = Parallel(return_as="generator_unordered", pre_dispatch=f"{AHEAD}*n_jobs")
        with signals_held():
            results = parallel(delayed(function)(*call) for call in calls)
        yield from results  # pyright: ignore


def _on_cluster(function: Callable[..., T], calls: Iterable[tuple], address: str) -> Iterator[T]:
    client = dask_client(address)
    try:
        from distributed import as_completed  # pyright: ignore[reportMissingImports]

        calls = iter(calls)
        room = AHEAD * max(1, sum(client.nthreads().values()))
        running = as_completed(
            client.submit(function, *call, pure=False) for call in islice(calls, room)
        )
        for future in running:
            yield future.result()
            for call in islice(calls, 1):
                running.add(client.submit(function, *call, pure=False))
    except CancelledError:  # of all calls, as the scheduler knows none of them any more
        gone = f"--cluster {address}: the scheduler is gone; what was done is kept, call again"
        raise OSError(gone) from None
    finally:
        client.close()


def dask_client(address: str) -> Any:
    """Client of the Dask scheduler at `address`, given 10 s to answer.

    ValueError: Dask is not installed, or no scheduler answers there.
    """
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
