"""The file samples.mcap: rows and events of a run as bytes, and bytes as rows and events.

A row is one protobuf message of `optional double` fields, all of them always written (a blank is
NaN). Field numbers start at 16: every tag then has two bytes, so that a row is one numpy record
of fixed layout (`RECORD`), written and read without a protobuf library. Events are JSON on a
second channel. Formats: https://mcap.dev/spec and
https://protobuf.dev/programming-guides/encoding.

While a run is recorded the file holds plain messages and can be cut anywhere; the finished file is
written by the `mcap` package: the same messages in compressed chunks with an index. Reading goes
record by record here and not by that package's `StreamReader`, for two reasons: rows in our own
layout are read in blocks (15 000 rows in 0.02 s instead of 0.11 s), and rows after damaged bytes
are still found: every row begins with the same eleven bytes. What another tool rewrote is decoded
by its own schema.
"""

import json
import struct
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from io import BytesIO
from typing import Any

import numpy as np

from experiments.records.unpacking import LEAST_BYTES, MOST_RATIO, unpacked
from rig.files import read_json
from rig.log import COLUMNS, INDEX, NAMES

MAGIC = b"\x89MCAP0\r\n"
LIBRARY = "balancing-table-rig"
SAMPLES, EVENTS = "samples", "events"
CHANNEL_ID = {SAMPLES: 1, EVENTS: 2}  # in the order in which `mcap.writer` counts them
SCHEMA_NAME = {SAMPLES: "rig.Sample", EVENTS: "rig.Event"}
FIRST_FIELD = 16  # the first number whose tag has two bytes
SHORTEST_S, LONGEST_S = -1e9, 4e9  # plus today they fit 63 bits of nanoseconds since 1970
BLOCK_ROWS = 1024  # rows read at once
# Bytes of one message, and of all events: brackets in JSON, or empty messages in protobuf, take a
# hundred times their bytes once they are decoded. Chosen: far beyond any that is written.
LONGEST_MESSAGE, MOST_EVENT_BYTES = 1 << 16, 1 << 24

_FIXED64 = 1  # protobuf's wire type of a double
_tag = (np.arange(len(COLUMNS)) + FIRST_FIELD) << 3 | _FIXED64
TAGS = ((_tag & 0x7F | 0x80) | (_tag >> 7) << 8).astype("<u2")  # as a varint of two bytes
RECORD = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
        ("cells", [("tag", "<u2"), ("value", "<f8")], (len(COLUMNS),)),
    ]
)
HEAD = 9  # bytes of opcode and length, which `length` does not count
MESSAGE_HEAD = 22  # bytes of channel, sequence and two times, before a message's own data
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK = 0x02, 0x03, 0x04, 0x05, 0x06  # opcodes of MCAP
OWN_ROWS = -1  # not an opcode: a block of rows in our own layout
ENDS = (0x01, FOOTER, 0x0F)  # header, footer, end of data
HOLDS_ROWS = (OWN_ROWS, MESSAGE, CHUNK)
INDEXES = range(0x07, 0x0F)  # indexes, statistics, attachments, metadata: of finished files
FOOTER_BYTES = 20


# --- writing ---
def message_records(rows: np.ndarray, start_ns: int, first: int = 0) -> np.ndarray:
    """MCAP message records (n,) of dtype RECORD for rows (n, len(COLUMNS)).

    start_ns: wall-clock time of t_s = 0 [ns since 1970]; first: sequence number of the first row.
    ValueError: a time that cannot be recorded (see `check_times`).
    """
    check_times(rows[:, 0])
    records = np.zeros(len(rows), RECORD)
    records["opcode"] = MESSAGE
    records["length"] = RECORD.itemsize - HEAD
    records["channel"] = CHANNEL_ID[SAMPLES]
    records["sequence"] = np.arange(first, first + len(rows))
    records["log_time"] = start_ns + np.rint(rows[:, 0] * 1e9).astype(np.int64)
    records["publish_time"] = records["log_time"]
    records["cells"]["tag"] = TAGS
    records["cells"]["value"] = rows
    return records


def check_times(t_s: np.ndarray | float) -> None:
    """Raise ValueError where a time t_s (any shape) [s] is NaN or not from -1e9 to 4e9."""
    t_s = np.atleast_1d(t_s)
    bad = t_s[~((t_s >= SHORTEST_S) & (t_s <= LONGEST_S))]
    if len(bad):
        raise ValueError(
            f"t_s = {bad[0]} cannot be recorded: "
            f"it must be a number from {SHORTEST_S:g} to {LONGEST_S:g} s"
        )


