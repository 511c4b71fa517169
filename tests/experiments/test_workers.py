"""Work in processes: an interruption leaves them without a word of theirs."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from experiments.workers import results_of
from tests.support import ROOT
from tests.support.waiting import wait_for

INTERRUPTED = """
import _thread, sys, threading, time
from pathlib import Path
from experiments.workers import results_of

folder = Path(sys.argv[1])
work = "import time, pathlib; pathlib.Path({!r}).touch(); time.sleep(60)"

def interrupt():
    while len(list(folder.iterdir())) < 2:  # both processes are at work
        time.sleep(0.05)
    _thread.interrupt_main()

threading.Thread(target=interrupt, daemon=True).start()
try:
    list(results_of(exec, [(work.format(str(folder / str(k))),) for k in range(20)], jobs=2))
except KeyboardInterrupt:
    print("interrupted")
"""


@pytest.mark.usefixtures("heeded")
def test_an_interruption_ends_the_processes_and_nothing_else_is_said(tmp_path: Path):
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED, str(tmp_path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=50,
    )
    assert (done.stdout, done.stderr) == ("interrupted\n", "")


def test_a_scheduler_that_vanishes_in_the_midst_is_told_in_one_line(tmp_path: Path):
    pytest.importorskip("distributed")
    said = tmp_path / "scheduler.json"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": tmp_path}
    dask = [sys.executable, "-m", "distributed.cli.dask_scheduler"]
    begin = [*dask, "--port", "0", "--no-dashboard", "--host", "127.0.0.1"]
    scheduler = subprocess.Popen([*begin, "--scheduler-file", str(said)], **quiet)
    dask = [sys.executable, "-m", "distributed.cli.dask_worker", "--scheduler-file", str(said)]
    options = ["--nthreads", "1", "--no-nanny", "--no-dashboard"]
    worker = subprocess.Popen([*dask, *options], **quiet)
    try:
        wait_for("the scheduler", said.exists)
        address = json.loads(said.read_text())["address"]
        found = results_of(time.sleep, [(0.2,)] * 100, cluster=address)
        next(found)
        scheduler.kill()
        with pytest.raises(OSError, match="the scheduler is gone; what was done is kept"):
            list(found)
    finally:
        for process in (scheduler, worker):
            process.kill()
            process.wait(30.0)


STARTED = """
import multiprocessing
from experiments import cli
from experiments.cli import application
from experiments.workers import results_of

def command():
    print(sorted(results_of(len, [("a",), ("bb",)], jobs=2)), flush=True)
    child = multiprocessing.get_context("spawn").Process(target=print, args=("a child",))
    child.start()
    child.join()

if __name__ == "__main__":
    application.main = command
    cli.main()
"""


def test_what_lies_in_the_working_folder_under_a_name_of_pythons_own_is_not_executed(
    tmp_path: Path,
):
    """A colleague's folder, or one with a lab's own socket.py: the processes imported it."""
    program, folder = tmp_path / "program.py", tmp_path / "folder"
    program.write_text(STARTED)
    folder.mkdir()
    for name in ("pickle", "socket"):
        (folder / f"{name}.py").write_text("raise SystemExit('executed')")
    done = subprocess.run(
        [sys.executable, str(program)],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert (done.stdout, done.stderr) == ("[1, 2]\na child\n", "")
