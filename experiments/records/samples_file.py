"""The file samples.mcap: rows and events of a run as bytes.

A row is one protobuf message of `optional double` fields, all of them always written (a blank is
NaN). Field numbers start at 16: every tag then has two bytes, so that a row is one numpy record
of fixed layout (`RECORD`), written and read without a protobuf library. Events are JSON on a
second channel. Formats: https://mcap.dev/spec and
https://protobuf.dev/programming-guides/encoding.

While a run is recorded the file holds plain messages and can be cut anywhere; the finished file is
written by the `mcap` package: the same messages in compressed chunks with an index.
"""

import json
from collections.abc import Sequence
from functools import cache
from io import BytesIO
from typing import Any

import numpy as np

from rig.log import COLUMNS, NAMES

MAGIC = b"\x89MCAP0\r\n"
LIBRARY = "balancing-table-rig"
SAMPLES, EVENTS = "samples", "events"
CHANNEL_ID = {SAMPLES: 1, EVENTS: 2}  # in the order in which `mcap.writer` counts them
SCHEMA_NAME = {SAMPLES: "rig.Sample", EVENTS: "rig.Event"}
FIRST_FIELD = 16  # the first number whose tag has two bytes
SHORTEST_S, LONGEST_S = -1e9, 4e9  # plus today they fit 63 bits of nanoseconds since 1970

_FIXED64 = 1  # protobuf's wire type of a double
_tag = (np.arange(len(COLUMNS)) + FIRST_FIELD) << 3 | _FIXED64
TAGS = ((_tag & 0x7F | 0x80) | (_tag >> 7) << 8).astype("<u2")  # as a varint of two bytes
CELL = np.dtype([("tag", "<u2"), ("value", "<f8")])
RECORD = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
        ("cells", CELL, (len(COLUMNS),)),
    ]
)
HEAD = 9  # bytes of opcode and length, which `length` does not count
MESSAGE_HEAD = 22  # bytes of channel, sequence and two times, before a message's own data
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK = 0x02, 0x03, 0x04, 0x05, 0x06  # opcodes of MCAP


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
