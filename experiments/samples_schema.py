"""samples.mcap: how rows and events of a run become bytes, and how bytes become rows again.

A row is one protobuf message of `optional double` fields, all of them always written (a blank is
NaN). Field numbers start at 16: every tag then has two bytes, so that a row is one numpy record
of fixed layout, filled and read without a protobuf library. Formats: https://mcap.dev/spec and
https://protobuf.dev/programming-guides/encoding. Events are JSON on a second channel.

While it is recorded a file holds plain messages, so that it can be cut anywhere; a finished file
holds the same messages in compressed chunks with an index.
"""

import json
import zlib
from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any

import numpy as np

from rig.log import COLUMNS, NAMES

MAGIC = b"\x89MCAP0\r\n"
SAMPLES, EVENTS = "samples", "events"
CHANNEL = {SAMPLES: 1, EVENTS: 2}
MESSAGE_NAME = "rig.Sample"
FIRST_FIELD = 16  # the first number whose tag has two bytes
CHUNK_ROWS = 2048
SHORTEST_S, LONGEST_S = -1e9, 4e9  # plus today they fit 63 bits of nanoseconds since 1970

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
MESSAGE = 0x05  # opcode


def pack(rows: np.ndarray, start_ns: int, first: int = 0) -> np.ndarray:
    """Return the message records (n,) of `RECORD` of rows (n, len(COLUMNS)).

    `start_ns`: wall-clock time of t_s = 0; `first`: sequence number of the first row.
    ValueError: a time that is none (see `check_times`).
    """
    check_times(rows[:, 0])
    records = np.zeros(len(rows), RECORD)
    records["opcode"] = MESSAGE
    records["length"] = RECORD.itemsize - HEAD
    records["channel"] = CHANNEL[SAMPLES]
    records["sequence"] = np.arange(first, first + len(rows))
    records["log_time"] = start_ns + np.rint(rows[:, 0] * 1e9).astype(np.int64)
    records["publish_time"] = records["log_time"]
    records["cells"]["tag"] = TAGS
    records["cells"]["value"] = rows
    return records


def check_times(t_s: np.ndarray | float) -> None:
    """ValueError where a time (any shape, s) is no number or beyond what a wall clock can say."""
    t_s = np.atleast_1d(t_s)
    bad = t_s[~((t_s >= SHORTEST_S) & (t_s <= LONGEST_S))]
    if len(bad):
        raise ValueError(
            f"t_s = {bad[0]} cannot be recorded: "
            f"it must be a number from {SHORTEST_S:g} to {LONGEST_S:g} s"
        )


def event_message(event: dict, start_ns: int, sequence: int) -> tuple[int, bytes]:
    """Return log time (ns) and message record of an event with "t_s", "text" and plain data.

    ValueError: one of the two is missing, or the time is none.
    """
    from mcap.records import Message

    if not {"t_s", "text"} <= event.keys():
        raise ValueError(f"an event has t_s and text, this one has {', '.join(event) or 'nothing'}")
    t_s = float(event["t_s"])
    check_times(t_s)
    time_ns = start_ns + round(t_s * 1e9)
    message = Message(
        channel_id=CHANNEL[EVENTS],
        log_time=time_ns,
        publish_time=time_ns,
        sequence=sequence,
        data=json.dumps(event, allow_nan=False).encode(),
    )
    return time_ns, _bytes(message)


def _bytes(*records: Any) -> bytes:
    """Return records of `mcap.records`, one after the other, as bytes."""
    from mcap.data_stream import RecordBuilder

    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()


@cache
def sample_schema() -> bytes:
    """Return the serialised FileDescriptorSet of a row: an optional double for every column."""
    from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorSet

    files = FileDescriptorSet()
    package, name = MESSAGE_NAME.split(".")
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
def _declarations() -> bytes:
    """Return schema and channel records; units and meanings of the columns are channel metadata."""
    from mcap.records import Channel, Schema

    number, text = {"type": "number"}, {"type": "string"}
    event = {"type": "object", "properties": {"t_s": number, "text": text}}
    units = {column.name: f"[{column.unit}] {column.meaning}" for column in COLUMNS}
    schemas = (
        Schema(data=sample_schema(), encoding="protobuf", id=1, name=MESSAGE_NAME),
        Schema(data=json.dumps(event).encode(), encoding="jsonschema", id=2, name="rig.Event"),
    )
    channels = (
        Channel(
            id=CHANNEL[topic],
            topic=topic,
            message_encoding=encoding,
            schema_id=schema,
            metadata=metadata,
        )
        for topic, encoding, schema, metadata in (
            (SAMPLES, "protobuf", 1, units),
            (EVENTS, "json", 2, {}),
        )
    )
    return _bytes(*schemas, *channels)


