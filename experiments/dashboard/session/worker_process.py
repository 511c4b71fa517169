"""A worker process for long work: one task at a time, whose progress and output come back."""

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

from rig.loop.child_process import end_with_program, leave_ctrl_c, start

# Two threads of it then weigh a fifth of the loop (Linux: 1.25 a step). Chosen.
NICE_INCREMENT = 10


class ProgressSender:
    """Sends the progress of a task (stage, done, total) and intermediate results to the page.

    A `ProgressCall` of `experiments.progress`; send: puts a message (kind, what) into the pipe.
    """

    def __init__(self, send: Callable[[tuple[str, Any]], None]) -> None:
        self._send = send

    def __call__(self, stage: str, done: int, total: int) -> None:
        self._send(("progress", (stage, done, total)))

    def show(self, what: Any) -> None:
        """Send an intermediate result `what`, which must be picklable; the page gets it as
        "shown".
        """
        self._send(("shown", what))


WorkerTask = Callable[[ProgressSender], Any]  # it and its result can be pickled


@dataclass(frozen=True)
class WorkItem:
    """A task with its name, and the function that gets its messages.

    `on_message(kind, what)` is called from the worker's thread with the kinds "progress" (stage,
    done, total), "shown" (intermediate result), "line" (printed text), and at last "done" (what the
    task returned) or "failed" (a sentence); with none after other work was put instead of it.
    """

    name: str
    task: WorkerTask
    on_message: Callable[[str, Any], None]


class _Lines(io.TextIOBase):
    """Text file that sends what a task prints, line by line."""

    def __init__(self, there: Connection) -> None:
        self._there, self._part = there, ""

    def write(self, text: str) -> int:
        self._part += text
        *lines, self._part = self._part.split("\n")
        for line in lines:
            if line.strip():
                self._there.send(("line", line.strip()))
        return len(text)


def stand_back() -> None:
    """Give way to the loop, and leave Ctrl-C to the program, with which this process ends."""
    leave_ctrl_c()
    end_with_program()
    with suppress(OSError, AttributeError):
        os.nice(NICE_INCREMENT)


def _serve_tasks(there: Connection) -> None:
    """Main function of the process: task after task, since their imports take seconds."""
    stand_back()
    lines = _Lines(there)
    with suppress(BrokenPipeError, EOFError):  # the program has died: nobody wants to know
        while True:
            task: WorkerTask = there.recv()
            try:
                with redirect_stdout(lines), redirect_stderr(lines):
                    done = task(ProgressSender(there.send))
                there.send(("done", done))
            except BrokenPipeError:
                raise
            except Exception as error:
                known = isinstance(error, (ValueError, OSError))
                there.send(("failed", str(error) if known else f"{type(error).__name__}: {error}"))


class WorkerProcess:
    """Does work items in turn in one process, which starts with the first. `put` does not wait."""

    def __init__(self) -> None:
        self._waiting: deque[WorkItem] = deque()
        self._wake = threading.Condition()  # its lock may be taken twice
        self._process: Any = None
        self._pipe: Any = None
        self._killed = False  # the process, or it is about to die
        self._replaced = False  # the work that is being done: nobody waits for its messages
        self._cancelled = False  # the work that is being done
        self._now, self._closed = "", False
        self._thread = threading.Thread(target=self._serve, daemon=True, name="worker")
        self._thread.start()

    def put(self, item: WorkItem, *, instead: bool = False) -> None:
        """Enqueue work; instead: end the work of this name first, of which no more is heard.

        ValueError: work of this name waits or is being done.
        """
        with self._wake:
            if instead:
                self.cancel(item.name)
                self._replaced = self._now == item.name
            else:
                self.check_free(item.name)
            self._waiting.append(item)
            self._wake.notify_all()

    def check_free(self, name: str) -> None:
        """Raise ValueError where work of this name waits or is being done."""
        with self._wake:
            if name in (self._now, *(other.name for other in self._waiting)):
                raise ValueError(f"{name} is on already: wait, or cancel it")

    def goes_before(self, name: str) -> str:
        """Name of the work that is being done while work of this name waits; "" where none is."""
        with self._wake:
            waits = any(waiting.name == name for waiting in self._waiting)
            return self._now if waits else ""

    def cancel(self, name: str) -> bool:
        """End the work of a name, in the middle if need be.

        Returns True where it had not begun, so that no message will come of it.
        """
        with self._wake:
            waited = any(waiting.name == name for waiting in self._waiting)
            self._waiting = deque(waiting for waiting in self._waiting if waiting.name != name)
            if self._now == name:
                self._cancelled = True
                self._end_process()
            return waited

    def close(self) -> None:
        """End the process and the thread; waiting work is dropped."""
        with self._wake:
            self._closed = True
            self._waiting.clear()
            self._end_process()
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
                item = self._waiting.popleft()
                self._now, self._replaced, self._cancelled = item.name, False, False
            with suppress(Exception):  # of a receiver that failed: the next item is served
                self._do(item)

    def _do(self, item: WorkItem) -> None:
        pipe = self._worker()
        ended = False
        with suppress(EOFError, OSError):
            if pipe is not None:
                pipe.send(item.task)
            while pipe is not None and not ended:
                kind, what = pipe.recv()
                ended = kind in ("done", "failed")
                self._tell(item, kind, what, last=ended)
        if not ended:
            with self._wake:
                self._end_process()
            self._tell(item, "failed", "ended before it was done", last=True)

    def _end_process(self) -> None:
        if self._process is not None:
            self._process.kill()  # whatever a lab's own code does with signals
            self._killed = True

    def _tell(self, item: WorkItem, kind: str, what: Any, *, last: bool) -> None:
        """Tell who waits for it; who hears the last message can put work of the same name."""
        with self._wake:
            heard = not self._replaced
            if last:
                self._now = ""
        if heard:
            item.on_message(kind, what)

    def _worker(self) -> Connection | None:
        """The pipe to the process, started where there is none; None: its work was cancelled."""
        with self._wake:
            if self._cancelled or self._closed:
                return None
            if self._killed:
                self._process.join(5.0)
                self._pipe.close()
                self._process, self._killed = None, False
            if self._process is None:
                context = multiprocessing.get_context("spawn")
                self._pipe, there = context.Pipe()
                self._process = context.Process(target=_serve_tasks, args=(there,), daemon=True)
                start(self._process)
                there.close()
            return self._pipe
