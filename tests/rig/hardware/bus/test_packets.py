"""Packets of both makers: the published examples byte for byte, and every kind of damage.

Examples: Feetech, Communication Protocol User Manual, 1.3.2, 1.3.6 (example 7) and 1.3.7 (example
8); ROBOTIS e-Manual, Protocol 2.0: Sync Read, Sync Write, Ping.
"""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig.hardware.bus.dynamixel import Dynamixel, DynamixelParser, crc16
from rig.hardware.bus.dynamixel import packet as dynamixel_packet
from rig.hardware.bus.feetech import Feetech, FeetechParser, check_sum
from rig.hardware.bus.feetech import packet as feetech_packet
from rig.hardware.bus.vendor import Block, Status
from tests.support.boards.bus_servos import DynamixelBus, FeetechBus

BUSES = {"feetech": FeetechBus({1: 2048}), "dynamixel": DynamixelBus({1: 2048})}
VENDORS = {"feetech": Feetech(), "dynamixel": Dynamixel()}
EVERY = pytest.mark.parametrize("maker", VENDORS)
answers = st.tuples(st.integers(0, 252), st.integers(0, 255), st.binary(max_size=40))


def test_feetech_questions_are_the_published_ones():
    goal = bytes.fromhex("00080000e803")  # position 2048, time 0, speed 1000
    assert Feetech().ask(Block(0x38, 8), (1, 2)) == bytes.fromhex("fffffe06823808010236")
    assert Feetech().tell(0x2A, dict.fromkeys((1, 2, 3, 4), goal)) == bytes.fromhex(
        "fffffe20832a06 0100080000e803 0200080000e803 0300080000e803 0400080000e803 58"
    )
    assert feetech_packet(1, 2, b"\x38\x02") == bytes.fromhex("ffff0104023802be")


def test_feetech_answers_are_read_as_published():
    heard = bytes.fromhex("ffff010a00 0008 0000 0000 79 1e 55 ffff020a00 ff07 0000 0000 77 23 53")
    one, two = FeetechParser().feed(heard)
    seen = Feetech().read_present(one.data)
    assert (one.servo_id, seen.counts, seen.temperature_C) == (1, 2048, 30.0)
    assert seen.voltage_V == pytest.approx(12.1)
    assert (two.servo_id, Feetech().read_present(two.data).counts) == (2, 2047)
    [read] = FeetechParser().feed(bytes.fromhex("ffff0104001805dd"))
    assert read == Status(1, 0, b"\x18\x05")


def test_feetech_numbers_have_a_sign_bit():
    seen = Feetech().read_present(bytes.fromhex("0180 0000 6405 79 1e"))
    assert seen.counts == -1
    assert seen.load == pytest.approx(-0.356)


@given(st.integers(-32767, 32767))
def test_a_goal_is_written_as_a_position_is_read(counts: int):
    """Feetech's by sign and magnitude, Dynamixel's in two's complement."""
    assert Feetech().read_present(Feetech().goal_data(counts) + bytes(6)).counts == counts
    position = bytes(6) + Dynamixel().goal_data(counts) + bytes(11)
    assert Dynamixel().read_present(position).counts == counts


def test_goals_below_zero_are_the_documents():
    assert Feetech().goal_data(-5) == bytes.fromhex("0580")
    assert Dynamixel().goal_data(-5) == bytes.fromhex("fbffffff")


def test_dynamixel_questions_are_the_published_ones():
    goals = {1: (150).to_bytes(4, "little"), 2: (170).to_bytes(4, "little")}
    assert Dynamixel().ask(Block(132, 4), (1, 2)) == bytes.fromhex(
        "fffffd00 fe 0900 82 8400 0400 01 02 cefa"
    )
    assert Dynamixel().tell(116, goals) == bytes.fromhex(
        "fffffd00 fe 1100 83 7400 0400 01 96000000 02 aa000000 8287"
    )
    assert dynamixel_packet(1, 1, b"") == bytes.fromhex("fffffd00 01 0300 01 194e")


