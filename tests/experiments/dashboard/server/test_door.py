"""The door of the page: few strangers at a time, and nobody who keeps STOP of others waiting."""

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import repeat
from types import SimpleNamespace
from typing import Any

import pytest
import viser
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Origin, Subprotocol

from experiments.dashboard.server import door
from experiments.dashboard.server.door import (
    AT_ONCE_S,
    HEARD_HZ,
    HEARD_S,
    MOST_WAITING,
    ODD_AT_ONCE,
    WANTED_FILES,
    allow_files,
)
from experiments.dashboard.server.server import open_server


@contextmanager
def stopped(server: Any) -> Iterator[None]:
    try:
        yield
    finally:
        server.stop()


def test_a_crowd_drops_nobody_who_may_have_asked_and_was_not_read_yet(monkeypatch):
    limit: tuple[Any, Any] = door.crowd_limit()
    kind, passed = limit
    monkeypatch.setattr(ServerConnection, "connection_made", lambda one, transport: None)
    monkeypatch.setattr(ServerConnection, "connection_lost", lambda one, error: None)
    clock, dropped = SimpleNamespace(now=0.0), []
    monkeypatch.setattr(door, "time", SimpleNamespace(monotonic=lambda: clock.now))

    def came(name: str) -> Any:
        one = kind.__new__(kind)
        one.transport = SimpleNamespace(abort=lambda: dropped.append(name))
        one.connection_made(one.transport)
        return one

    stop, second = came("stop"), came("second")
    for k in range(MOST_WAITING - 2):
        came(f"{k}")
    assert dropped == []
    came("newest")
    assert dropped == ["newest"]
    passed(stop)
    came("in its place")
    clock.now = 1.01 * HEARD_S
    second.connection_lost(None)
    came("in that of the second")
    assert dropped == ["newest"]
    came("newer")
    came("newer still")
    assert dropped == ["newest", "0", "1"]


def test_pages_that_flood_are_heard_in_measure_all_together(monkeypatch):
    limit: tuple[Any, Any] = door.crowd_limit()
    clock, flooded_s = SimpleNamespace(now=100.0), 10.0

    async def received(one, decode=None):
        return b""

    async def sleep(seconds: float):
        clock.now += seconds

    monkeypatch.setattr(ServerConnection, "recv", received)
    monkeypatch.setattr(door, "time", SimpleNamespace(monotonic=lambda: clock.now))
    monkeypatch.setattr(door, "asyncio", SimpleNamespace(sleep=sleep))
    pages = [limit[0].__new__(limit[0]) for _ in range(5)]

    async def flood(talking: int) -> int:
        """How many messages are read of so many pages that send without end, in turn."""
        count, until_s = 0, clock.now + flooded_s
        while clock.now < until_s:
            for one in pages[:talking]:
                await one.recv()
                count += 1
        return count

    for one in pages:  # all have spoken once, and watch
        asyncio.run(one.recv())
    clock.now += 2 * AT_ONCE_S
    most = HEARD_HZ * (flooded_s + AT_ONCE_S)
    alone = asyncio.run(flood(1))
    assert 0.95 * most < alone < 1.05 * most  # who watches takes nothing from it
    clock.now += 2 * AT_ONCE_S
    assert asyncio.run(flood(3)) < 1.05 * most


@pytest.mark.parametrize("odd", ["ping", "pong", "part"])
def test_who_floods_what_is_no_message_is_gone(odd: str):
    """It kept all pages' STOP waiting for 3 to 10 s, and parts without an end took memory."""
    server, gate = open_server("127.0.0.1", 0, "a-token-of-some-length-for-tests")
    with (
        stopped(server),
        connect(
            f"ws://127.0.0.1:{gate.port}{gate.path}",
            origin=Origin(f"http://127.0.0.1:{gate.port}"),
            additional_headers={"Cookie": f"{gate.cookie}={gate.key}"},
            subprotocols=[Subprotocol(f"viser-v{viser.__version__}")],
            compression=None,
        ) as websocket,
    ):
        assert len(websocket.recv(timeout=5)) > 0

        def listen():
            while True:  # it is closed, if anything of the flood was still on its way
                websocket.recv(timeout=5)

        def parts():
            yield from repeat(b"", 100 * ODD_AT_ONCE)
            listen()

        def flood():
            if odd == "part":
                websocket.send(parts())
            for _ in range(100 * ODD_AT_ONCE):
                websocket.ping() if odd == "ping" else websocket.pong()
            listen()

        with pytest.raises((ConnectionClosed, ConnectionError)):
            flood()


def test_the_program_allows_itself_more_files():
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (256, before[1]))
        allow_files()
        assert resource.getrlimit(resource.RLIMIT_NOFILE)[0] == min(WANTED_FILES, before[1])
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)
