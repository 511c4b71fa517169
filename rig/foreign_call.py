"""A call of a lab's own code: bounded in time and memory, and its prints go to standard error."""

import contextlib
import os
import re
import signal
import sys
import threading
import time
import traceback
from pathlib import Path
from types import TracebackType
from typing import Any

try:
    import resource
except ImportError:  # Windows
    resource = None

_NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
ENDING = tuple(getattr(signal, name) for name in _NAMES if hasattr(signal, name))
LONGEST_WORDS = 500  # characters; chosen: a sentence with a path, no dump of an array
WORDS_S = 1.0  # chosen: an error's words are made in microseconds
_LIMITED = ("RLIMIT_AS", "RLIMIT_DATA", "RLIMIT_NOFILE", "RLIMIT_FSIZE")  # what a recording needs
LIMITED = tuple(getattr(resource, name) for name in _LIMITED if hasattr(resource, name))
MEMORY_SHARE = 0.5  # of what is free when the run begins; chosen: the rest is the recording's


def in_words(error: BaseException, seconds: float = WORDS_S) -> str:
    """Kind and words of an error that code of a lab's own raised, which may have no words, more
    than are read, or words that do not come within `seconds`.
    """
    kind = "an error of no name"
    try:
        with ForeignCall(seconds):
            kind = str(type(error).__name__)[:LONGEST_WORDS]
            return f"{kind}: {error}"[:LONGEST_WORDS]
    except BaseException:
        return f"{kind}, whose words cannot be read"


def frames_of(error: BaseException) -> list[traceback.FrameSummary]:
    """Where an error came by, the innermost last; [] where it does not tell: its class may say
    anything in place of that."""
    try:
        return traceback.extract_tb(error.__traceback__)
    except BaseException:
        return []


class OvertimeError(BaseException):
    """Raised inside a call that takes too long; no `except Exception` in it helps."""


class FeignedInterruptError(Exception):
    """What a call raises in place of a KeyboardInterrupt that no SIGINT caused."""


class ForeignCall:
    """Context of a call that may take `seconds` and `MEMORY_SHARE` of free memory.

    OvertimeError: it took longer; MemoryError: it asked for more. Both are raised in the called
    code itself. The time is bounded in a main thread on Linux and macOS, the memory on Linux. A
    KeyboardInterrupt that leaves it is the operator's, else it becomes a FeignedInterruptError.

    Afterwards relative paths mean what they did before, new files have the former rights, signals
    that end the program do so still, and limits on memory and files are the former ones, as far as
    the system allows. A process that the code has forked ends where it would go on as a second rig,
    with the same recording and the same table. Threads that it starts do not keep the program from
    its end, unless they ask for it (`daemon=False`).
    """

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds
        self._in_main = threading.current_thread() is threading.main_thread()
        self._bounds_time = self._in_main and hasattr(signal, "setitimer")
        self._data_bytes, self._limits = _most_data_bytes(), _limits()

    def _alarm(self, *_: object) -> None:
        raise OvertimeError(f"did not return within {self.seconds:g} s")

    def _interrupt(self, number: int, frame: Any) -> None:
        self._interrupted = True
        self._on_interrupt(number, frame)

    def __enter__(self) -> None:
        self._process, self._folder = os.getpid(), _working_folder()
        self._umask = os.umask(0o077)  # the system tells it in no other way
        os.umask(self._umask)
        self._stdout, sys.stdout = sys.stdout, sys.stderr
        self._thread: Any = threading.current_thread()  # new threads take after it
        self._daemonic, self._thread._daemonic = self._thread.daemon, True
        self._endings = [(one, signal.getsignal(one)) for one in ENDING] if self._in_main else []
        self._interrupted = False
        self._on_interrupt: Any = signal.getsignal(signal.SIGINT)
        if self._in_main and callable(self._on_interrupt):
            signal.signal(signal.SIGINT, self._interrupt)
        if resource is not None and self._data_bytes:
            hard = resource.getrlimit(resource.RLIMIT_DATA)[1]
            resource.setrlimit(resource.RLIMIT_DATA, (self._data_bytes, hard))
        if self._bounds_time:
            self._began_s, self._handler = (
                time.monotonic(),
                signal.signal(signal.SIGALRM, self._alarm),
            )
            self._timer = signal.setitimer(signal.ITIMER_REAL, self.seconds)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if os.getpid() != self._process:
            os._exit(1)
        self._thread._daemonic = self._daemonic
        for one, handler in self._endings:
            if signal.getsignal(one) is not handler and handler is not None:
                signal.signal(one, handler)
        if self._bounds_time:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, self._handler)
            left_s, again_s = self._timer  # of whoever had set it before
            if left_s:
                passed_s = time.monotonic() - self._began_s
                signal.setitimer(signal.ITIMER_REAL, max(left_s - passed_s, 1e-3), again_s)
        _give_back(self._limits)
        os.umask(self._umask)
        sys.stdout = self._stdout
        if self._folder and self._folder != _working_folder():
            os.chdir(self._folder)
        if isinstance(error, KeyboardInterrupt) and not self._interrupted:
            feigned = FeignedInterruptError("KeyboardInterrupt, which nobody asked for")
            raise feigned.with_traceback(trace) from error


def _limits() -> dict[int, tuple[int, int]]:
    """The process's limits, soft and hard, on what a recording needs."""
    return {} if resource is None else {one: resource.getrlimit(one) for one in LIMITED}


def _give_back(limits: dict[int, tuple[int, int]]) -> None:
    """Set limits as they were, or as near to it as a hard one allows that was lowered."""
    if resource is None:
        return
    for one, (soft, hard) in limits.items():
        try:
            resource.setrlimit(one, (soft, hard))
        except (ValueError, OSError):
            most = resource.getrlimit(one)[1]
            within = most if soft == resource.RLIM_INFINITY else min(soft, most)
            with contextlib.suppress(ValueError, OSError):
                resource.setrlimit(one, (within, most))


def _working_folder() -> str:
    """The working folder's path; "" where it was removed."""
    try:
        return os.getcwd()  # noqa: PTH109  (at every tick: `Path.cwd` takes 10 us more)
    except FileNotFoundError:
        return ""


def _most_data_bytes() -> int:
    """Bytes of data that this process may have; 0 where the system does not tell."""
    free = [_number("/proc/meminfo", r"MemAvailable:\s+(\d+) kB") * 1024]
    group = "/sys/fs/cgroup/memory."
    most = _number(f"{group}max", r"(\d+)")
    if most:
        free.append(most - _number(f"{group}current", r"(\d+)"))
    used, whole = (
        _number("/proc/self/status", rf"{name}:\s+(\d+) kB") * 1024 for name in ("VmData", "VmSize")
    )
    if resource is None or not (used and free[0]):
        return 0
    for limit, taken in ((resource.RLIMIT_DATA, used), (resource.RLIMIT_AS, whole)):
        most = resource.getrlimit(limit)[0]
        if most != resource.RLIM_INFINITY:
            free.append(most - taken)
    return used + int(MEMORY_SHARE * max(min(free), 0))


def _number(path: str, pattern: str) -> int:
    with contextlib.suppress(OSError):
        found = re.search(pattern, Path(path).read_text())
        return int(found[1]) if found else 0
    return 0
