"""The loop in its own process: the same run, and nothing that happens to the program harms it."""

import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from experiments.runs.assemble import known, load_rig
from rig.control.controllers import COMPENSATORS
from rig.course import Course
from rig.hardware.board.link import LinkLost
from rig.loop import process
from rig.loop.commands import Push, SetGains, Stop, Target
from rig.loop.job import PARENT_SILENT_S, Job, _Inbox, _wait_for_word
from rig.loop.loop import Ending
from rig.loop.paced import Paced
from rig.loop.process import LoopProcess
from rig.loop.shared_channel import READY, SharedChannel, SharedCommandSlot, take_commands
from rig.operator import Operator
from rig.safety.monitor import MonitorLimits
from rig.simulation.operator import SimulatedOperator
from rig.simulation.simulate import draw, simulate
from rig.simulation.simulator import SimulatedTable
from rig.table import ArmingStoppedError
from tests.support import ROOT

pytestmark = pytest.mark.realtime

TABLE = load_rig(None)
# A busy machine that grants no priority may be late as it likes.
PATIENT = replace(MonitorLimits.of_rig(TABLE), late_s=10.0, late_ticks=1e9)


def course(seconds: float) -> Course:
    n = round(seconds * 500)
    return Course(np.zeros((n, 2)), np.zeros((n, 2)), (-0.08, 0.06), 0.3)


def paced_table(seed: int = 3, pace: bool = True):
    table = SimulatedTable(TABLE, np.random.default_rng(seed), start_m=(-0.08, 0.06), held=True)
    return Paced(table) if pace else table


def hand(table) -> SimulatedOperator:
    return SimulatedOperator(getattr(table, "table", table), 0.3)


def job(seconds: float, **more) -> Job:
    return Job(
        paced_table, known(TABLE), COMPENSATORS["with"], course(seconds), hand, PATIENT, **more
    )


def test_it_gives_the_same_bits_as_the_batch_kernel_and_notes_its_jitter():
    rows, events = [], []
    loop = LoopProcess(job(1.5, trace=2000))
    ending = loop.run(rows.append, lambda t_s, text: events.append(text))
    assert ending.outcome == "completed"
    seen, way = known(TABLE), course(1.5)
    batch = simulate(
        TABLE, seen, COMPENSATORS["with"], way, draw(np.random.default_rng(3), seen, way)
    )
    assert np.array_equal(np.array(rows), batch.log.rows, equal_nan=True)
    assert events == ["released"]
    notes = loop.notes
    assert (
        notes["jitter"]["ticks"] == len(rows) == len(loop.late_us) == sum(notes["jitter"]["counts"])
    )
    assert set(notes["realtime"]) == {
        "sched_fifo",
        "mlockall",
        "cpu_dma_latency",
        "garbage_collector",
    }
    assert (notes["lost_rows"], notes["lost_events"]) == (0, 0)
    if notes["realtime"]["sched_fifo"] == "yes":
        assert notes["jitter"]["missed"] < 0.1 * len(rows)


def test_a_stop_from_another_thread_and_commands_before_it():
    loop, rows, events = LoopProcess(job(30.0)), [], []
    loop.put(Target((0.01, 0.02)))

    def press() -> None:
        while len(rows) < 200:
            time.sleep(0.005)
        loop.put(Stop("the operator's button"))

    thread = threading.Thread(target=press)
    thread.start()
    ending = loop.run(rows.append, lambda t_s, text: events.append(text))
    thread.join()
    assert ending == Ending("aborted", "the operator's button")
    assert loop.at_rest
    assert rows[-1][9] == 0.01
    assert "by hand: target x +1.0, y +2.0 cm" in events


def written_table(path: str):
    Path(path).touch()
    return paced_table()


def test_a_stop_before_the_table_is_opened_keeps_it_closed(tmp_path: Path):
    opened = tmp_path / "opened"
    loop = LoopProcess(replace(job(5.0), table=partial(written_table, str(opened))))
    assert not loop.at_rest
    loop.put(Stop("the operator's button"))
    assert loop.at_rest  # at once: whatever the process does, it is never given the word
    loop.put(Stop("too late"))
    assert loop.run() == Ending("aborted", "the operator's button")
    assert not opened.exists()
    loop.put(Stop("after the run"))  # is no error


