"""A recording beside a paced loop, killed or out of room: what was recorded is there."""

import random
import signal
from pathlib import Path

import pytest

from experiments.records.recording import read_run
from tests.support.killed_program import kill_after, opened_by_mcap, start, wait_for_ticks, whole

# kill -9 by default: test_recording.py; Ctrl-C: ../cli/test_cli.py
pytestmark = [pytest.mark.slow, pytest.mark.realtime]
POSIX = pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="kill -9 is of POSIX")


@POSIX
@pytest.mark.parametrize("most_s", [0.0, 0.5, 1.0])
def test_kill_9_at_a_random_moment_takes_at_most_a_fifth_of_a_second(tmp_path: Path, most_s: float):
    """Three of the fifty of tests/benchmarks/records/kill_nine.py."""
    kill_after(tmp_path / "run", random.uniform(0.0, most_s))


@POSIX
def test_no_more_room_ends_the_run_with_its_reason_and_all_rows(tmp_path: Path):
    program, _ = start(tmp_path / "run", "150000")
    _, words = program.communicate(timeout=150)
    assert program.returncode == 1
    assert "free disk space" in words
    run = read_run(tmp_path / "run")
    assert run.meta["outcome"] == "aborted"
    assert "recording failed" in run.meta["reason"]
    assert run.meta["rows"] == len(run.log) > 300
    assert run.meta["loop"]["jitter"]["ticks"] > len(run.log)
    whole(run, opened_by_mcap(tmp_path / "run"))


@POSIX
@pytest.mark.parametrize("name", ["SIGTERM", "SIGINT"])
def test_a_signal_ends_the_run_and_the_recording_says_so(tmp_path: Path, name: str):
    program, ticks = start(tmp_path / "run")
    wait_for_ticks(program, ticks, 100)
    program.send_signal(getattr(signal, name))
    program.communicate(timeout=90)
    run = read_run(tmp_path / "run")
    assert run.meta["outcome"] == "interrupted"
    assert run.meta["reason"] in ("SIGTERM from the system", "by the operator")
    assert not run.meta["truncated"]
    assert len(run.log) >= 100
    whole(run, opened_by_mcap(tmp_path / "run", finished=True))
    assert program.returncode == (143 if name == "SIGTERM" else -signal.SIGINT)