def event_record(event: dict, start_ns: int, sequence: int) -> bytes:
    """MCAP message record of an event with "t_s" [s], "text" and plain data.

    start_ns: wall-clock time of t_s = 0 [ns since 1970]; sequence: number of the event. ValueError:
    "t_s" or "text" is missing, or the time cannot be recorded.
    """
    from mcap.records import Message

    time_ns, data = _event_message(event, start_ns)
    return _bytes(Message(CHANNEL_ID[EVENTS], time_ns, data, time_ns, sequence))


def _event_message(event: dict, start_ns: int) -> tuple[int, bytes]:
    """Return log time [ns] and JSON of an event; ValueError as of `event_record`."""
    if not {"t_s", "text"} <= event.keys():
        raise ValueError(f"an event has t_s and text, this one has {', '.join(event) or 'nothing'}")
    t_s = float(event["t_s"])
    check_times(t_s)
    return start_ns + round(t_s * 1e9), json.dumps(event, allow_nan=False).encode()


def _bytes(*records: Any) -> bytes:
    """Return records of `mcap.records`, one after the other, as bytes."""
    from mcap.data_stream import RecordBuilder

    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()


@cache
def sample_schema() -> bytes:
    """Serialised protobuf FileDescriptorSet of a row: an optional double for every column."""
    from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorSet

    files = FileDescriptorSet()
    package, name = SCHEMA_NAME[SAMPLES].split(".")
    message = files.file.add(name="sample.proto", package=package, syntax="proto3")
    message = message.message_type.add(name=name)
    for i, column in enumerate(NAMES):
        message.field.add(
            name=column,
            number=FIRST_FIELD + i,
            type=FieldDescriptorProto.TYPE_DOUBLE,
            label=FieldDescriptorProto.LABEL_OPTIONAL,
            proto3_optional=True,
            oneof_index=i,
        )
        message.oneof_decl.add(name=f"_{column}")  # what proto3 makes of `optional`
    return files.SerializeToString(deterministic=True)


@cache
def declarations() -> tuple[list[tuple], list[tuple]]:
    """The arguments of `Writer.register_schema` and `Writer.register_channel`.

    Schemas (name, encoding, data) and channels (topic, encoding, schema id, metadata), in the
    order of their ids; units and meanings of the columns are metadata of the samples' channel.
    """
    number, text = {"type": "number"}, {"type": "string"}
    event = {"type": "object", "properties": {"t_s": number, "text": text}}
    units = {column.name: f"[{column.unit}] {column.meaning}" for column in COLUMNS}
    schemas = [
        (SCHEMA_NAME[SAMPLES], "protobuf", sample_schema()),
        (SCHEMA_NAME[EVENTS], "jsonschema", json.dumps(event).encode()),
    ]
    return schemas, [(SAMPLES, "protobuf", 1, units), (EVENTS, "json", 2, {})]


@cache
def opening() -> bytes:
    """First bytes of a file being recorded: magic, header, schemas, channels."""
    from mcap.records import Channel, Header, Schema

    schemas, channels = declarations()
    records = [Header(profile="", library=LIBRARY)]
    records += [
        Schema(id=i, name=name, encoding=encoding, data=data)
        for i, (name, encoding, data) in enumerate(schemas, 1)
    ]
    records += [
        Channel(id=i, topic=topic, message_encoding=encoding, schema_id=schema, metadata=metadata)
        for i, (topic, encoding, schema, metadata) in enumerate(channels, 1)
    ]
    return MAGIC + _bytes(*records)


@cache
def plain_ending() -> bytes:
    """Last bytes of a file of plain messages: end of data, a footer without summary, magic."""
    from mcap.records import DataEnd, Footer

    footer = Footer(summary_start=0, summary_offset_start=0, summary_crc=0)
    return _bytes(DataEnd(0), footer) + MAGIC


def finished_file(rows: np.ndarray, events: Sequence[dict], start_ns: int) -> bytes:
    """Bytes of a whole file: rows in compressed chunks, the events' chunk, the index.

    rows: (n, len(COLUMNS)); events: dicts with "t_s", "text" and plain data; start_ns: wall-clock
    time of t_s = 0 [ns since 1970]. ValueError: a time or an event that cannot be recorded.
    """
    from mcap.writer import Writer

    out = BytesIO()
    out.write(opening())  # instead of `writer.start()`: a damaged first chunk takes no declaration
    writer = Writer(out)
    schemas, channels = declarations()
    for schema in schemas:
        writer.register_schema(*schema)
    for channel in channels:
        writer.register_channel(*channel)
    records = message_records(rows, start_ns)
    times_ns = records["log_time"].tolist()
    for i, (time_ns, cells) in enumerate(zip(times_ns, records["cells"], strict=True)):
        writer.add_message(CHANNEL_ID[SAMPLES], time_ns, cells.tobytes(), time_ns, i)
    writer.flush()
    for i, event in enumerate(events):
        time_ns, data = _event_message(event, start_ns)
        writer.add_message(CHANNEL_ID[EVENTS], time_ns, data, time_ns, i)
    writer.finish()
    return out.getvalue()


