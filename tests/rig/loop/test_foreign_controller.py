"""A user's controller that is slow, hangs, eats memory or talks: named, and the table is level."""

import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from experiments.records.recording import read_run
from experiments.runs.assemble import known, load_rig
from experiments.runs.protocol import read_protocol
from experiments.runs.runner import RunRequest, run
from rig.course import Course
from rig.loop import process
from rig.loop.job import Job
from rig.loop.loop import Ending
from rig.loop.paced import Paced
from rig.loop.process import LoopProcess
from rig.safety.monitor import MonitorLimits
from rig.simulation.simulator import SimulatedTable

pytestmark = pytest.mark.realtime

TABLE = load_rig(None)
# A busy machine that grants no priority may be late as it likes.
PATIENT = replace(MonitorLimits.of_rig(TABLE), late_s=0.5, late_ticks=1e9)
FILE = """
import sys, time
class Mine:
    ticks = 0
    def start(self, rig, period_s):
        {start}
    def control(self, now):
        self.ticks += 1
        if self.ticks > 150:
            {control}
        return [14.0 * (3.45 * (t - x) - 2.11 * v - th) for t, x, v, th in zip(
            now.target_m, now.ball_m, now.velocity_m_s, now.theta_rad)]
    def end(self, outcome):
        {end}
"""
# In pieces of 16 MB: one of 256 MB takes a busy machine a second that nothing can interrupt.
MEMORY = "self.kept = [bytearray(1 << 24) for _ in range(1 << 20)]"
CAUGHT = "exec('while True:\\n try: time.sleep(9)\\n except BaseException: pass')"


class Told(Paced):
    """Writes down when it was armed and its volts and angles at the end."""

    def __init__(self, path: str, level_s: float = Paced.level_s) -> None:
        super().__init__(SimulatedTable(TABLE, np.random.default_rng(3), start_m=(-0.03, 0.02)))
        self._path, self.level_s = Path(path), level_s

    def __enter__(self):
        (self._path / "armed").write_text(str(time.monotonic()))
        return super().__enter__()

    def close(self) -> None:
        table = self.table
        angle = float(np.abs(table.truth()["arm_rad"]).max())
        (self._path / "left").write_text(f"{max(map(abs, table.volts_V))} {angle}")
        super().close()


def told(path: str, level_s: float):
    return Told(path, level_s)


def ran(
    folder: Path, *, start="pass", control="pass", end="pass", ticks=400, level_s=Paced.level_s
):
    """Ending, rows and seconds of a run in a process of its own."""
    file = folder / "mine.py"
    file.write_text(FILE.format(start=start, control=control, end=end))
    course = Course(np.zeros((ticks, 2)), np.zeros((ticks, 2)), (-0.03, 0.02))
    table = partial(told, str(folder), level_s)
    loop = LoopProcess(
        Job(table, known(TABLE), 0, course, limits=PATIENT, controller=f"{file}:Mine")
    )
    rows: list = []
    begin = time.monotonic()
    return loop.run(rows.append), rows, time.monotonic() - begin


def slow(*values):
    return pytest.param(*values, marks=pytest.mark.slow)


def level(folder: Path) -> None:
    volts, angle = map(float, (folder / "left").read_text().split())
    assert volts == 0.0
    assert angle < 0.03


@pytest.mark.slow
def test_a_slow_start_and_a_slow_end_are_waited_for_with_the_table_unarmed(tmp_path):
    began = time.monotonic()
    ending, rows, _ = ran(tmp_path, start="time.sleep(1.5)", end="time.sleep(1.5)")
    assert ending == Ending("completed")
    assert len(rows) == 400
    assert float((tmp_path / "armed").read_text()) > began + 1.5
    level(tmp_path)


@pytest.mark.parametrize(
    ("control", "said"),
    [
        ("time.sleep(99)", "did not return within 0.4 s"),
        slow("exec('while True: pass')", "did not return within 0.4 s"),
        slow(MEMORY, ""),  # out of memory or out of time
        slow("print('x' * 10**6)", None),
    ],
)
def test_what_control_does_for_ever_is_named_and_the_table_levelled(
    tmp_path, capfd, control: str, said: str | None
):
    ending, rows, seconds = ran(tmp_path, control=control)
    if said is None:
        assert ending == Ending("completed")
    else:
        assert ending.outcome == "aborted"
        assert "controller Mine.control" in ending.reason
        assert said in ending.reason
        assert 150 <= len(rows) < 170
        assert np.all(rows[-1][1:3] == 0.0)
    assert seconds < 60.0
    assert capfd.readouterr().out == ""  # standard output is the program's
    level(tmp_path)