def test_a_loop_that_is_ready_waits_for_the_word_and_a_stop_outdoes_it():
    box, parent = SharedChannel(), os.getppid()
    try:
        box.beat("parent_s")
        word = threading.Timer(0.1, box.allow_to_open)
        word.start()
        commands = SharedCommandSlot(box)
        commands.put(SetGains(1.0, 2.0, 3.0))
        assert _wait_for_word(box, _Inbox(box, parent)) is None
        assert box.may_open
        assert _Inbox(box, parent).take() == [SetGains(1.0, 2.0, 3.0)]  # kept for the run
        stop = Stop("crossed the word", "aborted")
        commands.put(stop)
        assert _wait_for_word(box, _Inbox(box, parent)) == stop
        assert box.state == READY
    finally:
        box.close()


class SlowToArm(Paced):
    """Moves while it is armed, for as long as nobody asks it to stop."""

    stop_asked = staticmethod(lambda: False)

    def __enter__(self):
        while not self.stop_asked():
            time.sleep(0.004)
        raise ArmingStoppedError


class MovesAtOnce(Paced):
    """Takes a second to open, and moves as soon as it is armed."""

    def __init__(self, path: str) -> None:
        super().__init__(paced_table(pace=False))
        self._path = path
        time.sleep(1.0)

    def __enter__(self):
        Path(self._path + ".moved").touch()
        return super().__enter__()

    def close(self) -> None:
        Path(self._path + ".closed").touch()
        super().close()


def slow_to_arm(path: str) -> SlowToArm:
    Path(path).touch()
    return SlowToArm(paced_table(pace=False))


def slow_to_open(path: str) -> MovesAtOnce:
    Path(path).touch()
    return MovesAtOnce(path)


@pytest.mark.parametrize("table", [slow_to_arm, slow_to_open])
def test_a_stop_while_the_table_is_opened_or_armed_ends_it_there(tmp_path: Path, table):
    begun = tmp_path / "begun"
    loop = LoopProcess(replace(job(5.0), table=partial(table, str(begun))))
    asked_s: list[float] = []

    def press() -> None:
        while not begun.exists():
            time.sleep(0.005)
        time.sleep(0.2)
        asked_s.append(time.monotonic())
        loop.put(Stop("the operator's button"))

    thread = threading.Thread(target=press)
    thread.start()
    assert loop.run() == Ending("aborted", "the operator's button")
    thread.join()
    assert time.monotonic() - asked_s[0] < 1.0 + PARENT_SILENT_S
    assert loop.at_rest
    assert not (tmp_path / "begun.moved").exists()
    assert (table is slow_to_arm) or (tmp_path / "begun.closed").exists()


class LostWhileLevelling(Paced):
    def __exit__(self, *error) -> None:
        super().__exit__(*error)
        raise LinkLost("cable out")


def lost_while_levelling() -> LostWhileLevelling:
    return LostWhileLevelling(paced_table(pace=False))


def test_the_first_thing_that_went_wrong_names_the_run():
    loop = LoopProcess(replace(job(30.0), table=lost_while_levelling))

    def keep(row) -> None:
        loop.put(Stop("the operator's button"))

    told = "the operator's button; the plate may not be level: cable out"
    assert loop.run(keep) == Ending("aborted", told)
    assert not loop.at_rest
    ending = LoopProcess(replace(job(0.2), table=lost_while_levelling)).run()
    assert ending == Ending("link lost", "LinkLost: cable out")


def hangs_as_it_opens(path: str) -> Paced:
    Path(path).touch()
    time.sleep(600.0)
    return paced_table()


class HangsAsItCloses(Paced):
    def __exit__(self, *error) -> None:
        time.sleep(600.0)


def hangs_as_it_closes() -> HangsAsItCloses:
    return HangsAsItCloses(paced_table(pace=False))


