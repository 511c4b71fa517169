"""Work with a lab's own code in a copy of this process, which it may hang, leave or crash."""

import ctypes
import io
import os
import pickle
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from math import inf
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any, NoReturn, Protocol, TextIO, TypeVar

from rig.foreign_call import ENDING, in_words

T = TypeVar("T")
Begins = Callable[[str, float | None], None]  # what begins, and how long it may take [s]

START_S = 30.0  # until a copy of this process does anything; chosen: a busy machine's seconds
OBEYS_S = 5.0  # after a signal; chosen: a person waits no longer, a recording is finished in less
LOOKS_S = 0.1  # so often it is looked whether a copy that got a signal obeys it
DRAINS_S = 1.0  # until all is heard of a copy that was killed
OURS = ("builtins", "vision", "rig", "calibration", "experiments")  # whose errors can be read
# Linux: with this number the kernel ends the calling process when the one that made it dies.
_PR_SET_PDEATHSIG = 1
_PRCTL = getattr(ctypes.CDLL(None), "prctl", None) if sys.platform.startswith("linux") else None


class LeftError(Exception):
    """The work did not end as it should: it hung, left the program or crashed; number: of the first
    signal that was passed on to it, 0: none was.
    """

    number = 0


def _raised(error: LeftError) -> NoReturn:
    raise error


class Tells(Protocol):
    """How the work tells the program: what begins in it, and whatever else is to be heard."""

    def begins(self, what: str, patience_s: float | None) -> None:
        """Tell what begins, and how long it may take [s]; None: as long as it likes."""
        ...

    def say(self, told: Any) -> None:
        """Tell something, which can be pickled."""
        ...


class _Line:
    """The copy's end of the line to the program."""

    def __init__(self, there: Connection) -> None:
        self._there = there

    def begins(self, what: str, patience_s: float | None) -> None:
        self._there.send(("begins", what, patience_s))

    def say(self, told: Any) -> None:
        self._there.send(("said", told))


class Here:
    """Where no copy can be made: nothing is bounded, all is heard at once."""

    def __init__(self, heard: Callable[[Any], None]) -> None:
        self._heard = heard

    def begins(self, what: str, patience_s: float | None) -> None:
        pass

    def say(self, told: Any) -> None:
        self._heard(told)


def in_copy(
    work: Callable[[Tells], T],
    *,
    heard: Callable[[Any], None] = lambda told: None,
    output: Callable[[], TextIO] = io.StringIO,
    passes_on: bool = False,
    left: Callable[[LeftError], T] = _raised,
) -> T:
    """Return `work(tells)` of a copy of this process, and forget what it changed.

    heard: called with what the work says; output: made in the copy, of what is printed there;
    passes_on: signals that end the program go to the copy, which tells how it ended; a copy that
    goes on after a second one, or OBEYS_S after the first, is killed. Processes that the copy
    leaves behind are ended with it; on Linux the copy ends with the program, whatever ends that. It
    has a group of its own, to which no keyboard speaks: it reads an end of input there.

    left: returns the result where a part hung, left the program or crashed, even in compiled code,
    or was killed (default: raise that LeftError); signals still wait for it. Else what the work
    raised is raised here. Where the system copies no process (Windows) the work is done in this
    one, unguarded.
    """
    if not hasattr(os, "fork"):
        return work(Here(heard))
    program, (here, there) = os.getpid(), Pipe(duplex=False)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of threads: the copy uses none
        pid = _fork()
    if pid == 0:
        _copy(program, there, work, output)
    there.close()
    with suppress(OSError):
        os.setpgid(pid, pid)  # as the copy does: whoever is first
    copy = _Copy(pid, here)
    with _passing_on(copy) if passes_on else nullcontext():
        try:
            return _answer(copy, heard)
        except LeftError as error:
            copy.end()
            error.number = copy.signal
            return left(error)
        finally:
            copy.end()


def _fork() -> int:
    """`os.fork`, with OpenCV's threads ended before: a copy has none of them, and would wait for
    them for ever. It does with one, this process has as many as before."""
    cv2 = sys.modules.get("cv2")
    if cv2 is None:
        return os.fork()
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    pid = -1
    try:
        pid = os.fork()
    finally:
        if pid:
            cv2.setNumThreads(threads)
    return pid


def standard_error() -> TextIO:
    """Standard error anew (the program's own may be a progress bar's, with a lock), and for what is
    written to standard output as well: `output` of a copy whose prints are to be seen."""
    with suppress(OSError):
        os.dup2(2, 1)
    return open(2, "w", buffering=1, errors="backslashreplace", closefd=False)


