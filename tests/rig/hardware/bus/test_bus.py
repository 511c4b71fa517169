"""A table on bus servos: how it starts and ends, what it survives, what ends its run by name."""

from dataclasses import replace
from itertools import count, pairwise
from math import pi

import numpy as np
import pytest

from rig.hardware.board.link import LinkLost
from rig.hardware.board.serial_link import SerialLink
from rig.hardware.bus.bus import START_RAD_S, BusTable, ServoAlarm, check_period
from rig.hardware.bus.dynamixel import Dynamixel
from rig.hardware.bus.feetech import Feetech
from rig.hardware.wiring import Wiring
from rig.parameters import Rig
from rig.rigfile import read_rig
from rig.table import ArmingStoppedError
from rig.three_arms import arm_angle
from tests.support import ROOT
from tests.support.boards.bus_servos import Bus
from tests.support.boards.bus_world import LEVEL, VENDORS, BusWorld, bus_of, table_on
from tests.support.boards.pty import PtyBoard, SteppedLink

EVERY = pytest.mark.parametrize("kind", VENDORS)
COUNT_RAD = 2 * pi / 4096
ARMS = replace(read_rig(ROOT / "experiments/rigs/three-arms.toml"), effects={})
GOAL = {"feetech": 42, "dynamixel": 116}
SPEED = {"feetech": 46, "dynamixel": 112}
AWAY = (2048 + 300.0, 2048 - 200.0)


class Bench:
    """A bus on a pty with a plant; opens tables in its time."""

    def __init__(self, kind: str, counts=AWAY, rig: Rig | None = None, wiring=LEVEL) -> None:
        self.kind, self.board = kind, bus_of(kind, counts)
        self.world = BusWorld(self.board, rig or Rig(), start_m=(1.0, 1.0), wiring=wiring)
        self.pty = PtyBoard(self.world, thread=False)

    def open(self, **settings) -> BusTable:
        link = SteppedLink(self.pty, SerialLink(self.pty.port, 1_000_000, "servo bus"))
        return table_on(self.world, link, self.kind, **settings)

    def run(self, seconds: float) -> None:
        """The bus goes on alone; what is on its way arrives."""
        for _ in range(round(1e3 * seconds)):
            self.pty.step()

    def goals(self) -> list[tuple[int, int]]:
        """Every goal told so far: (id, counts)."""
        return [
            (servo_id, int.from_bytes(data, "little"))
            for servo_id, address, data in self.board.told
            if address == GOAL[self.kind]
        ]


@pytest.fixture
def bench():
    made: list[Bench] = []

    def one(*settings) -> Bench:
        made.append(Bench(*settings))
        return made[-1]

    yield one
    for each in made:
        each.pty.close()


def ticks(table: BusTable, n: int, angles=(0.0, 0.0)) -> tuple[float, float]:
    seen = (0.0, 0.0)
    for _ in range(n):
        seen = table.read().theta_rad
        table.drive(angles)
    return seen


@EVERY
def test_nothing_moves_before_it_is_armed(bench, kind: str):
    one = bench(kind)
    table = one.open()
    assert table.read().theta_rad == pytest.approx((300 * COUNT_RAD, -200 * COUNT_RAD))
    assert table.read().t_s == pytest.approx(0.004)
    table.drive((0.0, 0.0))
    with pytest.raises(ValueError, match="not armed"):
        table.drive((0.1, 0.0))
    table.close()
    assert one.board.told == []