@pytest.mark.parametrize("stops", [True, False])
def test_a_table_that_hangs_as_it_opens_is_given_up(monkeypatch, tmp_path: Path, stops: bool):
    monkeypatch.setattr(process, "OPEN_S", 600.0 if stops else 0.5)
    monkeypatch.setattr(process, "STOPPED_OPEN_S", 0.5)
    begun = tmp_path / "begun"
    loop = LoopProcess(replace(job(5.0), table=partial(hangs_as_it_opens, str(begun))))

    def press() -> None:
        while not begun.exists():
            time.sleep(0.005)
        loop.put(Stop("the operator's button"))

    thread = threading.Thread(target=press if stops else lambda: None)
    thread.start()
    what = "the table was not open, nor armed, within 0.5 s"
    assert loop.run() == Ending("loop died", f"the operator's button; {what}" if stops else what)
    thread.join()
    assert not loop.at_rest


def test_a_table_that_hangs_as_it_closes_is_given_up(monkeypatch):
    monkeypatch.setattr(process, "CLOSE_S", 0.5)
    loop, rows = LoopProcess(replace(job(0.2), table=hangs_as_it_closes)), []
    told = "the table was not level and closed within 0.5 s"
    assert loop.run(rows.append) == Ending("loop died", told)
    assert len(rows) >= 100
    assert not loop.at_rest


class BadHand(Operator):
    def act(self, reading, wanted_m_s2):
        if reading.t_s > 0.2:
            raise ValueError("a user's mistake")
        return wanted_m_s2


def bad_hand(table) -> Operator:
    return BadHand()


def test_what_is_raised_in_the_loop_is_told_by_name():
    ending = LoopProcess(Job(paced_table, known(TABLE), 0, course(5.0), bad_hand, PATIENT)).run()
    assert ending == Ending("aborted", "ValueError: a user's mistake")


def test_a_recorder_that_fails_stops_the_loop_and_is_heard():
    loop, rows = LoopProcess(job(30.0)), []

    def keep(row) -> None:
        rows.append(row)
        if len(rows) > 100:
            raise OSError(28, "disk full")

    start = time.monotonic()
    with pytest.raises(OSError, match="disk full"):
        loop.run(keep)
    assert time.monotonic() - start < 15.0
    assert loop.notes["jitter"]["ticks"] < 5000


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="signals of POSIX")
@pytest.mark.parametrize("name", ["SIGKILL", "SIGSTOP"])
def test_a_loop_that_is_killed_or_hangs_is_named(name: str):
    loop, rows = LoopProcess(job(30.0)), []

    def keep(row) -> None:
        rows.append(row)
        if len(rows) == 100:
            os.kill(loop.pid, getattr(signal, name))

    assert loop.run(keep) == Ending("loop died", "its process ended with -9")


@pytest.mark.slow
def test_a_slow_reader_never_stops_the_loop_and_is_told_what_it_lost(monkeypatch):
    monkeypatch.setattr("rig.loop.shared_channel.ROWS", 64)
    loop, rows = LoopProcess(job(2.0)), []

    def keep(row) -> None:
        if not rows:
            time.sleep(1.0)
        rows.append(row[0])

    assert loop.run(keep).outcome == "completed"
    assert loop.notes["lost_rows"] >= 300
    assert loop.notes["jitter"]["ticks"] == len(rows) + loop.notes["lost_rows"]
    assert np.all(np.diff(rows) > 0)


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


PROGRAM = """
import os, sys, time
import numpy as np
from functools import partial
from tests.rig.loop.test_process import black_box_job
from rig.loop.process import LoopProcess
if __name__ == "__main__":
    loop = LoopProcess(black_box_job(sys.argv[1]))
    print(loop.pid, flush=True)
    loop.run()
"""


