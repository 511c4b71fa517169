"""A board on a real pseudo terminal in real time: a thread, or a process of its own.

Run as a program (`python -m tests.support.boards.pty chip|host SECONDS`) it prints the port's name,
then a line `exposed_s x_m y_m` on the monotonic clock for every ball seen, and ends when the time
is over.
"""

import os
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import contextmanager, suppress
from typing import Any

from rig.parameters import Rig
from tests.support.boards.host import HostBoard
from tests.support.boards.world import STEP_S, World


class Way:
    """One way of a cable: what sets out at t [s] arrives `late_s(t)` [s] later, in its order."""

    def __init__(self) -> None:
        self.late_s: Callable[[float], float] = lambda now_s: 0.0
        self._going: deque[tuple[float, bytes]] = deque()

    def carry(self, data: bytes, now_s: float) -> bytes:
        """Take what sets out now; return what arrives now."""
        if data:
            self._going.append((now_s + self.late_s(now_s), data))
        arrived = b""
        while self._going and self._going[0][0] <= now_s + 1e-9:
            arrived += self._going.popleft()[1]
        return arrived


class PtyBoard:
    """Serves a World, or what steps like one, on a pty, one step a millisecond of the wall clock,
    until `close`. commands, telemetry: the two ways of its cable."""

    def __init__(self, world: Any, *, thread: bool = True) -> None:
        self.world, self.hung = world, False
        self.commands, self.telemetry = Way(), Way()
        self._master, self._slave = os.openpty()
        self.port = os.ttyname(self._slave)
        os.set_blocking(self._master, False)
        self._going = True
        self._thread = threading.Thread(target=self.serve, daemon=True)
        if thread:
            self._thread.start()

    def serve(self, seconds: float = 1e9, seen=lambda ball, start_s: None) -> None:
        start = time.monotonic()
        balls, steps = 0, 0
        while self._going and time.monotonic() < start + seconds:
            if not self.hung:
                self.step()
                for ball in self.world.balls[balls:]:
                    seen(ball, start)
                balls = len(self.world.balls)
            steps += 1
            late = time.monotonic() - (start + steps * STEP_S)
            if late < 0:
                time.sleep(-late)
            elif late > 0.05:  # a busy machine: time stands still here, no burst after it
                start += late

    def step(self) -> None:
        """One millisecond: bytes in, board and plant on, bytes out."""
        if self.hung:
            self.world.step()
            return
        data = b""
        with suppress(BlockingIOError, OSError):
            data = os.read(self._master, 4096)
        if data := self.commands.carry(data, self.world.now_s):
            self.world.board.receive(data)
        self.world.step()
        if data := self.telemetry.carry(self.world.board.take(), self.world.now_s):
            with suppress(BlockingIOError, OSError):
                os.write(self._master, data)

    def unplug(self) -> None:
        """The device vanishes; its board goes on alone."""
        self._going = False
        if self._thread.is_alive():
            self._thread.join()
        os.close(self._slave)
        os.close(self._master)
        self._master = self._slave = -1

    def close(self) -> None:
        self._going = False
        if self._thread.is_alive():
            self._thread.join()
        for end in (self._master, self._slave):
            with suppress(OSError):
                os.close(end)


class SteppedLink:
    """The product's link to a PtyBoard whose time passes only while the host waits: the device and
    the driver are real, and no thread of a busy machine can be late."""

    def __init__(self, peer: PtyBoard, link) -> None:
        self.peer, self.name, self._link = peer, link.name, link
        self.send, self.receive, self.close = link.send, link.receive, link.close

    def clock(self) -> float:
        return self.peer.world.now_s

    def wait(self, timeout_s: float) -> bool:
        until = self.clock() + timeout_s
        while not self._link.wait(0.0):
            self.peer.step()
            if self.clock() >= until - 1e-9:
                return self._link.wait(0.0)
        return True


@contextmanager
def real_time():
    """This thread before all others, where that is allowed: as a real loop would have it."""
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(2))
    try:
        yield
    finally:
        os.sched_setscheduler(0, *before)


def main(kind: str, seconds: float) -> None:
    if kind == "chip":
        from tests.support.boards.chip import Chip

        board = Chip()
    else:
        board = HostBoard()
    world = World(board, Rig(), start_m=(0.05, -0.04))
    world.run(0.1)  # compile before the clock matters
    world.plant.place((0.05, -0.04))
    world.plant.release()
    offset_s = world.now_s
    served = PtyBoard(world, thread=False)
    print(served.port, flush=True)

    def seen(ball, start_s: float) -> None:
        at = start_s + ball.exposed_s - offset_s
        print(at, *ball.xy_m, flush=True)

    with real_time():
        served.serve(seconds, seen)


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]))
