"""The real firmware behind a real serial device in real time, in a process of its own.

Without real time: test_firmware_commands.py and tests/rig/hardware/test_contract.py.
"""

import subprocess
import sys
import threading
import time
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest

from rig.control.controllers import COMPENSATORS
from rig.course import Course
from rig.hardware.board.board import BoardTable
from rig.hardware.board.link import LinkLost
from rig.hardware.board.serial_link import SerialLink
from rig.hardware.board.session import BoardStopped
from rig.loop.loop import Loop
from rig.parameters import Rig
from rig.simulation.simulator import SimulatedTable
from tests.support import ROOT
from tests.support.boards.chip import firmware
from tests.support.boards.pty import real_time
from vision.frames import Observation

pytestmark = pytest.mark.realtime

PROGRAM = "tests.support.boards.pty"
SECONDS = 3.0
TRIES = 3


class PipedEye:
    """Balls as the process prints them, on the clock of the table's readings."""

    def __init__(self, lines) -> None:
        self.table: BoardTable | None = None
        self._newest: Observation | None = None
        self.listening = threading.Thread(target=self._listen, args=(lines,), daemon=True)
        self.listening.start()

    def _listen(self, lines) -> None:
        for line in lines:
            exposed, x, y = map(float, line.split())
            self._newest = Observation((x, y), (9e-8, 0.0, 9e-8), exposed)

    def latest(self, after_s: float) -> Observation | None:
        if self._newest is None or self.table is None:
            return None
        ball = replace(self._newest, exposed_s=self._newest.exposed_s - self.table.zero_s)
        return ball if ball.exposed_s > max(after_s, 0.0) else None


def warm() -> None:
    """Compile what the loop runs before a board waits for it."""
    way = Course(np.zeros((2, 2)), np.zeros((2, 2)))
    Loop(SimulatedTable(Rig(), np.random.default_rng(1)), Rig(), COMPENSATORS["without"], way).run()


def balance() -> tuple[str, np.ndarray, float]:
    """Outcome, rows, and ticks missed as a share, of `SECONDS` through the device."""
    rig, rows = Rig(), []
    n = round(SECONDS * rig.control_rate_hz)
    way = Course(np.zeros((n, 2)), np.zeros((n, 2)))
    served = subprocess.Popen(
        [sys.executable, "-m", PROGRAM, "chip", str(SECONDS + 10)],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert served.stdout is not None
    with served, ExitStack() as at_end:
        try:
            link = SerialLink(served.stdout.readline().strip())
            eye = PipedEye(served.stdout)
            at_end.callback(eye.listening.join, 10.0)  # before the pipe is closed under it
            table = BoardTable(link, eye=eye)
            eye.table = table
            loop = Loop(
                table, rig, COMPENSATORS["without"], way, keep=lambda row: rows.append(row.copy())
            )
            with real_time(), table:
                ending = loop.run()
        finally:
            served.terminate()
    return ending.outcome, np.array(rows), table.ticks_missed / n


@pytest.mark.slow
def test_the_firmware_balances_the_ball_in_real_time_over_a_serial_device():
    """A machine too busy to give either process its turn for 80 ms is a lost link, rightly: then
    once more, and in the end skipped."""
    firmware()
    warm()
    for _ in range(TRIES):
        try:
            begin = time.monotonic()
            outcome, rows, missed = balance()
            break
        except (LinkLost, BoardStopped) as error:  # the board's word for the same silence
            why = str(error)
    else:
        pytest.skip(f"THIS MACHINE IS TOO BUSY for real time, {TRIES} tries: {why}")
    assert outcome == "completed"
    assert time.monotonic() - begin > SECONDS
    seen = rows[~np.isnan(rows[:, 5]), 5:7]
    assert len(seen) > 30 * SECONDS
    assert np.hypot(*seen[-20:].T).mean() < 0.5 * np.hypot(*seen[0])  # 6.4 cm away at first
    assert np.all(np.diff(rows[:, 0]) > 0)
    assert missed < 0.2
