"""Work in processes: an interruption leaves them without a word of theirs."""

import subprocess
import sys
from pathlib import Path

from tests.support import ROOT

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


def test_an_interruption_ends_the_processes_and_nothing_else_is_said(tmp_path: Path):
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED, str(tmp_path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=50,
    )
    assert (done.stdout, done.stderr) == ("interrupted\n", "")
