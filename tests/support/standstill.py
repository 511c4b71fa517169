"""A watch that sees the machine stand still, for tests that are `realtime`.

There a table, its program and its camera answer each other within tens of milliseconds. A machine
that halts, or is given to others, for as long makes them fall silent whatever they are; a halt of
one of them alone is a lost link by definition. Where such a test failed by a lost link, or the
watch saw a halt meanwhile, it is tried again, and never otherwise: the closing line of pytest
counts it as "rerun".
"""

import subprocess
import sys
import threading

from rig.hardware.board.link import LINK_DEAD_S, LinkLost

RERUNS = 3  # chosen: four halts in four tries are the test's own doing
RERUN_DELAY_S = 20  # chosen: what makes a machine halt lasts for seconds
HALT_S = LINK_DEAD_S / 2  # chosen: of the shortest patience that a link has, both ends share it
_WATCH = f"""
import os, time
last_s, parent = time.monotonic(), os.getppid()
while os.getppid() == parent:
    time.sleep({HALT_S / 8})
    now_s = time.monotonic()
    if now_s - last_s > {HALT_S}:
        os.write(1, b"h")
    last_s = now_s
"""


class Watch:
    """A process of its own, at the priority of the tests, that tells when it woke too late."""

    def __init__(self) -> None:
        command = [sys.executable, "-S", "-E", "-c", _WATCH]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, bufsize=0)
        self._halts, self._listener = 0, threading.Thread(target=self._listen, daemon=True)
        self._listener.start()

    @property
    def pid(self) -> int:
        """Number of its process."""
        return self._process.pid

    def _listen(self) -> None:
        assert self._process.stdout is not None
        while self._process.stdout.read(1):
            self._halts += 1

    def saw_a_halt(self) -> bool:
        """Whether the machine stood still since this was last asked."""
        halts, self._halts = self._halts, 0
        return halts > 0

    def end(self) -> None:
        self._process.kill()
        self._process.wait()
        self._listener.join()
        assert self._process.stdout is not None
        self._process.stdout.close()


def link_was_lost(error: BaseException | None) -> bool:
    """Whether a test failed by a lost link: by its error, or because `pytest.raises` waited for
    another reason to lose it (the error that came is the context of that failure)."""
    return isinstance(error, LinkLost) or isinstance(getattr(error, "__context__", None), LinkLost)
