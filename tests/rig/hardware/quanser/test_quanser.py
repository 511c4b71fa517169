"""The Quanser driver against a stand-in of the vendor's module; no card was ever there."""

import sys
import time
from dataclasses import replace

import numpy as np
import pytest

from experiments.runs.assemble import known, load_rig
from rig.control.controllers import COMPENSATORS
from rig.course import Course
from rig.hardware.board.link import LinkLost
from rig.hardware.quanser import quanser
from rig.hardware.quanser.quanser import QuanserTable
from rig.hardware.wiring import Wiring
from rig.loop.loop import Loop
from rig.parameters import Rig, TableChoice
from rig.simulation.operator import SimulatedOperator
from rig.simulation.simulator import SimulatedTable
from tests.support.hardware import contract
from tests.support.hardware.quanser_card import Bench, install

pytestmark = pytest.mark.realtime

CLEAN = Rig(table=TableChoice(kind="quanser"))


@pytest.fixture(scope="module", autouse=True)
def _compiled():
    table = SimulatedTable(CLEAN, np.random.default_rng(1))
    for _ in range(20):  # to the first frame: compiles now, not while somebody waits for a tick
        table.read()


@pytest.fixture(autouse=True)
def _patient(monkeypatch):
    """The stand-in takes no time; a busy machine may halt this process all the same."""
    monkeypatch.setattr(quanser, "PATIENCE_S", 5.0)


def bench(rig: Rig = CLEAN, **settings) -> Bench:
    return Bench(SimulatedTable(rig, np.random.default_rng(1)), **settings)


@pytest.fixture
def card(monkeypatch) -> Bench:
    return install(monkeypatch, bench())


def opened(one: Bench, rig: Rig = CLEAN, wiring: Wiring | None = None) -> QuanserTable:
    return QuanserTable(rig, wiring or Wiring(), eye=one, clock=one.clock)


def test_the_order_of_start_up_and_shut_down(card: Bench):
    options = replace(CLEAN, table=replace(CLEAN.table, card_options="led=auto"))
    with opened(card, options) as table:
        assert card.calls == [
            "open", "is_valid", "options", "watchdog_clear", "write_analog", "watchdog_state",
            "quadrature", "create", "start", "watchdog_start",
        ]  # fmt: skip
        table.read()
        table.drive((2.0, -1.0))
        table.read()
        assert list(card.outputs) == [2.0, -1.0]
    assert card.calls[-5:] == ["write_analog", "stop", "delete", "watchdog_stop", "close"]
    assert not card.outputs.any()


def test_motor_volts_are_clamped_and_divided_by_the_amplifiers_gain(monkeypatch):
    rig = replace(CLEAN, table=replace(CLEAN.table, amplifier_gain=3.0))
    one = install(monkeypatch, bench(gain=3.0))
    with opened(one, rig) as table:
        assert table.voltage_limit_V == 6.0
        table.read()
        table.drive((60.0, -3.0))
        table.read()
        assert list(one.outputs) == [2.0, -1.0]
        assert one.motor_V == (6.0, -3.0)
        with pytest.raises(ValueError, match="finite"):
            table.drive((float("nan"), 0.0))


@pytest.mark.parametrize("swap", [False, True])
@pytest.mark.parametrize("volts", [(1, 1), (-1, 1)])
@pytest.mark.parametrize("counts", [(1, 1), (1, -1)])
@pytest.mark.parametrize("axis", [0, 1])
def test_the_contract_holds_whatever_the_wiring(monkeypatch, swap, volts, counts, axis):
    one = install(monkeypatch, bench(swap=swap, volt_signs=volts, count_signs=counts))
    one.offset = np.array([500, -300])
    wiring = Wiring((1, 0) if swap else (0, 1), volts, counts, (500, -300))
    ball, times = (0.0, 0.0), []
    with opened(one, wiring=wiring) as table:
        reading = table.read()
        for _ in range(250):
            reading = table.read()
            times.append(reading.t_s)
            push = 2.0 if reading.theta_rad[axis] < 0.2 else 0.0
            table.drive((push, 0.0) if axis == 0 else (0.0, push))
            if reading.ball is not None:
                assert reading.ball.exposed_s + CLEAN.camera.delay_s <= reading.t_s + 1e-9
                ball = reading.ball.xy_m
            assert reading.motor_speed_rad_s == pytest.approx(one.reading.motor_speed_rad_s)
        assert reading.theta_rad[axis] > 0.1
        assert abs(reading.theta_rad[1 - axis]) < 0.01
    assert ball[axis] > 0.005
    assert np.all(np.diff(times) > 0)
    assert np.allclose(np.diff(times), table.period_s, atol=1e-4)
    assert np.all(np.abs(one.table.truth()["arm_rad"]) < 0.03)  # level again


