"""A small file that unpacks to a flood of messages is read in time, and its own rows are kept."""

import struct
import time
import tracemalloc
from zlib import crc32

import numpy as np
import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Schema
from mcap_protobuf.decoder import DecoderFactory

from experiments.records import samples_reading, unpacking
from experiments.records.samples_file import (
    RECORD,
    event_record,
    message_records,
    opening,
    plain_ending,
    sample_schema,
)
from experiments.records.samples_reading import read_samples
from rig.log import COLUMNS
from tests.experiments.records.test_samples_reading import EVENTS, START_NS, example


def packed(messages, claimed=None, checksum=0):
    """Records in one chunk of zstd's, which claims to hold so many bytes of this checksum."""
    raw, claimed = zstandard.compress(messages), len(messages) if claimed is None else claimed
    head = struct.pack("<QQQII", 0, 0, claimed, checksum, 4) + b"zstd" + struct.pack("<Q", len(raw))
    return struct.pack("<BQ", 6, len(head) + len(raw)) + head + raw


def message(payload, channel=1):
    return struct.pack("<BQHIQQ", 5, 22 + len(payload), channel, 0, 0, 0) + payload


@pytest.mark.parametrize("payload", [b"", b"\x00", None])
def test_messages_that_are_no_rows_are_not_decoded_without_end(payload):
    """A file of 10 kB with two million of them kept every command for a minute, and 0.6 GB."""
    if payload is None:  # a row of another layout: of its time alone
        payload = struct.pack("<Hd", message_records(example(1), 0)["cells"]["tag"][0, 0], 1.0)
    rows = message_records(example(3), START_NS).tobytes()
    flood = packed(message(payload) * 300_000)
    begin = time.process_time()
    tracemalloc.start()
    try:
        samples = read_samples(opening() + flood + packed(rows) + plain_ending())
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    found = len(samples.rows) - 3
    assert found == (len(payload) > 1)  # all alike
    np.testing.assert_array_equal(samples.rows[found:], example(3))
    assert samples.unread > 0
    assert most < 1 << 27
    assert time.process_time() - begin < 30.0  # traced, on a busy machine


def test_a_message_counts_where_it_is_no_event(monkeypatch):
    """As many rows of another layout as the file's size allows, and every event, are read."""
    monkeypatch.setattr(samples_reading, "LEAST_ROWS", 3)
    tag = message_records(example(1), 0)["cells"]["tag"][0, 0]
    rows = [message(struct.pack("<Hd", tag, 0.5 + i)) for i in range(5)]
    events = event_record(EVENTS[0], START_NS, 0) * 9
    for count in (3, 4):
        data = opening() + events + b"".join(rows[:count]) + events + plain_ending()
        monkeypatch.setattr(samples_reading, "MOST_RATIO", 3 * RECORD.itemsize / len(data))
        samples = read_samples(data)
        assert len(samples.rows) == count
        assert samples.complete == (count == 3)
        assert len(samples.events) == (18 if count == 3 else 9)


def records(*those):
    builder = RecordBuilder()
    for one in those:
        one.write(builder)
    return builder.end()


def record(opcode, content=b""):
    return struct.pack("<BQ", opcode, len(content)) + content


FLOODS = {
    "unknown": record(0x80),
    "no channel": record(4),
    "chunk": record(6),
    "attachment": record(9, bytes(36)),
    "bad event": message(b"{}", 2),
    "row's begin": message_records(example(1), 0).tobytes()[:11],
}


@pytest.mark.parametrize("kind", FLOODS)
def test_records_that_are_no_rows_are_not_looked_at_without_end(monkeypatch, kind):
    """A file of 10 kB with seven million of them kept every command for a minute or two."""
    monkeypatch.setattr(samples_reading, "LEAST_ROWS", 1000)
    monkeypatch.setattr(samples_reading, "MOST_RATIO", 0)
    steps, own_rows = [], samples_reading._own_rows
    monkeypatch.setattr(
        samples_reading, "_own_rows", lambda *told: steps.append(1) or own_rows(*told)
    )
    rows = message_records(example(3), START_NS).tobytes()
    data = opening() + packed(FLOODS[kind] * 30_000) + packed(rows) + plain_ending()
    samples = read_samples(data)
    np.testing.assert_array_equal(samples.rows, example(3))
    assert samples.unread > 0
    assert not samples.complete
    assert len(steps) < len(data) + 3000
    assert len(data) < 9000


