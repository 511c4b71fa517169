"""How late the ticks of our loop come, beside C's cyclictest in the same minutes.

    python tests/benchmarks/hardware/loop_jitter.py [--seconds 10] [--rounds 3] [--idle] \
        [--json FILE]

Rounds alternate: our loop in its own process at 500 Hz (the real loop on a paced simulated table,
its rows recorded), then `cyclictest` (package rt-tests) with the same period and priority. All the
while this program is busy as a live session is: viser gets an image 30 times a second, and OpenCV
renders and tracks frames as fast as it can. cyclictest's figures are the machine's own floor.
"""

import argparse
import json
import os
import shutil
import subprocess
import tempfile
import threading
import time
from functools import partial
from pathlib import Path

import numpy as np

from experiments.records.recording import Recorder, read_run
from experiments.runs.assemble import known, load_rig
from experiments.runs.live_run import record_live
from rig.course import Course
from rig.loop.job import Job
from rig.loop.paced import Paced
from rig.loop.realtime import PRIORITY
from rig.simulation.simulator import SimulatedTable

PERIOD_S = 0.002
RIG = load_rig(None)


def paced_table() -> Paced:
    return Paced(SimulatedTable(RIG, np.random.default_rng(1), start_m=(-0.05, 0.05)))


class Busy:
    """A live session's work in threads of this process, until left."""

    def __init__(self) -> None:
        self.over, self.frames, self.images = threading.Event(), 0, 0
        self.threads = [threading.Thread(target=t) for t in (self.see, self.show)]

    def __enter__(self) -> "Busy":
        for thread in self.threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.over.set()
        for thread in self.threads:
            thread.join()

    def see(self) -> None:
        from vision.ball_camera import BallCamera
        from vision.frames import Frame
        from vision.plate.markers import default_layout
        from vision.synthetic.synthetic import Renderer, Scene, virtual_view

        layout = default_layout(0.275)
        scene = Scene(plate_side_m=0.275, layout=layout, ball_radius_m=0.019625)
        renderer = Renderer(scene, virtual_view(), np.random.default_rng(0))
        camera = BallCamera.over_plate(virtual_view(), layout, 0.019625, 0.275, 0.105)
        while not self.over.is_set():
            at = 0.05 * np.cos(0.1 * self.frames), 0.05 * np.sin(0.1 * self.frames)
            image = renderer.render(np.eye(3), at)
            camera.step(Frame(image, self.frames / 60, self.frames), np.eye(3))
            self.frames += 1

    def show(self) -> None:
        import viser

        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        image = np.random.default_rng(0).integers(0, 255, (480, 640, 3), np.uint8)
        while not self.over.wait(1 / 30):
            server.scene.set_background_image(np.roll(image, self.images, 1), format="jpeg")
            self.images += 1
        server.stop()


def figures(late_us: np.ndarray, missed: int) -> dict:
    p50, p99, p999 = np.quantile(late_us, (0.5, 0.99, 0.999))
    return {
        "ticks": len(late_us),
        "p50_us": float(p50),
        "p99_us": float(p99),
        "p99.9_us": float(p999),
        "max_us": float(late_us.max()),
        "missed": missed,
        "missed_percent": 100 * missed / len(late_us),
    }


def ours(seconds: float, folder: Path) -> tuple[np.ndarray, int, dict]:
    """Lateness (n,) [us], missed ticks, and what the recording says of real time."""
    n = round(seconds / PERIOD_S)
    way = Course(np.zeros((n, 2)), np.zeros((n, 2)), (-0.05, 0.05))
    traced: list = []
    job = Job(partial(paced_table), known(RIG), 1, way, trace=n)
    with Recorder(folder, {"source": "simulated"}) as recorder:
        record_live(job, recorder, started=traced.append)
    run = read_run(folder)
    assert len(run.log) == n, f"{len(run.log)} rows of {n}: {run.meta['outcome']}"
    loop = run.meta["loop"]
    return np.array(traced[0].late_us)[1:], loop["jitter"]["missed"], loop["realtime"]


def cyclictest(seconds: float) -> tuple[np.ndarray, int]:
    """The same of cyclictest: one thread, its histogram to 1 us."""
    loops, most = round(seconds / PERIOD_S), 200_000
    command = ["cyclictest", "-q", "-m", "-t1", "-i", f"{1e6 * PERIOD_S:.0f}", "-l", str(loops)]
    command += ["-h", str(most), *(["-p", str(PRIORITY)] if os.geteuid() == 0 else [])]
    out = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    pairs = [line.split()[:2] for line in out.splitlines() if line[:1].isdigit()]
    late_us = np.repeat([int(a) for a, _ in pairs], [int(b) for _, b in pairs])
    return late_us.astype(float), int(np.sum(late_us // (1e6 * PERIOD_S)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--idle", action="store_true", help="nothing else runs in this program")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    if shutil.which("cyclictest") is None:
        raise SystemExit("cyclictest is missing: apt-get install rt-tests")
    late: dict[str, list[np.ndarray]] = {"ours": [], "cyclictest": []}
    missed, realtime, busy = {"ours": 0, "cyclictest": 0}, {}, Busy()
    start_s = time.monotonic()
    if not given.idle:
        busy.__enter__()
    try:
        with tempfile.TemporaryDirectory() as folder:
            for k in range(given.rounds):
                told, count, realtime = ours(given.seconds, Path(folder) / str(k))
                late["ours"].append(told)
                missed["ours"] += count
                told, count = cyclictest(given.seconds)
                late["cyclictest"].append(told)
                missed["cyclictest"] += count
    finally:
        if not given.idle:
            busy.__exit__()
    took_s = time.monotonic() - start_s
    print(f"granted: {realtime}")
    if not given.idle:
        print(
            f"meanwhile {busy.frames / took_s:.0f} frames/s seen, {busy.images / took_s:.0f} shown"
        )
    table = {name: figures(np.concatenate(late[name]), missed[name]) for name in late}
    print("lateness at 500 Hz [us]    p50      p99    p99.9      max   missed")
    for name, row in table.items():
        numbers = "".join(f"{row[k]:9.1f}" for k in ("p50_us", "p99_us", "p99.9_us", "max_us"))
        share = f"{row['missed']} of {row['ticks']} ({row['missed_percent']:.3f} %)"
        print(f"{name:>20s}{numbers}   {share}")
    ratio = table["ours"]["p99_us"] / table["cyclictest"]["p99_us"]
    print(f"p99: {ratio:.2f} times cyclictest's (goal: at most 2)")
    if given.json:
        given.json.write_text(json.dumps({"figures": table, "p99_ratio": ratio}, indent=2))


if __name__ == "__main__":
    main()
