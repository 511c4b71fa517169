"""What makes a test be tried again: a halt, told once by the watch, or a lost link."""

import os
import signal
import time

import pytest

from rig.hardware.board.link import LinkLost
from tests.support.standstill import HALT_S, Watch, link_was_lost
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


@pytest.mark.parametrize(
    ("error", "lost"),
    [(LinkLost("silent"), True), (LinkLost("round trip"), None), (ValueError("x"), False)],
)
def test_a_link_lost_for_another_reason_than_expected_counts_as_lost(error, lost):
    def failure():
        try:
            with pytest.raises(LinkLost, match="round trip"):
                raise error
        except Exception as failed:
            return failed
        return None

    failed = failure()
    assert (failed is None) == (lost is None)
    assert link_was_lost(failed) == bool(lost)