def test_events_are_read_whatever_else_there_is_no_room_for(monkeypatch):
    monkeypatch.setattr(samples_reading, "LEAST_ROWS", 20)
    monkeypatch.setattr(samples_reading, "MOST_RATIO", 0)
    events = event_record(EVENTS[0], START_NS, 0) * 99
    samples = read_samples(opening() + packed(events) + plain_ending())
    assert len(samples.events) == 99
    assert samples.complete


def test_a_layout_that_many_channels_name_is_made_ready_once(monkeypatch):
    """A chunk of channels whose rows have a long description kept every command for minutes."""
    made, ready = [], DecoderFactory.decoder_for
    monkeypatch.setattr(DecoderFactory, "decoder_for", lambda *told: made.append(1) or ready(*told))
    tag = message_records(example(1), 0)["cells"]["tag"][0, 0]
    row = message(struct.pack("<Hd", tag, 1.0))
    channel = records(Channel(1, "samples", "protobuf", {}, 1))
    samples = read_samples(opening() + packed(channel * 999 + row) + plain_ending())
    assert len(samples.rows) == 1
    assert len(made) == 1
    # a field that nobody knows makes another one each time
    layouts = (sample_schema() + struct.pack("<HB", 0xF8, i) for i in range(99))
    flood = (records(Schema(1, data, "protobuf", "rig.Sample")) + channel for data in layouts)
    samples = read_samples(opening() + packed(b"".join(flood) + row) + plain_ending())
    assert len(samples.rows) == 1
    assert len(made) == 1 + samples_reading.MOST_LAYOUTS


@pytest.mark.parametrize("refused", [{"checksum": 1}, {"claimed": (1 << 22) - 1}, "cut"])
def test_chunks_that_are_refused_cost_no_more_than_what_a_file_may_hold(monkeypatch, refused):
    """A file of 1 MB with 500 of them, of 64 MB each, kept every command for half a minute."""
    bomb = packed(bytes(1 << 22), **({} if refused == "cut" else refused))
    if refused == "cut":
        bomb = bomb[:-3] + b"\xff\xff\xff"
    monkeypatch.setattr(samples_reading, "LEAST_BYTES", 1 << 23)
    monkeypatch.setattr(samples_reading, "MOST_RATIO", 0)
    taken, reader = [], unpacking._reader

    def counted(chunk):
        read = reader(chunk)
        return lambda size: taken.append(piece := read(size)) or piece

    monkeypatch.setattr(unpacking, "_reader", counted)
    rows = message_records(example(3), START_NS).tobytes()
    samples = read_samples(opening() + packed(rows) + bomb * 40 + plain_ending())
    np.testing.assert_array_equal(samples.rows, example(3))
    assert samples.unread == 40 * len(bomb)
    assert 1 << 21 < sum(map(len, taken)) <= (1 << 23) + 40


def test_a_flipped_bit_in_one_chunk_leaves_the_room_of_the_others(monkeypatch):
    """Even where all of them together hold as much as the file may."""
    rows = np.random.default_rng(9).normal(size=(60, len(COLUMNS)))
    rows[:, 0] = np.arange(60) * 0.002
    records = message_records(rows, START_NS).tobytes()
    half = len(records) // 2
    monkeypatch.setattr(samples_reading, "LEAST_BYTES", len(records))
    monkeypatch.setattr(samples_reading, "MOST_RATIO", 0)
    damaged, other = (packed(one, checksum=crc32(one)) for one in (records[:half], records[half:]))
    for bit in [*range(8 * 100), *range(8 * 100, 8 * len(damaged), 61)]:  # all of its head's
        bad = bytearray(damaged)
        bad[bit // 8] ^= 1 << bit % 8
        found = read_samples(opening() + bytes(bad) + other + plain_ending())
        assert found.rows[-30:].tobytes() == rows[30:].tobytes(), bit
