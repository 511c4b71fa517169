"""Read samples.mcap, finished or cut off anywhere, into rows and events.

Rows in our own layout are read with one `np.frombuffer` a block; whatever else the schema in the
file says (older columns, fields left out, another writer) goes through protobuf's own decoder.
"""

import json
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from typing import Any

import numpy as np

from experiments.samples_schema import (
    EVENTS,
    HEAD,
    MAGIC,
    MESSAGE,
    RECORD,
    SAMPLES,
    TAGS,
    sample_schema,
)
from rig.log import COLUMNS, INDEX

FOOTER, SCHEMA, CHANNEL, CHUNK = 0x02, 0x03, 0x04, 0x06  # opcodes of mcap.dev/spec
BLOCK = -1  # not an opcode: a block of rows in our own layout
BLOCK_ROWS = 1024


@dataclass
class Samples:
    """What a file held: rows (n, len(COLUMNS)), events, and whether it ends as it should."""

    rows: np.ndarray
    events: list[dict] = field(default_factory=list)
    complete: bool = False


@dataclass
class _Reading:
    """What is known while a file is read: declarations so far, and what they led to."""

    schemas: dict[int, Any] = field(default_factory=dict)
    topics: dict[int, str] = field(default_factory=dict)
    own_layout: int | None = None  # the channel whose rows have our own layout
    message_class: Any = None  # the generic decoder of rows
    blocks: list[np.ndarray] = field(default_factory=list)
    events: list[dict] = field(default_factory=list)
    complete: bool = False
    damaged: bool = False


def read_samples(data: bytes) -> Samples:
    """Read the bytes of samples.mcap; what follows the first half record is left out.

    ValueError: the data is no MCAP file.
    """
    if not data.startswith(MAGIC[: len(data)]):
        raise ValueError("it does not start like an MCAP file")
    reading = _Reading()
    _read(memoryview(data), len(MAGIC), reading)
    rows = np.concatenate([np.empty((0, len(COLUMNS))), *reading.blocks])
    return Samples(rows, reading.events, reading.complete and not reading.damaged)


def _read(buffer: memoryview, position: int, reading: _Reading) -> None:
    """Take every whole record of `buffer` from `position` into `reading`."""
    for opcode, content in _records(buffer, position, reading):
        if opcode == FOOTER:
            reading.complete = True
            return
        try:
            _take(opcode, content, reading)
        except Exception:  # of damaged bytes each parser has errors of its own: leave them out
            reading.damaged = True


def _take(opcode: int, content: Any, reading: _Reading) -> None:
    """Take what one record holds (`content`: bytes, or the records of a block)."""
    if opcode == BLOCK:
        reading.blocks.append(content["cells"]["value"])
    elif opcode == MESSAGE:
        _take_message(content, reading)
    elif opcode == CHUNK:
        _take_chunk(content, reading)
    elif opcode in (SCHEMA, CHANNEL):
        _take_declaration(opcode, content, reading)


def _records(buffer: memoryview, position: int, reading: _Reading) -> Iterator[tuple[int, Any]]:
    """Yield (opcode, content) of whole records, runs of own rows as (BLOCK, records (k,))."""
    while position + HEAD <= len(buffer):
        block = _own_rows(buffer, position, reading.own_layout)
        if len(block):
            yield BLOCK, block
            position += block.nbytes
            continue
        opcode, length = struct.unpack_from("<BQ", buffer, position)
        end = position + HEAD + length
        if opcode == 0 or end > len(buffer):  # half a record, or zeros after a power cut
            return
        yield opcode, buffer[position + HEAD : end]
        position = end


def _own_rows(buffer: memoryview, position: int, channel: int | None) -> np.ndarray:
    """Return the records (k,) of our own layout that follow each other from `position`."""
    count = min(BLOCK_ROWS, (len(buffer) - position) // RECORD.itemsize)
    if channel is None or buffer[position] != MESSAGE or count == 0:
        return np.empty(0, RECORD)
    records = np.frombuffer(buffer, RECORD, count, position)
    own = (records["opcode"] == MESSAGE) & (records["length"] == RECORD.itemsize - HEAD)
    own &= (records["channel"] == channel) & (records["cells"]["tag"] == TAGS).all(axis=1)
    return records if own.all() else records[: np.argmin(own)]


def _take_declaration(opcode: int, content: memoryview, reading: _Reading) -> None:
    """Keep a schema, or what a channel is for."""
    from mcap.data_stream import ReadDataStream
    from mcap.records import Channel, Schema

    stream = ReadDataStream(BytesIO(content))
    if opcode == SCHEMA:
        schema = Schema.read(stream)
        reading.schemas[schema.id] = schema
        return
    channel = Channel.read(stream)
    schema = reading.schemas.get(channel.schema_id)
    reading.topics[channel.id] = channel.topic
    if channel.topic != SAMPLES or schema is None:
        return
    reading.message_class = _message_class(schema.data, schema.name)
    if schema.data == sample_schema():
        reading.own_layout = channel.id


def _take_chunk(content: memoryview, reading: _Reading) -> None:
    """Read the records in a chunk. ValueError: its checksum is wrong."""
    from mcap.data_stream import ReadDataStream
    from mcap.records import Chunk

    chunk = Chunk.read(ReadDataStream(BytesIO(content)))
    data = _decompressed(chunk.compression, chunk.data, chunk.uncompressed_size)
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise ValueError("a chunk with a wrong checksum")
    _read(memoryview(data), 0, reading)


def _decompressed(compression: str, data: bytes, size: int) -> bytes:
    """Undo a chunk's compression ("", "zstd" or "lz4")."""
    if compression == "zstd":
        import zstandard

        return zstandard.decompress(data, size)
    if compression == "lz4":
        import lz4.frame

        return lz4.frame.decompress(data)
    if compression:
        raise ValueError(f"unknown compression {compression!r}")
    return data


def _take_message(content: memoryview, reading: _Reading) -> None:
    """Take one event, or one row that is not in our own layout."""
    channel = struct.unpack_from("<H", content)[0]
    payload = bytes(content[22:])  # after channel, sequence and two times
    topic = reading.topics.get(channel)
    if topic == EVENTS:
        reading.events.append(json.loads(payload))
    elif topic == SAMPLES and reading.message_class is not None:
        message = reading.message_class.FromString(payload)
        row = np.full((1, len(COLUMNS)), np.nan)
        for described, value in message.ListFields():
            if described.name in INDEX:
                row[0, INDEX[described.name]] = value
        reading.blocks.append(row)


def _message_class(descriptors: bytes, name: str) -> Any:
    """Return the protobuf class of message `name` of a serialised FileDescriptorSet."""
    from google.protobuf.descriptor_pb2 import FileDescriptorSet
    from google.protobuf.descriptor_pool import DescriptorPool
    from google.protobuf.message_factory import GetMessageClass

    pool = DescriptorPool()
    for file in FileDescriptorSet.FromString(descriptors).file:
        pool.Add(file)
    return GetMessageClass(pool.FindMessageTypeByName(name))
