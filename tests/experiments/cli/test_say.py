"""What is said beside a table that moves: nobody waits for a terminal."""

import os
import subprocess
import sys
import threading
import time
from contextlib import suppress
from typing import Any

import pytest

from experiments.cli.say import LAST_S, LONGEST, WAITING, output_aside, saying_aside
from tests.support import ROOT


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


def test_errors_go_aside_line_by_line_and_cannot_steer_the_terminal(capsys):
    with output_aside():
        print("half a ", end="", file=sys.stderr)
        print("\x1b[2Jof a library", file=sys.stderr)
        print("x" * 10 * LONGEST, file=sys.stderr)
    said = capsys.readouterr().err
    assert "half a " in said
    assert "?[2Jof a library" in said
    assert "\x1b" not in said
    assert max(map(len, said.splitlines())) == LONGEST


def test_what_a_program_says_and_what_libraries_print_go_aside_in_one_order(capsys):
    with output_aside() as aside:
        aside("the link")
        print("a line of a library")
    assert capsys.readouterr().out == "the link\na line of a library\n"


@pytest.mark.skipif(sys.platform == "win32", reason="pipes of POSIX")
@pytest.mark.parametrize("unread", ["stdout", "stderr"])
def test_nobody_waits_for_output_that_nobody_reads(unread: str):
    read = {"stdout": "stderr", "stderr": "stdout"}[unread]
    code = (
        "import sys, time, warnings\n"
        "from experiments.cli.say import output_aside\n"
        "with output_aside():\n"
        "    begin_s = time.monotonic()\n"
        "    for k in range(300):\n"
        f"        sys.{unread}.write('a traceback\\n' * 300)\n"
        "        warnings.warn(f'{k}' * 300)\n"
        f"print(time.monotonic() - begin_s, file=sys.{read}, flush=True)\n"
    )
    there, here = os.pipe()
    try:
        command = [sys.executable, "-c", code]
        outputs: dict[str, Any] = {unread: here, read: subprocess.PIPE}
        done = subprocess.run(command, cwd=ROOT, timeout=60, check=True, **outputs)
        said = {"stdout": done.stdout, "stderr": done.stderr}[read]
        assert float(said.split()[-1]) < 5.0 + LAST_S
    finally:
        os.close(there)
        os.close(here)


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="a full disk of Linux")  # noqa: PTH110
def test_a_full_disk_does_not_end_who_says_something(monkeypatch):
    with open("/dev/full", "w") as full:  # noqa: PTH123
        monkeypatch.setattr(sys, "stdout", full)
        before = set(threading.enumerate())
        with saying_aside() as aside:
            aside("somebody knocks")
        assert set(threading.enumerate()) <= before  # who says it has ended
