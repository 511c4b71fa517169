"""Read MCAP files: ROS 2 bags, and messages in JSON or protobuf. One stream a topic.

The time of a sample is when it was written into the bag (log_time): that is when it was usable,
on one clock for all topics: `TOPIC.time`. A message's own stamp is a column of its own,
`TOPIC.header.stamp`; its own field `time` is called `TOPIC.own_time`.
"""

import json
import os
import struct
from array import array
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import numpy as np

from experiments.importing.formats.bag_folder import Span, bag_files, check_spans, extremes
from experiments.importing.formats.extra import library
from experiments.importing.formats.messages import Columns, numbers
from experiments.importing.recording import (
    MAX_CELLS,
    BadFileError,
    Stream,
    check_size,
)
from experiments.records.unpacking import Room, unpacked

# Bytes of a message that is decoded, which may take a hundred times as many; chosen: a longer one
# is a picture or a point cloud.
LONGEST_MESSAGE = 1 << 18
# Records in the chunks of a file of any size, of a larger one as many as it has bytes; chosen: a
# small message takes some bytes even where its neighbours are like it.
LEAST_RECORDS = 100_000
# Bytes of what is no number in the messages of a file: of any file, and for each byte of its own.
# Chosen: of the shortest elements 15 s of work; a laser's scans become ten times smaller.
LEAST_LISTED, LISTED_A_BYTE = 1 << 23, 16
BYTES_A_NUMBER = 64  # of a message, at most; chosen: with its part of the stamps and names
RECORD_HEAD = struct.Struct("<BQ")  # kind, and length of what follows
MAGIC = b"\x89MCAP0\r\n"  # a file that was not cut off ends with it, too
PLAIN_CDR = (b"\0\0", b"\0\1")  # a message's first two bytes: high byte first, low byte first


class Topic(Columns):
    """The numbers of a topic's messages, and when each was written."""

    def __init__(self) -> None:
        super().__init__()
        self.log_time_ns = array("Q")


Topics = dict[str, Topic]


def read_bag(path: Path) -> list[Stream]:
    """Read the numbers of every topic of an MCAP file, or of a ROS 2 bag's folder.

    A file that was cut off is read as far as it goes, and says so in the streams' notes.
    BadFileError: damaged, too large, a bag in the older SQLite format, a folder with files of
    several recordings, or nothing can be decoded.
    """
    files, notes = bag_files(path) if path.is_dir() else ([path], [])
    topics: Topics = {}
    spans = []
    for file in files:
        before = {name: len(topic) for name, topic in topics.items()}
        try:
            notes += _read(file, topics)
        except BadFileError:
            raise
        except Exception as error:  # of damaged bytes the decoders raise whatever they meet
            why = str(error) or type(error).__name__
            raise BadFileError(f"{file.name} is not readable as MCAP ({why})") from error
        spans += [
            Span(name, file.name, *extremes(topic.log_time_ns[before.get(name, 0) :]))
            for name, topic in topics.items()
            if len(topic) > before.get(name, 0)
        ]
    check_spans(spans)
    streams = [_stream(name, one, notes) for name, one in topics.items() if one.columns]
    if not streams:
        raise BadFileError("it is no MCAP file of ROS 2, JSON or protobuf messages with numbers")
    return streams


def _read(path: Path, topics: Topics) -> list[str]:
    """Append the messages of one file to `topics`; returns notes."""
    from mcap.exceptions import McapError

    lost: list[str] = []
    foreign: dict[str, str] = {}
    with path.open("rb") as file:
        file.seek(-min(len(MAGIC), path.stat().st_size), os.SEEK_END)
        cut = file.read() != MAGIC
        file.seek(0)
        if not MAGIC.startswith(file.read(len(MAGIC))):
            raise BadFileError(f"{path.name} is no MCAP file")
        file.seek(0)
        try:
            most = max(LEAST_LISTED, LISTED_A_BYTE * path.stat().st_size)
            _decode(_messages(file, lost), topics, foreign, most)
        except McapError:
            if not cut:
                raise
    left = [f"{name} is left out: nothing here reads {kind}" for name, kind in foreign.items()]
    if cut:
        return [f"{path.name} was cut off: read as far as it goes", *left]
    return [f"{path.name} is damaged: {words}" for words in lost] + left


def _messages(file: IO[bytes], lost: list[str]) -> Iterator[tuple[Any, Any, Any]]:
    """Yield schema, channel and message in the file's order; one chunk is in memory at a time.

    lost: is told where the file's summary counts more messages than it holds: a damaged byte makes
    a record of a kind that nobody knows, which readers pass over. ValueError: the chunks unpack to
    more than a table records, whatever the file's summary says.
    """
    from mcap.records import Channel, Message, Schema, Statistics

    schemas: dict[int, Any] = {}
    channels: dict[int, Any] = {}
    count = 0
    for record in _records(file):
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel):
            channels[record.id] = record
        elif isinstance(record, Message):
            channel = channels[record.channel_id]
            count += 1
            yield schemas.get(channel.schema_id), channel, record
        elif isinstance(record, Statistics) and record.message_count > count:
            lost.append(f"{count} of its {record.message_count} messages were found")


