"""The watch by which a test that failed is tried again: it sees a halt, and tells of it once."""

import os
import signal
import time

import pytest

from tests.support.standstill import HALT_S, Watch
from tests.support.waiting import wait_for


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="signals of POSIX")
def test_the_watch_tells_of_a_halt_once():
    watch = Watch()
    try:
        wait_for("the watch", lambda: _halted(watch))
        assert not watch.saw_a_halt()
    finally:
        watch.end()


def _halted(watch: Watch) -> bool:
    """Stop the watch as a halt of the machine would; before it has started it sees nothing."""
    os.kill(watch.pid, signal.SIGSTOP)
    time.sleep(2 * HALT_S)
    os.kill(watch.pid, signal.SIGCONT)
    time.sleep(2 * HALT_S)
    return watch.saw_a_halt()