class BlackBox(Paced):
    """Writes every volt with its wall-clock time into a file that outlives everybody."""

    def __init__(self, path: str) -> None:
        inner = SimulatedTable(TABLE, np.random.default_rng(1), start_m=(-0.08, 0.06), held=False)
        super().__init__(inner)
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND)

    def drive(self, volts) -> None:
        super().drive(volts)
        told = np.array([time.monotonic(), *volts, *self.table.truth()["arm_rad"]])
        os.write(self._file, told.tobytes())


def black_box_job(path: str) -> Job:
    n = 30000
    way = Course(np.full((n, 2), 0.05), np.zeros((n, 2)), (-0.08, 0.06))
    return Job(partial(BlackBox, path), known(TABLE), 0, way, limits=PATIENT)


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="signals of POSIX")
def test_when_the_program_dies_the_loop_levels_the_plate_at_once(tmp_path: Path):
    path = tmp_path / "volts"
    command = [sys.executable, "-c", PROGRAM, str(path)]
    program = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, cwd=ROOT, text=True
    )
    assert program.stdout is not None
    loop_pid = int(program.stdout.readline())
    deadline = time.monotonic() + 150  # of a busy machine: it compiles first
    while not path.exists() or path.stat().st_size < 40 * 200:
        assert time.monotonic() < deadline, "the loop does not run"
        time.sleep(0.01)
    died_s = time.monotonic()
    program.kill()
    patience_s = 0.5  # chosen: of a busy machine
    size = -1
    while size != path.stat().st_size and time.monotonic() < deadline:
        size = path.stat().st_size
        time.sleep(0.3)
    program.wait()
    program.stdout.close()
    told = np.frombuffer(path.read_bytes()).reshape(-1, 5)
    after = told[told[:, 0] > died_s + patience_s]
    level = np.clip(-14.0 * after[:, 3:], -3.0, 3.0)  # what levelling asks, but for one tick
    assert np.all(np.abs(after[:, 1:3] - level) < 0.5)
    assert np.all(told[-1, 1:3] == 0.0)
    assert told[-1, 0] < died_s + patience_s + 1.0
    while alive(loop_pid) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not alive(loop_pid)


def test_a_program_that_hangs_or_is_not_the_parent_ends_the_loop():
    box = SharedChannel()
    try:
        box.beat("parent_s")
        inbox = _Inbox(box, os.getppid())
        assert inbox.take() == []
        box.pulse.array["parent_s"][0] -= PARENT_SILENT_S
        assert inbox.take() == [Stop("the program was silent for 2 s", "program lost")]
        orphan = _Inbox(box, os.getppid() + 1)
        events = "the program that started the loop has died"
        assert orphan.take() == [Stop(events, "program lost")]
    finally:
        box.close()


def test_commands_pass_through_shared_memory_as_they_were():
    box = SharedChannel()
    try:
        commands = SharedCommandSlot(box)
        sent = [Push((1.0, -2.0), 0.1), Target((0.01, 0.02)), Target(None), SetGains(1.0, 2.0, 3.0)]
        for command in sent:
            commands.put(command)
        assert take_commands(box) == sent
        assert take_commands(box) == []
        for k in range(200):
            commands.put(SetGains(float(k), 0.0, 0.0))
        assert take_commands(box) == [SetGains(float(k), 0.0, 0.0) for k in range(136, 200)]
        commands.put(Stop("ä" * 500, "interrupted"))
        commands.put(Stop("second"))
        assert take_commands(box) == [Stop("ä" * 120, "interrupted")]
        assert take_commands(box) == [Stop("ä" * 120, "interrupted")]
        with pytest.raises(TypeError, match="no command"):
            commands.put("left")  # type: ignore[arg-type]
    finally:
        box.close()


def test_a_stop_arrives_whatever_its_words_are():
    """A failure names a file, and a folder's name need not be UTF-8: that stop was never sent, nor
    any after it.
    """
    box = SharedChannel()
    try:
        SharedCommandSlot(box).put(Stop("Messung_f\udcfcr: no room", "recording failed"))
        box.say(1.0, "f\udcfcr")
        assert take_commands(box) == [Stop("Messung_f?r: no room", "recording failed")]
        assert box.take_events() == [(1.0, "f?r")]
    finally:
        box.close()
