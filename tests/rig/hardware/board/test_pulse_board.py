"""pulses.c on the bench, a millisecond at a time: what is refused, at which rate, when it ends."""

from dataclasses import replace

import numpy as np
import pytest

from rig.hardware.board import wire
from rig.hardware.board.wire import (
    VERSION,
    Arm,
    Command,
    ConfigAnswer,
    ConfigRequest,
    Disarm,
    Parser,
    PulseCommand,
    PulseConfigRequest,
    PulseTelemetry,
)
from tests.support.boards.host import HostPulseBoard

# Half us, 0.1 us/rad, half us, half us, 0.1 mrad, mrad/s: to each side 600 us for 1 rad, 2 rad/s.
ONE = (3000, 6000, 1800, 4200, 10_000, 2000)
OTHER = (2880, -5000, 1880, 3880, 10_000, 1000)
LEVEL_US = (1500.0, 1440.0)
REQUEST = PulseConfigRequest(VERSION, 7, 1, 2, 20_000, *ONE, *OTHER)


class Bench:
    def __init__(self, request=REQUEST, *, servos: int = 2, armed: bool = True) -> None:
        self.board, self.parser, self.request = HostPulseBoard(servos=servos), Parser(), request
        self.newest, self.sequence = PulseTelemetry(0, 0, 0, 0, 0, 0, 0), 500
        self.configure()
        if armed:
            self.send(Arm(self.answer.token, self.sequence))
            self.run(1)

    def configure(self) -> ConfigAnswer:
        self.send(self.request)
        self.answer = next(p for p in self.run(1) if isinstance(p, ConfigAnswer))
        return self.answer

    def send(self, packet) -> None:
        self.board.receive(wire.encode(packet))

    def command(self, *angles_rad: float) -> None:
        self.sequence = (self.sequence + 1) % 65536
        self.send(PulseCommand(self.sequence, *(round(1e4 * angle) for angle in angles_rad)))

    def run(self, ms: int) -> list:
        found = []
        for _ in range(ms):
            self.board.run_ms()
            found += self.parser.feed(self.board.take())
        for packet in found:
            self.newest = packet if isinstance(packet, PulseTelemetry) else self.newest
        return found

    def pulses(self) -> tuple[float, ...]:
        return self.board.pulses_us()[:2]

    def hold(self, ms: int, *angles_rad: float) -> np.ndarray:
        """The pulses of each millisecond (ms, 2) under a command in every one."""
        seen = []
        for _ in range(ms):
            self.command(*angles_rad)
            self.run(1)
            seen.append(self.pulses())
        return np.array(seen)

    def has(self, *flags: int) -> bool:
        return all(self.newest.flags & flag for flag in flags)


def servo(**changed: int) -> tuple[int, ...]:
    names = ("level", "slope", "lowest", "highest", "limit", "rate")
    return tuple(changed.get(name, value) for name, value in zip(names, ONE, strict=True))


GOOD = [
    servo(), servo(slope=-6000), servo(limit=0), servo(rate=100), servo(rate=65_535),
    servo(lowest=1000, highest=5000), servo(lowest=1800), servo(highest=4200),
    servo(slope=100, limit=31_415),
]  # fmt: skip
BAD = [
    servo(slope=0), servo(lowest=999), servo(highest=5001), servo(limit=31_416, slope=100),
    servo(rate=99), servo(rate=0), servo(lowest=1801), servo(highest=4199), servo(level=3001),
    servo(level=2999), servo(slope=6010), servo(slope=-6010), servo(limit=10_020),
    servo(level=1700, limit=0), servo(level=4300, limit=0), servo(lowest=4200, highest=1800),
]  # fmt: skip


@pytest.mark.parametrize("fields", GOOD)
@pytest.mark.parametrize("place", [0, 1, 2])
def test_a_servo_within_the_bounds_is_taken(fields, place: int):
    every = [ONE, ONE, ONE]
    every[place] = fields
    request = PulseConfigRequest(VERSION, 7, 1, 3, 20_000, *sum(every, ()))
    answer = Bench(request, servos=3).answer
    assert answer.features == wire.TAKES_ANGLE | wire.HAS_THREE


