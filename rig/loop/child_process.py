"""Processes that the program starts: what a terminal sends to all of them is for the program alone.

Ctrl-C and the end of a terminal reach every process of its group. The program stops the run, levels
the table and ends its processes; one that hears the signal first, in the midst of its imports, ends
with a traceback.
"""

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import parent_process, resource_tracker
from multiprocessing.process import BaseProcess

_HELD = [getattr(signal, name) for name in ("SIGINT", "SIGHUP") if hasattr(signal, name)]
_ENDING = [getattr(signal, name) for name in ("SIGTERM",) if hasattr(signal, name)]


@contextmanager
def signals_held(*, ending: bool = False) -> Iterator[None]:
    """While inside, SIGINT and SIGHUP wait, and in processes that this thread starts for ever, or
    until they `leave_ctrl_c`. (Windows cannot hold them: nothing is done.)

    ending: SIGTERM, too, for processes that are sure to `leave_ctrl_c`. A program that it leaves
    while it hands a process its work leaves that a torn message, of which it dies with a traceback.
    """
    held = _HELD + _ENDING if ending else _HELD
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, held)
    try:
        resource_tracker.ensure_running()  # as it begins, it lets SIGINT through
        signal.pthread_sigmask(signal.SIG_BLOCK, held)
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def start(process: BaseProcess) -> None:
    """Start a process that begins with `leave_ctrl_c`."""
    with signals_held(ending=True):
        process.start()


def leave_ctrl_c() -> None:
    """In a process of the program's: leave SIGINT to the program; hear SIGHUP and SIGTERM again."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _HELD + _ENDING)


def end_with_program() -> None:
    """In a process of the program's: end at once when the program has died, by SIGKILL, say; it
    would hold a camera, or compute on, for nobody.
    """
    threading.Thread(target=_outlive, daemon=True, name="end with program").start()


def _outlive() -> None:
    if (program := parent_process()) is not None:
        program.join()
        os._exit(1)
