"""A signal that compiled code keeps from Python ends the program all the same."""

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress

import pytest

from rig.loop import unheard

# A call that lets go of the interpreter's lock and does not come back, as a compiled equation that
# hangs; before it a signal that is heard, and one of a handler that is not the program's own.
PROGRAM = """
import hashlib, os, signal, sys
from rig.loop import unheard
from rig.loop.signals import leave_on_signals, stop_on_signals
from rig.loop.commands import CommandSlot

unheard.UNHEARD_S = 1.0
with leave_on_signals(lambda line: print(line, file=sys.stderr)):
    with stop_on_signals(CommandSlot(), leave=False):
        signal.raise_signal(signal.SIGTERM)
    signal.signal(signal.SIGHUP, lambda *_: os.write(1, b"other\\n"))
    signal.raise_signal(signal.SIGHUP)
    print("begun", flush=True)
    hashlib.pbkdf2_hmac("sha256", b"", b"", 10**10 // 10)
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_that_is_never_heard_ends_the_program_with_its_code(number: int):
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    ) as program:
        assert program.stdout
        assert program.stderr
        assert program.stdout.readline() == "other\n"
        assert program.stdout.readline() == "begun\n"
        program.send_signal(signal.SIGHUP)  # of the other handler: it is left alone
        with suppress(subprocess.TimeoutExpired):
            pytest.fail(f"ended with {program.wait(2.0)}: {program.stderr.read()}")
        program.send_signal(number)
        assert program.wait(30.0) == 128 + number
        (line,) = program.stderr.read().splitlines()
    assert line.startswith(f"ended by {signal.Signals(number).name}, which compiled code did not")


@pytest.mark.usefixtures("heeded")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_run_is_stopped_at_once_while_the_main_thread_stands_still(number: int):
    """As in a write to a disk that hangs: the loop would go on for UNHEARD_S."""
    text = """
import hashlib, os
from rig.loop.signals import leave_on_signals, stop_on_signals

class Slot:
    def put(self, stop):
        os.write(1, f"{stop.outcome}: {stop.reason}\\n".encode())

