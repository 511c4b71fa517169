"""Bytes of samples.mcap as rows and events, whole, cut off, damaged or rewritten by another tool.

Reading goes record by record here and not by the `mcap` package's `StreamReader`, for two reasons:
rows in our own layout are read in blocks (15 000 rows in 0.02 s instead of 0.11 s), and rows after
damaged bytes are still found: every row begins with the same eleven bytes, and chunks of rows are
found by theirs (`chunk_places`). What another tool rewrote is decoded by its own schema.
"""

import struct
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from io import BytesIO
from typing import Any

import numpy as np

from experiments.records.chunk_places import chunk_places
from experiments.records.samples_file import (
    CELL,
    CHANNEL,
    CHANNEL_ID,
    CHUNK,
    EVENTS,
    FOOTER,
    HEAD,
    LONGEST_S,
    MAGIC,
    MESSAGE,
    MESSAGE_HEAD,
    RECORD,
    SAMPLES,
    SCHEMA,
    SHORTEST_S,
    TAGS,
    sample_schema,
)
from experiments.records.unpacking import LEAST_BYTES, MOST_RATIO, Room, unpacked
from rig.files import read_json
from rig.log import COLUMNS, INDEX

BLOCK_ROWS = 1024  # rows read at once
_TAGS = TAGS.tobytes()[::2], TAGS.tobytes()[1::2]  # low and high bytes
# Bytes of one message, and of all events: brackets in JSON, or empty messages in protobuf, take a
# hundred times their bytes once they are decoded. Chosen: far beyond what a run has to say; a
# `Recorder` writes no more.
LONGEST_MESSAGE, MOST_EVENT_BYTES = 1 << 16, 1 << 24
LEAST_EVENT = 64  # bytes that one counts for at least; chosen: of the shortest, four seconds' work
LEFT_OUT = "events are left out from here on: they are too many, or too long"
SHORTEST_ROW = 2  # bytes of a row's data: a tag and a time
# Rows of another layout, which are decoded one by one; a longer file may hold what its size allows.
# Chosen: three seconds' work, three minutes at 500 Hz.
LEAST_ROWS = 100_000
MOST_LAYOUTS = 16  # of rows, that are made ready; chosen: a tool that rewrites a recording has one
OWN_ROWS = -1  # not an opcode: a block of rows in our own layout
ENDS = (0x01, FOOTER, 0x0F)  # header, footer, end of data
INDEXES = range(0x07, 0x0F)  # indexes, statistics, attachments, metadata: of finished files
ATTACHMENT = 0x09
ATTACHED = (ATTACHMENT, 0x0C)  # and metadata
FOOTER_BYTES, CHECKSUM = 20, 4


@dataclass
class SamplesFile:
    """Content of a samples file: rows (n, len(COLUMNS)), events, and whether it is complete.

    complete: it ends as a finished file does and every byte was understood; unread: how many bytes
    were not, of which `tail` stand at the end (half a record of a recording that was killed);
    foreign: it holds more than a `Recorder` of this version writes, columns or topics of others.
    """

    rows: np.ndarray
    events: list[dict] = field(default_factory=list)
    complete: bool = False
    unread: int = 0
    tail: int = 0
    foreign: bool = False


@dataclass
class _Reading:
    """What is known while a file is read: declarations so far, and what they led to."""

    schemas: dict[int, Any] = field(default_factory=dict)
    topics: dict[int, str] = field(default_factory=dict)
    # The channel whose rows have our own layout: the usual one, should its declaration be damaged.
    own_layout: int | None = CHANNEL_ID[SAMPLES]
    decode: Callable[[bytes], Any] | None = None  # a row that has another layout
    layout: Any = None  # the schema of `decode`
    layouts: int = 0  # that were made ready so far
    blocks: list[np.ndarray] = field(default_factory=list)
    numbers: list[np.ndarray] = field(default_factory=list)  # of the blocks' rows, in sequence
    events: list[dict] = field(default_factory=list)
    complete: bool = False
    unread: int = 0  # bytes that were not understood
    tail: int = 0  # of those, after the last record
    foreign: bool = False  # more was understood than rows and events can hold
    room: Room = field(default_factory=lambda: Room(0))
    row_room: int = LEAST_ROWS  # messages but events that may still be taken one by one
    other_room: int = LEAST_ROWS  # and other records; below 0 only our own rows are looked for
    event_room: int = MOST_EVENT_BYTES  # bytes that events may still have; below 0: some are out
    inside: bool = False  # a chunk
    has_chunks: bool = False


