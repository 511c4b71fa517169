"""A lab's own controller: it steers, and whatever it does wrong stops the rig at 0 V."""

import json
import sys
import time
from math import nan
from typing import Any

import numpy as np
import pytest

from rig.control.user_controller import (
    ControllerError,
    Now,
    WatchedController,
    command_volts,
    load_controller,
)
from rig.foreign_call import ForeignCall
from rig.loop.loop import Loop, run_controlled
from rig.parameters import Rig
from rig.simulation.simulator import SimulatedTable
from tests.support.simulated import random_steps


class Steering:
    """PD of the published gains without an integral: as a user would write it."""

    def __init__(self) -> None:
        self.calls: list[str] = []
        self.seen = []

    def start(self, rig, period_s):
        self.gains, self.calls = rig.gains, [f"start {period_s}"]

    def control(self, now):
        self.seen.append(now)
        volts = []
        for a in range(2):
            error = now.target_m[a] - now.ball_m[a]
            wanted = 3.45 * error - 2.11 * now.velocity_m_s[a]
            volts.append(14.0 * (wanted - now.theta_rad[a]))
        return volts

    def end(self, outcome):
        self.calls.append(f"end {outcome}")


class FailsAt(Steering):
    def __init__(self, tick: int, what) -> None:
        super().__init__()
        self.tick, self.what = tick, what

    def control(self, now) -> Any:
        volts = super().control(now)
        return self.what(volts) if len(self.seen) > self.tick else volts


def run(controller, seconds=1.0):
    rows: list[np.ndarray] = []
    course = random_steps(np.random.default_rng(1), seconds)

    def on_table():
        with SimulatedTable(Rig(), np.random.default_rng(2)) as table:
            keep = lambda row: rows.append(row.copy())  # noqa: E731
            ending = Loop(table, Rig(), 0, course, controller=controller, keep=keep).run()
            assert ending.outcome != "aborted" or table.volts_V == (0.0, 0.0)
            return ending

    return run_controlled(controller, Rig(), on_table), np.array(rows)


def test_it_steers_the_ball_and_is_told_of_start_and_end():
    controller = Steering()
    ending, rows = run(controller, 4.0)
    assert ending.outcome == "completed"
    assert controller.calls == ["start 0.002", "end completed"]
    assert len(controller.seen) > 1900
    late = controller.seen[900]
    assert np.hypot(*np.subtract(late.ball_m, late.target_m)) < 0.03
    assert late.volts_V != (0.0, 0.0)
    assert len(rows) == 2000


def _raise(volts):
    raise RuntimeError("no idea")


def _leave(volts):
    sys.exit(0)


@pytest.mark.parametrize(
    ("what", "said"),
    [(_raise, "RuntimeError: no idea"), (lambda v: 1.0, "TypeError"), (lambda v: (1, 2, 3), "many"),
     (lambda v: None, "TypeError"), (lambda v: ("a", 0), "two numbers are wanted"),
     (_leave, "SystemExit: 0")],
)  # fmt: skip
def test_what_fails_in_it_stops_the_rig_and_is_recorded(what, said):
    controller = FailsAt(100, what)
    ending, rows = run(controller)
    assert ending.outcome == "aborted"
    assert "controller FailsAt.control failed" in ending.reason
    assert said in ending.reason
    assert np.all(rows[-1, 1:3] == 0.0)  # the last row says 0 V
    assert len(rows) < 200
    assert controller.calls[-1] == "end aborted"


def test_the_reason_names_the_labs_own_line():
    ending, _ = run(FailsAt(10, _raise))
    assert ", line " in ending.reason

    class OfALibrary(Steering):
        def control(self, now):
            return json.loads("{")

    own = OfALibrary.control.__code__.co_firstlineno + 1
    ending, _ = run(OfALibrary())
    assert f", line {own}: JSONDecodeError" in ending.reason


def test_an_error_whose_words_raise_one_themselves_is_named():
    class MuteError(Exception):
        def __str__(self) -> str:
            raise RuntimeError("no words")

    def fail(now):
        raise MuteError

    ending, rows = run(FailsAt(10, fail))
    assert ending.outcome == "aborted"
    assert "MuteError, whose words cannot be read" in ending.reason
    assert len(rows) > 5


