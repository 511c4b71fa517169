"""viser's word to its sending task that a message is there, said from any thread.

viser 1.1.1 (pinned) calls `asyncio.Event.set` from the thread that draws, in the middle of its
`push`. That goes through the tasks that wait, and raises "deque mutated during iteration" where the
event loop's thread lets one begin or stop to wait meanwhile: what was drawn next was left out, and
the error stood among the run's events. viser has the event loop set it again, which wakes whoever
looked at the event just before it was set and began to wait just after.
"""

import asyncio
from contextlib import suppress
from functools import wraps


class Wake(asyncio.Event):
    """An event that may be set from any thread."""

    def set(self) -> None:
        """Wake all who wait, also where the event was set before."""
        self._value = True
        for waiting in tuple(self._waiters):  # a copy is made in one step of the interpreter
            with suppress(asyncio.InvalidStateError):  # woken already, by another thread just now
                waiting.set_result(True)


def wake_from_any_thread() -> None:
    """Have viser make its message buffers with a `Wake`; once is enough."""
    from viser.infra._async_message_buffer import AsyncMessageBuffer

    plain = AsyncMessageBuffer.__init__
    if hasattr(plain, "__wrapped__"):
        return

    @wraps(plain)
    def made(self: AsyncMessageBuffer, *words: object, **named: object) -> None:
        plain(self, *words, **({"message_event": Wake()} | named))  # pyright: ignore

    AsyncMessageBuffer.__init__ = made
