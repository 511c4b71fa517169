"""What watching costs the loop: missed ticks with and without four pages, and memory over time.

`uv run python tests/benchmarks/dashboard/dashboard_load.py --pairs 8 --seconds 20 --minutes 30`
Pages are websocket clients in a process of their own that read everything that is sent, the
camera's image included; each pair is one run with and one without them, in random order.
"""

import argparse
import asyncio
import multiprocessing
import random
import tempfile
import time
from pathlib import Path

import numpy as np

CLIENTS = 4


async def _watch(port: int, path: str, cookie: str) -> None:
    import viser
    from websockets.asyncio.client import connect

    async with connect(
        f"ws://127.0.0.1:{port}{path}",
        origin=f"http://127.0.0.1:{port}",  # pyright: ignore[reportArgumentType]
        additional_headers={"Cookie": cookie},
        subprotocols=[f"viser-v{viser.__version__}"],  # pyright: ignore[reportArgumentType]
        max_size=None,
        compression=None,
    ) as page:
        async for _ in page:
            pass


def watch(port: int, path: str, cookie: str) -> None:
    """Four pages, until they are ended."""

    async def all_of_them() -> None:
        await asyncio.gather(*(_watch(port, path, cookie) for _ in range(CLIENTS)))

    asyncio.run(all_of_them())


def resident_mb() -> float:
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024
    return float("nan")


class Pages:
    """Four pages in a process of their own, for as long as the context lasts."""

    def __init__(self, gate, on: bool) -> None:
        cookie = f"{gate.cookie}={gate.key}"
        context, asked = multiprocessing.get_context("spawn"), (gate.port, gate.path, cookie)
        self._process = context.Process(target=watch, args=asked, daemon=True) if on else None

    def __enter__(self) -> None:
        if self._process is not None:
            self._process.start()

    def __exit__(self, *error: object) -> None:
        if self._process is not None:
            self._process.terminate()
            self._process.join()


def state(app, wanted: str, seconds: float = 180.0) -> None:
    """Wait for the session to be in a state."""
    end = time.monotonic() + seconds
    while app.session.status.state != wanted:
        if time.monotonic() > end:
            raise TimeoutError(f"not {wanted} after {seconds:g} s: {app.session.status}")
        time.sleep(0.05)


def one(app, gate, seconds: float, pages: bool) -> tuple[int, int]:
    """Missed and all ticks of a run of the balancing loop."""
    with Pages(gate, pages):
        time.sleep(3.0)
        app.session.balance()
        state(app, "balancing")
        time.sleep(seconds)
        app.session.stop("the benchmark")
        state(app, "stopped")
    jitter = app.session.last_notes["jitter"]
    return jitter["missed"], jitter["ticks"]


def main() -> None:
    from experiments.dashboard.app import App
    from experiments.dashboard.server.server import open_server
    from experiments.runs.assemble import load_rig

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--minutes", type=float, default=30.0)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as out:
        server, gate = open_server("127.0.0.1", 0, "benchmark-token-" + "x" * 20)
        app = App(server, load_rig(None), Path(out))
        app.camera.set_wanted(True)
        state(app, "balancing")
        app.session.stop("the benchmark")
        state(app, "stopped")
        print(app.session.last_notes["realtime"])
        paired(app, gate, given.pairs, given.seconds)
        memory(app, gate, given.minutes)
        app.close()
        server.stop()


def paired(app, gate, pairs: int, seconds: float) -> None:
    """Shares of missed ticks, pair by pair, and the difference with its 95 % interval."""
    rng, differences = random.Random(1), []
    for i in range(pairs):
        share = {}
        for pages in rng.sample([True, False], 2):
            missed, ticks = one(app, gate, seconds, pages)
            share[pages] = 100 * missed / ticks
        differences.append(share[True] - share[False])
        print(f"pair {i + 1}: {share[False]:.3f} % without, {share[True]:.3f} % with", flush=True)
    if pairs > 1:
        draws = np.random.default_rng(1).choice(differences, (10000, pairs)).mean(axis=1)
        low, high = np.percentile(draws, [2.5, 97.5])
        print(f"difference {np.mean(differences):+.4f} % [{low:+.4f}, {high:+.4f}], n = {pairs}")


def memory(app, gate, minutes: float) -> None:
    """Growth of the program's memory while four pages are served."""
    if not minutes:
        return
    with Pages(gate, True):
        app.session.balance()
        state(app, "balancing")
        time.sleep(min(60.0, 20 * minutes))  # rings and caches fill
        begin_mb, begin_s = resident_mb(), time.monotonic()
        while (past := time.monotonic() - begin_s) < 60 * minutes:
            time.sleep(min(30.0, 60 * minutes - past))
            print(f"{past / 60 + 0.5:5.1f} min  {resident_mb() - begin_mb:+.1f} MB", flush=True)
        print(f"memory grew by {resident_mb() - begin_mb:.1f} MB in {minutes:g} min")


if __name__ == "__main__":
    main()
