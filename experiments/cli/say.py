"""A line on standard output that may hold text of files, recordings and their names."""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from queue import Full, Queue
from threading import Thread
from typing import TextIO

import typer

WAITING = 1000  # lines; chosen: more than a run says
LAST_S = 1.0  # that the last lines are given


def say(text: object, file: TextIO | None = None) -> None:
    """Print lines; control characters in them, which could steer the terminal, as "?"."""
    typer.echo("".join(c if c.isprintable() or c == "\n" else "?" for c in str(text)), file=file)


@contextmanager
def saying_aside() -> Iterator[Callable[[object], None]]:
    """A `say` that neither waits nor fails, for who has a table to look after.

    A paused terminal, a pipe that nobody reads or a full disk takes no line; what waits beyond
    WAITING lines then is left out.
    """
    lines: Queue[object] = Queue(WAITING)
    file = _own_output()

    def work() -> None:
        while (line := lines.get()) is not None:
            with suppress(OSError):
                say(line, file)
        if file is not sys.stdout:
            with suppress(OSError):
                file.close()

    def put(text: object) -> None:
        with suppress(Full):
            lines.put_nowait(text)

    thread = Thread(target=work, daemon=True, name="say")
    thread.start()
    try:
        yield put
    finally:
        put(None)
        thread.join(LAST_S)


def _own_output() -> TextIO:
    """Standard output as a file of its own, which a program that ends need not wait for."""
    try:
        return os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding=sys.stdout.encoding)
    except (OSError, AttributeError):  # it is no file of the system's, or closed
        return sys.stdout
