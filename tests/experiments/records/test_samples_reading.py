"""samples.mcap opens in the official readers, and cut or damaged anywhere in ours."""

import io
import json
import struct
import tracemalloc
from dataclasses import replace
from datetime import UTC, datetime

import lz4.frame
import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.data_stream import RecordBuilder
from mcap.decoder import DecoderFactory as McapDecoderFactory
from mcap.records import Attachment, Chunk

from experiments.records import samples_reading, unpacking
from experiments.records.samples_file import (
    HEAD,
    MAGIC,
    RECORD,
    event_record,
    finished_file,
    message_records,
    opening,
    plain_ending,
    sample_schema,
)
from experiments.records.samples_reading import read_samples
from experiments.records.unpacking import Room, unpacked
from rig.log import COLUMNS, INDEX, NAMES

START_NS = int(datetime(2026, 11, 20, 10, 15, 2, tzinfo=UTC).timestamp()) * 10**9
CHUNK_ROWS = 2**20 // RECORD.itemsize + 1  # the writer ends a chunk beyond 1 MiB
EVENTS = [{"t_s": 0.001, "text": "begin"}, {"t_s": 0.5, "text": "push", "speed_m_s": 0.1}]


def example(n):
    rows = np.random.default_rng(2).normal(size=(n, len(COLUMNS)))
    rows[:, 0] = np.arange(n) * 0.002
    rows[1::2, INDEX["ball_x_m"]] = np.nan
    return rows


def plain_file(rows, ending=True):
    """A file as it stands while it is recorded: an event, rows, an event."""
    first, last = (event_record(event, START_NS, i) for i, event in enumerate(EVENTS))
    body = opening() + first + message_records(rows, START_NS).tobytes() + last
    return body + plain_ending() if ending else body


def official(data, order=False):
    """(topic, log time, decoded message) of every message by the official indexed reader."""
    from mcap.reader import make_reader
    from mcap_protobuf.decoder import DecoderFactory

    reader = make_reader(io.BytesIO(data), decoder_factories=[DecoderFactory(), _JsonFactory()])
    for _, channel, message, decoded in reader.iter_decoded_messages(log_time_order=order):
        yield channel.topic, message.log_time, decoded


class _JsonFactory(McapDecoderFactory):
    """Decodes the events' channel."""

    def decoder_for(self, message_encoding, schema):
        """Return the decoder of JSON, None for another encoding."""
        return json.loads if message_encoding == "json" else None


