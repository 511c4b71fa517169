"""A signal that comes while numba compiles ends the program, and not by a fault of its memory."""

import signal
import subprocess
import sys

import pytest

PROGRAM = """
import signal, sys
import numba
from llvmlite.binding import ffi
from rig.loop.signals import leave_on_signals

link, linked = ffi.lib.LLVMPY_LinkModules, []

def link_and_signal(*modules):
    error = link(*modules)
    linked.append(error)
    if len(linked) == 1:
        signal.raise_signal(int(sys.argv[1]))
    return error

ffi.lib._fntab["LLVMPY_LinkModules"] = link_and_signal

@numba.njit
def inner(x):
    return x + 1.0

@numba.njit
def outer(x):
    return 2.0 * inner(x)

with leave_on_signals(print):
    try:
        outer(1.0)
    finally:
        print(len(inner.overloads), len(outer.overloads))
    print("went on")
"""


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="signals of POSIX")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_module_that_llvm_has_taken_over_is_not_freed_twice(number):
    """A handler that raises at once ended the program by SIGSEGV."""
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(int(number))], capture_output=True, text=True
    )
    assert done.returncode == 128 + number, done.stderr
    told, overloads = done.stdout.splitlines()
    assert told == f"ended by {number.name}; what was recorded so far is kept"
    assert overloads == "1 0"  # what was compiled is done, what it belongs to is not waited for


@pytest.mark.usefixtures("heeded")
@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="signals of POSIX")
def test_ctrl_c_in_the_compiler_is_a_keyboard_interrupt():
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(int(signal.SIGINT))], capture_output=True, text=True
    )
    assert done.returncode in (130, -signal.SIGINT)  # Python's own end by a KeyboardInterrupt
    assert done.stderr.splitlines()[-1] == "KeyboardInterrupt"
    assert done.stdout == "1 0\n"
