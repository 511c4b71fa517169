"""What the board does by itself, and what its driver makes of it; all in lock step."""

from collections.abc import Iterator
from dataclasses import replace
from math import inf, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig.hardware.board import wire
from rig.hardware.board.board import TACHOMETER_RAD_S_V, BoardTable
from rig.hardware.board.link import LinkLost
from rig.hardware.board.session import BoardStopped
from rig.hardware.board.wire import (
    VERSION,
    Arm,
    Command,
    ConfigAnswer,
    ConfigRequest,
    Disarm,
    Parser,
    PulseCommand,
    Telemetry,
)
from rig.hardware.camera.eye import CameraStopped
from rig.hardware.wiring import Wiring
from rig.parameters import Rig
from rig.safety.limits import Braking, limit
from tests.support.boards.host import HostBoard, library
from tests.support.boards.world import World, WorldLink, table_on

LIMIT = 341  # counts of 30 degrees
STEP_RAD = 2 * pi / 4096
SIGNS = st.tuples(st.sampled_from([-1, 1]), st.sampled_from([-1, 1]))
COUNTS = st.tuples(st.integers(-1000, 1000), st.integers(-1000, 1000))
WIRINGS = st.builds(
    Wiring, order=st.sampled_from([(0, 1), (1, 0)]), sign_volts=SIGNS, sign_angle=SIGNS,
    zero_counts=COUNTS, crossed=st.booleans(),
)  # fmt: skip


class Bench:
    """protocol.c on the bench: packets in, a millisecond at a time."""

    def __init__(self, *, homed: bool = True, armed: bool = True, zeros=(0, 0)) -> None:
        self.board, self.parser, self.counts = HostBoard(), Parser(), zeros
        self.newest = Telemetry(0, 0, 0, 0, 0, 0, 0, 0)
        self.sequence = 500
        self.request = ConfigRequest(VERSION, 7, 1, int(homed), *zeros, 4096, LIMIT, 6000)
        self.configure()
        if armed:
            self.send(Arm(self.token, self.sequence))
            self.run(1)

    def configure(self) -> None:
        self.send(self.request)
        self.token = next(p.token for p in self.run(1) if isinstance(p, ConfigAnswer))

    def send(self, packet) -> None:
        self.board.receive(wire.encode(packet))

    def command(self, x: float, y: float = 0.0, *, ttl_ms: int = 20, step: int = 1) -> None:
        self.sequence = (self.sequence + step) % 65536
        self.send(Command(self.sequence, ttl_ms, round(1000 * x), round(1000 * y)))

    def run(self, ms: int) -> list:
        found = []
        for _ in range(ms):
            self.board.run_ms(self.counts)
            found += self.parser.feed(self.board.take())
        for packet in found:
            self.newest = packet if isinstance(packet, Telemetry) else self.newest
        return found

    def has(self, *flags: int) -> bool:
        return all(self.newest.flags & flag for flag in flags)


# --- the board ---
def test_it_boots_quiet_and_disarmed():
    board = HostBoard()
    board.receive(wire.encode(Command(1, 100, 3000, 3000)))
    for _ in range(100):
        board.run_ms((0, 0))
        assert board.volts() == (0.0, 0.0)
    assert board.take() == b""


def test_it_arms_once_and_only_with_its_token():
    bench = Bench(armed=False)
    for token in (0, bench.token + 1, bench.token ^ 0x80000000):
        bench.send(Arm(token, 0))
        bench.run(1)
        assert not bench.has(wire.ARMED)
    bench.send(Arm(bench.token, 0))
    bench.run(1)
    assert bench.has(wire.ARMED)
    bench.send(Disarm())
    bench.send(Arm(bench.token, 0))
    bench.run(1)
    assert not bench.has(wire.ARMED)