@EVERY
def test_it_starts_where_the_servos_are_and_goes_to_level_slowly(bench, kind: str):
    one = bench(kind)
    shafts: list[tuple[float, float]] = []
    one.world.watch = lambda: shafts.append(one.world.shafts_rad)
    with one.open(rate_limit_rad_s=(2.0, 3.0)) as table:
        assert one.goals()[:2] == [(1, 2348), (2, 1848)]
        assert table.read().theta_rad == pytest.approx((0.0, 0.0), abs=0.04)
        speeds = [d for _, address, d in one.board.told if address == SPEED[kind]]
        unit = COUNT_RAD if kind == "feetech" else 0.229 * 2 * pi / 60
        told = [unit * int.from_bytes(d, "little") for d in speeds]
        assert told == pytest.approx([2.0, 3.0], rel=0.01)
    steps = [abs(b[k] - a[k]) for a, b in pairwise(shafts) for k in (0, 1)]
    assert max(steps) < 1.3e-3 * START_RAD_S


@EVERY
def test_a_servo_that_stands_a_little_below_zero_is_told_so_and_comes_to_level(bench, kind: str):
    one = bench(kind, (-5, 2048))
    with one.open(wiring=Wiring(zero_counts=(400, 2048))) as table:
        first = next(data for _, address, data in one.board.told if address == GOAL[kind])
        assert first == bytes.fromhex("0580" if kind == "feetech" else "fbffffff")
        assert table.read().theta_rad == pytest.approx((0.0, 0.0), abs=0.04)


@EVERY
def test_an_arm_that_is_turned_away_from_level_is_refused_before_it_moves(bench, kind: str):
    one = bench(kind, (2600, 2048))
    with pytest.raises(ValueError, match=r"servo x stands 3\.37 rad from level, it may turn 0\.6"):
        one.open(wiring=Wiring(zero_counts=(400, 2048))).arm()
    assert one.board.told == []


THREE = Wiring((2, 0, 1), (1, 1, 1), (-1, 1, -1), (2100, 1990, 2060))


@EVERY
def test_three_arms_stand_as_the_tilt_asks_and_tell_it(bench, kind: str):
    one = bench(kind, (2100, 1990, 2060), ARMS, THREE)
    linkage = ARMS.linkage
    with one.open(wiring=THREE, angle_limit_rad=0.2) as table:
        seen = ticks(table, 60, (0.15, -0.1))
        assert seen == pytest.approx((0.15, -0.1), abs=0.004)
        sines = np.sin((0.15, -0.1))
        level = arm_angle(0, 0.0, 0.0, linkage.height_m, linkage.size)
        arms = [arm_angle(i, *sines, linkage.height_m, linkage.size) - level for i in range(3)]
        off = np.array([-arms[2], arms[0], -arms[1]]) / COUNT_RAD
        counts = [servo.counts for servo in one.board.servos.values()]
        assert counts == pytest.approx(off + np.array([2100, 1990, 2060]), abs=3)
        one.board.servos[2].gone = True
        with pytest.raises(LinkLost, match=r"servo 2 \(arm at 0 degrees\) is lost: silent"):
            ticks(table, 50)


@EVERY
def test_arms_that_hold_the_plate_askew_are_brought_to_level_slowly(bench, kind: str):
    one = bench(kind, (2100 + 700, 1990 - 600, 2060 + 500), ARMS, THREE)
    turned: list[tuple[float, ...]] = []
    one.world.watch = lambda: turned.append(one.world.turned_rad)
    with one.open(wiring=THREE, angle_limit_rad=0.2) as table:
        assert table.read().theta_rad == pytest.approx((0.0, 0.0), abs=0.02)
    assert np.abs(np.diff(turned, axis=0)).max() < 1.3e-3 * START_RAD_S


@EVERY
def test_signs_swap_and_level_are_the_wirings(bench, kind: str):
    wiring = Wiring(order=(1, 0), sign_angle=(-1, 1), zero_counts=(2100, 1990))
    one = bench(kind, (2100, 1990))
    with one.open(wiring=wiring) as table:
        seen = ticks(table, 60, (0.2, -0.1))
        assert seen == pytest.approx((0.2, -0.1), abs=0.004)
        counts = [servo.counts for servo in one.board.servos.values()]
        assert counts == pytest.approx([2100 + 0.1 / COUNT_RAD, 1990 + 0.2 / COUNT_RAD], abs=3)