def _records(file: IO[bytes]) -> Iterator[Any]:
    """Yield the records of a file and, in place of its chunks, theirs.

    McapError, ValueError: a checksum is wrong, where the file has one, a chunk is not whole, or the
    chunks hold more records than the file has bytes.
    """
    from mcap.exceptions import EndOfFile
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader

    room, most = Room(8 * MAX_CELLS), max(LEAST_RECORDS, os.fstat(file.fileno()).st_size)
    for record in StreamReader(file, emit_chunks=True, validate_crcs=True).records:
        if not isinstance(record, Chunk):
            yield record
            continue
        data = unpacked(record, room)
        if len(data) < record.uncompressed_size:
            raise BadFileError("a chunk is not whole")
        most -= _count(data, most)
        with suppress(EndOfFile):  # a chunk has no footer
            yield from StreamReader(BytesIO(data), skip_magic=True, emit_chunks=True).records


def _count(data: bytes, most: int) -> int:
    """How many records a chunk holds, those of unknown kinds too. BadFileError: more than most."""
    count = at = 0
    while at + RECORD_HEAD.size <= len(data):
        at += RECORD_HEAD.size + RECORD_HEAD.unpack_from(data, at)[1]
        count += 1
        if count > most:
            raise BadFileError("its chunks hold more records than the file has bytes")
    return count


def _decode(
    messages: Iterable[Any], topics: Topics, foreign: dict[str, str], most_listed: int
) -> None:
    """Append decoded messages to `topics`, and to `foreign` what the messages of a topic are that
    nothing decodes. BadFileError: there are too many numbers, or more than `most_listed` bytes of
    lists and texts.
    """
    decoders: dict[int, Any] = {}
    cells = listed = 0
    for schema, channel, message in messages:
        if channel.id not in decoders:
            decoders[channel.id] = _decoder(channel, schema)
            if decoders[channel.id] is None:
                kind = schema.encoding if schema is not None else "no schema"
                foreign[channel.topic] = f"{channel.message_encoding or 'bytes'} of {kind}"
        decode = decoders[channel.id]
        if decode is None or len(message.data) > LONGEST_MESSAGE:
            continue
        row = dict(numbers("", decode(message.data), 0))
        cells += len(row)
        if cells > MAX_CELLS:
            check_size(cells, 1)
        listed += max(0, len(message.data) - BYTES_A_NUMBER * len(row))
        if listed > most_listed:
            raise BadFileError(
                f"its messages hold more than {most_listed} bytes of lists and texts, of which "
                f"{channel.topic} has some: keep the topics with the table's signals"
            )
        topic = topics.setdefault(channel.topic, Topic())
        topic.log_time_ns.append(message.log_time)
        topic.append(row)


def _decoder(channel: Any, schema: Any) -> Any:
    """What decodes a channel's messages; None where nothing does."""
    if channel.message_encoding == "json":
        return json.loads
    if channel.message_encoding == "cdr":
        factory = library("mcap_ros2.decoder", "a ROS 2 bag").DecoderFactory()
        decode = factory.decoder_for(channel.message_encoding, schema)
        return None if decode is None else partial(_plain_cdr, decode)
    factory = library("mcap_protobuf.decoder", "protobuf").DecoderFactory()
    return factory.decoder_for(channel.message_encoding, schema)


def _plain_cdr(decode: Any, data: bytes) -> Any:
    """A decoded message. BadFileError: it is no plain CDR, whose numbers lie elsewhere."""
    if data[:2] not in PLAIN_CDR:
        raise BadFileError(f"its messages are encoded as 0x{data[:2].hex()}, not as plain CDR")
    return decode(_Whole(data))


class _Whole(bytes):
    """A message beyond whose end nothing is read. The decoder's bytes that are missing there are
    none, and of elements of no bytes a short message claims billions.
    """

    def __getitem__(self, key: Any) -> Any:
        """Return a byte, or some. ValueError: not all of them are there."""
        if isinstance(key, slice) and key.stop is not None and key.stop > len(self):
            raise ValueError("a message ends before its fields do")
        return super().__getitem__(key)


def _stream(name: str, topic: Topic, notes: Sequence[str]) -> Stream:
    """One topic's messages as columns `TOPIC.PATH`, in the order of log_time.

    NaN where a message lacks the field.
    """
    check_size(len(topic), 1 + len(topic.columns))
    stamps = np.array(topic.log_time_ns)
    order = np.argsort(stamps, kind="stable")
    own = "own_time"
    while own in topic.columns:
        own = f"own_{own}"
    name = name.lstrip("/")
    columns = {f"{name}.time": stamps[order] / 1e9} | {
        f"{name}.{own if key == 'time' else key}": topic.column(key)[order] for key in topic.columns
    }
    return Stream(columns, {f"{name}.time": "s"}, f"{name}.time", notes=tuple(notes))
