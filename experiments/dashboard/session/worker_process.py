"""Long work in a process of its own, one piece at a time; its words come back as they are said."""

import io
import multiprocessing
import os
import threading
from collections import deque
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

NICE = 5  # the loop comes first


class Tell:
    """What a task tells while it works: progress (stage, done, total), and what is to be shown."""

    def __init__(self, send: Callable[[tuple[str, Any]], None]) -> None:
        self._send = send

    def __call__(self, stage: str, done: int, total: int) -> None:
        self._send(("progress", (stage, done, total)))

    def show(self, what: Any) -> None:
        """Something picklable for whoever hears."""
        self._send(("shown", what))


Task = Callable[[Tell], Any]  # picklable; what it returns is, too


@dataclass(frozen=True)
class Piece:
    """A piece of work and who hears of it: heard(kind, what) with the kinds "progress" (stage,
    done, total), "shown" (what), "line" (text), "done" (what the task returned) and "failed" (a
    sentence)."""

    name: str
    task: Task
    heard: Callable[[str, Any], None]


class _Lines(io.TextIOBase):
    """What the work prints, line by line."""

    def __init__(self, there: Connection) -> None:
        self._there, self._part = there, ""

    def write(self, text: str) -> int:
        self._part += text
        *lines, self._part = self._part.split("\n")
        for line in lines:
            if line.strip():
                self._there.send(("line", line.strip()))
        return len(text)


def _work(there: Connection) -> None:
    """The work's process: one task after the other, as what they import takes seconds."""
    with suppress(OSError, AttributeError):
        os.nice(NICE)
    lines = _Lines(there)
    with suppress(BrokenPipeError, EOFError):  # the program has died: nobody wants to know
        while True:
            task: Task = there.recv()
            try:
                with redirect_stdout(lines), redirect_stderr(lines):
                    done = task(Tell(there.send))
                there.send(("done", done))
            except BrokenPipeError:
                raise
            except Exception as error:
                known = isinstance(error, (ValueError, OSError))
                there.send(("failed", str(error) if known else f"{type(error).__name__}: {error}"))


class Desk:
    """Pieces of work in turn. `put` returns at once; `cancel` ends the present piece."""

    def __init__(self) -> None:
        self._waiting: deque[Piece] = deque()
        self._wake = threading.Condition()  # its lock may be taken twice
        self._process: Any = None
        self._pipe: Any = None
        self._killed = False  # the process, or it is about to die
        self._now, self._closed = "", False
        self._thread = threading.Thread(target=self._serve, daemon=True, name="desk")
        self._thread.start()

    def put(self, piece: Piece, *, instead: bool = False) -> None:
        """ValueError: a piece of this name waits or is being done; `instead` of it, it is ended."""
        with self._wake:
            if instead:
                self.cancel(piece.name)
            elif self._now == piece.name or any(one.name == piece.name for one in self._waiting):
                raise ValueError(f"{piece.name} is on already: wait, or cancel it")
            self._waiting.append(piece)
            self._wake.notify_all()

    def cancel(self, name: str) -> bool:
        """End a piece of work by its name, wherever it is. True: it had not begun, so that nobody
        will hear of it."""
        with self._wake:
            waited = any(one.name == name for one in self._waiting)
            self._waiting = deque(one for one in self._waiting if one.name != name)
            if self._now == name and self._process is not None:
                self._process.terminate()
                self._killed = True
            return waited

    def close(self) -> None:
        with self._wake:
            self._closed = True
            self._waiting.clear()
            if self._process is not None:
                self._process.terminate()
            self._wake.notify_all()
        self._thread.join(5.0)

    def _serve(self) -> None:
        while True:
            with self._wake:
                self._now = ""
                while not self._waiting and not self._closed:
                    self._wake.wait()
                if self._closed:
                    return
                piece = self._waiting.popleft()
                self._now = piece.name
            with suppress(Exception):  # who hears is asked to put, never to fail
                self._do(piece)

    def _do(self, piece: Piece) -> None:
        pipe = self._worker()
        ended = False
        with suppress(EOFError, OSError):
            pipe.send(piece.task)
            while not ended:
                kind, what = pipe.recv()
                ended = kind in ("done", "failed")
                piece.heard(kind, what)
        if not ended:
            self._killed = True
            piece.heard("failed", "ended before it was done")

    def _worker(self) -> Connection:
        """The pipe to the work's process, started where there is none."""
        with self._wake:
            if self._killed:
                self._process.join(5.0)
                self._pipe.close()
                self._process, self._killed = None, False
            if self._process is None:
                context = multiprocessing.get_context("spawn")
                self._pipe, there = context.Pipe()
                self._process = context.Process(target=_work, args=(there,), daemon=True)
                self._process.start()
                there.close()
            return self._pipe