@pytest.mark.parametrize("finished", [True, False])
@pytest.mark.parametrize("damage", [b"\xc9", bytes(2048)])
def test_a_file_whose_first_bytes_are_damaged_keeps_its_rows(finished: bool, damage: bytes):
    """One flipped bit there, or a first block that a power cut left empty: none was read."""
    rows = example(CHUNK_ROWS + 10)
    data = finished_file(rows, EVENTS, START_NS) if finished else plain_file(rows)
    found = read_samples(damage + data[len(damage) :])
    lost = -(-len(damage) // RECORD.itemsize)
    assert len(found.rows) >= len(rows) - lost
    np.testing.assert_array_equal(found.rows, rows[-len(found.rows) :])
    assert found.unread >= len(MAGIC)
    assert not found.complete


@pytest.mark.parametrize(
    "data", [b"t_s,theta_x_rad\n", bytes(10**5), b"\x89HDF\r\n\x1a\n" + bytes(999)]
)
def test_what_is_no_recording_is_told_so(data: bytes):
    with pytest.raises(ValueError, match="does not start like an MCAP file"):
        read_samples(data)


@pytest.mark.parametrize("finished", [True, False])
def test_another_recording_that_was_attached_is_none_of_its_rows(finished: bool):
    """As `mcap add attachment` does it: chunks and rows are found by their own bytes."""
    rows, other = example(50), example(80) + 1.0
    attached = finished_file(other, EVENTS, START_NS) if finished else plain_file(other)
    builder = RecordBuilder()
    Attachment(0, 0, "other.mcap", "application/octet-stream", attached).write(builder)
    data = MAGIC + builder.end() + finished_file(rows, EVENTS, START_NS)[len(MAGIC) :]
    found = read_samples(data)
    np.testing.assert_array_equal(found.rows, rows)
    assert (found.complete, found.foreign, len(found.events)) == (True, True, len(EVENTS))


@pytest.mark.parametrize("finished", [True, False])
def test_the_official_reader_sees_every_value_at_its_time(finished):
    rows = example(CHUNK_ROWS + 10)
    data = finished_file(rows, EVENTS, START_NS) if finished else plain_file(rows)
    messages = list(official(data, order=True))
    times = [time for _, time, _ in messages]
    assert times == sorted(times)
    assert [message for topic, _, message in messages if topic == "events"] == EVENTS
    samples = [(time, message) for topic, time, message in messages if topic == "samples"]
    assert len(samples) == len(rows)
    assert samples[5][0] == START_NS + 10_000_000
    for row, (_, message) in list(zip(rows, samples, strict=True))[::97]:
        values = [getattr(message, name) for name in NAMES]
        np.testing.assert_array_equal(values, row)
        assert message.HasField("ball_x_m")


def test_the_index_and_the_checksums_are_right():
    from mcap.reader import make_reader
    from mcap.stream_reader import StreamReader

    rows = example(2 * CHUNK_ROWS + 1)
    data = finished_file(rows, EVENTS, START_NS)
    assert sum(1 for _ in StreamReader(io.BytesIO(data), validate_crcs=True).records) > len(rows)
    reader = make_reader(io.BytesIO(data), validate_crcs=True)
    summary = reader.get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.channel_message_counts == {1: len(rows), 2: 2}
    assert len(summary.chunk_indexes) == 4
    assert summary.statistics.message_end_time == START_NS + round(rows[-1, 0] * 1e9)
    units = next(c for c in summary.channels.values() if c.topic == "samples").metadata
    assert units["theta_x_rad"].startswith("[rad]")
    late = reader.iter_messages(topics=["samples"], starting_at=START_NS + 8 * 10**9)
    assert sum(1 for _ in late) == len(rows) - 4000


def test_the_rows_are_what_protobuf_itself_would_write():
    from google.protobuf.descriptor_pb2 import FileDescriptorSet
    from google.protobuf.descriptor_pool import DescriptorPool
    from google.protobuf.message_factory import GetMessageClass

    pool = DescriptorPool()
    pool.Add(FileDescriptorSet.FromString(sample_schema()).file[0])
    message = GetMessageClass(pool.FindMessageTypeByName("rig.Sample"))()
    rows = example(1)
    for name, value in zip(NAMES, rows[0], strict=True):
        setattr(message, name, value)
    record = message_records(rows, 0).tobytes()
    assert record[9 + 22 :] == message.SerializeToString(deterministic=True)
    assert len(record) == RECORD.itemsize


@settings(max_examples=60)
@given(st.data())
def test_a_file_cut_anywhere_keeps_every_whole_row(data):
    rows = example(7)
    whole = plain_file(rows, ending=False)
    first = whole.index(message_records(rows[:1], START_NS).tobytes())
    cut = data.draw(st.integers(0, len(whole)))
    samples = read_samples(whole[:cut])
    assert not samples.complete
    expected = rows[: max(0, (cut - first) // RECORD.itemsize)]
    np.testing.assert_array_equal(samples.rows, expected)
    assert len(samples.events) == (cut >= first) + (cut == len(whole))


@pytest.mark.parametrize("cut", [1, 7, 8, 9])
def test_a_finished_file_without_its_last_bytes_is_not_complete(cut):
    data = finished_file(example(9), EVENTS, START_NS)
    samples = read_samples(data[:-cut])
    assert not samples.complete
    np.testing.assert_array_equal(samples.rows, example(9))


@pytest.mark.parametrize("cut", [0, 1, 5, 100, RECORD.itemsize - 1])
def test_the_official_streaming_reader_reads_a_cut_file(cut):
    import struct

    from mcap.exceptions import EndOfFile
    from mcap.records import Message
    from mcap.stream_reader import StreamReader

    rows = example(9)
    body = opening() + message_records(rows, START_NS).tobytes()
    messages = []
    try:
        for record in StreamReader(io.BytesIO(body[: len(body) - cut])).records:
            if isinstance(record, Message):
                messages.append(record)
    except (EndOfFile, struct.error):
        pass
    assert len(messages) == (9 if cut == 0 else 8)
    values = np.frombuffer(messages[-1].data, [("tag", "<u2"), ("value", "<f8")])["value"]
    np.testing.assert_array_equal(values, rows[len(messages) - 1])


def test_zeros_after_a_power_cut_end_the_rows():
    samples = read_samples(plain_file(example(5), ending=False) + bytes(4096))
    np.testing.assert_array_equal(samples.rows, example(5))
    assert not samples.complete


@settings(max_examples=60)
@given(st.data(), st.booleans())
def test_damaged_bytes_never_raise_more_than_a_value_error(data, finished):
    rows = example(20)
    whole = finished_file(rows, EVENTS, START_NS) if finished else plain_file(rows)
    broken = bytearray(whole)
    for _ in range(data.draw(st.integers(1, 4))):
        broken[data.draw(st.integers(8, len(whole) - 1))] = data.draw(st.integers(0, 255))
    samples = read_samples(bytes(broken))
    assert samples.rows.shape[1] == len(COLUMNS)


@settings(max_examples=60)
@given(st.integers(0, 7), st.sampled_from((9, 10, 11, 200)), st.integers(0, HEAD + 1))
def test_one_flipped_bit_takes_one_row_and_no_more(bit, row, byte):
    """Opcode, length and channel of a row: whatever it then seems to be, the next row is found."""
    rows = example(500)
    data = bytearray(plain_file(rows, ending=False))
    first = data.index(message_records(rows[:1], START_NS).tobytes())
    data[first + row * RECORD.itemsize + byte] ^= 1 << bit
    samples = read_samples(bytes(data))
    np.testing.assert_array_equal(samples.rows, np.delete(rows, row, axis=0))
    assert not samples.complete
    assert samples.unread <= RECORD.itemsize


def test_a_damaged_chunk_is_left_out_and_said():
    rows = example(2 * CHUNK_ROWS)
    data = bytearray(finished_file(rows, EVENTS, START_NS))
    data[len(opening()) + 5000] ^= 0xFF
    samples = read_samples(bytes(data))
    assert not samples.complete
    assert CHUNK_ROWS <= len(samples.rows) < 1.02 * CHUNK_ROWS  # declarations are in the first, too
    np.testing.assert_array_equal(samples.rows, rows[-len(samples.rows) :])
    assert samples.events == EVENTS


def test_what_is_no_mcap_is_refused():
    with pytest.raises(ValueError, match="MCAP"):
        read_samples(b"t_s,voltage_x_V\n0.0,1.0\n")


@pytest.mark.parametrize("compression", ["NONE", "LZ4", "ZSTD"])
def test_another_writers_schema_is_decoded_by_name(compression):
    """Fewer columns, other field numbers, fields left out, a column of the future."""
    from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorSet
    from google.protobuf.descriptor_pool import DescriptorPool
    from google.protobuf.message_factory import GetMessageClass
    from mcap.writer import CompressionType, Writer

    files = FileDescriptorSet()
    file = files.file.add(name="old.proto", package="rig", syntax="proto3")
    kind = file.message_type.add(name="Sample")
    for i, name in enumerate(["theta_x_rad", "t_s", "of_the_future"]):
        kind.field.add(
            name=name,
            number=i + 1,
            type=FieldDescriptorProto.TYPE_DOUBLE,
            label=FieldDescriptorProto.LABEL_OPTIONAL,
            proto3_optional=True,
            oneof_index=i,
        )
        kind.oneof_decl.add(name=f"_{name}")
    pool = DescriptorPool()
    pool.Add(file)
    message_class = GetMessageClass(pool.FindMessageTypeByName("rig.Sample"))
    out = io.BytesIO()
    writer = Writer(out, compression=CompressionType[compression])
    writer.start()
    schema = writer.register_schema("rig.Sample", "protobuf", files.SerializeToString())
    writer.register_channel("unrelated", "json", 0)
    channel = writer.register_channel("samples", "protobuf", schema)
    writer.add_message(channel, 0, message_class(t_s=0.5).SerializeToString(), 0)
    full = message_class(t_s=0.0, theta_x_rad=-2.0, of_the_future=3.0)
    writer.add_message(channel, 1, full.SerializeToString(), 1)
    writer.finish()
    samples = read_samples(out.getvalue())
    assert samples.complete
    np.testing.assert_array_equal(samples.rows[:, INDEX["t_s"]], [0.5, 0.0])
    np.testing.assert_array_equal(samples.rows[:, INDEX["theta_x_rad"]], [np.nan, -2.0])
    assert np.isfinite(samples.rows).sum() == 3


def test_our_schema_rewritten_by_another_tool_is_read_too():
    """The same rows under another channel number, some of them with fields left out."""
    from mcap.writer import Writer

    rows = example(6)
    records = message_records(rows, START_NS)
    out = io.BytesIO()
    writer = Writer(out)
    writer.start()
    schema = writer.register_schema("rig.Sample", "protobuf", sample_schema())
    for topic in ("a", "b", "samples"):
        channel = writer.register_channel(topic, "protobuf", schema)
    for i, record in enumerate(records):
        payload = record["cells"].tobytes()
        writer.add_message(channel, i, payload[:20] if i == 3 else payload, i)
    writer.finish()
    expected = rows.copy()
    expected[3, 2:] = np.nan
    np.testing.assert_array_equal(read_samples(out.getvalue()).rows, expected)


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_chunks_that_hold_more_than_a_recording_are_left_out(monkeypatch, compression):
    """A file of 70 kB may claim gigabytes: nothing of that is unpacked."""
    monkeypatch.setattr(samples_reading, "LEAST_BYTES", 1 << 20)
    packed = {"zstd": zstandard.compress, "lz4": lz4.frame.compress}[compression](bytes(1 << 26))
    assert len(packed) < 1 << 19
    name = compression.encode()
    head = struct.pack("<QQQII", 0, 0, 1 << 26, 0, len(name)) + name
    content = head + struct.pack("<Q", len(packed)) + packed
    chunk = struct.pack("<BQ", 6, len(content)) + content
    reading = samples_reading._Reading(room=Room(1 << 20))
    with pytest.raises(ValueError, match="hold more than 1048576 bytes"):
        samples_reading._take(6, content, reading)
    tracemalloc.start()
    try:
        found = read_samples(MAGIC + chunk * 3)
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    # by its size the file can hold none such chunk of zstd's, but one of LZ4's
    assert most < (1 << 24 if compression == "zstd" else 5 << 26)
    assert len(found.rows) == 0
    assert found.unread >= 3 * len(content)
    inner = struct.pack("<QQQII", 0, 0, len(chunk), 0, 0) + struct.pack("<Q", len(chunk)) + chunk
    with pytest.raises(ValueError, match="a chunk inside a chunk"):
        samples_reading._take(6, content, samples_reading._Reading(room=Room(1 << 30), inside=True))
    assert read_samples(MAGIC + struct.pack("<BQ", 6, len(inner)) + inner).unread > 0


@pytest.mark.parametrize("compression", ["zstd", "lz4", ""])
def test_a_small_chunk_of_a_large_file_takes_little_memory(compression):
    """LZ4's decoder takes all that it is allowed to fill at once."""
    packs = {"zstd": zstandard.compress, "lz4": lz4.frame.compress, "": bytes}
    held = bytes(range(256)) * 40
    chunk = Chunk(compression, packs[compression](held), 0, 0, 0, len(held))
    tracemalloc.start()
    try:
        assert unpacked(chunk, Room(1 << 33)) == held
        assert tracemalloc.get_traced_memory()[1] < 1 << 22
    finally:
        tracemalloc.stop()
    with pytest.raises(ValueError, match="hold more than 99 bytes"):
        unpacked(replace(chunk, uncompressed_size=99), Room(1 << 33))


def test_no_chunk_is_longer_than_a_file_of_any_size_may_hold(monkeypatch):
    """However large the file about it is: what one chunk claims is held in memory at once."""
    monkeypatch.setattr(unpacking, "LEAST_BYTES", 1 << 20)
    held = bytes(1 << 21)
    chunk = Chunk("zstd", zstandard.compress(held), 0, 0, 0, len(held))
    with pytest.raises(ValueError, match="hold more than 1048576 bytes"):
        unpacked(chunk, Room(1 << 33))


def test_what_only_begins_like_a_row_has_no_block_looked_at(monkeypatch):
    """A file of 10 kB whose chunk is full of such beginnings had kept every command for minutes."""
    rows, frombuffer, looked_at = example(5), np.frombuffer, []

    def counted(*arguments):
        looked_at.append(arguments)
        return frombuffer(*arguments)

    monkeypatch.setattr(samples_reading.np, "frombuffer", counted)
    begins = message_records(rows, 0).tobytes()[:11]
    found = read_samples(opening() + 2000 * begins + message_records(rows, 0).tobytes())
    np.testing.assert_array_equal(found.rows, rows)
    assert found.unread == 2000 * 11
    assert len(looked_at) <= 4


def test_each_row_is_looked_at_twice_at_most_whatever_lies_between(monkeypatch):
    """Thousands of records of another tool: each had a block of rows behind it looked at."""
    rows, looked_at, frombuffer = example(50), [], np.frombuffer

    def counted(buffer, dtype, count, offset):
        looked_at.append(count)
        return frombuffer(buffer, dtype, count, offset)

    monkeypatch.setattr(samples_reading.np, "frombuffer", counted)
    foreign = struct.pack("<BQH", 0x05, 32, 99) + bytes(30)  # a message of a channel unknown here
    body = opening() + 5000 * foreign + message_records(rows, START_NS).tobytes() + 5000 * foreign
    samples = read_samples(body + plain_ending())
    np.testing.assert_array_equal(samples.rows, rows)
    most_rows = len(body) // RECORD.itemsize
    assert sum(looked_at) <= 2 * most_rows


def test_brackets_beyond_all_measure_are_no_event():
    """What a few bytes unpack to is a hundred times as large again once JSON has made lists of it:
    such messages are left out, one by one or taken together."""
    long = {"t_s": 1.0, "text": "x", "more": [[]] * samples_reading.LONGEST_MESSAGE}
    some = {"t_s": 1.0, "text": "x", "more": [[]] * (samples_reading.LONGEST_MESSAGE // 5)}
    room = samples_reading.MOST_EVENT_BYTES
    many = -(-room // len(json.dumps(some))) + 5
    records = [event_record(one, START_NS, i) for i, one in enumerate([long] + [some] * many)]
    samples = read_samples(opening() + b"".join(records) + plain_ending())
    assert 0 < len(samples.events) <= room // len(json.dumps(some)) + 1
    assert samples.unread > len(json.dumps(long))  # and no more: many events damage no file
    assert samples.unread < 2 * len(json.dumps(long))
    assert not samples.complete
    assert [one["text"] for one in samples.events].index(samples_reading.LEFT_OUT) == (
        len(samples.events) - 1
    )


def test_the_shortest_events_are_no_more_work_than_others():
    """A chunk of a few kilobytes held 880 000 of them, which kept every command for 13 s."""
    room = samples_reading.MOST_EVENT_BYTES // samples_reading.LEAST_EVENT
    one = event_record({"t_s": 0, "text": ""}, START_NS, 0)
    samples = read_samples(opening() + (room + 9) * one + plain_ending())
    assert len(samples.events) == room + 1
    assert samples.events[-1] == {"t_s": 0.0, "text": samples_reading.LEFT_OUT}
    assert samples.complete


def test_a_finished_file_without_a_row_is_complete():
    for events in ([], EVENTS):
        samples = read_samples(finished_file(np.empty((0, len(COLUMNS))), events, START_NS))
        assert samples.complete
        assert samples.unread == 0
        assert len(samples.events) == len(events)