@EVERY
def test_angles_beyond_the_limit_are_not_told(bench, kind: str):
    one = bench(kind, (2048, 2048))
    with one.open(angle_limit_rad=0.3) as table:
        ticks(table, 5, (9.0, -9.0))
        with pytest.raises(ValueError, match="finite"):
            table.drive((float("nan"), 0.0))
    most = max(abs(counts - 2048) for _, counts in one.goals())
    assert most == round(0.3 / COUNT_RAD)


@EVERY
@pytest.mark.parametrize("fails", [False, True])
def test_leaving_levels_and_holds(bench, kind: str, fails: bool):
    one = bench(kind)
    try:
        with one.open() as table:
            ticks(table, 30, (0.3, 0.3))
            if fails:
                raise KeyboardInterrupt
    except KeyboardInterrupt:
        assert fails
    one.run(1.0)
    assert one.world.shafts_rad == pytest.approx((0.0, 0.0), abs=1e-3)
    assert [servo.memory[40 if kind == "feetech" else 64] for servo in servos(one)] == [1, 1]
    if kind == "dynamixel":
        assert not any(one.board.frozen.values())


def servos(one: Bench):
    return one.board.servos.values()


ERRORS = [
    ("feetech", 32, "overload"), ("feetech", 1, "voltage"), ("feetech", 4, "temperature"),
    ("dynamixel", 32, "overload"), ("dynamixel", 1, "voltage"), ("dynamixel", 4, "temperature"),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "bit", "name"), ERRORS)
def test_a_servo_that_reports_an_error_ends_the_run_by_name(bench, kind, bit: int, name: str):
    one = bench(kind)

    def work() -> None:
        with one.open() as table:
            ticks(table, 20, (0.2, 0.2))
            servo = one.board.servos[2]
            servo.alarm = bit
            if kind == "dynamixel":
                servo.alarm, servo.memory[70] = 0x80, bit
            ticks(table, 20, (0.2, 0.2))

    with pytest.raises(ServoAlarm, match=rf"servo 2 \(y\) reports: .*{name}") as caught:
        work()
    assert caught.value.outcome == "servo alarm"
    assert "\n" not in str(caught.value)
    one.run(1.0)
    assert one.world.shafts_rad == pytest.approx((0.0, 0.0), abs=1e-3)  # the others are levelled


@EVERY
def test_a_servo_in_alarm_is_not_even_opened(bench, kind: str):
    one = bench(kind)
    one.board.servos[1].alarm = 32 if kind == "feetech" else 0x80
    with pytest.raises(ServoAlarm, match=r"servo 1 \(x\) reports"):
        one.open()
    assert one.board.told == []


@EVERY
def test_a_servo_whose_supply_was_cut_is_named(bench, kind: str):
    """It answers again at once, but its torque is off and its speed limit gone."""
    one = bench(kind)
    with one.open() as table:
        ticks(table, 10)
        servo = one.board.servos[1]
        servo.memory[40 if kind == "feetech" else 64] = 0
        servo.put(SPEED[kind], 0, 2)
        with pytest.raises(ServoAlarm, match="was its supply cut"):
            ticks(table, 50)


def test_a_halted_program_finds_its_servos_stopped_by_their_watchdog(bench):
    one = bench("dynamixel")
    with one.open() as table:
        ticks(table, 50, (0.3, 0.3))
        table.drive((-0.3, -0.3))
        one.run(0.3)
        assert all(one.board.frozen.values())
        assert min(one.world.shafts_rad) < -0.05  # it was on its way, and stands
        stands = one.world.shafts_rad
        one.run(0.5)
        assert one.world.shafts_rad == pytest.approx(stands, abs=0.05)
        with pytest.raises(ServoAlarm, match="no word for 100 ms"):
            ticks(table, 50)
    one.run(2.0)
    assert one.world.shafts_rad == pytest.approx((0.0, 0.0), abs=1e-3)


