"""A program that records a paced loop, to be killed.

    python -m tests.support.killed_program FOLDER TICKS [BYTES]

The loop's process writes the clock of every tick into TICKS, which outlives everybody, so that one
knows afterwards what there was to record. With BYTES no file may grow beyond them.
"""

import signal
import subprocess
import sys
import time
from dataclasses import replace
from functools import partial
from io import BytesIO
from pathlib import Path

import numpy as np

from experiments.records.recording import Recorder, Run, read_run, recover
from experiments.runs.assemble import known, load_rig
from experiments.runs.live_run import record_live
from rig.course import Course
from rig.loop.job import Job
from rig.loop.paced import Paced
from rig.safety.monitor import MonitorLimits
from rig.simulation.simulator import SimulatedTable
from tests.support import ROOT
from tests.support.waiting import wait_for

RIG = load_rig(None)
MOST_TICKS = 20_000
LOST_S = 0.2  # at most so much of the end may be missing


class Witness(Paced):
    """Paced; writes (clock, t_s) of every tick into a file in shared pages."""

    def __init__(self, path: str) -> None:
        super().__init__(SimulatedTable(RIG, np.random.default_rng(1), start_m=(-0.08, 0.06)))
        self._ticks = np.memmap(path, np.float64, "r+", shape=(MOST_TICKS, 2))
        self._count = 0

    def read(self):
        reading = super().read()
        if self._count < MOST_TICKS:
            self._ticks[self._count] = time.monotonic(), reading.t_s
            self._count += 1
        return reading


def job(ticks: str) -> Job:
    n = MOST_TICKS
    way = Course(np.zeros((n, 2)), np.zeros((n, 2)), (-0.08, 0.06))
    patient = replace(MonitorLimits.of_rig(RIG), late_s=10.0, late_ticks=1e9)  # a busy machine
    return Job(partial(Witness, ticks), known(RIG), 0, way, limits=patient)


def main(folder: str, ticks: str, most: str | None = None) -> None:
    def started(loop) -> None:  # after the shared memory is made, which is files, too
        if most is not None:
            import resource

            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (int(most), int(most)))

    with Recorder(folder, {"source": "simulated"}) as recorder:
        record_live(job(ticks), recorder, started=started)


# --- for who kills it ---
def start(folder: Path, *more: str, ticks: Path | None = None) -> tuple[subprocess.Popen, Path]:
    """The program, recording into `folder`; and the witness's file."""
    ticks = ticks or folder.with_suffix(".ticks")
    np.zeros((MOST_TICKS, 2)).tofile(ticks)
    command = [sys.executable, "-m", "tests.support.killed_program", str(folder), str(ticks), *more]
    return subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True), ticks


def witnessed(ticks: Path) -> np.ndarray:
    """(clock, t_s) of the ticks so far, (n, 2)."""
    told = np.fromfile(ticks).reshape(-1, 2)
    return told[told[:, 0] > 0]


def wait_for_ticks(
    program: subprocess.Popen, ticks: Path, count: int, patience_s: float = 150.0
) -> None:
    """Until the loop has made `count` ticks; kills the program and fails where it does not."""

    def enough() -> bool:
        return program.poll() is not None or len(witnessed(ticks)) >= count

    try:
        wait_for(f"{count} ticks", enough, patience_s)
        assert program.poll() is None, "the program has ended"
    except AssertionError as error:
        program.kill()
        raise AssertionError(f"the loop does not run: {program.communicate()[1]}") from error


def kill_after(folder: Path, seconds: float) -> float:
    """Start, kill -9 `seconds` after the loop's begin, check; returns what was lost [s]."""
    program, ticks = start(folder)
    wait_for_ticks(program, ticks, 5)
    time.sleep(seconds)
    killed_s = time.monotonic()
    program.kill()
    program.communicate()
    before = witnessed(ticks)
    before = before[before[:, 0] < killed_s]
    run = read_run(folder)
    assert run.meta["truncated"]
    assert run.meta["outcome"] is None
    whole(run, opened_by_mcap(folder))
    last_s = float(run.log["t_s"][-1]) if len(run.log) else 0.0
    lost_s = max(0.0, float(before[-1, 1]) - last_s)
    assert lost_s <= LOST_S, f"{lost_s:.3f} s lost of a run killed after {seconds:.3f} s"
    mended = recover(folder)
    assert (mended.meta["outcome"], mended.meta["truncated"]) == ("killed", False)
    whole(mended, opened_by_mcap(folder, finished=True))
    assert len(mended.log) == len(run.log)
    return lost_s


def whole(run: Run, messages: int) -> None:
    """Every tick from the first to the last is there, and the official reader found as many."""
    t_s = run.log["t_s"]
    np.testing.assert_allclose(t_s, np.arange(len(t_s)) * 0.002, atol=1e-9)
    assert messages == len(t_s)


def opened_by_mcap(folder: Path, *, finished: bool = False) -> int:
    """How many samples the `mcap` package's own reader finds, also in a file that is cut off."""
    from mcap.exceptions import EndOfFile
    from mcap.reader import make_reader
    from mcap.records import Channel, Message
    from mcap.stream_reader import StreamReader

    data = (folder / "samples.mcap").read_bytes()
    if finished:
        reader = make_reader(BytesIO(data))
        summary = reader.get_summary()
        assert summary is not None
        return sum(1 for _ in reader.iter_messages(topics=["samples"]))
    channels, count = {}, 0
    try:
        for record in StreamReader(BytesIO(data)).records:
            if isinstance(record, Channel):
                channels[record.id] = record.topic
            count += isinstance(record, Message) and channels[record.channel_id] == "samples"
    except EndOfFile:
        pass
    return count


if __name__ == "__main__":
    main(*sys.argv[1:])
