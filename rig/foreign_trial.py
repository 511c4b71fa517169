"""A trial of a lab's own code in a copy of this process, which it may hang, leave or crash."""

import io
import os
import signal
import sys
import warnings
from collections.abc import Callable
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import NoReturn

from rig.foreign_call import in_words

Begins = Callable[[str, float], None]  # what begins, in words, and how long it may take [s]

START_S = 30.0  # until a copy of this process does anything; chosen: a busy machine's seconds


def on_trial(work: Callable[[Begins], None]) -> None:
    """Do `work(begins)` in a copy of this process and forget what it changed; it calls
    `begins(what, patience_s)` before each of its parts, the first one at once.

    ValueError: what it raised there; or a part hung, left the program or crashed, even in compiled
    code. Where the system copies no process (Windows) the work is done in this one, unguarded.
    """
    if not hasattr(os, "fork"):
        work(lambda what, patience_s: None)
        return
    here, there = Pipe(duplex=False)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of threads: the copy uses none
        pid = os.fork()
    if pid == 0:
        _copy(there, work)
    there.close()
    what, patience_s = "it", START_S
    try:
        while True:
            if not here.poll(patience_s):
                raise ValueError(f"{what} did not return within {patience_s:g} s")
            kind, *told = here.recv()
            if kind == "wrong":
                raise ValueError(told[0])
            if kind == "good":
                return
            what, patience_s = told
    except EOFError:
        raise ValueError(f"{what} {_ending(pid)}") from None
    finally:
        here.close()
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
        with suppress(ChildProcessError):  # its ending was asked for
            os.waitpid(pid, 0)


def _copy(there: Connection, work: Callable[[Begins], None]) -> NoReturn:
    """Do the work in the copy, silently, and tell how it went."""
    try:
        sys.stdout = sys.stderr = io.StringIO()  # what it prints, it prints when it is used
        work(lambda *part: there.send(("begins", *part)))
        there.send(("good",))
    except ValueError as error:
        there.send(("wrong", str(error)))
    except BaseException as error:
        there.send(("wrong", in_words(error)))
    finally:
        os._exit(0)


def _ending(pid: int) -> str:
    """How a process ended that said nothing more, in words."""
    code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    if code < 0:
        return f"crashed the program (signal {-code})"
    return f"left the program (exit code {code})"