@pytest.mark.parametrize("fields", BAD)
@pytest.mark.parametrize("place", [0, 1, 2])
def test_a_servo_out_of_the_bounds_is_refused_and_gets_no_pulse(fields, place: int):
    every = [ONE, ONE, ONE]
    every[place] = fields
    bench = Bench(PulseConfigRequest(VERSION, 7, 1, 3, 20_000, *sum(every, ())), servos=3)
    assert bench.answer.features == wire.TAKES_ANGLE | wire.HAS_THREE | wire.REFUSED
    assert not bench.hold(50, 0.5, 0.5).any()
    assert bench.newest == PulseTelemetry(0, 0, 0, 0, 0, 0, 0)  # and it says nothing


@pytest.mark.parametrize(
    ("changed", "taken"),
    [
        ({"frame_us": 4000}, True), ({"frame_us": 3999}, False),
        ({"frame_us": 20_000}, True), ({"frame_us": 20_001}, False),
        ({"servos": 0}, False), ({"servos": 1}, True), ({"servos": 3}, False),
        ({"servos": 255}, False), ({"version": VERSION + 1}, False), ({"version": 0}, False),
    ],
)  # fmt: skip
def test_what_the_board_takes(changed, taken: bool):
    answer = Bench(replace(REQUEST, **changed), armed=False).answer
    assert answer.features == wire.TAKES_ANGLE | (0 if taken else wire.REFUSED)
    assert answer.version == VERSION


@pytest.mark.parametrize("servos", [1, 2])
def test_a_servo_that_is_not_configured_gets_no_pulse(servos: int):
    """Not even one that the last host had configured."""
    three = PulseConfigRequest(VERSION, 7, 1, 3, 20_000, *ONE, *ONE, *ONE)
    bench = Bench(three, servos=3)
    assert bench.board.pulses_us() == (1500.0, 1500.0, 1500.0)
    bench.send(Disarm())
    bench.request = replace(three, servos=servos)
    bench.configure()
    bench.send(Arm(bench.answer.token, bench.sequence))
    bench.hold(100, 0.0, 0.0, 0.3)
    assert bench.board.pulses_us() == tuple(1500.0 * (i < servos) for i in range(3))


@pytest.mark.parametrize("slope", [641, -641, 6000, -5000])
def test_a_pulse_is_the_nearest_half_us(slope: int):
    """Level and slope angle, rounded half away from zero, exactly."""
    rng = np.random.default_rng(1)
    fields = servo(slope=slope, lowest=1000, highest=5000, rate=65_535)
    bench = Bench(PulseConfigRequest(VERSION, 7, 1, 1, 20_000, *fields))
    for angle in (
        0,
        39,
        -39,
        105,
        -105,
        10_000,
        -10_000,
        *rng.integers(-10_000, 10_001, 60).tolist(),
    ):
        bench.hold(35, 1e-4 * angle, 0.0)
        turned = slope * angle
        steps = (2 * abs(turned) + 50_000) // 100_000
        assert bench.newest.pulse_0 == 3000 + (steps if turned > 0 else -steps)


def test_a_volt_hosts_question_is_refused_and_ends_the_last_hosts_configuration():
    bench = Bench(armed=False)
    bench.send(ConfigRequest(VERSION, 9, 1, 1, 0, 0, 4096, 341, 6000))
    (answer,) = (p for p in bench.run(1) if isinstance(p, ConfigAnswer))
    assert answer.features == wire.TAKES_ANGLE | wire.REFUSED
    assert answer.homing == 0
    bench.send(Arm(bench.answer.token, 0))
    bench.run(5)
    assert bench.pulses() == (0.0, 0.0)


def test_it_arms_once_and_only_with_its_token():
    bench = Bench(armed=False)
    for token in (0, bench.answer.token + 1, bench.answer.token ^ 0x80000000):
        bench.send(Arm(token, 0))
        bench.run(1)
        assert bench.pulses() == (0.0, 0.0)
    bench.send(Arm(bench.answer.token, 0))
    bench.run(1)
    assert bench.pulses() == LEVEL_US
    bench.send(Disarm())
    bench.send(Arm(bench.answer.token, 0))
    bench.run(1)
    assert bench.pulses() == (0.0, 0.0)


