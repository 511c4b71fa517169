"""What is said beside a table that moves: nobody waits for a terminal."""

import os
import sys
import threading
import time
from contextlib import suppress

import pytest

from experiments.cli.say import LAST_S, WAITING, saying_aside


def test_what_is_said_aside_stands_there_in_its_order(capsys):
    with saying_aside() as aside:
        for k in range(WAITING // 2):
            aside(f"line {k}\x1b[2J")
    said = capsys.readouterr().out.splitlines()
    assert said == [f"line {k}?[2J" for k in range(WAITING // 2)]


@pytest.mark.skipif(sys.platform == "win32", reason="pipes of POSIX")
def test_nobody_waits_for_a_pipe_that_nobody_reads(monkeypatch):
    there, here = os.pipe()
    with open(there, "rb") as unread, open(here, "w") as full:  # noqa: PTH123
        os.set_blocking(here, False)
        with suppress(BlockingIOError):
            while os.write(here, bytes(4096)):
                pass
        os.set_blocking(here, True)
        monkeypatch.setattr(sys, "stdout", full)
        begin_s = time.monotonic()
        with saying_aside() as aside:
            for _ in range(2 * WAITING):
                aside("somebody knocks")
            assert time.monotonic() - begin_s < 0.5
        assert time.monotonic() - begin_s < LAST_S + 0.5
        unread.read(4096)


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="a full disk of Linux")  # noqa: PTH110
def test_a_full_disk_does_not_end_who_says_something(monkeypatch):
    with open("/dev/full", "w") as full:  # noqa: PTH123
        monkeypatch.setattr(sys, "stdout", full)
        before = set(threading.enumerate())
        with saying_aside() as aside:
            aside("somebody knocks")
        assert set(threading.enumerate()) <= before  # who says it has ended
