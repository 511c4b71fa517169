"""The host's end of a pulse board: angles, limits, three arms, and how it says what went wrong."""

from dataclasses import replace
from itertools import product
from math import inf, nan, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.runs.assemble import load_rig
from rig.hardware.board import wire
from rig.hardware.board.board import BoardTable
from rig.hardware.board.link import LinkLost
from rig.hardware.board.open_pulses import open_pulse_board
from rig.hardware.board.pulse_servo import PulseServo
from rig.hardware.board.pulse_table import PulseTable
from rig.hardware.board.session import BoardStopped
from rig.parameters import Rig, Servo
from rig.plant.ball import tilt_sines
from rig.three_arms import arm_angle
from tests.support import ROOT
from tests.support.boards.host import HostBoard, HostPulseBoard
from tests.support.boards.world import PulseWorld, World, WorldLink, pulse_table_on

PLAIN, TURNED = PulseServo(), PulseServo(1440.0, -500.0, 900.0, 2100.0)
RIG = Rig(servo=Servo(kind="position", angle_limit_rad=0.6, rate_limit_rad_s=5.0))
HALF_US = 0.5


def opened(
    *servos: PulseServo, rig: Rig = RIG, board: HostPulseBoard | None = None, **more
) -> tuple[PulseWorld, PulseTable]:
    world = PulseWorld(board or HostPulseBoard(), RIG, (PLAIN, TURNED))
    link = WorldLink(world)
    servos = servos or (PLAIN, TURNED)
    return world, open_pulse_board(link, rig, servos, clock=link.clock, **more)


def hold(table: PulseTable, seconds: float, *angles: float) -> None:
    for _ in range(round(seconds / table.period_s)):
        table.read()
        table.drive((angles[0], angles[1]))


@given(st.floats(-0.6, 0.6), st.floats(-900, 900).filter(lambda k: abs(k) >= 10))
def test_a_pulse_and_its_angle_are_each_others_inverse(angle: float, us_per_rad: float):
    servo = PulseServo(us_per_rad=us_per_rad)
    assert servo.angle_rad(servo.pulse_us(angle)) == pytest.approx(angle, abs=1e-9)
    assert PulseServo().pulse_us(pi / 4) == pytest.approx(2000.0)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_angles_come_out_as_pulses_and_none_is_read_back(order: tuple[int, int]):
    _, table = opened(order=order)
    with table:
        hold(table, 0.3, 0.25, -0.4)
        reading = table.read()
        table.drive((0.25, -0.4))
        assert np.isnan(reading.theta_rad).all()
        assert table.takes_angle
        a, b = (-0.4, 0.25) if order == (1, 0) else (0.25, -0.4)
        right = (PLAIN.pulse_us(a), TURNED.pulse_us(b))
        assert table.pulses_us == pytest.approx(right, abs=HALF_US)


def test_angles_beyond_the_limit_are_cut_there():
    _, table = opened()
    with table:
        hold(table, 0.4, 5.0, -5.0)
        right = (PLAIN.pulse_us(0.6), TURNED.pulse_us(-0.6))
        assert table.pulses_us == pytest.approx(right, abs=HALF_US)


def test_the_board_itself_cuts_what_a_wrong_program_asks():
    world, table = opened()
    table.arm()
    for k in range(200):
        world.board.receive(wire.encode(wire.PulseCommand(60_000 + k, 32_767, -32_768)))
        world.step()
        pulses = world.board.pulses_us()
        assert PLAIN.lowest_us <= pulses[0] <= PLAIN.pulse_us(0.6) + HALF_US
        assert TURNED.pulse_us(0.0) - HALF_US <= pulses[1] <= TURNED.pulse_us(-0.6) + HALF_US


@pytest.mark.parametrize("angles", [(nan, 0.0), (0.0, inf), (-inf, nan)])
def test_angles_that_are_none_are_refused(angles):
    _, table = opened()
    with table, pytest.raises(ValueError, match="angles must be finite"):
        table.drive(angles)


def test_angles_need_an_armed_board_and_give_no_pulse_without():
    world, table = opened()
    table.drive((0.0, 0.0))
    with pytest.raises(ValueError, match="not armed"):
        table.drive((0.1, 0.0))
    world.run(0.2)
    assert world.board.pulses_us() == (0.0, 0.0, 0.0)


def test_leaving_levels_before_the_pulses_end():
    world, table = opened()
    seen = []
    world.watch = lambda: seen.append(world.board.pulses_us()[0])
    with table:
        hold(table, 0.3, 0.5, 0.0)
        seen.clear()
    levelled = [pulse for pulse in seen if pulse]
    assert levelled[0] == pytest.approx(PLAIN.pulse_us(0.5), abs=4)
    assert levelled[-200:] == [1500.0] * 200
    assert max(-np.diff(levelled)) <= PLAIN.us_per_rad * 5.0e-3 + HALF_US
    assert world.board.pulses_us() == (0.0, 0.0, 0.0)


def test_a_program_that_was_silent_is_told_so():
    world, table = opened()
    table.arm()
    hold(table, 0.3, 0.3, 0.3)
    world.run(0.15)
    with pytest.raises(BoardStopped, match="no command for 100 ms"):
        hold(table, 0.1, 0.3, 0.3)
    table.close()
    world.run(1.0)
    assert world.board.pulses_us() == (0.0, 0.0, 0.0)