class _Copy:
    """The copy as the program sees it; signal: the first that was passed on to it, 0: none."""

    def __init__(self, pid: int, here: Connection) -> None:
        self._pid, self._here = pid, here
        self.signal, self._until_s = 0, inf
        self._killed = self._ended = False

    def pass_on(self, number: int, _: object) -> None:
        """Pass a signal on; the second one kills the copy."""
        if self._ended:
            return
        if self.signal:
            self._kill()
        else:
            self.signal, self._until_s = number, time.monotonic() + OBEYS_S
            with suppress(ProcessLookupError):
                os.kill(self._pid, number)

    def _kill(self) -> None:
        self._killed, self._until_s = True, time.monotonic() + DRAINS_S
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self._pid, signal.SIGKILL)

    def end(self) -> None:
        """End what is left of the copy."""
        if self._ended:
            return
        self._ended = True
        self._here.close()
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self._pid, signal.SIGKILL)
        with suppress(ChildProcessError):  # its ending was asked for
            os.waitpid(self._pid, 0)

    def next(self, what: str, patience_s: float | None) -> Any:
        """What the copy tells next, within patience_s [s]. LeftError: it is over in `what`."""
        silent_s = time.monotonic() + (inf if patience_s is None else patience_s)
        forced = LeftError(f"{what} went on and was ended by force")
        while True:
            if time.monotonic() > self._until_s:
                if self._killed:  # somebody it left behind holds the line
                    raise forced
                self._kill()
            if self._here.poll(LOOKS_S):
                break
            if time.monotonic() > silent_s:
                raise LeftError(f"{what} did not return within {patience_s:g} s")
        try:
            return self._here.recv()
        except (EOFError, OSError):  # OSError: in the midst of a word
            raise forced if self._killed else LeftError(f"{what} {_ending(self._pid)}") from None


def _answer(copy: _Copy, heard: Callable[[Any], None]) -> Any:
    what, patience_s = "it", START_S
    while True:
        kind, *told = copy.next(what, patience_s)
        if kind == "raised":
            raise told[0]
        if kind == "good":
            return told[0]
        if kind == "said":
            heard(told[0])
        else:
            what, patience_s = told


@contextmanager
def _passing_on(copy: _Copy) -> Iterator[None]:
    """While inside, signals that end a program go to the copy, which has a group of its own."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    known = [one for one in ENDING if signal.getsignal(one) != signal.SIG_IGN]
    before = {one: signal.signal(one, copy.pass_on) for one in known}
    try:
        yield
    finally:
        for one, handler in before.items():
            signal.signal(one, signal.SIG_DFL if handler is None else handler)


def _copy(
    program: int, there: Connection, work: Callable[[Tells], Any], output: Callable[[], TextIO]
) -> NoReturn:
    """Do the work in the copy, and tell how it went; program: the number of its process."""
    try:
        if _PRCTL is not None:
            _PRCTL(_PR_SET_PDEATHSIG, ctypes.c_ulong(signal.SIGKILL))
        if os.getppid() != program:
            os._exit(0)
        with suppress(OSError):
            os.setpgid(0, 0)
            os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        sys.stdout = sys.stderr = output()
        there.send(("good", work(_Line(there))))
    except BaseException as error:
        with suppress(OSError):  # the program may be gone
            there.send(("raised", _sendable(error)))
    finally:
        with suppress(Exception):
            sys.stderr.flush()
        os._exit(0)


def _sendable(error: BaseException) -> BaseException:
    """The error, or a RuntimeError of its words where the program could not read it: it is of a
    class of a lab's own, or of a library's."""
    try:
        sent = pickle.loads(pickle.dumps(error))
        if type(sent).__module__.split(".")[0] in OURS:
            return sent
    except Exception:
        pass
    return RuntimeError(in_words(error))


def on_trial(work: Callable[[Begins], None]) -> None:
    """Do `work(begins)` silently in a copy of this process; it calls `begins(what, patience_s)`
    before each of its parts, the first one at once. ValueError: what it raised there, or how a part
    left it (`in_copy`).
    """

    def tried(tells: Tells) -> None:
        try:
            work(tells.begins)
        except ValueError:
            raise
        except BaseException as error:  # even Ctrl-C, if the lab's code raised it
            raise ValueError(in_words(error)) from None

    try:
        in_copy(tried)
    except LeftError as error:
        raise ValueError(str(error)) from None


def _ending(pid: int) -> str:
    """How a process ended that said nothing more, in words."""
    code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    if code < 0:
        return f"crashed the program (signal {-code})"
    return f"left the program (exit code {code})"
