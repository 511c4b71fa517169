"""The real servo firmware on simulated chips: every pulse is measured at its pin."""

from itertools import pairwise

import numpy as np
import pytest

from rig.hardware.board import wire
from rig.hardware.board.pulse_servo import PulseServo
from rig.hardware.board.wire import (
    VERSION,
    Arm,
    ConfigAnswer,
    Disarm,
    Parser,
    PulseCommand,
    PulseConfigRequest,
    PulseTelemetry,
    encode,
)
from tests.support.boards.chip import MEGA, UNO, Pulse, PulseChip, firmware

WIDE = PulseServo(1500.0, 600.0, 500.0, 2500.0)
TURNED = PulseServo(1480.0, -500.0, 600.0, 2400.0)
LIMIT_RAD, RATE_RAD_S = 1.6, 20.0
CHIPS = pytest.mark.parametrize("mcu", [UNO, MEGA])
FLASH = {UNO: 32_256, MEGA: 253_952}  # bytes beside the boot loader


class Bench:
    """A chip with two servos on the bench, configured and, where wanted, armed."""

    def __init__(
        self, mcu: str = UNO, *, servos=(WIDE, TURNED), frame_us: int = 20_000,
        rate_rad_s: float = RATE_RAD_S, armed: bool = True,
    ) -> None:  # fmt: skip
        self.chip, self.parser, self.sequence = PulseChip(mcu), Parser(), 100
        fields = [f for servo in servos for f in servo.fields(LIMIT_RAD, rate_rad_s)]
        self.request = PulseConfigRequest(VERSION, 7, 5, len(servos), frame_us, *fields)
        self.newest = PulseTelemetry(0, 0, 0, 0, 0, 0, 0)
        self.run(20)
        self.configure()
        if armed:
            self.arm()

    def configure(self) -> ConfigAnswer:
        self.send(self.request)
        self.answer = next(p for p in self.run(20) if isinstance(p, ConfigAnswer))
        return self.answer

    def arm(self) -> None:
        self.send(Arm(self.answer.token, self.sequence))
        self.run(3)

    def send(self, packet) -> None:
        self.chip.receive(encode(packet))

    def command(self, *angles_rad: float) -> None:
        self.sequence = (self.sequence + 1) % 65536
        self.send(PulseCommand(self.sequence, *(round(1e4 * angle) for angle in angles_rad)))

    def hold(self, ms: int, *angles_rad: float) -> list[Pulse]:
        """Command these angles every 20 ms; the pulses that were measured meanwhile."""
        begin = len(self.chip.pulses)
        for _ in range(0, ms, 20):
            self.command(*angles_rad)
            self.run(20)
        return self.chip.pulses[begin:]

    def run(self, ms: int) -> list:
        found = []
        for _ in range(ms):
            self.chip.run_ms()
            found += self.parser.feed(self.chip.take())
        for packet in found:
            self.newest = packet if isinstance(packet, PulseTelemetry) else self.newest
        return found

    def has(self, *flags: int) -> bool:
        return all(self.newest.flags & flag for flag in flags)

    def quiet(self, ms: int) -> bool:
        """Whether no pulse begins in so long, after the frame that is under way."""
        self.run(20)
        begin = len(self.chip.pulses)
        self.run(ms)
        return len(self.chip.pulses) == begin and not self.chip.is_high()


@CHIPS
def test_pulses_are_the_angles_to_a_microsecond_over_the_whole_range(mcu: str):
    bench = Bench(mcu)
    for angle in np.linspace(-LIMIT_RAD, LIMIT_RAD, 17):
        measured = bench.hold(240, angle, -0.5 * angle)[-2:]
        assert sorted(pulse.servo for pulse in measured) == [0, 1]
        for pulse in measured:
            servo, asked = ((WIDE, angle), (TURNED, -0.5 * angle))[pulse.servo]
            assert pulse.us == pytest.approx(servo.pulse_us(asked), abs=1.0)
    assert not bench.has(wire.LATE_TICK)


@CHIPS
@pytest.mark.parametrize("frame_us", [4_000, 10_000, 20_000])
def test_frames_never_waver_while_the_pulses_move(mcu: str, frame_us: int):
    """From 500 to 2500 us and back at any moment of a frame: no pulse is cut, none left out."""
    wide = PulseServo(1500.0, 625.0, 500.0, 2500.0)
    bench = Bench(mcu, servos=(wide, wide), frame_us=frame_us, rate_rad_s=65.0)
    bench.run(60)
    bench.chip.pulses.clear()
    rng = np.random.default_rng(1)
    for _ in range(200):
        bench.command(*rng.choice([-1.6, 1.6], 2))
        bench.run(int(rng.integers(1, 12)))
    for servo in (0, 1):
        own = [pulse for pulse in bench.chip.pulses if pulse.servo == servo]
        gaps = [later.begin_us - pulse.begin_us for pulse, later in pairwise(own)]
        assert gaps == pytest.approx([frame_us] * len(gaps), abs=1.0)
        assert all(499.0 <= pulse.us <= 2501.0 for pulse in own)
        assert max(pulse.us for pulse in own) - min(pulse.us for pulse in own) > 1000