def test_a_call_that_hangs_is_a_lost_card(monkeypatch):
    one = install(monkeypatch, bench())
    monkeypatch.setattr(quanser, "PATIENCE_S", 0.09)
    contract.a_dead_link_raises_by_name(
        opened(one), lambda: one.hangs.add("task_read"), time.monotonic, LinkLost,
        "Quanser card q2_usb 0", slack_s=0.1,
    )  # fmt: skip


def test_without_tachometers_none_are_read(card: Bench):
    rig = replace(CLEAN, servo=replace(CLEAN.servo, tachometer=False))
    with opened(card, rig) as table:
        assert table.read().motor_speed_rad_s is None
    assert "read_analog" not in card.calls


def test_a_whole_protocol_balances_the_ball_through_the_card(monkeypatch):
    rig = replace(load_rig(None), table=TableChoice(kind="quanser"))
    n = round(12 / 0.002)
    course = Course(np.zeros((n, 2)), np.zeros((n, 2)), (-0.1, 0.1), 0.5)
    plant = SimulatedTable(rig, np.random.default_rng(3), start_m=course.start_m, held=True)
    one = install(monkeypatch, Bench(plant))
    rows = []
    with opened(one, rig) as table:
        ending = Loop(
            table, known(rig), COMPENSATORS["with"], course, operator=SimulatedOperator(plant, 0.5),
            keep=lambda row: rows.append(row.copy()),
        ).run()  # fmt: skip
    assert ending.outcome == "completed"
    assert np.hypot(*plant.truth()["ball_m"]) < 0.02
    assert len(rows) > n


def test_a_hung_program_is_cut_off_by_the_watchdog_and_told(card: Bench):
    def hang() -> None:
        with opened(card) as table:
            table.read()
            table.drive((2.0, 0.0))
            for _ in range(52):  # ticks without a command
                table.read()
            assert card.motor_V == (0.0, 0.0)
            table.drive((2.0, 0.0))
            table.read()

    with pytest.raises(LinkLost, match="watchdog expired"):
        hang()
    assert not card.outputs.any()
    assert card.calls[-1] == "close"


@pytest.mark.parametrize("call", ["task_read", "write_analog", "watchdog_reload", "read_analog"])
def test_an_error_of_the_sdk_is_one_line_and_everything_is_shut_down(card: Bench, call: str):
    def fail() -> None:
        with opened(card) as table:
            table.read()
            table.drive((2.0, 0.0))
            card.fails[call] = "The device was\nremoved (-43)"
            for _ in range(3):
                table.read()
                table.drive((2.0, 0.0))

    with pytest.raises(LinkLost, match=r"Quanser card q2_usb 0: The device") as caught:
        fail()
    assert "\n" not in str(caught.value)
    assert card.calls[-5:] == ["write_analog", "stop", "delete", "watchdog_stop", "close"]


def test_a_call_that_never_returns_is_given_up_within_100_ms(card: Bench, monkeypatch):
    table = opened(card)
    table.read()
    card.hangs.add("task_read")
    monkeypatch.setattr(quanser, "PATIENCE_S", 0.09)
    begin = time.monotonic()
    with pytest.raises(LinkLost, match="no answer for 90 ms"):
        table.read()
    assert time.monotonic() - begin < 0.1 + 0.1  # the machine's own lateness
    begin = time.monotonic()
    with pytest.raises(LinkLost):
        table.drive((0.0, 0.0))
    table.close()
    assert time.monotonic() - begin < 0.05


def test_a_late_loop_reads_over_what_it_missed(card: Bench):
    with opened(card) as table:
        first = table.read()
        card.t_s += 0.011  # five ticks and a half went by
        assert table.read().t_s == pytest.approx(first.t_s + 5 * table.period_s, abs=2e-3)


def test_no_sdk_no_card_no_watchdog_are_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "quanser", None)
    with pytest.raises(LinkLost, match="rig serve"):
        QuanserTable(CLEAN, Wiring())
    one = install(monkeypatch, bench())
    one.fails["open"] = "The specified board could not be found"
    with pytest.raises(LinkLost, match=r"could not be found .*plugged in"):
        opened(one)
    one = install(monkeypatch, bench(), without=("watchdog_reload",))
    with pytest.raises(LinkLost, match="no watchdog_reload"):
        opened(one)
    assert one.calls[-1] == "close"


def test_counters_can_be_marked(card: Bench):
    with opened(card) as table:
        table.read()
        table.shift_counts((9000, -9000))
        reading = table.read()
        assert reading.theta_rad == pytest.approx((13.81, -13.81), abs=0.01)
        table.shift_counts((-9000, 9000))
