"""A lab's own controller that leaves, crashes or hangs the program: named, and its rows kept."""

import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import pytest

from experiments.records.recording import read_run
from experiments.runs.assemble import load_rig
from experiments.runs.own_run import PATIENCE_S, run_own
from experiments.runs.protocol import read_protocol
from experiments.runs.runner import RunRequest
from rig import foreign_trial

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="this system copies no process")

FILE = """
import ctypes, os, signal, threading, time
class Mine:
    def start(self, rig, period_s):
        self.ticks = 0
    def control(self, now):
        self.ticks += 1
        if self.ticks == 100:
            {what}
        return (0.0, 0.0)
    def end(self, outcome):
        pass
"""
PROTOCOL = 'title = "mine"\nduration_s = 1.0\ncontroller = "mine.py:Mine"\n[start]\nhold_s = 0.0\n'


def request(folder: Path, what: str, file: str = FILE, protocol: str = PROTOCOL) -> RunRequest:
    (folder / "mine.py").write_text(file.format(what=what))
    (folder / "mine.toml").write_text(protocol)
    plan = read_protocol(str(folder / "mine.toml"))
    return RunRequest(load_rig(None), plan, "own", 1, folder / "runs")


@pytest.mark.parametrize(
    ("what", "said"),
    [
        ("os._exit(0)", "left the program (exit code 0)"),
        ("os.kill(os.getpid(), signal.SIGKILL)", "crashed the program (signal 9)"),
        (
            "import faulthandler; faulthandler.disable(); ctypes.string_at(0)",
            "crashed the program (signal 11)",
        ),
        ("os.kill(os.getpid(), signal.SIGSTOP)", "did not return within 1 s"),
        ("os.fork() or (os.setsid(), time.sleep(9)); os._exit(3)", "did not return within 1 s"),
    ],
)
def test_what_leaves_or_hangs_the_program_ends_the_run_with_its_rows(
    tmp_path, monkeypatch, what: str, said: str
):
    monkeypatch.setitem(PATIENCE_S, "control", 0.0)
    done = run_own(request(tmp_path, what), progress=lambda t_s: None)
    assert done.ending.outcome == "aborted"
    assert done.ending.reason == f"controller Mine.control {said}"
    whole = read_run(done.folder)
    assert (whole.meta["outcome"], whole.meta["reason"]) == ("aborted", done.ending.reason)
    assert 99 <= len(whole.log) < 500


@pytest.mark.parametrize("what", ["raise GeneratorExit", "raise type('X', (BaseException,), {{}})"])
def test_whatever_it_raises_is_named(tmp_path, what: str):
    done = run_own(request(tmp_path, what), progress=lambda t_s: None)
    assert done.ending.outcome == "aborted"
    assert "controller Mine.control failed, line 9" in done.ending.reason


def test_what_it_leaves_behind_does_not_keep_the_program(tmp_path):
    """A thread that spins for ever, a child that sleeps, an exit handler that hangs."""
    left = "threading.Thread(target=time.sleep, args=(99,), daemon=False).start()"
    child = "self.child = os.fork() or time.sleep(99)"
    times: list[float] = []
    before = threading.active_count()
    done = run_own(request(tmp_path, f"{left}; {child}"), progress=times.append)
    assert done.ending.outcome == "completed"
    assert times
    assert threading.active_count() <= before


def test_a_module_that_it_breaks_takes_no_outcome_from_the_run(tmp_path):
    with pytest.raises(TypeError):
        run_own(request(tmp_path, "import json; json.dumps = None"), progress=lambda t_s: None)
    (folder,) = (tmp_path / "runs").iterdir()
    whole = read_run(folder)
    assert (whole.meta["outcome"], len(whole.log)) == ("aborted", 500)


def test_what_it_lets_others_do_with_new_files_is_not_what_the_run_does(tmp_path):
    done = run_own(request(tmp_path, "os.umask(0o777)"), progress=lambda t_s: None)
    assert {path.stat().st_mode & 0o400 for path in done.folder.iterdir()} == {0o400}


def test_a_file_that_leaves_as_it_is_loaded_is_bad_input(tmp_path):
    wrong = request(tmp_path, "pass", "import os\nos._exit(3)\n" + FILE)
    with pytest.raises(ValueError, match=r"Mine\.start left the program \(exit code 3\): correct"):
        run_own(wrong, progress=lambda t_s: None)


def test_an_attribute_that_leaves_as_it_is_looked_for_is_no_signal(tmp_path):
    asked = "class Mine:\n    @property\n    def start(self):\n        raise SystemExit(143)\n"
    with pytest.raises(ValueError, match=r"mine\.py:Mine: SystemExit: 143"):
        run_own(request(tmp_path, "pass", asked), progress=lambda t_s: None)