def test_silence_levels_after_100_ms_then_0_volts_then_latched():
    bench = Bench()
    bench.counts = (60, -50)
    bench.run(10)  # at rest there
    bench.command(2.0, -2.0, ttl_ms=20)
    volts = []
    for _ in range(700):
        bench.run(1)
        volts.append(bench.board.volts())
    volts = np.array(volts)
    assert np.all(volts[:20] == (2.0, -2.0))  # its time to live
    assert np.all(volts[20:99] == 0.0)
    assert np.all(volts[100:590, 0] < -1.0)  # level lies the other way
    assert np.all(volts[100:590, 1] > 0.5)
    assert np.all(np.abs(volts) <= 3.0)
    assert np.all(volts[601:] == 0.0)
    assert bench.has(wire.LATCHED, wire.BY_WATCHDOG)
    bench.command(3.0)
    bench.send(Arm(bench.token, 0))
    bench.run(2)
    assert bench.board.volts() == (0.0, 0.0)
    assert bench.has(wire.LATCHED)
    bench.configure()  # a host that asks anew may arm anew
    bench.send(Arm(bench.token, 0))
    bench.run(1)
    assert bench.has(wire.ARMED)
    assert not bench.has(wire.LATCHED)


def test_old_and_doubled_commands_move_nothing_and_feed_no_watchdog():
    bench = Bench()
    bench.command(1.0)
    bench.run(5)
    for _ in range(200):
        for step in (0, -1, -300):
            bench.send(Command((bench.sequence + step) % 65536, 100, 5000, 5000))
        bench.run(1)
        assert abs(bench.board.volts()[0]) <= 1.0
    assert bench.has(wire.BY_WATCHDOG)


def test_angles_for_servos_move_no_motor_and_feed_no_watchdog():
    bench = Bench()
    bench.command(1.0)
    bench.run(5)
    for k in range(120):
        bench.send(PulseCommand((bench.sequence + 1 + k) % 65536, 9000, 9000))
        bench.run(1)
        assert abs(bench.board.volts()[0]) <= 1.0
    assert bench.has(wire.BY_WATCHDOG)


def test_sequence_numbers_wrap():
    bench = Bench()
    for k in range(70):
        bench.command(0.01 * k, step=1000)
        bench.run(1)
        assert bench.board.volts()[0] == pytest.approx(0.01 * k)


def test_the_newest_command_wins():
    bench = Bench()
    bench.command(1.0)
    bench.command(-2.0, 0.5)
    bench.run(1)
    assert bench.board.volts() == (-2.0, 0.5)


@pytest.mark.parametrize(("homed", "most"), [(True, 6.0), (False, 1.5)])
def test_volts_are_limited_on_the_board(homed: bool, most: float):
    bench = Bench(homed=homed)
    bench.command(30.0, -30.0)
    bench.run(1)
    assert bench.board.volts() == (most, -most)
    assert bench.has(wire.LIMITED)


def test_its_counts_are_those_of_the_last_homing_that_has_armed_it():
    bench = Bench(armed=False)
    bench.board.reset()

    def asked(wired: int, *, arm: bool = False, **more) -> ConfigAnswer:
        bench.send(replace(bench.request, wired=wired, zero_0=wired & 1 ^ 1, **more))
        (answer,) = (p for p in bench.run(1) if isinstance(p, ConfigAnswer))
        if arm:
            bench.send(Arm(answer.token, 5))
            bench.run(1)
            bench.send(Disarm())
            bench.run(600)
        return answer

    assert asked(0b1111, arm=True).homing == asked(0b1110).homing == 0
    assert asked(0, version=9, arm=True).homing == 0
    assert asked(0, counts_per_rev=63, arm=True).homing == 0
    first = asked(0b1110, arm=True)
    assert first.homing == 0  # it had armed nothing yet
    assert asked(0).homing == asked(1, arm=True).homing == asked(1).homing == first.token != 0
    second = asked(0, arm=True)
    assert asked(1).homing == second.token != first.token
    bench.board.reset()
    assert asked(1).homing == 0


def test_an_arm_that_is_blocked_on_its_way_to_level_gets_no_more_volts():
    bench = Bench()
    bench.counts = (200, 0)
    bench.run(20)
    bench.command(0.1)
    bench.run(110)
    assert bench.has(wire.LEVELLING)
    assert bench.board.volts() == (-3.0, 0.0)
    bench.run(310)
    assert bench.has(wire.LATCHED)
    assert bench.has(wire.BY_STALL)
    assert bench.board.volts() == (0.0, 0.0)


def test_without_a_zero_no_angle_is_too_far_and_what_is_let_through_is_not_called_limited():
    bench = Bench(homed=False)
    bench.counts = (3 * LIMIT, -3 * LIMIT)
    bench.run(20)
    bench.command(1.0, -0.5)
    bench.run(2)
    assert bench.board.volts() == (1.0, -0.5)
    assert bench.has(wire.ARMED)
    assert not bench.has(wire.LIMITED)


