"""What a terminal sends to every process is heard by the program alone."""

import os
import signal
import subprocess
import sys
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