def test_a_third_servo_has_a_pin_on_the_mega_and_is_refused_by_an_uno():
    three = Bench(MEGA, servos=(WIDE, TURNED, PulseServo(1200.0, 100.0)))
    measured = {pulse.servo: pulse.us for pulse in three.hold(200, 0.2, 0.2, 0.2)[-3:]}
    assert measured == pytest.approx({0: 1620.0, 1: 1380.0, 2: 1220.0}, abs=1.0)
    answer = Bench(UNO, servos=(WIDE, WIDE, WIDE), armed=False).answer
    assert answer.features == wire.TAKES_ANGLE | wire.REFUSED


def test_a_chip_that_nobody_arms_gives_no_pulse():
    bench = Bench(armed=False)
    for token in (0, bench.answer.token ^ 1):
        bench.send(Arm(token, 0))
        bench.hold(100, 1.0, 1.0)
    assert bench.chip.pulses == []
    bench.arm()
    assert {round(pulse.us) for pulse in bench.hold(60, 0.0, 0.0)} == {1500, 1480}


def test_arming_begins_at_level_and_every_change_keeps_to_the_rate():
    bench = Bench(rate_rad_s=2.0)
    bench.run(60)
    own = [p for p in bench.chip.pulses + bench.hold(900, 1.5, 0.0) if p.servo == 0]
    assert own[0].us == pytest.approx(1500.0, abs=1.0)
    steps = np.diff([pulse.us for pulse in own])
    assert max(steps) == pytest.approx(600.0 * 2.0 * 0.020, abs=1.5)  # a ms more or less
    assert own[-1].us == pytest.approx(1500.0 + 600.0 * 1.5, abs=1.0)
    assert bench.newest.pulse_0 == round(2 * own[-1].us)
    assert not bench.has(wire.LIMITED)


@CHIPS
def test_a_silent_host_is_levelled_at_the_rate_then_the_pulses_end_for_good(mcu: str):
    bench = Bench(mcu, rate_rad_s=2.0)
    bench.hold(600, 1.0, 1.0)
    bench.chip.pulses.clear()
    bench.run(1400)  # 100 ms of watchdog, 500 to level, 500 there
    own = [pulse for pulse in bench.chip.pulses if pulse.servo == 0]
    assert own[3].us == pytest.approx(2100.0, abs=1.0)
    assert all(-25.5 < step <= 1.0 for step in np.diff([pulse.us for pulse in own]))
    assert [pulse.us for pulse in own[-24:]] == pytest.approx([1500.0] * 24, abs=1.0)
    assert len(own) * 20 == pytest.approx(1100, abs=45)
    assert bench.has(wire.LATCHED, wire.BY_WATCHDOG)
    bench.command(0.5, 0.5)
    bench.arm()
    assert bench.quiet(200)


def test_disarming_and_a_reset_end_the_pulses_within_a_frame():
    bench = Bench()
    bench.hold(100, 0.5, 0.5)
    bench.send(Disarm())
    assert bench.quiet(100)
    bench.configure()
    bench.arm()
    bench.hold(100, 0.5, 0.5)
    bench.chip.reset()
    bench.chip.pulses.clear()
    assert bench.hold(300, 0.5, 0.5)[1:] == []  # what was under way may end
    bench.configure()
    bench.arm()
    assert {round(pulse.us) for pulse in bench.hold(60, 0.0, 0.0)} == {1500, 1480}


def test_noise_on_the_line_moves_nothing():
    bench = Bench()
    bench.run(50)
    bench.chip.pulses.clear()
    rng = np.random.default_rng(2)
    for _ in range(50):
        bench.command(0.0, 0.0)
        bench.chip.receive(rng.integers(0, 256, 200).astype(np.uint8).tobytes() + b"\0")
        bench.run(10)
    assert {round(pulse.us) for pulse in bench.chip.pulses} == {1500, 1480}
    assert bench.newest.bad_frames > 20


def test_the_chip_repeats_bit_for_bit():
    runs = []
    for _ in range(2):
        bench = Bench()
        bench.hold(300, 0.7, -0.3)
        runs.append((bench.chip.pulses, bench.chip.cycles))
    assert runs[0] == runs[1]


@CHIPS
@pytest.mark.parametrize("kind", ["all", "servo"])
def test_it_fits_the_chip(mcu: str, kind: str):
    """Uno and Nano have the same chip; the figures stand in rig/firmware/README.md."""
    hexadecimal = firmware(mcu, kind=kind).with_suffix(".hex").read_text()
    data = [bytes.fromhex(line[1:]) for line in hexadecimal.split()]
    size = sum(line[0] for line in data if line[3] == 0)
    assert 4_000 < size < 10_000 < FLASH[mcu]