@pytest.mark.parametrize("wired", [1, 3, 5, 7, 9, 15])
def test_volts_come_out_as_asked_whatever_the_polarity(wired: int):
    bench = Bench(armed=False)
    bench.request = replace(bench.request, wired=wired)
    bench.configure()
    bench.send(Arm(bench.token, bench.sequence))
    bench.command(1.5, -0.75)
    bench.run(1)
    assert bench.board.volts() == (1.5, -0.75)


def test_without_a_zero_it_does_not_level():
    bench = Bench(homed=False)
    bench.counts = (200, 200)
    bench.command(1.0)
    bench.run(150)
    assert bench.has(wire.LEVELLING)
    assert bench.board.volts() == (0.0, 0.0)


@pytest.mark.parametrize("sign", [-1, 1])
def test_beyond_the_limit_only_volts_that_lead_back_pass(sign: int):
    bench = Bench(zeros=(900, 900))
    bench.counts = (900 + sign * (LIMIT + 16), 900)
    for _ in range(200):  # until its speed is that of an arm at rest
        bench.command(3.0 * sign, 1.0)
        bench.run(1)
    assert bench.board.volts() == (pytest.approx(-6.0 * sign * 16 / 27, abs=0.002), 1.0)
    bench.command(-5.0 * sign)
    bench.run(1)
    assert bench.board.volts()[0] == -5.0 * sign


def test_far_beyond_the_limit_it_levels_and_latches():
    bench = Bench()
    bench.counts = (0, LIMIT + 60)
    bench.run(2)
    assert bench.has(wire.LEVELLING, wire.BY_ANGLE)
    assert bench.board.volts()[1] == -3.0
    bench.run(500)
    assert bench.has(wire.LATCHED)
    assert bench.board.volts() == (0.0, 0.0)


