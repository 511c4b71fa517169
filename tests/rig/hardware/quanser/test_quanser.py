"""The Quanser driver against a stand-in of the vendor's module; no card was ever there."""

import sys
import time
from dataclasses import replace
from math import degrees

import numpy as np
import pytest

from experiments.runs.assemble import known, load_rig
from rig.control.controllers import COMPENSATORS
from rig.course import Course
from rig.hardware.board.link import LinkLost
from rig.hardware.quanser import quanser
from rig.hardware.quanser.quanser import QuanserTable
from rig.hardware.wiring import Wiring
from rig.loop.commands import CommandSlot, Stop
from rig.loop.loop import Loop
from rig.parameters import Gains, Rig, Servo, TableChoice
from rig.safety.limits import CATCH_TAUS
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


def test_a_program_that_is_slow_before_its_first_volts_is_not_cut_off(card: Bench):
    with opened(card) as table:
        for _ in range(30):  # its homing is checked, a camera waited for
            table.read()
        assert card.expired
        table.drive((0.0, 0.0))
        for _ in range(5):
            table.read()
            table.drive((2.0, 0.0))
        assert card.motor_V == (2.0, 0.0)
        assert not card.expired


def test_a_program_that_hung_is_told_until_the_arms_rest_and_then_cut_off(card: Bench):
    told: list[str] = []

    def hang() -> None:
        with opened(card) as table:
            table.read()
            table.drive((2.0, 0.0))
            for _ in range(52):  # ticks without a command
                table.read()
            assert card.motor_V == (0.0, 0.0)
            while True:
                table.drive((-1.0, 0.0))
                told.append(table.read().lost)
                assert card.motor_V == (-1.0, 0.0)

    with pytest.raises(LinkLost, match="watchdog expired"):
        hang()
    assert all("Quanser card q2_usb 0: its watchdog expired" in one for one in told)
    rest_s = quanser.REST_S + CATCH_TAUS * CLEAN.servo.time_constant_s
    assert len(told) == pytest.approx(rest_s / 0.002, abs=2)
    assert not card.outputs.any()
    assert card.calls[-1] == "close"


def test_a_second_expiry_ends_it_at_0_v(card: Bench):
    table = opened(card)
    table.read()
    for _ in range(2):
        table.drive((2.0, 0.0))
        table.read()
        card.hold_up(12)
        table.read()
    table.drive((2.0, 0.0))
    with pytest.raises(LinkLost, match="watchdog expired"):
        table.read()
    assert not card.outputs.any()
    assert card.calls.count("watchdog_clear") == 2  # with that of the start
    with pytest.raises(LinkLost, match="watchdog expired"):
        table.drive((2.0, 0.0))
    table.close()


def test_a_card_that_somebody_else_stopped_gets_no_volts_any_more(card: Bench):
    table = opened(card)
    table.read()
    table.drive((2.0, 0.0))
    table.read()
    card.expired, card.outputs = True, np.zeros(2)  # this program was in time
    table.drive((2.0, 0.0))
    with pytest.raises(LinkLost, match="watchdog expired"):
        table.read()
    assert not card.outputs.any()
    assert card.calls.count("watchdog_clear") == 1
    table.close()


def test_a_card_that_does_not_come_back_is_lost_at_once(card: Bench):
    table = opened(card)
    table.read()
    table.drive((2.0, 0.0))
    table.read()
    card.hold_up(12)
    card.fails["watchdog_clear"] = "The device was removed (-43)"
    table.read()
    table.drive((2.0, 0.0))
    with pytest.raises(LinkLost, match="removed"):
        table.read()
    assert not card.outputs.any()
    table.close()


def thrown(monkeypatch, tau_s: float, pause: int, at_s: float, stop: bool = False):
    """Full volts throw both arms from limit to limit from 0.4 s on; the program hangs at `at_s` for
    so many ticks, and is stopped as it comes back. How far [degrees] beyond its limit an arm went,
    and the ending."""
    servo = Servo(time_constant_s=tau_s)
    gains, choice = Gains(servo_proportional_V_rad=1e4), TableChoice("quanser", amplifier_gain=3.0)
    rig = Rig(servo=servo, gains=gains, table=choice)
    one = install(
        monkeypatch, Bench(SimulatedTable(rig, np.random.default_rng(1), held=True), gain=3.0)
    )
    wild = np.where(np.arange(600)[:, None] < 200, -30.0, 30.0) * np.ones((600, 2))
    slot, table = CommandSlot(), opened(one, rig)

    def keep(row: np.ndarray) -> None:
        if row[0] >= at_s > row[0] - 0.002:
            table._thread.call(lambda: None, patience_s=5.0)  # the volts of this tick are out
            one.hold_up(pause)
            if stop:
                slot.put(Stop("the operator's button"))

    course = Course(wild, np.zeros((600, 2)), (0.0, 0.0), 0.0, True)
    with table:
        ending = Loop(table, rig, 0, course, keep=keep, commands=slot).run()
    assert not one.outputs.any()
    assert np.all(np.abs(one.table.truth()["arm_rad"]) < 0.03)  # level
    return degrees(one.widest_rad - servo.angle_limit_rad), ending


@pytest.mark.parametrize("stop", [False, True])
@pytest.mark.parametrize("pause", [12, 20])
@pytest.mark.parametrize("tau_s", [0.025, 0.046])
def test_arms_in_flight_are_braked_after_a_pause(monkeypatch, tau_s: float, pause: int, stop: bool):
    """They coasted on, to 1.6 degrees beyond their limit (0.025 s), and into the stop, 5 degrees
    beyond, at 2 rad/s (0.046 s)."""
    for k in range(6):
        far, ending = thrown(monkeypatch, tau_s, pause, 0.444 + 0.018 * k, stop)
        assert far < 0.5
        assert ending.level
        if stop:
            assert ending.outcome == "aborted"
        else:
            assert ending.outcome == "link lost"
            assert "its watchdog expired" in ending.reason


def test_a_pause_of_a_tenth_of_a_second_ends_level_as_well(monkeypatch):
    _, ending = thrown(monkeypatch, 0.046, 60, 0.5)
    assert (ending.outcome, ending.level) == ("late loop", True)


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
