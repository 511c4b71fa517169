"""Whatever goes wrong: within 0.1 s the plate is levelled or without volts, and why is said."""

import signal
from dataclasses import replace
from math import nan

import numpy as np
import pytest

from experiments.runs.assemble import known
from rig.loop.commands import CommandSlot, Stop, Target
from rig.loop.loop import Ending, ending_of
from rig.loop.signals import stop_on_signals
from rig.operator import Operator
from rig.safety.levelling import LEVEL_LIMIT_V
from rig.safety.monitor import MonitorLimits
from tests.support.faulty_table import FAULT_S, TABLE, FaultyTable, run
from vision.frames import Observation


def moved(reading, x_rad):
    return replace(reading, theta_rad=(reading.theta_rad[0] + x_rad, reading.theta_rad[1]))


def old(exposed_s):
    return Observation((0.0, 0.0), (1e-8, 0.0, 1e-8), exposed_s)


FAULTS = {
    "encoder jump": lambda reading: moved(reading, 0.3),
    "no number": lambda reading: moved(reading, nan),
    "link silent": lambda reading: replace(reading, t_s=FAULT_S - 0.002),
    "late loop": lambda reading: replace(reading, t_s=reading.t_s + 0.2),
    "camera stall": lambda reading: replace(reading, ball=old(reading.t_s - 0.6)),
}


@pytest.mark.parametrize("name", FAULTS)
def test_each_fault_ends_the_run_by_its_name_in_time(name: str):
    table = FaultyTable(FAULTS[name])
    ending, rows = run(table)
    assert ending.outcome == name
    assert ending.reason
    safe(table, FAULT_S, level=ending.level)
    assert all(np.isfinite(row[0]) for row in rows)
    assert np.all(np.diff([row[0] for row in rows]) > 0)


def safe(table: FaultyTable, since_s: float, *, level: bool) -> None:
    """0 V or weak volts towards level from 0.1 s after the fault at the latest; 0 V in the end."""
    assert table.closed
    assert table.driven[-1][1:] == (0.0, 0.0)
    after = np.array([v for t, *v in table.driven if t > since_s + 0.1])
    if not level:
        assert not np.any(after)
        assert not np.any([v for t, *v in table.driven if t > since_s + 0.002])
    else:
        assert np.abs(after).max() <= LEVEL_LIMIT_V
        assert np.all(np.abs(table.arm()) < 0.03)


def test_a_blocked_servo_is_a_stall_and_gets_no_volts():
    stuck: list = []

    def spoil(reading):
        stuck.append(reading.theta_rad)
        return replace(reading, theta_rad=stuck[0])

    table, slot = FaultyTable(spoil), CommandSlot()

    def keep(row):
        if row[0] >= FAULT_S:
            slot.put(Target((0.13, -0.13)))  # far: the controller asks for much

    ending, rows = run(table, keep=keep, commands=slot)
    assert ending.outcome == "stall"
    assert "is it blocked, unplugged, reversed?" in ending.reason
    strong = [row[0] for row in rows if row[0] > FAULT_S and max(abs(row[1:3])) >= 2.0]
    assert rows[-1][0] - strong[0] < 0.12  # as long as a healthy one may take to cross its play
    safe(table, rows[-1][0], level=False)


def test_an_arm_that_runs_away_ends_the_run():
    """The amplifier fails for a while and gives 6 V whatever it is told."""

    class Failing(FaultyTable):
        def drive(self, volts):
            self.driven.append((self.t_s, *volts))
            failed = FAULT_S <= self.t_s < FAULT_S + 0.12
            self.inner.drive((6.0, 0.0) if failed else volts)

    table = Failing()
    ending, rows = run(table)
    assert ending.outcome in ("limit", "stall")
    assert rows[-1][0] < FAULT_S + 0.15
    safe(table, rows[-1][0], level=ending.level)


class BangError(Exception):
    outcome = "link lost"


@pytest.mark.parametrize(
    "error",
    [
        ValueError("a mistake"),
        BangError("gone"),
        KeyboardInterrupt(),
        SystemExit(128 + signal.SIGTERM),  # of `rig.loop.signals.leave_on_signals`
        SystemExit(3),
    ],
    ids=str,
)
def test_an_exception_anywhere_in_a_tick_leaves_no_volts(error: BaseException):
    class Bad(Operator):
        def act(self, reading, wanted_m_s2):
            if reading.t_s >= FAULT_S:
                raise error
            return wanted_m_s2

    table = FaultyTable()
    with pytest.raises(type(error)):
        run(table, operator=Bad())
    first = next(v for t, *v in table.driven if t >= FAULT_S)
    assert first == [0.0, 0.0]
    safe(table, FAULT_S, level=True)
    told = ending_of(error)
    outcomes = {ValueError: "aborted", BangError: "link lost", KeyboardInterrupt: "interrupted"}
    ended = "interrupted" if str(error) == "143" else "aborted"
    assert told.outcome == outcomes.get(type(error), ended)
    assert (told.reason == "SIGTERM from the system") == (str(error) == "143")