def read_samples(data: bytes) -> SamplesFile:
    """Read the bytes of samples.mcap, whole or cut off, also rewritten by another tool.

    Damaged records are left out, as is a row that stands there twice; rows in our own layout are
    found again behind them. ValueError: the data does not start like an MCAP file, and no row is in
    it.
    """
    room = MOST_RATIO * len(data)
    reading = _Reading(
        room=Room(max(room, LEAST_BYTES)),
        row_room=max(room // RECORD.itemsize, LEAST_ROWS),
        other_room=max(len(data), LEAST_ROWS),
    )
    records = data[len(MAGIC) :]
    _read(records.removesuffix(MAGIC), reading)
    rows = np.concatenate([np.empty((0, len(COLUMNS))), *reading.blocks])
    if not data.startswith(MAGIC[: len(data)]):
        if not len(rows):
            raise ValueError("it does not start like an MCAP file")
        reading.unread += len(MAGIC)
    again = _stand_again(rows, np.concatenate([np.empty(0, np.uint32), *reading.numbers]))
    if again:
        rows = np.delete(rows, again, axis=0)
        reading.unread += RECORD.itemsize * len(again)
    ended = reading.complete and data.endswith(MAGIC)  # other readers begin at the end
    whole = ended and not reading.unread
    return SamplesFile(rows, reading.events, whole, reading.unread, reading.tail, reading.foreign)


def _stand_again(rows: np.ndarray, numbers: np.ndarray) -> list[int]:
    """Indexes of the rows (n, len(COLUMNS)) that stood before under the same number in sequence.

    They have every value of the other: what a second recorder wrote under that number is kept, and
    so is what a tool wrote that counts nothing.
    """
    if (numbers[1:] > numbers[:-1]).all():
        return []
    order = np.lexsort((rows[:, 0], numbers))
    alike = (np.diff(numbers[order]) == 0) & (np.diff(rows[order, 0]) == 0)
    seen: set[tuple[int, bytes]] = set()
    again = []
    for i in np.unique(np.concatenate([order[1:][alike], order[:-1][alike]])).tolist():
        row = int(numbers[i]), rows[i].tobytes()
        if row in seen:
            again.append(i)
        seen.add(row)
    return again


def _read(buffer: bytes, reading: _Reading) -> None:
    """Take every whole record of `buffer` into `reading`."""
    for opcode, content in _records(buffer, reading):
        # Of damaged bytes each parser has errors of its own: they are left out.
        with suppress(Exception):
            if _take(opcode, content, reading):
                continue
        reading.unread += HEAD + len(content)


def _records(buffer: bytes, reading: _Reading) -> Iterator[tuple[int, Any]]:
    """Yield (opcode, content) of whole records, runs of own rows as (OWN_ROWS, records (k,)).

    No record but a chunk holds rows, and none holds chunks: one that seems to reach beyond the next
    row or chunk is damaged. But an attachment may be another recording.
    """
    places = iter(()) if reading.inside else chunk_places(buffer)
    place, position = next(places, None), 0
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
        while place and place.begin < position:
            place = next(places, None)
        if place and place.begin == position:
            yield CHUNK, place.content(buffer)
            reading.unread += 0 if place.sound else HEAD
            position = place.end
            continue
        after = place.begin if place else len(buffer)
        opcode, length = struct.unpack_from("<BQ", buffer, position)
        end = position + HEAD + length
        reading.other_room -= 1
        if reading.other_room < -LEAST_ROWS:
            break
        if opcode == ATTACHMENT and not reading.inside and _is_attachment(buffer, position, end):
            yield opcode, buffer[position + HEAD : end]
            position = end
            continue
        whole = opcode != 0 and end <= after  # not half a record, nor zeros of a power cut
        if (reading.row_room if opcode == MESSAGE else reading.other_room) < 0:
            whole = False  # it is no recording: the next row of our own is what counts
        stop = end if whole else after
        begin = _next_row(buffer, position + 1, stop, reading.own_layout)
        if whole and (opcode == CHUNK or begin == end):
            reading.other_room += opcode == MESSAGE
            yield opcode, buffer[position + HEAD : end]
            position = end
            continue
        reading.unread += begin - position
        if begin == len(buffer) and not reading.inside:
            reading.tail = begin - position
        position = begin
    reading.unread += len(buffer) - position
    if position < len(buffer) and not reading.inside:
        reading.tail = len(buffer) - position


def _is_attachment(buffer: bytes, begin: int, end: int) -> bool:
    """Whether the record in `buffer` from begin to end is an attachment: its lengths agree, those
    of name, type of media and data.
    """
    at = begin + HEAD + 2 * 8  # behind two times
    for kind in ("<I", "<I", "<Q"):
        if at + struct.calcsize(kind) > len(buffer):
            return False
        at += struct.calcsize(kind) + struct.unpack_from(kind, buffer, at)[0]
    return at + CHECKSUM == end <= len(buffer)


def _next_row(buffer: bytes, position: int, stop: int, channel: int | None) -> int:
    """Return where the first row in our own layout begins from `position`, or `stop` without."""
    if channel is None:
        return stop
    begins = _begin(channel)
    found = buffer.find(begins, position, stop + len(begins) - 1)
    return stop if found < 0 else found


def _begin(channel: int) -> bytes:
    """The first bytes of a row in our own layout."""
    return struct.pack("<BQH", MESSAGE, RECORD.itemsize - HEAD, channel)


def _begins_row(buffer: bytes, position: int, channel: int) -> bool:
    """Whether a whole row in our own layout lies at `position`, by its head and its cells' tags."""
    if not buffer.startswith(_begin(channel), position):
        return False
    cells = buffer[position + HEAD + MESSAGE_HEAD : position + RECORD.itemsize]
    return (cells[:: CELL.itemsize], cells[1 :: CELL.itemsize]) == _TAGS


def _own_rows(buffer: bytes, position: int, channel: int | None) -> np.ndarray:
    """Return the records (k,) of our own layout that follow each other from `position`."""
    count = min(BLOCK_ROWS, (len(buffer) - position) // RECORD.itemsize)
    if channel is None or count <= 0 or not _begins_row(buffer, position, channel):
        return np.empty(0, RECORD)  # before a block is looked at: what is no row may be much
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
        _take_rows(content["cells"]["value"], content["sequence"], reading)
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
    reading.foreign = reading.foreign or opcode in ATTACHED
    is_finished = reading.has_chunks or not (reading.blocks or reading.events)  # or empty
    return opcode in ENDS or (opcode in INDEXES and is_finished)


def _take_chunk(content: bytes, reading: _Reading) -> None:
    """Take the records of a chunk."""
    from mcap.data_stream import ReadDataStream
    from mcap.records import Chunk

    if reading.inside:
        raise ValueError("a chunk inside a chunk")
    chunk = Chunk.read(ReadDataStream(BytesIO(content)))
    rows, reading.inside = unpacked(chunk, reading.room), True
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
    if schema == reading.layout:
        return
    if reading.layouts == MOST_LAYOUTS:
        raise ValueError("more layouts than a recording has")
    reading.layouts += 1
    reading.decode = DecoderFactory().decoder_for("protobuf", schema)
    reading.layout = schema


def _take_message(content: bytes, reading: _Reading) -> None:
    """Take one event, or one row that is not in our own layout."""
    payload = content[MESSAGE_HEAD:]
    topic = reading.topics.get(struct.unpack_from("<H", content)[0])
    reading.row_room -= 1
    if len(payload) < SHORTEST_ROW:
        raise ValueError("a message without a time")
    if len(payload) > LONGEST_MESSAGE:
        raise ValueError("a message beyond all measure")
    if topic == EVENTS:
        _take_event(payload, reading)
    elif topic == SAMPLES:
        _take_row(content, reading)
    elif topic is None:
        raise ValueError("a message of a channel that was not declared")
    else:
        reading.foreign = True


def _take_row(content: bytes, reading: _Reading) -> None:
    """Take one row that is not in our own layout, or whose tags are damaged."""
    row, channel = np.full((1, len(COLUMNS)), np.nan), struct.unpack_from("<H", content)[0]
    payload = content[MESSAGE_HEAD:]
    if channel == reading.own_layout and len(content) == RECORD.itemsize - HEAD:
        # A tag is damaged, but each value has its place.
        row[0] = np.frombuffer(payload, RECORD["cells"])["value"]
    elif reading.decode is None:
        raise ValueError("a row whose layout was not declared")
    else:
        for described, value in reading.decode(payload).ListFields():
            if described.name in INDEX:
                row[0, INDEX[described.name]] = value
            else:
                reading.foreign = True
    _take_rows(row, np.frombuffer(content, "<u4", 1, 2), reading)


def _take_event(payload: bytes, reading: _Reading) -> None:
    """Take one event; the first for which there is no room is told by `LEFT_OUT`."""
    if reading.event_room < 0:  # the rows are none the worse for it
        return
    reading.event_room -= max(len(payload), LEAST_EVENT)
    event = read_json(bytes(payload).decode())
    if not isinstance(event, dict) or not isinstance(event.get("text"), str):
        raise ValueError("an event without a text")
    if reading.event_room < 0:
        event = {"text": LEFT_OUT, "t_s": event["t_s"]}
    reading.events.append({**event, "t_s": float(event["t_s"])})
    reading.row_room += 1  # it had a room of its own


def _take_rows(rows: np.ndarray, numbers: np.ndarray, reading: _Reading) -> None:
    """Take rows (k, len(COLUMNS)), of these numbers in sequence (k,), but those whose time is
    damaged: no file could hold them.
    """
    sound = (rows[:, 0] >= SHORTEST_S) & (rows[:, 0] <= LONGEST_S)
    reading.unread += RECORD.itemsize * int(np.sum(~sound))
    reading.blocks.append(rows if sound.all() else rows[sound])
    reading.numbers.append(numbers if sound.all() else numbers[sound])