def test_a_fault_at_the_start_never_moves_the_table():
    class Broken(Steering):
        def start(self, rig, period_s):
            raise OSError("no model file")

    ending, rows = run(Broken())
    assert ending.outcome == "aborted"
    assert "no model file" in ending.reason
    assert len(rows) == 0


@pytest.mark.parametrize("where", ["", "    def __init__(self):\n        sys.exit(3)\n"])
def test_a_file_that_leaves_the_program_is_bad_input(tmp_path, where):
    file = tmp_path / "mine.py"
    file.write_text("import sys\nclass Mine:\n" + (where or "    sys.exit(3)\n"))
    with pytest.raises(ValueError, match="SystemExit: 3"):
        load_controller(f"{file}:Mine")


@pytest.mark.parametrize("method", ["start", "end"])
def test_leaving_the_program_at_the_start_or_the_end_is_said(method):
    controller = Steering()
    setattr(controller, method, lambda *given: sys.exit(0))
    ending, _ = run(controller)
    assert ending.outcome == ("aborted" if method == "start" else "completed")
    assert f"{method} failed" in ending.reason


def test_a_fault_at_the_end_does_not_take_the_run_away():
    class Sloppy(Steering):
        def end(self, outcome):
            raise ValueError("disk full")

    ending, _ = run(Sloppy())
    assert ending.outcome == "completed"
    assert "disk full" in ending.reason


def test_wishes_that_are_no_numbers_are_refused_at_0_volts():
    controller = FailsAt(100, lambda v: (nan, v[1]))
    ending, rows = run(controller)
    assert ending.outcome == "no number"
    assert "asked for nan V" in ending.reason
    assert rows[-1, 1] == 0.0
    assert len(rows) < 200
    assert controller.calls[-1] == "end no number"


def test_wishes_beyond_the_limits_are_clipped():
    controller = FailsAt(100, lambda v: (1e9, -1e9))
    _, rows = run(controller)
    assert np.abs(rows[:, 1:3]).max() <= Rig().servo.voltage_limit_V


@pytest.mark.parametrize(
    "returned",
    ["99", b"zz", bytearray(b"zz"), {1.0, -3.0}, {5.0: 1, 6.0: 2}, ("1", "2"), (1.0,), 3.0, None],
)
def test_what_is_not_two_numbers_in_order_ends_the_run_at_0_volts(returned):
    ending, rows = run(FailsAt(100, lambda v: returned))
    assert ending.outcome == "aborted"
    assert ".control failed" in ending.reason
    assert rows[-1, 1:3].tolist() == [0.0, 0.0]


@pytest.mark.parametrize("kind", [list, np.array, lambda v: np.array(v, np.float32)])
def test_two_numbers_in_order_are_volts_whatever_holds_them(kind):
    assert run(FailsAt(100, lambda v: kind(tuple(v))))[0].outcome == "completed"


def test_words_that_never_come_are_made_within_what_a_tick_may_take():
    called: list[str] = []

    class EndlessError(Exception):
        def __str__(self) -> str:
            called.append("words")
            while True:
                pass

    def fail(volts):
        raise EndlessError

    volts, watched = np.ones(2), WatchedController(FailsAt(-1, fail), called.append)
    seen = Now(0.0, *[(0.0, 0.0)] * 10)
    begin = time.monotonic()
    with pytest.raises(ControllerError, match=r"control failed, line \d+: EndlessError, wh"):
        command_volts(watched, seen, volts, ForeignCall(0.1))
    assert time.monotonic() - begin < 0.9  # below the second that an error's words may take
    assert called == ["control", "", "control", "words", ""]  # watched from outside, too
    assert volts.tolist() == [0.0, 0.0]


@pytest.mark.parametrize("method", ["start", "control", "end"])
def test_an_interrupt_of_its_own_is_an_error_like_any_other(method):
    def fail(*given):
        raise KeyboardInterrupt

    controller = FailsAt(10, fail) if method == "control" else Steering()
    if method != "control":
        setattr(controller, method, fail)
    ending, _ = run(controller)
    assert ending.outcome == ("completed" if method == "end" else "aborted")
    assert f".{method} failed, line " in ending.reason
    assert "KeyboardInterrupt, which nobody asked for" in ending.reason