def test_a_watchdog_that_another_program_switched_off_ends_the_run(bench):
    """A servo without one would go on to its last goal after a halt of this program."""
    one = bench("dynamixel")
    with one.open() as table:
        ticks(table, 50)
        one.board.write(one.board.servos[1], 98, b"\0")
        with pytest.raises(ServoAlarm, match=r"servo 1 \(x\) reports: its watchdog was set"):
            ticks(table, 50)


@EVERY
def test_a_servo_that_is_missing_is_named_with_the_cure(bench, kind: str):
    one = bench(kind)
    with pytest.raises(LinkLost, match=r"servo 7 \(y\) is lost.*table\.ids and table\.baud"):
        one.open(ids=(1, 7))


@EVERY
def test_a_servo_that_falls_silent_ends_the_run_within_100_ms(bench, kind: str):
    one = bench(kind)
    with one.open() as table:
        ticks(table, 10)
        one.board.servos[2].gone = True
        begin = one.world.now_s
        with pytest.raises(LinkLost, match=r"servo 2 \(y\) is lost: silent"):
            ticks(table, 50)
        assert one.world.now_s - begin < 0.1


def spoilers(bus: Bus) -> dict:
    """What may happen to answers, every fifth of them."""
    other = bus.frame(9, 0, b"\0" * 8)
    return {
        "damaged": lambda answer: answer[:6] + bytes((answer[6] ^ 4,)) + answer[7:],
        "cut": lambda answer: answer[:-3],
        "none": lambda answer: b"",
        "foreign": lambda answer: other + answer,
        "doubled": lambda answer: answer + answer,
        "noise before": lambda answer: b"\xff\xff\x01\x3f\xff\xfd\x00" + answer,
        "of another length": lambda answer: bus.frame(1, 0, b"\0\0") + answer,
    }


@EVERY
@pytest.mark.parametrize("how", spoilers(bus_of("feetech")))
def test_spoilt_answers_cost_a_tick_and_no_wrong_angle(bench, kind: str, how: str):
    one = bench(kind, (2048, 2048))
    with one.open() as table:
        count = 0

        def spoil(answer: bytes) -> bytes:
            nonlocal count
            count += 1
            return spoilers(one.board)[how](answer) if count % 5 == 0 else answer

        one.board.spoil = spoil
        times = []
        for _ in range(100):
            reading = table.read()
            times.append(reading.t_s)
            assert reading.theta_rad == pytest.approx((0.0, 0.0), abs=2 * COUNT_RAD)
            table.drive((0.0, 0.0))
        one.board.spoil = lambda answer: answer
    assert all(b > a for a, b in pairwise(times))
    notes = table.notes()
    if how in ("damaged", "cut", "none"):
        assert notes["asked_again"] > 10
        assert notes["ticks_missed"] > 10
    assert notes["lowest_voltage_V"] == pytest.approx(12.1)


@EVERY
@pytest.mark.parametrize("late_ms", [3, 8, 15])
def test_late_answers_make_ticks_late_and_no_more(bench, kind: str, late_ms: int):
    """Up to what an FTDI adapter holds back without low latency: 16 ms."""
    one = bench(kind)
    one.board.late_ms = late_ms
    with one.open() as table:
        seen = ticks(table, 30, (0.2, 0.2))
        assert seen == pytest.approx((0.2, 0.2), abs=0.05)
        assert table.asked_again == 0