# --- reading ---
@dataclass
class SamplesFile:
    """Content of a samples file: rows (n, len(COLUMNS)), events, and whether it is complete.

    complete: it ends as a finished file does and every byte was understood; unread: how many bytes
    were not (of a recording that was killed: half a record at most).
    """

    rows: np.ndarray
    events: list[dict] = field(default_factory=list)
    complete: bool = False
    unread: int = 0


@dataclass
class _Reading:
    """What is known while a file is read: declarations so far, and what they led to."""

    schemas: dict[int, Any] = field(default_factory=dict)
    topics: dict[int, str] = field(default_factory=dict)
    # The channel whose rows have our own layout: the usual one, should its declaration be damaged.
    own_layout: int | None = CHANNEL_ID[SAMPLES]
    decode: Callable[[bytes], Any] | None = None  # a row that has another layout
    blocks: list[np.ndarray] = field(default_factory=list)
    events: list[dict] = field(default_factory=list)
    complete: bool = False
    unread: int = 0  # bytes that were not understood
    room: int = 0  # bytes that chunks may still hold, unpacked
    event_room: int = MOST_EVENT_BYTES  # bytes that events may still have
    inside: bool = False  # a chunk
    has_chunks: bool = False


def read_samples(data: bytes) -> SamplesFile:
    """Read the bytes of samples.mcap, whole or cut off, also rewritten by another tool.

    Damaged records are left out; rows in our own layout are found again behind them. ValueError:
    the data is no MCAP file.
    """
    if not data.startswith(MAGIC[: len(data)]):
        raise ValueError("it does not start like an MCAP file")
    reading = _Reading(room=max(MOST_RATIO * len(data), LEAST_BYTES))
    records = data[len(MAGIC) :]
    _read(records.removesuffix(MAGIC), reading)
    rows = np.concatenate([np.empty((0, len(COLUMNS))), *reading.blocks])
    ended = reading.complete and data.endswith(MAGIC)  # other readers begin at the end
    whole = ended and not reading.unread
    return SamplesFile(rows, reading.events, whole, reading.unread)


def _read(buffer: bytes, reading: _Reading) -> None:
    """Take every whole record of `buffer` into `reading`."""
    for opcode, content in _records(buffer, reading):
        # Of damaged bytes each parser has errors of its own: they are left out.
        if opcode not in HOLDS_ROWS:  # but for a chunk, of which a flipped bit made another record
            with suppress(Exception):
                _take_chunk(content, reading, sure=True)
                continue
        with suppress(Exception):
            if _take(opcode, content, reading):
                continue
        reading.unread += HEAD + len(content)


def _records(buffer: bytes, reading: _Reading) -> Iterator[tuple[int, Any]]:
    """Yield (opcode, content) of whole records, runs of own rows as (OWN_ROWS, records (k,)).

    No record but a chunk holds rows: one that seems to reach beyond the next row is damaged.
    """
    position = 0
    while position + HEAD <= len(buffer):
        block = _own_rows(buffer, position, reading.own_layout)
        if len(block):
            last = position + block.nbytes - RECORD.itemsize
            begin = _next_row(buffer, last + 1, last + RECORD.itemsize, reading.own_layout)
            if len(_own_rows(buffer, begin, reading.own_layout)) and begin - last < RECORD.itemsize:
                block = block[:-1]  # its end is missing: those bytes are the next row's
            yield OWN_ROWS, block
            position += block.nbytes
            if position == last:
                reading.unread += begin - last
                position = begin
            continue
        opcode, length = struct.unpack_from("<BQ", buffer, position)
        end = position + HEAD + length
        whole = opcode != 0 and end <= len(buffer)  # not half a record, nor zeros of a power cut
        stop = end if whole else len(buffer)
        begin = _next_row(buffer, position + 1, stop, reading.own_layout)
        if whole and (opcode == CHUNK or begin == end):
            yield opcode, buffer[position + HEAD : end]
            position = end
            continue
        reading.unread += begin - position
        position = begin
    reading.unread += len(buffer) - position


def _next_row(buffer: bytes, position: int, stop: int, channel: int | None) -> int:
    """Return where the first row in our own layout begins from `position`, or `stop` without."""
    if channel is None:
        return stop
    begins = struct.pack("<BQH", MESSAGE, RECORD.itemsize - HEAD, channel)
    found = buffer.find(begins, position, stop + len(begins) - 1)
    return stop if found < 0 else found


