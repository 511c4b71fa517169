"""Connections that have not shown the token: few at a time, so that nobody uses up the door; and
pages that have: heard so often that none keeps STOP of another one waiting.

Each costs a descriptor of the program, of which a system may allow as few as 1024; a run needs some
for its processes and files.
"""

import asyncio
import time
from contextlib import suppress
from typing import Any

MOST_WAITING = 256  # chosen: a quarter of 1024 descriptors; asyncio accepts 100 at a time
# chosen: of 3000 connects a second, beside a busy program, every STOP came through at once; after
# 1 s a flood holds all places so long that most STOPs find none
HEARD_S = 0.1
# Messages of all pages together; chosen: of eight pages on which somebody drags and looks around.
HEARD_HZ, AT_ONCE_S = 500.0, 1.0
# What is no whole message (a ping, the answer to one, a part) is not told to who hears messages: so
# many a second, and at once; who sends more is gone. Chosen: a browser answers a ping every 20 s.
ODD_HZ, ODD_AT_ONCE = 1.0, 60
READ_BYTES = 1 << 14  # at once; chosen: of the shortest frames some 10 ms' work
WANTED_FILES = 4096  # chosen: four times the usual limit


def crowd_limit() -> tuple[type, Any]:
    """Return the connection class for one server of `websockets`, and what lets a connection pass.

    When more than `MOST_WAITING` have not passed, the oldest is dropped if it has waited longer
    than HEARD_S, else the newest: what an older one asks for may be there and not be read yet.
    HEARD_HZ messages a second are read, as many of each connection that spoke in the last
    AT_ONCE_S, and at most those of AT_ONCE_S at once; who sends more waits. ODD_HZ: above.
    """
    from websockets.asyncio.server import ServerConnection

    waiting: dict[ServerConnection, float] = {}  # since when, in the order in which they came
    speaking: dict[ServerConnection, float] = {}  # when last, in the order in which they did

    def passed(connection: ServerConnection) -> None:
        waiting.pop(connection, None)

    class CountedConnection(ServerConnection):
        """A connection that is counted until it has passed or is gone, and heard in measure."""

        _heard_to_s = 0.0  # the time up to which its messages use up what it may say
        _odd_to_s = 0.0  # likewise, of what is no whole message

        def connection_made(self, transport: Any) -> None:
            transport.max_size = READ_BYTES  # asyncio's own name of it, on Linux and macOS
            super().connection_made(transport)
            now_s = time.monotonic()
            waiting[self] = now_s
            if len(waiting) > MOST_WAITING:
                oldest = next(iter(waiting))
                dropped = oldest if now_s - waiting[oldest] > HEARD_S else self
                passed(dropped)
                dropped.transport.abort()

        def process_event(self, event: Any) -> None:
            if _is_odd(event):
                now_s = time.monotonic()
                self._odd_to_s = max(self._odd_to_s, now_s) + 1.0 / ODD_HZ
                if self._odd_to_s - now_s > ODD_AT_ONCE / ODD_HZ:
                    self.transport.abort()
                    return
            super().process_event(event)

        async def recv(self, decode: bool | None = None) -> Any:
            now_s = time.monotonic()
            speaking.pop(self, None)
            speaking[self] = now_s
            while now_s - next(iter(speaking.values())) > AT_ONCE_S:
                del speaking[next(iter(speaking))]
            self._heard_to_s = max(self._heard_to_s, now_s) + len(speaking) / HEARD_HZ
            if (ahead_s := self._heard_to_s - now_s - AT_ONCE_S) > 0.0:
                await asyncio.sleep(ahead_s)
            return await super().recv(decode)

        def connection_lost(self, exc: Exception | None) -> None:
            passed(self)
            speaking.pop(self, None)
            super().connection_lost(exc)

    return CountedConnection, passed


def _is_odd(event: Any) -> bool:
    """Whether what came is neither the handshake nor a whole message."""
    from websockets.frames import Frame, Opcode

    whole = (Opcode.TEXT, Opcode.BINARY)
    return isinstance(event, Frame) and not (event.fin and event.opcode in whole)


def allow_files() -> None:
    """Raise this program's own limit of open files to `WANTED_FILES`, where the system allows."""
    try:
        import resource
    except ImportError:  # Windows has no such limit
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = WANTED_FILES if hard == resource.RLIM_INFINITY else min(WANTED_FILES, hard)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        with suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