def test_dynamixel_answers_are_read_as_published():
    heard = bytes.fromhex(
        "fffffd00 01 0800 55 00 a6000000 8cc0 fffffd00 02 0800 55 00 1f080000 babe"
    )
    assert DynamixelParser().feed(heard) == [
        Status(1, 0, (166).to_bytes(4, "little")),
        Status(2, 0, (2079).to_bytes(4, "little")),
    ]
    ping = bytes.fromhex("fffffd00 01 0700 55 00 060426 655d")
    assert DynamixelParser().feed(ping) == [Status(1, 0, b"\x06\x04\x26")]


def test_check_values_are_the_published_ones():
    assert crc16(b"123456789") == 0xFEE8  # CRC-16/UMTS, its check value
    assert check_sum(bytes.fromhex("fe06823808 0102")) == 0x36


def test_what_looks_like_a_header_is_stuffed():
    """FF FF FD in the data, also where its last byte is followed by another FD."""
    for inner in ("fffffd", "fffffdfd", "fffffffd", "fffffdfffffd"):
        data = bytes.fromhex(inner)
        whole = BUSES["dynamixel"].frame(1, 0, data)
        assert whole.count(b"\xff\xff\xfd\xfd") >= 1
        assert DynamixelParser().feed(whole) == [Status(1, 0, data)]
        assert BUSES["dynamixel"].unstuff(dynamixel_packet(1, 3, data)[7:-2])[1:] == data


@EVERY
@given(st.lists(answers, max_size=5), st.data())
def test_answers_survive_the_way_in_any_pieces(maker: str, sent, data):
    stream = b"".join(BUSES[maker].frame(*one) for one in sent)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=8)))
    parser, found = VENDORS[maker].parser(), []
    for begin, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        found += parser.feed(stream[begin:end])
    assert found == [Status(*one) for one in sent]
    assert parser.bad_packets == 0


@EVERY
@given(st.binary(max_size=200), answers)
def test_garbage_before_an_answer_costs_it_at_most_once(maker: str, garbage: bytes, one):
    """What garbage begins may swallow the first answer; after `clear`, as before every question,
    the next one is whole."""
    parser = VENDORS[maker].parser()
    parser.feed(garbage + BUSES[maker].frame(*one))
    parser.clear()
    assert parser.feed(BUSES[maker].frame(*one)) == [Status(*one)]


@EVERY
@given(answers, st.data())
def test_a_damaged_answer_is_never_another_of_the_same_length(maker: str, one, data):
    """One flipped bit: refused, or (in the length) waited for."""
    frame = bytearray(BUSES[maker].frame(*one))
    place = data.draw(st.integers(0, 8 * len(frame) - 1))
    frame[place // 8] ^= 1 << place % 8
    found = VENDORS[maker].parser().feed(bytes(frame))
    assert all(len(status.data) != len(one[2]) for status in found)


@EVERY
@given(st.binary(max_size=400))
def test_no_bytes_break_a_parser(maker: str, noise: bytes):
    parser = VENDORS[maker].parser()
    for status in parser.feed(noise):
        assert len(status.data) < 255


@EVERY
def test_a_cut_answer_and_an_echo_are_no_answers(maker: str):
    vendor, bus = VENDORS[maker], BUSES[maker]
    parser = vendor.parser()
    assert parser.feed(vendor.ask(vendor.present, (1, 2))) == []  # an adapter that echoes
    assert parser.feed(bus.frame(1, 0, b"abc")[:-1]) == []
    parser.clear()
    assert parser.feed(bus.frame(1, 0, b"abc")) == [Status(1, 0, b"abc")]
    assert parser.bad_packets == 0


def test_errors_have_names():
    assert Feetech().alarm(0) == Dynamixel().alarm(0) == ""
    assert Feetech().alarm(1 + 4 + 32) == "voltage, temperature, overload"
    assert Dynamixel().alarm(0x80) == "hardware error"
    assert Dynamixel().alarm(4) == "data range"
    health = bytearray(35)
    health[0], health[6] = 1, 32
    assert Dynamixel().health_alarm(bytes(health)) == "overload"
    health[6], health[34] = 0, 255
    assert "no word for 100 ms" in Dynamixel().health_alarm(bytes(health))


def test_speeds_are_never_the_zero_that_means_as_fast_as_you_can():
    assert Feetech().speed_data(0) == b"\x01\x00"
    assert Dynamixel().speed_data(0) == b"\x01\x00\x00\x00"
