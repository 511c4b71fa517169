"""viser's sending task is told of a message by a thread that draws, while others begin to wait."""

import asyncio
import threading
from collections import deque

import pytest

from experiments.dashboard.server.server import open_server
from experiments.dashboard.server.wake import Wake


class _Waiting:
    """One who waits, and whom another joins as they are woken."""

    def __init__(self, event: asyncio.Event) -> None:
        self._event, self.woken = event, False

    def done(self) -> bool:
        return self.woken

    def set_result(self, value: bool) -> None:
        if self.woken:
            raise asyncio.InvalidStateError
        self.woken = value
        self._event._waiters.append(_Waiting(self._event))  # pyright: ignore


def test_who_begins_to_wait_meanwhile_is_no_error():
    plain, event = asyncio.Event(), Wake()
    for one in (plain, event):
        one._waiters.extend(_Waiting(one) for _ in range(3))  # pyright: ignore
    with pytest.raises(RuntimeError, match="mutated during iteration"):
        plain.set()
    event.set()
    assert event.is_set()
    assert [one.done() for one in event._waiters] == [True] * 3 + [False] * 3
    event.set()
    assert [one.done() for one in event._waiters] == [True] * 6 + [False] * 3


def test_all_who_wait_are_woken_by_another_thread():
    async def main() -> int:
        event, woken = Wake(), 0

        async def wait() -> None:
            nonlocal woken
            await event.wait()
            woken += 1

        tasks = [asyncio.create_task(wait()) for _ in range(50)]
        await asyncio.sleep(0)
        thread = threading.Thread(target=event.set)
        thread.start()
        thread.join()
        await asyncio.gather(*tasks)
        return woken

    assert asyncio.run(main()) == 50


def test_who_begins_to_wait_as_the_event_is_set_is_woken_by_the_loop():
    """Set by a thread between the look at the event and the place in the queue of those who wait;
    the page stood still for minutes, whatever was drawn."""

    class Late(deque):
        def __init__(self, event: Wake) -> None:
            super().__init__()
            self._event: Wake | None = event

        def append(self, waiting) -> None:
            event, self._event = self._event, None
            if event is not None:
                thread = threading.Thread(target=event.set)
                thread.start()
                thread.join()
                asyncio.get_running_loop().call_soon_threadsafe(event.set)  # as viser does
            super().append(waiting)

    async def main() -> bool:
        event = Wake()
        event._waiters = Late(event)  # pyright: ignore
        return await asyncio.wait_for(event.wait(), 20.0)

    assert asyncio.run(main())


def test_the_page_server_is_woken_so():
    server, _ = open_server("127.0.0.1", 0, "a-token-of-some-length-for-tests")
    try:
        buffer = server._websock_server._broadcast_buffer
        assert isinstance(buffer.message_event, Wake)
        assert not isinstance(buffer.flush_event, Wake)
    finally:
        server.stop()
