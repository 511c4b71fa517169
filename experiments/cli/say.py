"""A line on standard output that may hold text of files, recordings and their names."""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from io import TextIOBase
from queue import Full, Queue
from threading import Lock, Thread
from typing import TextIO

import typer

WAITING = 1000  # lines; chosen: more than a run says
LAST_S = 1.0  # that the last lines are given
LONGEST = 2000  # characters of a line of a library's; chosen: whole paths, no flood


def say(text: object, file: TextIO | None = None) -> None:
    """Print lines; control characters in them, which could steer the terminal, as "?"."""
    typer.echo("".join(c if c.isprintable() or c == "\n" else "?" for c in str(text)), file=file)


@contextmanager
def saying_aside(output: TextIO | None = None) -> Iterator[Callable[[object], None]]:
    """A `say` that neither waits nor fails, for who has a table to look after; output: of the
    system's, None: standard output.

    A paused terminal, a pipe that nobody reads or a full disk takes no line; what waits beyond
    WAITING lines then is left out.
    """
    lines: Queue[object] = Queue(WAITING)
    into = sys.stdout if output is None else output
    file = _own_file(into)

    def work() -> None:
        while (line := lines.get()) is not None:
            with suppress(OSError):
                say(line, file)
        if file is not into:
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


def _own_file(output: TextIO) -> TextIO:
    """An output as a file of its own, which a program that ends need not wait for."""
    try:
        return os.fdopen(os.dup(output.fileno()), "w", encoding=output.encoding)
    except (OSError, AttributeError):  # it is no file of the system's, or closed
        return output


@contextmanager
def output_aside() -> Iterator[Callable[[object], None]]:
    """While inside, what this process writes to standard output and standard error (warnings,
    tracebacks, lines of libraries) is said aside: whoever writes there, a thread that hears STOP
    too, never waits. Yields the `say` of `saying_aside` for what the program itself has to say.
    """
    with (
        saying_aside() as aside,
        saying_aside(sys.stderr) as errors,
        redirect_stdout(_Lines(aside)),
        redirect_stderr(_Lines(errors)),
    ):
        yield aside


class _Lines(TextIOBase):
    """Gives whole lines away."""

    def __init__(self, aside: Callable[[object], None]) -> None:
        self._aside, self._rest, self._lock = aside, "", Lock()

    def writable(self) -> bool:
        return True

    def write(self, text: str) -> int:
        with self._lock:
            *lines, self._rest = (self._rest + text).split("\n")
            self._rest = self._rest[-LONGEST:]
        for line in lines:
            self._aside(line[:LONGEST])
        return len(text)