@EVERY
@pytest.mark.parametrize("lates", [{0: 24, 1: 24, 2: 10, 3: 10}, {1: 45, 2: 45, 5: 12, 6: 12}])
def test_an_answer_to_an_earlier_question_is_none_to_this_one(bench, kind: str, lates: dict):
    """Held back beyond the next question, or the next two, while the arms turn as fast as they
    can; lates: by answer, of every forty, how late it is [ms].
    """
    one = bench(kind, (2048, 2048))
    where: list[tuple[float, float]] = []
    count = 0

    def late(answer: bytes) -> bytes:
        nonlocal count
        count += 1
        one.board.late_ms = lates.get(count % 40, 0)
        return answer

    with one.open() as table:
        begin = round(1e3 * one.world.now_s)
        one.world.watch = lambda: where.append(one.world.shafts_rad)
        one.board.spoil = late
        off = []
        for _ in range(150):
            reading = table.read()
            then = where[round(1e3 * (table.zero_s + reading.t_s)) - begin]
            off += [abs(a - b) for a, b in zip(reading.theta_rad, then, strict=True)]
            table.drive((0.5, -0.5) if reading.t_s % 0.3 < 0.15 else (-0.5, 0.5))
        one.board.spoil, one.board.late_ms = (lambda answer: answer), 0
    assert table.asked_again >= 5
    assert max(off) < 4.7e-3 * 2 + COUNT_RAD  # the question takes a millisecond


WRONG = {
    "feetech": [
        (33, 1, 1, "operating mode 1"),
        (30, 2, 1, "angular resolution of 2"),  # it turned twice as far as it told
        (11, 2300, 2, "goes from count 0 to 2300"),
    ],
    "dynamixel": [
        (11, 4, 1, "operating mode 4"),
        (10, 4, 1, "time-based"),
        (48, 2300, 4, "goes from count 0 to 2300"),
    ],
}


@pytest.mark.parametrize(
    ("kind", "address", "value", "length", "words"),
    [(kind, *row) for kind, rows in WRONG.items() for row in rows],
)
def test_a_servo_that_is_set_otherwise_is_refused_in_one_line(
    bench, kind, address: int, value: int, length: int, words: str
):
    one = bench(kind)
    one.board.servos[2].put(address, value, length)
    with pytest.raises(ValueError, match=rf"servo 2 \(y\) .*{words}") as caught:
        one.open()
    assert "\n" not in str(caught.value)
    assert one.board.told == []


@EVERY
def test_a_level_near_the_end_of_the_servos_turn_is_refused(bench, kind: str):
    one = bench(kind)
    with pytest.raises(ValueError, match=r"needs -42 to 642.*trim_rad"):
        one.open(wiring=Wiring(zero_counts=(2048, 300)))


@EVERY
def test_an_arm_that_is_held_does_not_come_to_level_and_is_named(bench, kind: str):
    one = bench(kind)
    one.board.servos[1].held = True
    with pytest.raises(ServoAlarm, match=r"servo x stays 0\.46 rad from level"):
        one.open().__enter__()
    one.run(1.0)
    assert (1, round(one.board.servos[1].counts)) in one.goals()[-2:]  # it pushed on, for ever


@EVERY
def test_a_stop_on_the_way_to_level_is_heeded_at_the_next_tick(bench, kind: str):
    """No arm is moved on, also one that is held, and nothing is levelled behind the stop."""
    one = bench(kind)
    one.board.servos[1].held = True
    table, looks = one.open(), count(1)
    table.stop_asked = lambda: next(looks) == 20
    with pytest.raises(ArmingStoppedError), table:
        pass
    assert next(looks) == 21
    one.run(1.0)
    (_, held), (_, other) = one.goals()[-2:]
    assert held == 2348
    assert 1850 < other < 2040
    assert one.world.shafts_rad[1] == pytest.approx((other - 2048) * COUNT_RAD, abs=2 * COUNT_RAD)