@pytest.mark.parametrize("control", ["1 / 0", slow(MEMORY)])
def test_levelling_after_a_failure_may_take_as_long_as_it_does(tmp_path, control: str):
    """As on a busy machine, where the 0.6 s of levelling take longer than control may."""
    ending, _, _ = ran(tmp_path, control=control, level_s=2.0 * process.LOOP_SILENT_S)
    assert ending.outcome == "aborted"
    assert "controller Mine.control" in ending.reason
    level(tmp_path)


@pytest.mark.slow
def test_control_that_cannot_be_interrupted_is_named_too(tmp_path):
    ending, rows, _ = ran(tmp_path, control=CAUGHT)
    assert ending == Ending("loop died", "controller Mine.control did not return within 1 s")
    assert len(rows) >= 150


@pytest.mark.parametrize("what", ["time.sleep(99)", slow(CAUGHT)])
def test_a_start_that_hangs_ends_before_the_table_is_armed(tmp_path, monkeypatch, what):
    monkeypatch.setattr(process, "PATIENCE_S", {**process.PATIENCE_S, "start": 1.0})
    ending, rows, _ = ran(tmp_path, start=what)
    assert ending.outcome in ("aborted", "loop died")
    assert "controller Mine.start did not return within 1 s" in ending.reason
    assert not rows
    assert not (tmp_path / "armed").exists()


@pytest.mark.parametrize("what", [slow("time.sleep(99)"), slow(CAUGHT)])
def test_an_end_that_hangs_takes_nothing_from_the_run(tmp_path, monkeypatch, what):
    monkeypatch.setattr(process, "PATIENCE_S", {**process.PATIENCE_S, "end": 1.0})
    ending, rows, _ = ran(tmp_path, end=what)
    assert ending.outcome == "completed"
    assert "controller Mine.end did not return within 1 s" in ending.reason
    assert len(rows) == 400
    level(tmp_path)


PROTOCOL = 'title = "mine"\nduration_s = 1.0\ncontroller = "mine.py:Mine"\n[start]\nhold_s = 0.0\n'


@pytest.mark.parametrize(
    "method", ["start", "end", pytest.param("control", marks=pytest.mark.slow)]
)
def test_on_the_virtual_table_too(tmp_path, monkeypatch, method: str):
    for name in ("START_S", "END_S"):
        monkeypatch.setattr(f"rig.control.user_controller.{name}", 0.5)
    words = dict.fromkeys(("start", "control", "end"), "pass")
    (tmp_path / "mine.py").write_text(FILE.format(**words | {method: "time.sleep(99)"}))
    (tmp_path / "mine.toml").write_text(PROTOCOL)
    plan = read_protocol(str(tmp_path / "mine.toml"))
    done = run(RunRequest(TABLE, plan, "own", 1, tmp_path / "runs"))
    assert done.ending.outcome == ("completed" if method == "end" else "aborted")
    seconds = "5" if method == "control" else "0.5"
    assert f"controller Mine.{method} did not return within {seconds} s" in done.ending.reason
    log = read_run(done.folder).log
    first = np.flatnonzero(np.isfinite(log["ball_x_m"]))[:1].tolist()  # it is asked from then on
    expected = {"start": 0, "control": sum(first) + 151, "end": 500}
    assert len(log) == expected[method]


def test_files_that_it_closes_take_nothing_from_the_run(tmp_path, capfd):
    ending, rows, _ = ran(tmp_path, end="import os; os.closerange(3, 4096)")
    assert ending == Ending("completed")
    assert len(rows) == 400
    assert "Traceback" not in capfd.readouterr().err


def test_words_that_never_come_end_the_run_by_name_at_level(tmp_path):
    never = "raise type('EndlessError', (Exception,), {'__str__': lambda e: time.sleep(99)})"
    ending, _, _ = ran(tmp_path, control=never)
    assert ending.outcome == "aborted"
    assert "controller Mine.control failed, line 10: EndlessError, whose words" in ending.reason
    level(tmp_path)