def _own_rows(buffer: bytes, position: int, channel: int | None) -> np.ndarray:
    """Return the records (k,) of our own layout that follow each other from `position`."""
    count = min(BLOCK_ROWS, (len(buffer) - position) // RECORD.itemsize)
    if channel is None or count <= 0 or buffer[position] != MESSAGE:
        return np.empty(0, RECORD)
    records = np.frombuffer(buffer, RECORD, count, position)
    own = (records["opcode"] == MESSAGE) & (records["length"] == RECORD.itemsize - HEAD)
    own &= (records["channel"] == channel) & (records["cells"]["tag"] == TAGS).all(axis=1)
    return records if own.all() else records[: np.argmin(own)]


def _take(opcode: int, content: Any, reading: _Reading) -> bool:
    """Take what one record holds (`content`: bytes, or the records of a block); whether it was
    understood.

    Damaged content raises whatever its parser raises, ValueError for a wrong checksum.
    """
    from mcap.data_stream import ReadDataStream
    from mcap.records import Schema

    if opcode == OWN_ROWS:
        _take_rows(content["cells"]["value"], reading)
    elif opcode == MESSAGE:
        _take_message(content, reading)
    elif opcode == CHUNK:
        _take_chunk(content, reading)
    elif opcode == SCHEMA:
        schema = Schema.read(ReadDataStream(BytesIO(content)))
        reading.schemas[schema.id] = schema
    elif opcode == CHANNEL:
        _take_channel(content, reading)
    else:
        return _passed_over(opcode, content, reading)
    return True


def _passed_over(opcode: int, content: bytes, reading: _Reading) -> bool:
    """Whether a record holds no rows: an index, say. One flipped bit makes such a one of a row,
    which has its length, or of a chunk, before which there was none.
    """
    if len(content) == RECORD.itemsize - HEAD:
        return False
    reading.complete = reading.complete or (opcode == FOOTER and len(content) == FOOTER_BYTES)
    return opcode in ENDS or (opcode in INDEXES and reading.has_chunks)


def _take_chunk(content: bytes, reading: _Reading, *, sure: bool = False) -> None:
    """Take the records of a chunk; sure: it has a checksum."""
    from mcap.data_stream import ReadDataStream
    from mcap.records import Chunk

    if reading.inside:
        raise ValueError("a chunk inside a chunk")
    chunk = Chunk.read(ReadDataStream(BytesIO(content)))
    if sure and not chunk.uncompressed_crc:
        raise ValueError("a chunk without a checksum")
    rows, reading.inside = unpacked(chunk, reading.room), True
    reading.room -= len(rows)
    reading.has_chunks = True
    try:
        _read(rows, reading)
    finally:
        reading.inside = False


def _take_channel(content: bytes, reading: _Reading) -> None:
    """Keep what a channel is for, and how the samples' channel is decoded."""
    from mcap.data_stream import ReadDataStream
    from mcap.records import Channel
    from mcap_protobuf.decoder import DecoderFactory

    channel = Channel.read(ReadDataStream(BytesIO(content)))
    schema = reading.schemas.get(channel.schema_id)
    reading.topics[channel.id] = channel.topic
    if channel.topic != SAMPLES or schema is None:
        return
    if schema.data == sample_schema():
        reading.own_layout = channel.id
    reading.decode = DecoderFactory().decoder_for("protobuf", schema)


def _take_message(content: bytes, reading: _Reading) -> None:
    """Take one event, or one row that is not in our own layout."""
    payload = content[MESSAGE_HEAD:]
    topic = reading.topics.get(struct.unpack_from("<H", content)[0])
    if len(payload) > LONGEST_MESSAGE:
        raise ValueError("a message beyond all measure")
    if topic == EVENTS:
        reading.event_room -= len(payload)
        if reading.event_room < 0:
            raise ValueError("events beyond all measure")
        event = read_json(bytes(payload).decode())
        if not isinstance(event, dict) or not isinstance(event.get("text"), str):
            raise ValueError("an event without a text")
        reading.events.append({**event, "t_s": float(event["t_s"])})
    elif topic is None:
        raise ValueError("a message of a channel that was not declared")
    elif topic == SAMPLES and reading.decode is not None:
        row = np.full((1, len(COLUMNS)), np.nan)
        own = struct.unpack_from("<H", content)[0] == reading.own_layout
        if own and len(content) == RECORD.itemsize - HEAD:
            # A tag is damaged, but each value has its place.
            row[0] = np.frombuffer(payload, RECORD["cells"])["value"]
        else:
            for described, value in reading.decode(payload).ListFields():
                if described.name in INDEX:
                    row[0, INDEX[described.name]] = value
        _take_rows(row, reading)


def _take_rows(rows: np.ndarray, reading: _Reading) -> None:
    """Take rows (k, len(COLUMNS)) but those whose time is damaged: no file could hold them."""
    sound = (rows[:, 0] >= SHORTEST_S) & (rows[:, 0] <= LONGEST_S)
    reading.unread += RECORD.itemsize * int(np.sum(~sound))
    reading.blocks.append(rows if sound.all() else rows[sound])