@EVERY
def test_what_a_lost_packet_left_out_at_arming_is_told_again_or_ends_it(bench, kind: str):
    """No servo acknowledges what all are told: a lost speed limit made one as fast as it can."""
    vendor = {"feetech": Feetech, "dynamixel": Dynamixel}[kind]()
    noticed = (vendor.torque,) if kind == "dynamixel" else ()  # a Feetech's goal turns it on
    for register in (vendor.speed, vendor.goal, *noticed):
        one, lost = bench(kind), count(1)
        written = one.board.write

        def noisy(servo, address, data, register=register, lost=lost, written=written):
            if address != register or next(lost) > 3:  # of two servos: one packet, half the next
                written(servo, address, data)

        one.board.write = noisy
        with one.open() as table:
            ticks(table, 5)
        assert next(lost) > 6
    for register in (vendor.speed, vendor.torque):
        one = bench(kind)
        written = one.board.write

        def deaf(servo, address, data, register=register, written=written):
            if address != register:
                written(servo, address, data)
                if address == 42:  # a Feetech's goal turns torque on by itself
                    servo.memory[40] = 0

        one.board.write = deaf
        with pytest.raises(ServoAlarm, match="is not as it was told"):
            one.open().__enter__()


@EVERY
def test_before_homing_goals_go_slowly_and_nothing_is_levelled(bench, kind: str):
    one = bench(kind)
    table = one.open(homed=False)
    table.level_s = 0.0
    with table:
        assert one.world.shafts_rad == pytest.approx((300 * COUNT_RAD, -200 * COUNT_RAD))
        ticks(table, 50, (0.4, 0.0))
    steps = [b[1] - a[1] for a, b in zip(one.goals()[::2], one.goals()[2::2], strict=False)]
    assert max(map(abs, steps)) <= 2  # 0.5 rad/s in 4 ms: 1.3 counts
    assert abs(one.world.shafts_rad[0] - 300 * COUNT_RAD) < 0.12


def test_the_speed_of_servos_that_count_in_fifties_is_told_in_fifties(bench):
    one = bench("feetech")
    for servo in servos(one):
        servo.put(18, 8, 1)
    with one.open(rate_limit_rad_s=(4.7, 4.7)):
        speeds = [d for _, address, d in one.board.told if address == 46]
        assert speeds[0] == (61).to_bytes(2, "little")


@pytest.mark.parametrize(
    ("vendor", "baud", "rate_hz", "fits"),
    [
        (Feetech(), 1_000_000, 250, True),
        (Feetech(), 1_000_000, 500, False),
        (Feetech(), 115_200, 100, True),
        (Feetech(), 115_200, 125, False),
        (Dynamixel(), 1_000_000, 250, True),
        (Dynamixel(), 57_600, 100, False),
        (Dynamixel(), 57_600, 30, True),
    ],
)
def test_a_tick_that_is_too_short_for_the_bus_is_refused(vendor, baud, rate_hz, fits: bool):
    if fits:
        return check_period(vendor, 2, baud, 1 / rate_hz)
    with pytest.raises(ValueError, match=rf"table.baud = {baud}: 2 {vendor.name} servos need"):
        check_period(vendor, 2, baud, 1 / rate_hz)


@EVERY
def test_a_lost_packet_at_the_end_leaves_no_arm_tilted(bench, kind: str):
    """After an alarm the way to level was told once, and by nobody again."""
    one = bench(kind)
    write, heard = one.board.write, count()

    def given_up() -> None:
        with one.open() as table:
            ticks(table, 100, (0.3, 0.3))
            one.board.servos[2].alarm = 32
            one.board.write = lambda *told: write(*told) if next(heard) >= 6 else None
            ticks(table, 100, (0.3, 0.3))

    with pytest.raises(ServoAlarm):
        given_up()
    one.run(3.0)
    assert next(heard) > 6
    assert one.board.servos[1].counts == pytest.approx(2048, abs=3)


@EVERY
def test_a_run_that_ends_without_levelling_pushes_nothing_on(bench, kind: str):
    """As the loop ends one whose servo is held: `level_s` is 0. It was told level, for ever."""
    one = bench(kind)
    table = one.open()
    with table:
        ticks(table, 200, (0.3, 0.0))
        one.board.servos[1].held = True
        ticks(table, 50, (-0.3, 0.0))
        table.level_s = 0.0
    one.run(1.0)
    assert (1, round(one.board.servos[1].counts)) in one.goals()[-2:]
