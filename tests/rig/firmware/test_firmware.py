"""The real firmware binary, its registers and pins simulated, under the ordinary loop."""

from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from experiments.runs.assemble import known, load_rig
from experiments.runs.protocol import course, read_protocol
from rig.control.controllers import COMPENSATORS
from rig.hardware.board.wire import (
    VERSION,
    Arm,
    Command,
    ConfigAnswer,
    ConfigRequest,
    Parser,
    Telemetry,
    encode,
)
from rig.log import Log
from rig.loop.loop import Loop
from rig.parameters import Rig
from rig.simulation.operator import SimulatedOperator
from tests.support.boards.chip import Chip, firmware
from tests.support.boards.host import HostBoard
from tests.support.boards.world import World, table_on


def balance(
    board, *, seed: int = 1, arm: str = "with", seconds: float | None = None
) -> tuple[Log, World, str]:
    """The shipped free-release protocol through packets and driver: log, world, outcome."""
    rig = load_rig(None)
    protocol = read_protocol(Path(str(files("experiments") / "protocols/free-release.toml")))
    if seconds is not None:
        protocol = protocol.model_copy(update={"duration_s": seconds})
    way = course(protocol, rig, seed)
    world = World(board, rig, seed=seed, start_m=way.start_m, held=True)
    operator, rows = SimulatedOperator(world.plant, way.hold_s), []
    with table_on(world) as table:
        loop = Loop(
            table,
            known(rig),
            COMPENSATORS[arm],
            way,
            operator=operator,
            keep=lambda row: rows.append(row.copy()),
        )
        ending = loop.run()
        assert table.ticks_missed == 0
    return Log.from_rows(np.array(rows)), world, ending.outcome


@pytest.fixture(scope="module")
def on_chip() -> tuple[Log, World, str]:
    return balance(Chip())


def test_the_firmware_balances_the_ball(on_chip):
    log, world, outcome = on_chip
    assert outcome == "completed"
    t_s, xy = log.ball()
    settled = np.hypot(*xy[t_s > t_s[-1] - 4].T)
    assert settled.max() < 0.012  # from 18 cm away to the limit cycle of a table with play
    assert world.volts == (0.0, 0.0)
    assert np.all(np.abs(world.arms_rad) < 0.03)


SLOWER = ("adaptive", "adaptive-asymmetric", "hybrid", "neural", "disturbance")


@pytest.mark.parametrize(
    "arm", ["smooth", *(pytest.param(name, marks=pytest.mark.slow) for name in SLOWER)]
)
def test_the_cures_of_the_literature_do_too(arm: str):
    log, world, outcome = balance(Chip(), arm=arm, seconds=5.0)
    assert outcome == "completed"
    t_s, xy = log.ball()
    assert np.hypot(*xy[t_s > t_s[-1] - 0.5].T).max() < 0.04  # from 18 cm away
    assert world.volts == (0.0, 0.0)


def test_the_whole_run_repeats_bit_for_bit(on_chip):
    log, _, _ = balance(Chip())
    np.testing.assert_array_equal(log.rows, on_chip[0].rows)


def test_the_chips_protocol_is_the_hosts(on_chip):
    """The binary and protocol.c built for this machine do nearly the same: what is between them
    (the ticks' phase, steps of the pulse width) is the chip's alone."""
    log, _, outcome = balance(HostBoard())
    assert outcome == "completed"
    n = 1500  # until the play's chaos parts them
    apart = log["theta_x_rad"][:n] - on_chip[0]["theta_x_rad"][:n]
    assert np.sqrt(np.mean(apart**2)) < 0.02
    assert abs(len(log) - len(on_chip[0])) <= 5