def test_angles_become_pulses_at_the_rate_and_are_cut_at_the_limit():
    bench = Bench()
    seen = bench.hold(400, 0.5, -0.25)
    k = np.arange(1, 401)
    right = 1500 + 600 * np.minimum(2e-3 * k, 0.5), 1440 + 500 * np.minimum(1e-3 * k, 0.25)
    np.testing.assert_allclose(seen, np.transpose(right), atol=0.25 + 1e-9)
    assert not bench.has(wire.LIMITED)
    bench.hold(100, 0.5, 0.25)
    assert bench.has(wire.LIMITED)  # it is on its way
    seen = bench.hold(2000, 3.2, 3.2)
    assert tuple(seen[-1]) == (2100.0, 940.0)
    assert bench.has(wire.LIMITED)
    seen = bench.hold(1, 0.99, 0.99)  # at once: nothing was wound up
    assert tuple(seen[-1]) == (2099.0, 940.5)
    assert tuple(bench.hold(2000, -3.2, -3.2)[-1]) == (900.0, 1940.0)


def test_silence_levels_after_100_ms_at_the_rate_then_ends_the_pulses_for_good():
    bench = Bench()
    bench.hold(400, 0.5, -0.25)
    seen = []
    for _ in range(1000):
        bench.run(1)
        seen.append(bench.pulses())
    a, b = np.transpose(seen)
    assert np.all(a[:98] == 1800.0)  # the last command is a millisecond old before
    assert a[98] == pytest.approx(1800 - 1.2, abs=0.26)
    assert a[346] == pytest.approx(1500 + 1.2, abs=0.26)
    first = int(np.flatnonzero(a == 0)[0])
    assert first == 347 + 499  # level for half a second, whatever the way there took
    assert np.all(a[347:first] == 1500.0)
    assert np.all(b[347:first] == 1440.0)
    assert not a[first:].any()
    assert not b[first:].any()
    assert bench.has(wire.LATCHED, wire.BY_WATCHDOG)
    bench.send(Arm(bench.answer.token, 0))
    assert not bench.hold(50, 0.3, 0.3).any()
    bench.configure()
    bench.send(Arm(bench.answer.token, bench.sequence))
    bench.run(1)
    assert bench.pulses() == LEVEL_US


def test_a_command_holds_until_a_newer_one_and_old_ones_feed_no_watchdog():
    bench = Bench()
    bench.hold(300, 0.2, 0.2)
    for _ in range(98):
        for step in (0, -1, -300):
            bench.send(PulseCommand((bench.sequence + step) % 65536, 9000, 9000))
        bench.send(Command((bench.sequence + 1) % 65536, 100, 6000, 6000))  # volts
        bench.run(1)
        assert bench.pulses() == (1620.0, 1340.0)
    bench.run(1)
    assert bench.has(wire.BY_WATCHDOG, wire.LEVELLING)


def test_armed_and_never_commanded_it_stays_level_and_gives_up_after_5_s():
    bench = Bench()
    for _ in range(4990):
        bench.run(1)
        assert bench.pulses() == LEVEL_US
    bench.run(600)
    assert bench.has(wire.LATCHED, wire.BY_WATCHDOG)
    assert bench.pulses() == (0.0, 0.0)


def test_a_wish_of_the_last_host_is_forgotten():
    bench = Bench()
    bench.hold(300, 0.2, 0.2)
    bench.send(Disarm())
    bench.run(1)
    assert bench.pulses() == (0.0, 0.0)
    bench.configure()
    bench.send(Arm(bench.answer.token, bench.sequence))
    bench.run(50)
    assert bench.pulses() == LEVEL_US
    assert not bench.has(wire.LIMITED)


def test_telemetry_says_what_is_put_out_at_its_period():
    bench = Bench(replace(REQUEST, period_ms=5))
    bench.hold(300, 0.1, 0.1)
    packets = [p for p in bench.run(50) if isinstance(p, PulseTelemetry)]
    assert len(packets) == 10
    assert (packets[0].pulse_0, packets[0].pulse_1, packets[0].pulse_2) == (3120, 2780, 0)
    assert {int(gap) for gap in np.diff([p.clock_us for p in packets])} == {5000}
    assert packets[0].sequence == bench.sequence
