"""Connections that have not shown the token: few at a time, so that nobody uses up the door.

Each costs a descriptor of the program, of which a system may allow as few as 1024; a run needs some
for its processes and files.
"""

from contextlib import suppress
from typing import Any

MOST_WAITING = 64  # chosen: a browser opens six at a time
WANTED_FILES = 4096  # chosen: four times the usual limit


def crowd_limit() -> tuple[type, Any]:
    """Return the connection class for one server of `websockets`, and what lets a connection pass.

    Of those that have not passed the oldest is dropped when there are more than `MOST_WAITING`.
    """
    from websockets.asyncio.server import ServerConnection

    waiting: list[ServerConnection] = []

    def passed(connection: ServerConnection) -> None:
        with suppress(ValueError):
            waiting.remove(connection)

    class CountedConnection(ServerConnection):
        """A connection that is counted until it has passed or is gone."""

        def connection_made(self, transport: Any) -> None:
            super().connection_made(transport)
            waiting.append(self)
            if len(waiting) > MOST_WAITING:
                oldest = waiting.pop(0)
                oldest.transport.abort()

        def connection_lost(self, exc: Exception | None) -> None:
            passed(self)
            super().connection_lost(exc)

    return CountedConnection, passed


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