def test_the_chip_repeats_bit_for_bit():
    runs = []
    for _ in range(2):
        chip, got = Chip(), b""
        chip.run_ms((0, 0))
        chip.receive(encode(ConfigRequest(VERSION, 7, 2, 1, 0, 0, 4096, 341, 6000)))
        for k in range(300):
            chip.run_ms((k // 3, -k // 2))
            got += chip.take()
        runs.append((got, chip.cycles))
    assert runs[0] == runs[1]
    assert len(runs[0][0]) > 3000


class Bench:
    """A chip on the bench, configured and armed."""

    def __init__(self, *, baud: int = 500_000, period_ms: int = 2) -> None:
        self.chip, self.parser = Chip(baud=baud), Parser()
        self.run(20)
        self.send(ConfigRequest(VERSION, 7, period_ms, 1, 0, 0, 4096, 341, 6000))
        answer = next(p for p in self.run(20) if isinstance(p, ConfigAnswer))
        assert (answer.homing, answer.features) == (0, 0)
        self.send(Arm(answer.token, 100))
        self.run(3)

    def send(self, packet) -> None:
        self.chip.receive(encode(packet))

    def run(self, ms: int, counts=(0, 0)) -> list:
        found = []
        for _ in range(ms):
            self.chip.run_ms(counts)
            found += self.parser.feed(self.chip.take())
        return found


@pytest.mark.parametrize("pace", [0.97, 1.03])
def test_a_chip_with_a_poor_resonator_is_neither_lost_nor_blind(pace: float):
    """What a camera saw is dated by the host's clock: the board's must be held to it."""
    world = World(Chip(), Rig(), pace=pace)
    seen = 0
    with table_on(world) as table:
        while world.now_s < 4.0:  # with 30 s of memory it would be lost by now
            reading = table.read()
            table.drive((0.0, 0.0))
            seen += reading.ball is not None
            assert abs(reading.t_s + table.zero_s - world.now_s) < 0.018
    assert seen > 0.95 * 60 * 4


@pytest.mark.parametrize("volts", [(3.0, -1.5), (-6.0, 6.0), (0.03, 0.0), (0.0, -0.03)])
def test_pulse_width_and_direction_are_the_volts_asked(volts):
    bench = Bench()
    bench.send(Command(101, 50, *(round(1000 * v) for v in volts)))
    bench.run(5)
    assert bench.chip.volts() == pytest.approx(volts, abs=12 / 800 / 2 + 1e-9)
    bench.run(50)  # its time to live has passed
    assert bench.chip.volts() == (0.0, 0.0)


@pytest.mark.parametrize("speed", [1, 7, 20])
def test_encoders_count_every_edge_both_ways(speed: int):
    """20 counts a millisecond is three times the servo's full speed."""
    bench, at = Bench(), 0
    for step in [speed] * 50 + [-speed] * 80 + [0] * 4:
        at += step
        bench.chip.run_ms((at, -at))
    newest = [p for p in bench.run(6, (at, -at)) if isinstance(p, Telemetry)][-1]
    assert (newest.count_0, newest.count_1) == (at, -at)


def test_on_a_line_too_slow_for_every_tick_whole_frames_arrive():
    """27 bytes take 2.3 ms at 115200 baud; asked for every millisecond, the newest are sent."""
    bench = Bench(baud=115_200, period_ms=1)
    found = [p for p in bench.run(600) if isinstance(p, Telemetry)]
    assert bench.parser.bad_frames == 0
    assert len(found) > 0.9 * 600 / 2.35
    assert np.diff([p.clock_us for p in found]).min() > 0


def test_a_reset_chip_is_disarmed_and_quiet():
    bench = Bench()
    bench.send(Command(101, 100, 3000, 3000))
    bench.run(5)
    assert bench.chip.volts() == (3.0, 3.0)
    bench.chip.reset()
    bench.send(Command(102, 100, 3000, 3000))
    assert bench.run(300) == []
    assert bench.chip.volts() == (0.0, 0.0)


def test_the_mega_builds_too():
    assert firmware("atmega2560").stat().st_size > 1000
    assert Rig().servo.encoder_counts_per_rev == 4096


@pytest.mark.parametrize("what", ["commands", "zeros"])
def test_a_host_that_never_pauses_delays_no_tick_and_keeps_no_volts(what: str):
    """A line at its full 500 kBaud; before, the chip saw to nothing else until it was reset."""
    bench = Bench()
    bench.send(Command(101, 20, 2000, 0))
    bench.run(2)
    assert any(bench.chip.volts())
    old = encode(Command(50, 20, 3000, 3000))
    flood = (bytes(50) if what == "zeros" else 4 * old)[:50]
    seen_us, volts = [], []
    for _ in range(300):
        bench.chip.receive(flood)
        seen_us += [one.clock_us for one in bench.run(1) if isinstance(one, Telemetry)]
        volts.append(any(bench.chip.volts()))
    assert not any(volts[25:])  # the command's 20 ms, and a tick
    assert max(np.diff(seen_us)) <= 4000  # every telemetry comes, a tick late at most; no reset
    assert min(np.diff(seen_us)) > 0
