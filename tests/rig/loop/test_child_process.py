"""What a terminal sends to every process is heard by the program alone."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

PROGRAM = """
import sys, time
from multiprocessing import get_context
from pathlib import Path
from rig.loop.child_process import leave_ctrl_c, start

if __name__ != "__main__":  # the child, in the midst of its imports
    Path(sys.argv[1]).touch()
    time.sleep(0.3)

def work():
    leave_ctrl_c()
    time.sleep(0.3)
    print("done", flush=True)

if __name__ == "__main__":
    child = get_context("spawn").Process(target=work)
    start(child)
    try:
        time.sleep(60)
    except KeyboardInterrupt:
        child.join()
        print("the program heard it; the child ended with", child.exitcode)
"""


@pytest.mark.usefixtures("heeded")
@pytest.mark.skipif(not hasattr(os, "killpg"), reason="process groups of POSIX")
def test_ctrl_c_while_a_child_still_imports_is_for_the_program(tmp_path: Path):
    program, here = tmp_path / "program.py", tmp_path / "child is here"
    program.write_text(PROGRAM)
    root = str(Path(__file__).parents[3])
    running = subprocess.Popen(
        [sys.executable, str(program), str(here)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
        env={**os.environ, "PYTHONPATH": root},
    )
    while not here.exists() and running.poll() is None:
        pass
    os.killpg(running.pid, signal.SIGINT)
    told = running.communicate(timeout=60)[0].splitlines()
    assert told == ["done", "the program heard it; the child ended with 0"]


LEFT = """
import os, sys, time
from multiprocessing import get_context
from rig.loop.child_process import end_with_program

def work():
    end_with_program()
    print(os.getpid(), flush=True)
    while True:
        time.sleep(60)

if __name__ == "__main__":
    get_context("spawn").Process(target=work).start()
    time.sleep(60)
"""


@pytest.mark.skipif(os.name == "nt", reason="kill -9 of POSIX")
def test_a_program_that_is_killed_leaves_no_process_behind(tmp_path: Path):
    """The camera's went on, and no other program got the camera."""
    program = tmp_path / "program.py"
    program.write_text(LEFT)
    root = str(Path(__file__).parents[3])
    running = subprocess.Popen(
        [sys.executable, str(program)],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": root},
    )
    with running:
        assert running.stdout is not None
        child = int(running.stdout.readline())
        running.kill()
        assert running.stdout.read() == ""  # the pipe's other end, which the child held, is closed
    until_s = time.monotonic() + 10.0
    while Path(f"/proc/{child}").exists() and time.monotonic() < until_s:
        time.sleep(0.05)
    assert not Path(f"/proc/{child}").exists()
