"""A bounded call: what is too long or too much is raised inside it, and nothing is left behind."""

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from rig import foreign_call
from rig.foreign_call import FeignedInterruptError, ForeignCall, OvertimeError, frames_of, in_words

POSIX = pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="timers of POSIX")


def spin() -> None:
    while True:
        with contextlib.suppress(Exception):
            time.sleep(0.01)


@POSIX
@pytest.mark.parametrize("work", [lambda: time.sleep(9), spin])
def test_what_does_not_return_is_ended_in_time(work):
    call, begin = ForeignCall(0.1), time.monotonic()
    with pytest.raises(OvertimeError, match="did not return within 0.1 s"), call:  # noqa: RUF043
        work()
    assert time.monotonic() - begin < 1.0
    with call:  # again, in time
        pass
    time.sleep(0.15)


@POSIX
def test_a_timer_that_was_set_before_goes_on():
    came: list[int] = []
    before = signal.signal(signal.SIGALRM, lambda *_: came.append(1))
    timer = signal.setitimer(signal.ITIMER_REAL, 0.2)
    try:
        with ForeignCall(5.0):
            time.sleep(0.1)
        assert not came
        time.sleep(0.3)
        assert came == [1]
    finally:
        signal.signal(signal.SIGALRM, before)
        signal.setitimer(signal.ITIMER_REAL, *timer)


@pytest.mark.parametrize("number", foreign_call.ENDING)
def test_signals_that_end_the_program_do_so_still(number):
    came: list[int] = []
    before = signal.signal(number, lambda *_: came.append(number))
    try:
        with ForeignCall(5.0):
            signal.signal(number, signal.SIG_IGN)
        signal.raise_signal(number)
        assert came == [number]
    finally:
        signal.signal(number, before)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="RLIMIT_DATA of Linux")
def test_memory_is_bounded_in_the_call_alone(monkeypatch):
    monkeypatch.setattr(foreign_call, "MEMORY_SHARE", 1e-9)
    call = ForeignCall(5.0)
    with pytest.raises(MemoryError), call:
        bytearray(1 << 28)
    assert len(bytearray(1 << 28)) == 1 << 28


def test_what_is_printed_goes_to_standard_error(capsys):
    with ForeignCall(5.0):
        print("a lab's words")
    print("the program's")
    told = capsys.readouterr()
    assert (told.out, told.err) == ("the program's\n", "a lab's words\n")


def test_relative_paths_mean_what_they_did_before(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "elsewhere").mkdir()
    with ForeignCall(5.0):
        os.chdir("elsewhere")
    assert Path.cwd() == tmp_path


@pytest.mark.skipif(not hasattr(os, "fork"), reason="fork of POSIX")
def test_a_process_that_it_forked_does_not_go_on_as_a_second_rig(tmp_path):
    with ForeignCall(5.0):
        child = os.fork()
    with (tmp_path / "rows").open("a") as rows:  # what follows the call
        rows.write("row\n")
    if child == 0:
        os._exit(0)
    os.waitpid(child, 0)
    assert (tmp_path / "rows").read_text() == "row\n"


def test_a_thread_that_it_left_does_not_keep_the_program_from_its_end():
    with ForeignCall(5.0):
        left = threading.Thread(target=print)
    assert left.daemon
    assert not threading.Thread(target=print).daemon


class EndlessError(Exception):
    def __str__(self) -> str:
        while True:
            pass


@POSIX
def test_words_that_do_not_come_are_not_waited_for():
    begin = time.monotonic()
    assert in_words(EndlessError(), 0.1) == "EndlessError, whose words cannot be read"
    assert time.monotonic() - begin < 5.0


def test_an_interrupt_that_nobody_asked_for_is_an_error():
    call = ForeignCall(5.0)
    with pytest.raises(FeignedInterruptError), call:
        raise KeyboardInterrupt
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt), call:
            signal.raise_signal(signal.SIGINT)
        with pytest.raises(FeignedInterruptError), call:  # another call, another interrupt
            raise KeyboardInterrupt
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)


def lowered(name: str, *, hard: bool) -> tuple[tuple[int, int], tuple[int, int]]:
    """A limit before and after a call that lowers it to 64."""
    resource = pytest.importorskip("resource")
    limit = getattr(resource, name)
    before = resource.getrlimit(limit)
    with ForeignCall(5.0):
        resource.setrlimit(limit, (64, 64 if hard else before[1]))
    return before, resource.getrlimit(limit)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="RLIMIT_DATA of Linux")
@pytest.mark.parametrize("name", ["RLIMIT_AS", "RLIMIT_DATA"])
def test_who_takes_all_that_a_limit_leaves_takes_none_of_what_the_recording_needs(name: str):
    """As under `ulimit -v`: an error of ours that found no memory left was told as an exit."""
    text = f"""
import re, resource
from pathlib import Path
from rig.foreign_call import ForeignCall

kept, status = [], Path("/proc/self/status").read_text()
used = max(int(re.search(rf"{{one}}:\\s+(\\d+)", status)[1]) for one in ("VmSize", "VmData"))
resource.setrlimit(resource.{name}, (used * 1024 + (400 << 20), resource.RLIM_INFINITY))
with ForeignCall(30.0):
    try:
        while True:
            kept.append(bytearray(1 << 20))
    except MemoryError:
        pass
assert 100 < len(kept) < 600, len(kept)
bytearray(100 << 20)
"""
    subprocess.run([sys.executable, "-c", text], check=True, timeout=60)


@pytest.mark.parametrize("name", ["RLIMIT_NOFILE", "RLIMIT_FSIZE", "RLIMIT_AS"])
def test_limits_on_files_are_those_of_before(name: str):
    before, after = lowered(name, hard=False)
    assert after == before


@pytest.mark.skipif(not hasattr(os, "fork"), reason="fork of POSIX")
def test_a_limit_that_only_the_superuser_raises_again_is_no_fault():
    child = os.fork()
    if child == 0:
        with contextlib.suppress(BaseException):
            if os.getuid() == 0:
                os.setuid(65534)
            _, after = lowered("RLIMIT_NOFILE", hard=True)
            os._exit(0 if after == (64, 64) else 2)
        os._exit(1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


class _Nameless(type):
    @property
    def __name__(cls) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        raise RuntimeError("no name")


class NoNameError(Exception, metaclass=_Nameless):
    pass


class OddTraceError(Exception):
    __traceback__ = 7  # pyright: ignore[reportAssignmentType, reportIncompatibleVariableOverride]


def test_an_error_that_tells_neither_its_name_nor_where_it_came_by_is_told_all_the_same():
    assert in_words(NoNameError("x")) == "an error of no name, whose words cannot be read"
    assert frames_of(OddTraceError()) == []
    with pytest.raises(ValueError, match="here") as caught:
        raise ValueError("here")
    assert frames_of(caught.value)[-1].name.startswith("test_an_error_that_tells")