def test_an_error_of_a_class_that_the_program_does_not_know_is_no_bad_input():
    """`ValueError` is bad input, exit code 2."""

    def work(tells) -> None:
        raise subprocess.TimeoutExpired("a lab's own", 1.0)

    with pytest.raises(RuntimeError, match="TimeoutExpired: Command 'a lab's own' timed out"):
        foreign_trial.in_copy(work)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_to_the_program_stops_the_run_in_the_copy(tmp_path, number):
    def at_once(t_s: float) -> None:
        os.kill(os.getpid(), number)

    slowly = "self.ticks = 0; time.sleep(0.1)"  # so that the signal comes while it runs
    long = PROTOCOL.replace("1.0", "300.0")
    before = signal.getsignal(number)
    if before == signal.SIG_IGN:  # as a shell starts what runs in the background
        signal.signal(number, signal.default_int_handler)
    try:
        with pytest.raises((SystemExit, KeyboardInterrupt)):
            run_own(request(tmp_path, slowly, protocol=long), progress=at_once)
    finally:
        signal.signal(number, before)
    (folder,) = (tmp_path / "runs").iterdir()
    assert read_run(folder).meta["outcome"] == "interrupted"


ENDLESS = "raise type('EndlessError', (Exception,), {{'__str__': lambda self: {0}}})"


def test_an_error_whose_words_never_come_ends_the_run(tmp_path):
    never = ENDLESS.format("[0 for _ in iter(int, 1)]")
    done = run_own(request(tmp_path, never), progress=lambda t_s: None)
    assert done.ending.outcome == "aborted"
    said = "controller Mine.control failed, line 9: EndlessError, whose words cannot be read"
    assert done.ending.reason == said
    assert len(read_run(done.folder).log) > 90


def test_an_interrupt_of_its_own_is_not_the_operators(tmp_path):
    done = run_own(request(tmp_path, "raise KeyboardInterrupt"), progress=lambda t_s: None)
    assert done.ending.outcome == "aborted"
    assert "nobody asked for" in done.ending.reason


@pytest.mark.parametrize(("number", "times"), [(signal.SIGTERM, 2), (signal.SIGINT, 1)])
def test_a_copy_that_goes_on_after_signals_is_ended_by_force(
    tmp_path, monkeypatch, number: int, times: int
):
    if times == 1:
        monkeypatch.setattr(foreign_trial, "OBEYS_S", 0.5)
    deaf = "signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals()); time.sleep(99)"

    def press() -> None:
        for _ in range(times):
            time.sleep(1.0)  # it is deaf by then
            os.kill(os.getpid(), number)

    waits = threading.Thread(target=press, daemon=True)
    before = signal.signal(number, lambda *_: None)
    monkeypatch.setitem(PATIENCE_S, "control", 60.0)
    begin = time.monotonic()
    try:
        wanted = request(tmp_path, deaf, FILE.replace("100", "300"))
        with pytest.raises((SystemExit, KeyboardInterrupt)):
            run_own(wanted, progress=lambda t_s: waits.ident or waits.start())
    finally:
        waits.join(10.0)
        signal.signal(number, before)
    assert time.monotonic() - begin < 50.0
    (folder,) = (tmp_path / "runs").iterdir()
    whole = read_run(folder)
    assert whole.meta["outcome"] == "interrupted"
    assert whole.meta["reason"].endswith("controller Mine.control went on and was ended by force")
    assert len(whole.log) > 290


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="a wish that Linux grants")
def test_a_copy_ends_with_its_program(tmp_path):
    file = tmp_path / "copy"
    program = foreign_trial._fork()  # tests before this one may have worked on pictures
    if program == 0:

        def work(tells) -> None:
            file.with_suffix(".part").write_text(str(os.getpid()))
            file.with_suffix(".part").rename(file)
            time.sleep(99)

        foreign_trial.in_copy(work)
    while not file.exists():
        time.sleep(0.01)
    copy = int(file.read_text())
    os.kill(program, signal.SIGKILL)
    os.waitpid(program, 0)
    until_s = time.monotonic() + 20.0
    while time.monotonic() < until_s and alive(copy):
        time.sleep(0.01)
    assert not alive(copy)


def alive(process: int) -> bool:
    """Whether a process runs; one that ended may wait for its heir to take note of it."""
    try:
        return "(zombie)" not in Path(f"/proc/{process}/status").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return False


@pytest.mark.parametrize("hard", ["most", "3"])
def test_a_limit_that_it_sets_takes_no_outcome_from_the_run(tmp_path, hard: str):
    limit = "import resource; _, most = resource.getrlimit(resource.RLIMIT_NOFILE); "
    limit += f"resource.setrlimit(resource.RLIMIT_NOFILE, (3, {hard}))"
    outcome = ""
    with suppress(OSError):  # below a hard limit its end cannot be written in the copy
        outcome = run_own(request(tmp_path, limit), progress=lambda t_s: None).ending.outcome
    assert outcome == "completed" or hard == "3"
    (folder,) = (tmp_path / "runs").iterdir()
    whole = read_run(folder)
    assert whole.meta["outcome"] == outcome or "Too many open files" in whole.meta["reason"]
    assert len(whole.log) == 500