def test_a_board_that_was_reset_is_lost_and_quiet():
    world, table = opened()
    table.arm()
    hold(table, 0.2, 0.3, 0.3)
    world.board.reset()
    with pytest.raises(LinkLost, match="silent"):
        hold(table, 0.3, 0.3, 0.3)
    table.close()
    assert world.board.pulses_us() == (0.0, 0.0, 0.0)


def test_a_volt_program_and_a_pulse_board_refuse_each_other_in_a_line():
    world = PulseWorld(HostPulseBoard(), RIG, (PLAIN, TURNED))
    link = WorldLink(world)
    with pytest.raises(LinkLost, match=r"drives servos by pulses.*make flash") as told:
        BoardTable(link, clock=link.clock)
    assert "\n" not in str(told.value)
    assert link.closed
    link = WorldLink(World(HostBoard(), Rig()))
    with pytest.raises(LinkLost, match=r"drives motors by volts.*flash-servo"):
        open_pulse_board(link, RIG, (PLAIN, TURNED), clock=link.clock)


def test_another_version_is_refused(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(wire, "VERSION", 9)
    with pytest.raises(LinkLost, match=r"speaks version 4.*this program 9: flash"):
        opened()


def test_an_armed_pulse_board_obeys_no_volts():
    world, table = opened()
    table.arm()
    for k in range(150):
        world.board.receive(wire.encode(wire.Command(60_000 + k, 100, 6000, 6000)))
        world.step()
    assert world.board.pulses_us()[:2] == (1500.0, 1440.0)


SERVO = RIG.servo


@pytest.mark.parametrize(
    ("servo", "why"),
    [
        (replace(SERVO, angle_limit_rad=0.9), r"angle of 0\.900 rad .* pulses from 927 to 2073 us"),
        (replace(SERVO, rate_limit_rad_s=0.01), r"rate_limit_rad_s = 0\.01: a board takes 0\.1 to"),
        (replace(SERVO, rate_limit_rad_s=1e4), r"rate_limit_rad_s = 10000"),
        (replace(SERVO, period_s=0.003), r"servo\.period_s = 0\.003: pulses come every"),
        (replace(SERVO, period_s=0.03), r"servo\.period_s = 0\.03"),
        (replace(SERVO, x={"period_s": 0.01}), "pulses have one frame"),
        (Servo(), "servos on pulses take an angle"),
    ],
)
def test_what_no_servo_can_do_is_one_line_and_the_link_is_let_go(servo: Servo, why: str):
    link = WorldLink(PulseWorld(HostPulseBoard(), RIG, (PLAIN, TURNED)))
    with pytest.raises(ValueError, match=why) as told:
        open_pulse_board(link, replace(RIG, servo=servo), (PLAIN, TURNED))
    assert "\n" not in str(told.value)
    assert link.closed


@pytest.mark.parametrize(
    "numbers",
    [
        {"lowest_us": 400.0}, {"highest_us": 2600.0}, {"lowest_us": 2000.0}, {"lowest_us": nan},
        {"us_per_rad": 0.0}, {"us_per_rad": nan}, {"us_per_rad": 4000.0}, {"highest_us": inf},
    ],
)  # fmt: skip
def test_a_servo_that_no_board_drives_is_refused(numbers):
    with pytest.raises(ValueError, match=r"pulses from|us_per_rad"):
        PulseServo(**numbers)


# --- three arms ---
ARMS_RIG = load_rig(ROOT / "experiments/rigs/three-arms.toml")
ARM = PulseServo(us_per_rad=-450.0, lowest_us=600.0, highest_us=2400.0)


def test_three_arms_hold_the_plate_at_the_tilt():
    board = HostPulseBoard(servos=3)
    world, table = opened(ARM, ARM, ARM, rig=ARMS_RIG, board=board)
    height, size = ARMS_RIG.linkage.height_m, ARMS_RIG.linkage.size
    limit = ARMS_RIG.servo.angle_limit_rad
    world._drive = lambda: board.run_ms()  # its plant has two rods
    with table:
        for x, y in product((-limit, 0.4 * limit, limit), repeat=2):
            hold(table, 0.4, x, y)
            s_x, s_y = tilt_sines((x, y), 1.0)
            turned = [
                arm_angle(i, s_x, s_y, height, size) - arm_angle(i, 0.0, 0.0, height, size)
                for i in range(3)
            ]
            right = [ARM.pulse_us(angle) for angle in turned]
            assert table.pulses_us == pytest.approx(right, abs=HALF_US)
            assert table.newest is not None
            assert not table.newest.flags & wire.LIMITED


def test_three_arms_need_a_board_with_three_pins():
    with pytest.raises(LinkLost, match=r"two servo pins; three arms take an Arduino Mega"):
        opened(ARM, ARM, ARM, rig=ARMS_RIG)
    with pytest.raises(ValueError, match="2 servos on pulses, the linkage has 3"):
        opened(ARM, ARM, rig=ARMS_RIG)
    with pytest.raises(ValueError, match="3 servos on pulses, the linkage has 2"):
        opened(ARM, ARM, ARM)


def test_a_link_over_which_everything_is_lost_does_not_answer():
    world = PulseWorld(HostPulseBoard(), RIG, (PLAIN, TURNED))
    world.board.take = lambda: b""
    with pytest.raises(LinkLost, match="does not answer"):
        pulse_table_on(world, RIG)
