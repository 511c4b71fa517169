"""Frames and packets: what goes in comes out, and what is damaged does not."""

import struct
from dataclasses import fields

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig.hardware.board.wire import (
    KINDS,
    LONGEST_FRAME,
    LONGEST_PAYLOAD,
    Command,
    Disarm,
    Packet,
    Parser,
    cobs,
    crc,
    decode,
    encode,
    uncobs,
)

RANGES = {"B": (0, 255), "H": (0, 65535), "I": (0, 2**32 - 1)}
RANGES |= {"h": (-(2**15), 2**15 - 1), "i": (-(2**31), 2**31 - 1)}


@st.composite
def packets(draw) -> Packet:
    kind = KINDS[draw(st.sampled_from(sorted(KINDS)))]
    return kind(*(draw(st.integers(*RANGES[letter])) for letter in kind.LAYOUT[1:]))


def test_crc_is_the_published_one():
    assert crc(b"123456789") == 0x29B1  # CRC-16/CCITT-FALSE's check value


@pytest.mark.parametrize("kind", KINDS.values())
def test_every_layout_fits_its_fields_and_a_frame(kind):
    assert len(kind.LAYOUT) - 1 == len(fields(kind))
    assert struct.calcsize(kind.LAYOUT) + 1 <= LONGEST_PAYLOAD


@given(st.binary(max_size=254))
def test_cobs_has_no_zero_and_goes_back(data: bytes):
    stuffed = cobs(data)
    assert 0 not in stuffed
    assert len(stuffed) == len(data) + 1
    assert uncobs(stuffed) == data


@given(st.lists(packets(), max_size=6), st.data())
def test_packets_survive_the_way_in_any_pieces(sent: list[Packet], data):
    stream = b"".join(map(encode, sent))
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=8)))
    parser, found = Parser(), []
    for begin, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        found += parser.feed(stream[begin:end])
    assert found == sent
    assert parser.bad_frames == 0


@given(st.lists(st.tuples(st.binary(max_size=200), packets()), max_size=5))
def test_garbage_between_frames_costs_no_frame(stream: list[tuple[bytes, Packet]]):
    """Garbage, closed by a zero, costs nothing; only chance makes a packet of it (2^-16)."""
    parser, found = Parser(), []
    for garbage, packet in stream:
        found += [p for p in parser.feed(garbage + b"\0") if encode(p)[:-1] not in garbage]
        found += parser.feed(encode(packet))
    assert found == [packet for _, packet in stream]


@given(packets(), st.data())
def test_up_to_three_flipped_bits_are_never_another_packet(packet: Packet, data):
    """Within the stuffing a flip moves bytes, so the CRC's distance of 4 does not carry over
    exactly; what is accepted is the packet itself or, by chance of 2^-16, never seen here."""
    frame = bytearray(encode(packet))
    places = data.draw(st.sets(st.integers(0, 8 * len(frame) - 1), min_size=1, max_size=3))
    for place in places:
        frame[place // 8] ^= 1 << place % 8
    assert all(found == packet for found in Parser().feed(bytes(frame) + b"\0"))


def test_damage_is_accepted_no_more_often_than_the_crc_lets_it():
    """Every single and every neighbouring double flip of a command is refused."""
    frame = encode(Command(0x1234, 20, -3000, 4500))
    for i in range(8 * len(frame) - 1):
        for pattern in (1, 3):
            number = int.from_bytes(frame, "little") ^ (pattern << i)
            parser = Parser()
            assert parser.feed(number.to_bytes(len(frame), "little")) == []


@pytest.mark.parametrize("length", [LONGEST_FRAME - 1, LONGEST_FRAME, 10_000])
def test_a_frame_that_does_not_end_is_dropped_whole(length: int):
    parser = Parser()
    assert parser.feed(b"\x01" * length + b"\0" + encode(Disarm())) == [Disarm()]
    assert parser.bad_frames == 1


def test_right_crc_of_a_wrong_length_or_kind_is_refused():
    for payload in (b"\x04\x01", b"\x77", b"\x03\x00", b""):
        framed = cobs(payload + crc(payload).to_bytes(2, "little"))
        assert decode(framed) is None


def test_a_field_that_does_not_fit_is_named():
    with pytest.raises(ValueError, match=r"Command.*does not fit"):
        encode(Command(0, 20, 40_000, 0))
