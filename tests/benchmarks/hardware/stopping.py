"""From STOP to 0 V, asked as the page asks, in the states in which it is hardest to obey.

`uv run python tests/benchmarks/hardware/stopping.py --tries 10`
STOP is the request that the bar of the page sends. On the virtual table 0 V is the loop's own word
that the table was left; on a table that another process serves it is the last change of the volts
at the plant itself, and homing is ended by Ctrl-C, as `rig home` has no page. A stop that finds no
volts (the table was not opened yet, and never is) took no time. `loaded`: four pages watch, the
camera's picture is open, and a calibration fits in a worker process.
"""

import argparse
import random
import tempfile
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import numpy as np

from tests.benchmarks.dashboard.dashboard_load import Pages, state

LONG_S = 120.0
RUN = "circle"


class Desk:
    """The dashboard of a rig, its STOP as the page presses it, and when the table was at 0 V."""

    def __init__(self, app, gate, volts: Callable[[], np.ndarray] | None = None) -> None:
        self.app, self.session = app, app.session
        self._gate, self._volts = gate, volts

    def press(self) -> None:
        """STOP as the bar of the page asks for it."""
        gate = self._gate
        request = urllib.request.Request(
            f"http://127.0.0.1:{gate.port}{gate.path}/stop",
            headers={"Cookie": f"{gate.cookie}={gate.key}"},
        )
        with urllib.request.urlopen(request, timeout=30.0) as answer:
            answer.read()

    def stopped_after_s(self) -> float:
        """Press STOP; the time until the table was at 0 V for good [s]."""
        began_s = time.monotonic()
        at_rest_s = []

        def watch() -> None:
            while self.session.status.state not in ("at rest", "stopped"):
                time.sleep(0.002)
            at_rest_s.append(time.monotonic())

        thread = threading.Thread(target=watch)
        self.press()
        thread.start()
        thread.join(LONG_S)
        state(self.app, "stopped")
        if self._volts is None:
            return at_rest_s[0] - began_s
        volts = self._volts()
        assert not len(volts) or not volts[-1, 1:].any(), "the plant was left with volts"
        return max(0.0, volts[-1, 0] - began_s) if len(volts) else 0.0


def begin(desk: Desk, rng: random.Random) -> None:
    """Press Start; armed, on a real table."""
    tab = desk.app.run_tab
    tab._protocol.now = RUN if not desk.session.table.real else "servo-squares"
    tab._armed.now = True
    tab.start(None)


def starting(desk: Desk, rng: random.Random) -> None:
    """A run is being started, at any moment of it."""
    begin(desk, rng)
    state(desk.app, "running")
    time.sleep(rng.uniform(0.0, 2.0))


def recording(desk: Desk, rng: random.Random) -> None:
    """A run is on, at any moment of it."""
    begin(desk, rng)
    end = time.monotonic() + LONG_S
    while desk.session.status.t_s <= 0.0 and time.monotonic() < end:
        time.sleep(0.01)
    time.sleep(rng.uniform(0.5, 3.0))


def balancing(desk: Desk, rng: random.Random) -> None:
    """The virtual table balances."""
    desk.session.balance()
    state(desk.app, "balancing")
    time.sleep(rng.uniform(0.5, 2.0))


@contextmanager
def dashboard(out: Path, rig_file: Path | None = None, volts=None) -> Iterator[Desk]:
    """The program of the page, without a browser."""
    from experiments.dashboard.app import App
    from experiments.dashboard.server.server import open_server
    from experiments.runs.assemble import load_rig

    server, gate = open_server("127.0.0.1", 0, "benchmark-token-" + "x" * 20)
    app = App(server, load_rig(rig_file), out, rig_file=rig_file)
    try:
        yield Desk(app, gate, volts)
    finally:
        app.close()
        server.stop()


@contextmanager
def loaded(desk: Desk) -> Iterator[None]:
    """Four pages, the camera's picture, a calibration of the lens over and over."""
    over = threading.Event()

    def calibrate() -> None:
        while not over.is_set():
            with suppress(Exception):
                desk.app.calibrate.begin(("camera",))
            over.wait(1.0)

    desk.app.camera.set_wanted(True)
    thread = threading.Thread(target=calibrate)
    thread.start()
    try:
        with Pages(desk._gate, True):
            time.sleep(2.0)
            yield
    finally:
        over.set()
        thread.join()
        desk.app.camera.set_wanted(False)


def told(name: str, seconds: list[float]) -> None:
    """A row of the table."""
    late = sum(s > 1.0 for s in seconds)
    print(
        f"| {name} | {np.median(seconds):.2f} | {max(seconds):.2f} | {late}/{len(seconds)} |",
        flush=True,
    )


def homing(lab, tries: int, rng: random.Random) -> list[float]:
    """`rig home` on the served table, ended by Ctrl-C while the arms move."""
    import signal

    found = []
    for _ in range(tries):
        before = len(lab.volts())
        child = lab.start("home", "--yes")
        end = time.monotonic() + LONG_S
        while len(lab.volts()) < before + 3 and time.monotonic() < end:
            time.sleep(0.01)
        time.sleep(rng.uniform(0.0, 3.0))
        began_s = time.monotonic()
        child.send_signal(signal.SIGINT)
        child.communicate()
        time.sleep(1.0)
        volts = lab.volts()
        assert not volts[-1, 1:].any(), "the plant was left with volts"
        found.append(max(0.0, volts[-1, 0] - began_s))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tries", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    rng = random.Random(given.seed)
    print("| table, state, load | median s | worst s | above 1 s |\n|---|---|---|---|")
    with tempfile.TemporaryDirectory() as out, dashboard(Path(out)) as desk:
        state(desk.app, "balancing")
        desk.press()
        state(desk.app, "stopped")
        measure("virtual", desk, (balancing, starting, recording), given.tries, rng)
    served(given.tries, rng)


def measure(table: str, desk: Desk, states, tries: int, rng: random.Random) -> None:
    """Every state, quiet and loaded."""
    for load in ("quiet", "loaded"):
        with ExitStack() as stack:
            if load == "loaded":
                stack.enter_context(loaded(desk))
            for one in states:
                seconds = []
                for _ in range(tries):
                    one(desk, rng)
                    seconds.append(desk.stopped_after_s())
                told(f"{table}, {one.__name__}, {load}", seconds)


def served(tries: int, rng: random.Random) -> None:
    """The same before a table that another process serves, and its homing."""
    from tests.support.patient_rig import patiently
    from tests.support.rig_lab import Lab

    with Lab() as lab:
        told("served, homing", homing(lab, tries, rng))
        lab.home()
        with patiently(), dashboard(lab.out, lab.rig, lab.volts) as desk:
            state(desk.app, "stopped")
            measure("served", desk, (starting, recording), tries, rng)


if __name__ == "__main__":
    main()