def test_a_table_that_cannot_be_driven_any_more_tells_its_first_error():
    table = FaultyTable()

    def spoil(reading):
        def gone(volts):
            raise OSError("not driven")

        table.drive = gone  # type: ignore[method-assign]
        raise BangError("cable out")

    table.spoil = spoil
    with pytest.raises(OSError, match="not driven"):  # of the levelling; the first is its context
        run(table)
    assert table.closed


def test_a_controller_that_asks_for_no_number_ends_the_run(monkeypatch: pytest.MonkeyPatch):
    from rig.loop import loop

    def spoiled(state, q, row, target, applied, commanded, tick=loop.control_tick):
        tick(state, q, row, target, applied, commanded)
        if row[0] >= FAULT_S:
            commanded[1] = nan

    monkeypatch.setattr(loop, "control_tick", spoiled)
    table = FaultyTable()
    ending, rows = run(table)
    assert (ending.outcome, ending.level) == ("no number", True)
    assert rows[-1][2] == 0.0
    safe(table, FAULT_S, level=True)


def test_the_operators_stop_and_a_signal_end_the_run():
    for kind in ("stop", "SIGTERM"):
        slot, table = CommandSlot(), FaultyTable()

        def keep(row, kind=kind, slot=slot):
            if row[0] >= FAULT_S:
                if kind == "stop":
                    slot.put(Stop("the operator's button"))
                else:
                    signal.raise_signal(signal.SIGTERM)

        before = signal.getsignal(signal.SIGTERM)
        with stop_on_signals(slot, leave=False):
            ending, _ = run(table, keep=keep, commands=slot)
        assert signal.getsignal(signal.SIGTERM) is before
        expected = {
            "stop": Ending("aborted", "the operator's button"),
            "SIGTERM": Ending("interrupted", "SIGTERM from the system"),
        }
        assert ending == expected[kind]
        safe(table, FAULT_S, level=True)


def test_a_stop_in_the_tick_of_an_encoder_jump_does_not_level_by_that_encoder():
    slot = CommandSlot()

    def spoil(reading):
        slot.put(Stop("the operator's button"))
        return moved(reading, 0.3)

    table = FaultyTable(spoil)
    ending, _ = run(table, commands=slot)
    assert ending.outcome == "encoder jump"
    safe(table, FAULT_S, level=False)


def test_a_signal_ends_the_program_after_the_run():
    def work() -> None:
        with stop_on_signals(CommandSlot()):
            signal.raise_signal(signal.SIGTERM)

    with pytest.raises(SystemExit) as caught:
        work()
    assert caught.value.code == 128 + signal.SIGTERM


def test_late_ticks_by_the_wall_clock_take_the_volts_and_then_the_run():
    lateness = iter([0.0] * 300 + [0.06, 0.0, 0.2])
    table = FaultyTable()
    ending, rows = run(table, late_s=lambda: next(lateness))
    assert ending.outcome == "late loop"
    assert [bool(np.any(row[1:3])) for row in rows[-4:]] == [True, False, True, False]
    safe(table, rows[-1][0], level=True)


@pytest.mark.parametrize("seconds", [0.0, 0.4, 0.8])
@pytest.mark.parametrize("axis", [0, 1])
def test_an_encoder_that_freezes_while_the_ball_is_balanced_is_seen_before_the_arm_is_far(
    seconds: float, axis: int
):
    """By 2 V alone it came after 0.45 to 1.7 s, the arm at its stop."""
    kept: list[float] = []

    def freeze(reading):
        if reading.t_s < FAULT_S + seconds:
            return reading
        kept.append(reading.theta_rad[axis])
        theta = list(reading.theta_rad)
        theta[axis] = kept[0]
        return replace(reading, theta_rad=(theta[0], theta[1]))

    class Followed(FaultyTable):
        widest_rad = 0.0

        def read(self):
            self.widest_rad = max(self.widest_rad, abs(float(self.arm()[axis])))
            return super().read()

    table = Followed(freeze)
    breakaway_V = ((0.3, 0.09), (0.22, 0.08))  # as rig home finds on this table
    ending, _ = run(table, limits=MonitorLimits.of_rig(known(TABLE), breakaway_V))
    assert (ending.outcome, ending.level) == ("stall", False)
    assert f"servo {'xy'[axis]} stands still" in ending.reason
    assert table.widest_rad < 0.35
    assert table.driven[-1][1:] == (0.0, 0.0)