with leave_on_signals(print), stop_on_signals(Slot(), also=("SIGINT",)):
    print("begun", flush=True)
    hashlib.pbkdf2_hmac("sha256", b"", b"", 10**10 // 10)
"""
    with subprocess.Popen(
        [sys.executable, "-c", text], stdout=subprocess.PIPE, text=True
    ) as program:
        assert program.stdout
        assert program.stdout.readline() == "begun\n"
        begun_s = time.monotonic()
        program.send_signal(number)
        said = program.stdout.readline()
        took_s = time.monotonic() - begun_s
        program.kill()
    who = {signal.SIGTERM: "SIGTERM from the system", signal.SIGINT: "by the operator"}
    assert said == f"interrupted: {who[signal.Signals(number)]}\n"
    assert took_s < 0.5 * unheard.UNHEARD_S


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no copy of the program there")
def test_a_signal_that_ends_a_copy_is_not_the_programs():
    """As of a lab's own process, `multiprocessing`'s, that is terminated in the midst of a run."""
    text = """
import os, signal, time
from rig.loop.signals import leave_on_signals, stop_on_signals

class Slot:
    def put(self, stop):
        os.write(1, b"stopped")

with leave_on_signals(print), stop_on_signals(Slot()):
    if (copy := os.fork()) == 0:
        signal.signal(signal.SIGTERM, lambda *_: os._exit(0))
        os.write(1, b"begun ")
        while True:
            signal.pause()
    time.sleep(0.5)
    os.kill(copy, signal.SIGTERM)
    os.waitpid(copy, 0)
    time.sleep(0.5)
"""
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, timeout=60)
    assert (done.returncode, done.stdout) == (0, b"begun ")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no copy of the program there")
def test_a_copy_that_lives_on_does_not_keep_the_program():
    """As of a lab's controller that begins a server of its own and leaves it behind."""
    text = """
import os, time
from rig.loop.signals import leave_on_signals

with leave_on_signals(print):
    if os.fork() == 0:
        os.setsid()
        os.closerange(0, 3)
        time.sleep(20)
        os._exit(0)
"""
    began_s = time.monotonic()
    subprocess.run([sys.executable, "-c", text], capture_output=True, timeout=60, check=True)
    assert time.monotonic() - began_s < 15


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no copy of the program there")
def test_a_copy_that_leaves_by_itself_does_not_deafen_the_program():
    """It leaves every context of the program's, and shut the socket of both."""
    text = """
import hashlib, os, signal, sys
from rig.loop import unheard
from rig.loop.signals import leave_on_signals

unheard.UNHEARD_S = 0.5
with leave_on_signals(print):
    pid = os.fork()
    if pid == 0:
        sys.exit(0)
    os.waitpid(pid, 0)
    print("begun", flush=True)
    hashlib.pbkdf2_hmac("sha256", b"", b"", 10**10 // 10)
"""
    with subprocess.Popen(
        [sys.executable, "-c", text], stdout=subprocess.PIPE, text=True
    ) as program:
        assert program.stdout
        assert program.stdout.readline() == "begun\n"
        program.send_signal(signal.SIGTERM)
        try:
            assert program.wait(20.0) == 143
        finally:
            program.kill()


def test_a_signal_that_changes_nothing_is_no_unheard_one():
    """One in the compiler soon after a run was left by another, which came long before."""
    text = """
import signal, time
from numba.core.compiler_lock import global_compiler_lock
from rig.loop import unheard
from rig.loop.commands import CommandSlot
from rig.loop.signals import leave_on_signals, stop_on_signals

unheard.UNHEARD_S = 0.5
with leave_on_signals(print):
    try:
        with stop_on_signals(CommandSlot()):
            signal.raise_signal(signal.SIGTERM)
            time.sleep(1.0)
    finally:
        with global_compiler_lock:
            signal.raise_signal(signal.SIGTERM)
        time.sleep(1.5)
        print("written", flush=True)
"""
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout.splitlines()[:1]) == (143, ["written"])


def test_a_signal_while_one_function_is_compiled_for_minutes_ends_the_program():
    """The compiler must not be left by what a handler raises; it is not waited for without end."""
    text = """
import signal, time
from numba.core.compiler_lock import global_compiler_lock
from rig.loop import unheard
from rig.loop.signals import leave_on_signals

unheard.UNHEARD_S = 0.5
with leave_on_signals(print):
    with global_compiler_lock:
        signal.raise_signal(signal.SIGTERM)
        time.sleep(30)
"""
    done = subprocess.run(
        [sys.executable, "-u", "-c", text], capture_output=True, text=True, timeout=60
    )
    assert (done.returncode, done.stdout.count("being compiled")) == (143, 1)


def test_what_is_left_in_time_leaves_no_thread_and_the_former_socket():
    import threading

    from rig.loop.signals import leave_on_signals

    before = signal.set_wakeup_fd(-1)
    with leave_on_signals(print):
        assert "unheard signals" in {one.name for one in threading.enumerate()}
    assert signal.set_wakeup_fd(before) == -1
    assert "unheard signals" not in {one.name for one in threading.enumerate()}
    assert unheard.UNHEARD_S >= 5.0  # of what levels a table on its way out


def test_signals_that_come_close_together_are_heard_and_end_nothing():
    text = """
import signal, time
from rig.loop import unheard
from rig.loop.signals import leave_on_signals, stop_on_signals
from rig.loop.commands import CommandSlot

unheard.UNHEARD_S = 0.3
with leave_on_signals(print), stop_on_signals(CommandSlot(), leave=False):
    for _ in range(200):
        signal.raise_signal(signal.SIGTERM)
    time.sleep(1.0)
print("went on")
"""
    done = subprocess.run(
        [sys.executable, "-c", text], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout == "went on\n"
