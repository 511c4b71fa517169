"""How a program ends that no command ended: a signal before one begins and after it was done, and
what the system refused."""

import errno
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support import command

NAMED = ("SIGINT", "SIGTERM", "SIGHUP")
BEGIN = """
import atexit, signal, sys
number = signal.{name}
signal.signal(number, signal.default_int_handler)  # in the background some are ignored
sys.argv = ["rig", "effects", "--no-such-option"]
from experiments.cli import main
"""
IN_AN_IMPORT = """
class Signal:
    def find_spec(self, name, *_):
        if name == "typer":
            sys.meta_path.remove(self)
            signal.raise_signal(number)
sys.meta_path.insert(0, Signal())
"""
AS_IT_ENDS = """
atexit.register(lambda: signal.raise_signal(number))
"""


def told(code: str) -> tuple[int, str]:
    words = [sys.executable, "-c", code + "main()\n"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    return done.returncode, done.stderr


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("name", NAMED)
def test_in_the_imports_it_ends_the_program_with_one_line(name: str):
    begin = BEGIN.format(name=name)
    code, error = told(begin + IN_AN_IMPORT)
    assert code == 128 + getattr(signal, name)
    assert error == f"rig: ended by {name}\n"


AFTER_ITS_HANDLERS = """
class Last:
    def __del__(self, kill=__import__("os").kill, own=__import__("os").getpid()):
        kill(own, int(number))
sys.last = Last()  # goes with the modules
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("name", NAMED)
def test_as_the_program_ends_it_changes_neither_code_nor_words(name: str):
    begin = BEGIN.format(name=name)
    code, error = told(begin)
    assert code == 2
    assert told(begin + AS_IT_ENDS) == (code, error)
    assert told(begin + AFTER_ITS_HANDLERS) == (code, error)


def test_a_file_that_ends_too_early_is_no_interruption(monkeypatch):
    """The parser takes whatever says so for somebody who left."""

    def too_early(_: object) -> None:
        raise EOFError("Ran out of input")

    monkeypatch.setattr("experiments.records.recording.recover", too_early)
    code, _, error = command.told("recover", "some-run")
    words = "a file, or a process of this program, ended too early: Ran out of input"
    assert (code, error.strip()) == (1, f"rig: {words}")


def test_a_place_that_takes_no_file_is_bad_input(monkeypatch):
    def refused(_: object) -> None:
        raise OSError(errno.EROFS, "Read-only file system", "table.xml")

    monkeypatch.setattr("experiments.records.recording.recover", refused)
    assert command.told("recover", "some-run") == (2, "", "rig: table.xml: Read-only file system\n")


def test_a_full_disk_is_named_with_its_cure_whatever_the_folder_is_called(monkeypatch):
    def full(_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", "free-release/run.json")

    monkeypatch.setattr("experiments.records.recording.recover", full)
    code, _, error = command.told("recover", "some-run")
    told = "rig: free-release/run.json: No space left on device; free some space: "
    assert (code, error[: len(told)]) == (1, told)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux")
def test_a_standard_output_that_is_full_ends_with_one_line():
    """The interpreter flushed again, failed again and ended with 120."""
    words = [sys.executable, "-c", "from experiments.cli import main; main()", "effects"]
    with Path("/dev/full").open("wb") as full:
        done = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith("rig: No space left on device; free some space")
    assert done.stderr.count("\n") == 1


def test_reading_parquet_reserves_no_memory_that_a_limit_may_not_leave():
    """Of a limit of 2 GB 1 GB was taken: rig gap then ended by an abort of a library's (134)."""
    program = """
from experiments.cli import application, main

def told():
    import pyarrow
    print(pyarrow.default_memory_pool().backend_name)

application.main = told
main()
"""
    words = [sys.executable, "-c", program]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "system\n"), done.stderr


def test_a_machine_that_starts_no_thread_is_named_with_its_cure():
    no_thread = """
import sys, threading
def start(self):
    raise RuntimeError("can't start new thread")
threading.Thread.start = start
sys.argv = ["rig", "effects"]
from experiments.cli import main
"""
    code, words = told(no_thread)
    assert code == 1
    assert words.startswith("rig: no thread can be started here: ")
    assert "ulimit -u" in words
    assert words.count("\n") == 1
