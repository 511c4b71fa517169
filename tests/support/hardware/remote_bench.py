"""A table served by a thread of this process, and a connection that can be cut or held up."""

import os
import queue
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import numpy as np

from rig.hardware.network.remote import RemoteTable
from rig.hardware.network.serve import Server
from rig.hardware.wiring import Wiring
from rig.loop.paced import Paced
from rig.parameters import Rig
from rig.simulation.simulator import SimulatedTable

TOKEN = b"0123456789abcdef0123456789abcdef"


@contextmanager
def realtime() -> Iterator[None]:
    """Real-time priority for this thread and those it starts, where it is allowed."""
    if not hasattr(os, "sched_setscheduler"):
        yield
        return
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))
    try:
        yield
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


class Served:
    """The server's side: its table, its guard, what it said."""

    def __init__(self, rig: Rig, table: SimulatedTable) -> None:
        self.table, self.said = table, []
        self.server = Server(
            Paced(table), TOKEN, servo=rig.servo,
            port=0, say=self.said.append,
        )  # fmt: skip
        self.error: BaseException | None = None
        self.volts: list[tuple[float, tuple[float, float]]] = []
        self.arms: list[np.ndarray] = []
        self._done = threading.Event()
        self._opened: list[RemoteTable] = []
        self.stopped = threading.Event()  # like SIGSTOP for the server
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        def until() -> bool:
            self.volts.append((time.monotonic(), self.table.volts_V))
            self.arms.append(self.table.truth()["arm_rad"].copy())
            while self.stopped.is_set():
                time.sleep(0.01)
            return self._done.is_set()

        try:
            with self.server:
                self.server.run(until)
        except Exception as error:
            self.error = error

    def open(self, *, token: bytes = TOKEN, wiring: Wiring | None = None, **more) -> RemoteTable:
        port = more.pop("port", self.server.port)
        table = RemoteTable("127.0.0.1", port, token, wiring or Wiring(), **more)
        self._opened.append(table)
        return table

    def widest_rad(self) -> float:
        """How far an arm was from level [rad]."""
        return float(np.abs(self.arms).max())

    def end(self) -> None:
        """End the server while its users are connected."""
        self.stopped.clear()
        self._done.set()
        self._thread.join(5)

    def close(self) -> None:
        for table in self._opened:
            table.close()
        self.end()


@contextmanager
def served(rig: Rig, **settings) -> Iterator[Served]:
    table = SimulatedTable(rig, np.random.default_rng(1), **settings)
    one = Served(rig, table)
    try:
        yield one
    finally:
        one.close()


class Cable:
    """Forwards a connection byte by byte; `cut` drops it, `hold` keeps everything back; late_s: how
    late what the server says at a moment arrives [s]."""

    def __init__(self, port: int) -> None:
        self._door = socket.create_server(("127.0.0.1", 0))
        self.port = self._door.getsockname()[1]
        self._target, self.hold, self._ends = port, threading.Event(), []
        self.change = lambda data, up: data
        self.late_s: Callable[[float], float] = lambda now_s: 0.0
        threading.Thread(target=self._work, daemon=True).start()

    def __enter__(self) -> "Cable":
        return self

    def __exit__(self, *_: object) -> None:
        self.cut()

    def _work(self) -> None:
        near, _ = self._door.accept()
        far = socket.create_connection(("127.0.0.1", self._target))
        self._ends = [near, far]
        for end in self._ends:  # as the two ends have it: else a small message waits for 40 ms
            end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        told = queue.SimpleQueue()
        for work in (
            lambda: self._carry(near, far.sendall, up=True),
            lambda: self._carry(far, lambda data: told.put((time.monotonic(), data)), up=False),
            lambda: self._deliver(told, near),
        ):
            threading.Thread(target=work, daemon=True).start()

    def _carry(self, source: socket.socket, give: Callable[[bytes], None], *, up: bool) -> None:
        with suppress(OSError):
            while data := source.recv(4096):
                while self.hold.is_set():
                    time.sleep(0.005)
                give(self.change(data, up))
        if not up:
            give(b"")

    def _deliver(self, told: queue.SimpleQueue, near: socket.socket) -> None:
        with suppress(OSError):
            while (one := told.get())[1]:
                time.sleep(max(one[0] + self.late_s(one[0]) - time.monotonic(), 0.0))
                near.sendall(one[1])

    def cut(self) -> None:
        for end in self._ends:
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            end.close()
        self._door.close()