def test_an_arm_that_flies_on_after_disarming_is_braked_until_it_rests():
    bench = Bench()
    for count in range(0, LIMIT + 10, 10):
        if count == 250:
            bench.send(Disarm())
        bench.counts = (count, 0)
        bench.run(1)
    assert bench.board.volts() == (-6.0, 0.0)
    bench.send(replace(bench.request, nonce=8, zero_0=500))
    assert not [p for p in bench.run(20) if isinstance(p, ConfigAnswer)], "not while it brakes"
    bench.counts = (LIMIT // 2, 0)
    bench.run(150)  # until its speed is that of an arm at rest
    assert bench.board.volts() == (0.0, 0.0)
    bench.send(replace(bench.request, nonce=9, zero_0=500))
    assert [p.nonce for p in bench.run(2) if isinstance(p, ConfigAnswer)] == [9]


@pytest.mark.parametrize("tau_ms", [25, 200])
def test_it_is_braked_for_half_a_second_and_five_time_constants(tau_ms: int):
    bench = Bench(armed=False)
    bench.request = replace(bench.request, nonce=8, time_constant_ms=tau_ms)
    bench.configure()
    bench.send(Arm(bench.token, bench.sequence))
    bench.run(1)
    bench.send(Disarm())
    for k in range(499 + 5 * tau_ms):
        bench.counts = (LIMIT + 20 + 10 * (k // 2 % 2), 0)  # a stalled one is let go
        bench.run(1)
        assert bench.board.volts()[0] < 0.0 or k < 30
    bench.run(1)
    assert bench.board.volts() == (0.0, 0.0)


def test_an_arm_that_is_held_beyond_its_limit_is_let_go_after_disarming():
    bench = Bench()
    bench.counts = (LIMIT + 20, 0)
    bench.run(200)
    bench.send(Disarm())
    bench.run(150)
    assert bench.board.volts() == (0.0, 0.0)
    assert not bench.has(wire.LATCHED)


def test_a_configuration_waits_for_an_arm_that_rests_beyond_its_limit_under_volts():
    bench = Bench()
    bench.counts = (LIMIT + 20, 0)
    bench.run(150)  # until its speed is that of an arm at rest, which passes no further limit
    bench.send(Disarm())
    bench.run(1)
    bench.send(replace(bench.request, nonce=8, zero_0=500))
    assert not [p for p in bench.run(2) if isinstance(p, ConfigAnswer)]
    assert bench.board.volts()[0] < 0.0
    bench.run(150)  # it is let go
    bench.send(replace(bench.request, nonce=9, zero_0=500))
    assert [p.nonce for p in bench.run(2) if isinstance(p, ConfigAnswer)] == [9]


def test_before_homing_nobody_knows_what_to_brake_for():
    bench = Bench(homed=False)
    bench.send(Disarm())
    for k in range(40):
        bench.counts = (50 * k, 0)
        bench.run(1)
        assert bench.board.volts() == (0.0, 0.0)


def test_a_stalled_motor_is_let_go():
    bench = Bench()
    for k in range(400):
        bench.command(2.5)
        bench.counts = (k % 3, 0)
        bench.run(1)
    assert bench.has(wire.LATCHED, wire.BY_STALL)
    assert bench.board.volts() == (0.0, 0.0)


def test_a_moving_or_gently_driven_motor_is_not_stalled():
    bench = Bench()
    for k in range(600):
        bench.command(2.5 if k < 300 else -2.5, 1.9)
        bench.counts = ((k if k < 300 else 600 - k) // 10, 0)
        bench.run(1)
    assert bench.has(wire.ARMED)


def test_armed_and_never_commanded_it_waits_5_seconds_at_0_volts():
    bench = Bench()
    bench.run(4990)
    assert bench.has(wire.ARMED)
    assert bench.board.volts() == (0.0, 0.0)
    bench.run(20)
    assert not bench.has(wire.ARMED)


def test_a_configuration_does_not_disturb_an_armed_board():
    bench = Bench()
    bench.command(1.0)
    bench.send(replace(bench.request, counts_per_rev=100, zero_0=5000))
    assert not any(isinstance(p, ConfigAnswer) for p in bench.run(2))
    assert bench.board.volts()[0] == 1.0


def test_a_host_that_died_between_arming_and_its_first_command_makes_room():
    bench = Bench()
    bench.run(50)
    old = bench.token
    bench.send(bench.request)  # the same once more was doubled on its way
    bench.run(2)
    assert bench.has(wire.ARMED)
    bench.request = replace(bench.request, nonce=8)
    bench.configure()
    assert not bench.has(wire.ARMED)
    bench.send(Arm(old, 900))
    bench.run(2)
    assert not bench.has(wire.ARMED)
    world = World(HostBoard(), Rig())
    table_on(world).arm()
    with table_on(world) as again:  # within ANSWER_S
        assert world.now_s < 0.1
        again.read()


def test_a_levelling_board_is_not_reconfigured():
    bench = Bench()
    bench.command(1.0)
    bench.run(150)
    bench.send(bench.request)
    assert not any(isinstance(p, ConfigAnswer) for p in bench.run(2))
    assert bench.has(wire.LEVELLING)


@pytest.mark.parametrize("volts", [6.0, -6.0])
@pytest.mark.parametrize(
    "wiring", [Wiring(), Wiring(order=(1, 0), sign_volts=(-1, 1), crossed=True)]
)
def test_a_mad_host_cannot_drive_the_plate_beyond_its_limit(volts: float, wiring: Wiring):
    world = World(HostBoard(), Rig(), wiring=wiring)
    table, worst = table_on(world), 0.0
    table.arm()
    for _ in range(600):
        table.read()
        table.drive((volts, -volts))
        worst = max(worst, *map(abs, world.arms_rad))
    assert 0.3 < worst < Rig().servo.angle_limit_rad + 0.04


class FreeMotor:
    """The speed that volts give a motor in the play of its gears, as the board has it: in whole
    numbers, every second tick. turn: 0 or 1, in which of the two."""

    def __init__(self, tau_ms: int, turn: int) -> None:
        self._share = max(1, min(8192 // tau_ms, 2048))
        self._gain = 2048 * (4096 * 9180 // 24544 + 1) // 6000
        self._turn, self._lagged = turn, 0

    def after(self, tick: int, mV: int) -> int:
        if tick % 2 == self._turn:
            self._lagged += ((32 * mV - self._lagged) * self._share) >> 12
        return int(int(self._lagged / 256) * self._gain / 256)


@pytest.mark.parametrize("encoder", [0, 1])
@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("tau_ms", [10, 25, 100, 500])
def test_the_board_brakes_by_the_law_of_the_loop(tau_ms: int, sign: int, encoder: int):
    """At every place and speed its volts are those of `limits.limit`, to 4 counts of room."""
    stops = Braking((16 + 1.5 + tau_ms / 40) * 1e-3, 1e-3 * tau_ms, 9.18)
    for counts_ms in (0, 1, 2, 4, 6):
        bench = Bench(armed=False)
        bench.request = replace(bench.request, time_constant_ms=tau_ms)
        bench.configure()
        ticks, braced = min(180, 2 * LIMIT // max(counts_ms, 1)), set()
        motors = FreeMotor(tau_ms, 0), FreeMotor(tau_ms, 1)

        def at(place: int, b: Bench = bench) -> None:
            b.counts = (sign * place, 0) if encoder == 0 else (0, sign * place)

        at(LIMIT + 12 - counts_ms * ticks)
        bench.run(300)
        bench.send(Arm(bench.token, bench.sequence))
        for k in range(1, ticks + 1):
            place = LIMIT + 12 - counts_ms * (ticks - k)
            at(place)
            bench.command(*((6.0 * sign, 0.0) if encoder == 0 else (0.0, 6.0 * sign)))
            before_mV = round(1000 * sign * bench.board.volts()[encoder])
            free = [motor.after(k, before_mV) * STEP_RAD / 0.256 for motor in motors]
            bench.run(1)
            if k < 100:  # its filter follows first
                continue
            rate = counts_ms * STEP_RAD / 1e-3
            bounds = (6.0, LIMIT * STEP_RAD, inf)
            found = sign * bench.board.volts()[encoder]
            right = [limit(6.0, place * STEP_RAD, rate, 0.0, *bounds, stops, 0.0, w) for w in free]
            assert min(abs(found - one) for one in right) <= 24 / 26
            braced.add(found < 6.0)
        assert True in braced


def most_mV(at: int, w: int, tau_ms: int, counts_per_rev: int) -> int:
    """The law of protocol.c in whole numbers: at [counts], w [counts/256 a ms]; 6 V, 9.18 rad/s."""
    room, taper = LIMIT - at, counts_per_rev // 157 + 1
    if w > 0:
        top_speed = counts_per_rev * 9180 // 24544 + 1
        room -= w * (32 + 3 + tau_ms // 20) // 512 + 1
        room -= w * w // (2 * top_speed + w) * tau_ms // 256 + 1
    return int(6000 * max(-taper, min(room, taper)) / taper)


@pytest.mark.parametrize("tau_ms", [2, 10, 20, 42, 500])
@pytest.mark.parametrize("sign", [-1, 1])
def test_the_board_brakes_to_the_millivolt_whatever_the_arm_does(tau_ms: int, sign: int):
    """Jumps, pauses, way there and back; its speed is filtered over 16 ms, a jump cut at 100."""
    told = list(braked(tau_ms, sign))
    for turn in (0, 1):
        motor, right, mV = FreeMotor(tau_ms, turn), [], 0
        for k, (found, at, w) in enumerate(told):
            free = sign * motor.after(k, mV)
            right.append(most_mV(at, max(w, free), tau_ms, 4096))
            mV = found
        if right == [sign * found for found, *_ in told]:
            break
    else:
        pytest.fail("in neither turn")
    assert sum(-6000 < one < 6000 for one in right) > 100


def braked(tau_ms: int, sign: int) -> Iterator[tuple[int, int, int]]:
    """Volts [mV] of an arm that is told 6 V, and its place and speed towards that side."""
    bench, rng = Bench(armed=False), np.random.default_rng(tau_ms)
    bench.request = replace(bench.request, time_constant_ms=tau_ms)
    bench.configure()
    bench.send(Arm(bench.token, bench.sequence))
    at, speed_sum = 0, 0
    for k in range(4000):
        before = at
        at += int(rng.integers(-4, 6)) if k % 200 < 120 else 0  # and then it rests
        at = int(rng.integers(-LIMIT, LIMIT)) if k % 200 == 0 else max(-LIMIT, min(at, LIMIT + 20))
        speed_sum += 256 * max(-100, min(at - before, 100)) - int(speed_sum / 16)
        bench.counts = (sign * at, 0)
        bench.command(6.0 * sign)
        bench.run(1)
        yield round(1000 * bench.board.volts()[0]), at, int(speed_sum / 16)


@pytest.mark.parametrize("counts_per_rev", [256, 1024, 4096, 65535])
def test_no_angle_beyond_the_boards_own_limit_is_taken(counts_per_rev: int):
    """0.6 rad from level, whatever the host asks for: there the volts are 0."""
    bench = Bench(armed=False)
    bench.request = replace(
        bench.request, counts_per_rev=counts_per_rev, angle_limit=65535, time_constant_ms=1
    )
    bench.configure()
    bench.send(Arm(bench.token, bench.sequence))
    bench.counts = (counts_per_rev * 600 // 6283, 0)
    for _ in range(400):
        bench.command(6.0, 0.0)
        bench.run(1)
    assert bench.board.volts()[0] == 0.0
    assert bench.has(wire.ARMED)
    bench.counts = (counts_per_rev * 730 // 6283, 0)
    bench.command(6.0, 0.0)
    bench.run(1)
    assert bench.has(wire.BY_ANGLE)


def test_a_full_ring_never_says_that_it_has_room():
    for size in (16, 128):
        for into in range(size):
            kept = {
                library("volts").ring_room(into, (into - n) % size, size) + n for n in range(size)
            }
            assert kept == {size - 1}


@pytest.mark.parametrize("beyond", [0, 1])
def test_the_angle_that_ends_a_run_is_exact(beyond: int):
    bench = Bench()
    for sign in (-1, 1):
        bench = Bench()
        bench.counts = (sign * (LIMIT + LIMIT // 6 + beyond), 0)
        bench.run(3)
        assert bench.has(wire.LEVELLING) == bool(beyond)


@pytest.mark.parametrize("phase", [0, 1])
@pytest.mark.parametrize(
    ("volts", "moves", "stalls"),
    [(2.0, 7, True), (-2.0, 7, True), (2.0, 8, False), (-2.0, 8, False), (1.999, 0, False)],
)
def test_stall_is_2_volts_for_300_ms_and_no_more_than_7_counts(phase, volts, moves, stalls):
    bench, told = Bench(zeros=(200, 0)), []
    bench.run(10)  # at rest
    for k in range(400):
        bench.command(volts)
        bench.counts = (200 + moves * ((k + phase) % 2), 0)
        bench.run(1)
        told.append(bench.has(wire.BY_STALL))
    assert told[-1] == stalls
    assert not stalls or told.index(True) == 301  # a tick until it counts, one that begins


@pytest.mark.parametrize(("counts_per_rev", "moves"), [(3668, 7), (3667, 6), (64, 2)])
def test_a_motion_is_twelve_thousandths_of_a_radian_and_more_than_two_counts(
    counts_per_rev: int, moves: int
):
    for more, stalls in ((0, True), (1, False)):
        bench = Bench(armed=False)
        bench.request = replace(bench.request, counts_per_rev=counts_per_rev)
        bench.configure()
        bench.send(Arm(bench.token, bench.sequence))
        for k in range(320):
            bench.command(2.0)
            bench.counts = ((moves + more) * (k % 2), 0)
            bench.run(1)
        assert bench.has(wire.BY_STALL) == stalls


def test_volts_that_turn_are_no_stall():
    bench = Bench()
    for k in range(600):
        bench.command(2.5 if k // 100 % 2 else -2.5)
        bench.run(1)
    assert bench.has(wire.ARMED)


def test_the_times_of_the_watchdog_are_exact():
    for silent_ms, levels in ((99, False), (100, True)):
        bench = Bench()
        bench.command(1.0, ttl_ms=255)
        bench.run(1)
        bench.run(silent_ms - 1)
        assert bench.has(wire.LEVELLING) == levels
    bench.run(499)
    assert bench.has(wire.LEVELLING)
    bench.run(1)
    assert bench.has(wire.LATCHED)
    unused = Bench()
    unused.run(4998)
    assert unused.has(wire.ARMED)
    unused.run(1)
    assert unused.has(wire.LEVELLING, wire.BY_WATCHDOG)


def test_a_request_that_it_cannot_fulfil_leaves_it_unconfigured():
    for change in ({"version": 1}, {"counts_per_rev": 63}, {"top_speed_mrad_s": 0}):
        bench = Bench(armed=False)
        bench.request = replace(bench.request, **change)
        bench.configure()
        bench.send(Arm(bench.token, 0))
        bench.run(2)
        assert not bench.has(wire.ARMED)
    bench.request = replace(
        bench.request, counts_per_rev=64, version=VERSION, limit_mV=6001, top_speed_mrad_s=1
    )
    bench.configure()
    bench.send(Arm(bench.token, bench.sequence))
    bench.command(9.0, -3.0)
    bench.run(1)
    assert bench.has(wire.ARMED)
    assert bench.board.volts() == (6.0, -3.0)  # never more than its own


def test_telemetry_comes_at_the_period_asked():
    for asked, period_ms, homed in ((1, 1, True), (5, 5, True), (0, 1, True), (5, 5, False)):
        bench = Bench(armed=False, homed=homed)
        bench.request = replace(bench.request, period_ms=asked)
        bench.configure()
        stamps = [p.clock_us for p in bench.run(50) if isinstance(p, Telemetry)]
        assert np.all(np.diff(stamps) == 1000 * period_ms)
        assert len(stamps) >= 9


# --- the wiring ---
@given(WIRINGS, st.tuples(st.floats(-6, 6), st.floats(-6, 6)), COUNTS)
def test_wiring_goes_there_and_back(wiring: Wiring, volts, counts):
    assert wiring.from_board(wiring.to_board(volts)) == volts
    assert wiring.counts(wiring.angles(counts)) == counts


@given(WIRINGS)
def test_polarity_is_what_volts_do_to_counts(wiring: Wiring):
    """Raise axis x by a volt at the board: the encoder that counts x moves by the polarity."""
    moved = np.subtract(wiring.counts((0.1, 0.0)), wiring.counts((0.0, 0.0)))
    encoder = int(np.flatnonzero(moved)[0])
    motor = int(np.flatnonzero(wiring.to_board((1.0, 0.0)))[0])
    assert motor == (1 - encoder if wiring.crossed else encoder)
    rise = np.sign(moved[encoder]) * wiring.to_board((1.0, 0.0))[motor]
    assert wiring.polarities()[encoder] == rise


@pytest.mark.parametrize("bad", [{"sign_volts": (1, 0)}, {"counts_per_rev": 12}])
def test_impossible_wiring_is_refused(bad):
    with pytest.raises(ValueError, match="wiring"):
        Wiring(**bad)


# --- the driver ---
class AnotherVersion(HostBoard):
    """A board flashed long ago."""

    def __init__(self) -> None:
        super().__init__()
        self._parser = Parser()

    def receive(self, data: bytes) -> None:
        for packet in self._parser.feed(data):
            if isinstance(packet, ConfigRequest):
                answer = ConfigAnswer(9, packet.nonce, 1, 0, 2, 0, 0)
                self._sent += wire.encode(answer)


def test_another_version_is_refused_with_its_cure():
    link = WorldLink(World(AnotherVersion(), Rig()))
    with pytest.raises(LinkLost, match=r"speaks version 9 .* flash"):
        BoardTable(link, clock=link.clock)
    assert link.closed


def test_volts_need_an_armed_board():
    table = table_on(World(HostBoard(), Rig()))
    table.read()
    table.drive((0.0, 0.0))
    with pytest.raises(ValueError, match="not armed"):
        table.drive((1.0, 0.0))
    with pytest.raises(ValueError, match="finite"):
        table.drive((float("nan"), 0.0))


@pytest.mark.parametrize("period_s", [0.0, 0.0015, 0.1])
def test_a_period_that_no_board_ticks_is_refused(period_s: float):
    with pytest.raises(ValueError, match="whole milliseconds"):
        table_on(World(HostBoard(), Rig()), period_s=period_s)


def test_a_reset_board_is_silent_and_lost():
    world = World(HostBoard(), Rig())
    never = table_on(world).boot_id
    assert table_on(world, homed=False).boot_id == never  # asking does not make it homed
    with table_on(world, homed=False) as table:  # homing does
        table.level_s = 0.0
        homing = table.boot_id
    table = table_on(world)
    assert table.boot_id == homing != never

    def work() -> None:
        with table:
            for k in range(200):
                table.read()
                table.drive((1.0, 1.0))
                if k == 50:
                    world.board.reset()

    with pytest.raises(LinkLost, match="silent for 80 ms"):
        work()
    assert world.volts == (0.0, 0.0)
    assert table_on(world).boot_id == never  # its zero is lost


@pytest.mark.parametrize("says", [LinkLost, KeyboardInterrupt])
def test_an_arming_that_is_not_confirmed_leaves_no_armed_board(says: type[BaseException]):
    world = World(HostBoard(), Rig())
    link, take = WorldLink(world), world.board.take
    table = table_on(world, link)

    def unheard() -> bytes:
        if says is KeyboardInterrupt and world.now_s > 0.02:
            raise KeyboardInterrupt
        return b""

    world.board.take = unheard
    with pytest.raises(says):
        table.arm()
    world.board.take = take
    world.run(0.01)
    (*_, newest) = Parser().feed(take())
    assert isinstance(newest, Telemetry)
    assert not newest.flags & wire.ARMED


def test_a_camera_that_stalls_ends_by_its_name_and_level():
    class Stalling:
        def latest(self, after_s: float) -> None:
            if world.now_s > 0.3:
                raise CameraStopped("no frame for 0.30 s")

    world = World(HostBoard(), Rig())
    link = WorldLink(world)
    table = BoardTable(link, clock=link.clock, eye=Stalling())

    def work() -> None:
        with table:
            while world.now_s < 1.0:
                table.read()
                table.drive((2.0, -2.0))

    with pytest.raises(CameraStopped, match="no frame"):
        work()
    assert world.now_s > 0.8  # it levelled
    assert world.volts == (0.0, 0.0)
    assert np.all(np.abs(world.arms_rad) < 0.03)


@pytest.mark.parametrize(
    ("longest_s", "said", "most_s"),
    [(inf, "deaf for 80 ms", 0.1), (0.029, "round trip takes 60 ms or more", 0.07)],
)
def test_a_deaf_board_is_lost(longest_s: float, said: str, most_s: float):
    world = World(HostBoard(), Rig())
    table = table_on(world, longest_trip_s=longest_s)
    table.arm()
    begin_s = world.now_s
    world.board.receive = lambda data: None

    def work() -> None:
        while world.now_s < 2.0:
            table.read()
            table.drive((1.0, 0.0))

    with pytest.raises(LinkLost, match=said):
        work()
    assert world.now_s - begin_s < most_s


def test_a_stopped_board_says_why_and_levels_in_peace():
    world = World(HostBoard(), Rig())

    def work() -> None:
        with table_on(world) as table:
            table.read()
            table.drive((2.0, 2.0))
            world.run(0.15)
            table.read()

    with pytest.raises(BoardStopped, match="had no command for 100 ms"):
        work()
    world.run(0.6)
    assert world.volts == (0.0, 0.0)
    assert np.all(np.abs(world.arms_rad) < 0.03)


def test_tachometers_reach_the_reading():
    class Scaled(World):
        def step(self) -> None:
            super().step()
            self._speeds = tuple(v / TACHOMETER_RAD_S_V for v in self._speeds)

    world = Scaled(HostBoard(tachometer=True), Rig(), tachometer=True)
    table, fastest = table_on(world), 0.0
    table.arm()
    for _ in range(100):
        reading = table.read()
        table.drive((2.0, 0.0))
        assert reading.motor_speed_rad_s is not None
        fastest = max(fastest, reading.motor_speed_rad_s[0])
    assert fastest == pytest.approx(2.0 * Rig().servo.gain_rad_s_V, rel=0.1)
    assert table_on(World(HostBoard(), Rig())).read().motor_speed_rad_s is None


def test_the_boards_clock_may_wrap():
    world = World(HostBoard(), Rig())
    link, sent = WorldLink(world), world.board.take

    def shifted() -> bytes:
        packets = Parser().feed(sent())
        late = [(p.clock_us + 2**32 - 500_000) % 2**32 for p in packets]  # pyright: ignore
        return b"".join(
            wire.encode(replace(p, clock_us=t)) for p, t in zip(packets, late, strict=True)
        )

    world.board.take = shifted
    table = BoardTable(link, clock=link.clock)
    times = [table.read().t_s for _ in range(1000)]
    assert np.diff(times) == pytest.approx(0.002, abs=1e-6)
    assert table.ticks_missed == 0


def test_doubled_and_overtaken_telemetry_is_not_read_again():
    world = World(HostBoard(), Rig())
    link, take, old = WorldLink(world), world.board.take, [b""]

    def doubled() -> bytes:
        data, old[0] = take() + old[0], old[0]
        old[0] = data[-29:] if data else old[0]
        return data

    world.board.take = doubled
    table = BoardTable(link, clock=link.clock)
    times = [table.read().t_s for _ in range(200)]
    assert np.diff(times) == pytest.approx(0.002, abs=1e-6)