@cache
def opening() -> bytes:
    """Return what every file starts with: magic, header, schemas, channels."""
    from mcap.records import Header

    return MAGIC + _bytes(Header(profile="", library="balancing-table-rig")) + _declarations()


@cache
def plain_ending() -> bytes:
    """Return what ends a file of plain messages: no summary, but complete."""
    from mcap.records import DataEnd, Footer

    footer = Footer(summary_start=0, summary_offset_start=0, summary_crc=0)
    return _bytes(DataEnd(0), footer) + MAGIC


def finished_file(rows: np.ndarray, events: Sequence[dict], start_ns: int) -> Iterator[bytes]:
    """Yield the bytes of a whole file: rows in compressed chunks, the events' chunk, the index."""
    position, indexes = len(opening()), []
    yield opening()
    for piece, times, offsets, channel in _contents(rows, events, start_ns):
        data, index = _chunk(piece, times, offsets, channel, position)
        indexes.append(index)
        position += len(data)
        yield data
    counts = {CHANNEL[SAMPLES]: len(rows), CHANNEL[EVENTS]: len(events)}
    yield _indexed_ending(indexes, counts, position)


def _contents(
    rows: np.ndarray, events: Sequence[dict], start_ns: int
) -> Iterator[tuple[bytes, np.ndarray, np.ndarray, int]]:
    """Yield each chunk's messages, with their times (n,), offsets (n,) and channel."""
    for first in range(0, len(rows), CHUNK_ROWS):
        records = pack(rows[first : first + CHUNK_ROWS], start_ns, first)
        offsets = np.arange(len(records)) * RECORD.itemsize
        yield records.tobytes(), records["log_time"], offsets, CHANNEL[SAMPLES]
    if events:
        times, messages = zip(
            *(event_message(event, start_ns, i) for i, event in enumerate(events)), strict=True
        )
        offsets = np.cumsum([0, *map(len, messages[:-1])])
        yield b"".join(messages), np.array(times, np.uint64), offsets, CHANNEL[EVENTS]


def _chunk(
    piece: bytes, times: np.ndarray, offsets: np.ndarray, channel: int, position: int
) -> tuple[bytes, Any]:
    """Return a chunk with its message index as bytes, and its entry in the file's index."""
    import zstandard
    from mcap.records import Chunk, ChunkIndex

    compressed = zstandard.ZstdCompressor(level=1).compress(piece)
    span = {"message_start_time": int(times.min()), "message_end_time": int(times.max())}
    chunk = Chunk(
        compression="zstd",
        data=compressed,
        uncompressed_crc=zlib.crc32(piece),
        uncompressed_size=len(piece),
        **span,
    )
    chunk = _bytes(chunk)
    entries = np.stack((times.astype("<u8"), offsets.astype("<u8")), axis=1).tobytes()
    size = len(entries).to_bytes(4, "little")
    content = channel.to_bytes(2, "little") + size + entries
    message_index = b"\x07" + len(content).to_bytes(8, "little") + content
    index = ChunkIndex(
        chunk_start_offset=position,
        chunk_length=len(chunk),
        message_index_offsets={channel: position + len(chunk)},
        message_index_length=len(message_index),
        compression="zstd",
        compressed_size=len(compressed),
        uncompressed_size=len(piece),
        **span,
    )
    return chunk + message_index, index


def _indexed_ending(indexes: list, counts: dict[int, int], position: int) -> bytes:
    """Return data end, summary and footer of a file whose data section ends at `position`."""
    from mcap.records import DataEnd, Footer, Statistics

    end = _bytes(DataEnd(0))
    statistics = Statistics(
        attachment_count=0,
        channel_count=len(counts),
        channel_message_counts=counts,
        chunk_count=len(indexes),
        message_count=sum(counts.values()),
        message_start_time=min((index.message_start_time for index in indexes), default=0),
        message_end_time=max((index.message_end_time for index in indexes), default=0),
        metadata_count=0,
        schema_count=2,
    )
    summary = _declarations() + _bytes(statistics, *indexes)
    footer = Footer(summary_start=position + len(end), summary_offset_start=0, summary_crc=0)
    return end + summary + _bytes(footer) + MAGIC
