"""Read MCAP files: ROS 2 bags, and messages in JSON or protobuf. One stream a topic.

The time of a sample is when it was written into the bag (log_time): that is when it was usable,
on one clock for all topics. A message's own stamp is a column of its own, `TOPIC.header.stamp`.
"""

import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from experiments.importing.formats.extra import library
from experiments.importing.recording import MAX_CELLS, BadFileError, Stream, check_size

MAX_WIDTH = 64  # chosen: a longer array in a message is a picture or a point cloud
MAX_DEPTH = 8
Topics = dict[str, list[dict[str, float]]]  # topic -> one dictionary a message
OF_JOINTS = ("position", "velocity", "effort")  # of JointState: one number a name


def read_bag(path: Path) -> list[Stream]:
    """Read the numbers of every topic of an MCAP file, or of a ROS 2 bag's folder.

    A file that was cut off is read as far as it goes, and says so in the streams' notes.
    BadFileError: damaged, too large, a bag in the older SQLite format, or nothing can be decoded.
    """
    files = sorted(path.glob("*.mcap")) if path.is_dir() else [path]
    if not files:
        raise BadFileError("a bag is read as MCAP: ros2 bag convert makes one of .db3 files")
    topics: Topics = {}
    notes = []
    for file in files:
        try:
            notes += _read(file, topics)
        except BadFileError:
            raise
        except Exception as error:  # of damaged bytes the decoders raise whatever they meet
            raise BadFileError(f"{file.name} is not readable as MCAP ({error})") from error
    streams = [_stream(name, rows, notes) for name, rows in topics.items() if len(rows[0]) > 1]
    if not streams:
        raise BadFileError("it is no MCAP file of ROS 2, JSON or protobuf messages with numbers")
    return streams


def _read(path: Path, topics: Topics) -> list[str]:
    """Append the messages of one file to `topics`; returns notes."""
    from mcap.exceptions import McapError
    from mcap.reader import NonSeekingReader, make_reader

    notes = []
    with path.open("rb") as file:
        try:
            summary = make_reader(file).get_summary()
        except McapError:
            summary = None
        file.seek(0)
        if summary is None:
            notes.append(f"{path.name} was cut off: read as far as it goes")
            messages = NonSeekingReader(file).iter_messages(log_time_order=False)
        else:
            unpacked = sum(chunk.uncompressed_size for chunk in summary.chunk_indexes)
            if unpacked > 8 * MAX_CELLS:
                raise BadFileError(f"it unpacks to {unpacked} bytes (limit: {8 * MAX_CELLS})")
            messages = make_reader(file).iter_messages()
        try:
            _decode(messages, topics)
        except McapError:
            if summary is not None:
                raise
    return notes


def _decode(messages: Iterable[Any], topics: Topics) -> None:
    """Append decoded messages to `topics`. BadFileError: there are too many numbers."""
    decoders: dict[int, Any] = {}
    cells = 0
    for schema, channel, message in messages:
        if channel.id not in decoders:
            decoders[channel.id] = _decoder(channel, schema)
        decode = decoders[channel.id]
        if decode is None:
            continue
        row = dict(_numbers("", decode(message.data), 0))
        cells += len(row)
        if cells > MAX_CELLS:
            check_size(cells, 1)
        topics.setdefault(channel.topic, []).append({"time": message.log_time / 1e9, **row})


def _decoder(channel: Any, schema: Any) -> Any:
    """What decodes a channel's messages; None where nothing does."""
    if channel.message_encoding == "json":
        return json.loads
    if channel.message_encoding == "cdr":
        factory = library("mcap_ros2.decoder", "a ROS 2 bag").DecoderFactory()
    else:
        factory = library("mcap_protobuf.decoder", "protobuf").DecoderFactory()
    return factory.decoder_for(channel.message_encoding, schema)


def _fields(message: Any) -> dict[str, Any] | None:
    """Fields of a message by name, whatever decoded it; None where it is no message."""
    if isinstance(message, dict):
        return message
    if hasattr(message, "DESCRIPTOR"):
        return {field.name: getattr(message, field.name) for field in message.DESCRIPTOR.fields}
    names = getattr(message, "__slots__", None) or getattr(message, "__dict__", {})
    return {name: getattr(message, name) for name in names if not name.startswith("_")} or None


def _numbers(name: str, value: Any, depth: int) -> Iterator[tuple[str, float]]:
    """Yield the numbers of a message with their paths; joints are called by their names."""
    if isinstance(value, bool | int | float | np.number):
        yield name, float(value)
    elif isinstance(value, str | bytes | bytearray) or value is None or depth > MAX_DEPTH:
        return
    elif hasattr(value, "__len__") and not isinstance(value, dict):
        if len(value) <= MAX_WIDTH:
            for i, one in enumerate(value):
                yield from _numbers(f"{name}[{i}]", one, depth + 1)
    else:
        fields = _fields(value) or {}
        if set(fields) == {"sec", "nanosec"}:
            yield name, fields["sec"] + 1e-9 * fields["nanosec"]
            return
        joints = fields.get("name")
        for key, one in fields.items():
            path = f"{name}.{key}" if name else key
            if key in OF_JOINTS and isinstance(joints, list | tuple) and _matches(joints, one):
                for joint, number in zip(joints, one, strict=True):
                    yield f"{path}.{joint}", float(number)
            else:
                yield from _numbers(path, one, depth + 1)


def _matches(joints: Any, values: Any) -> bool:
    """Whether `values` are numbers, one for each of the names `joints` (as in JointState)."""
    return (
        hasattr(values, "__len__")
        and not isinstance(values, str | bytes | dict)
        and 0 < len(joints) == len(values)
        and all(isinstance(joint, str) for joint in joints)
        and all(isinstance(one, int | float | np.number) for one in values)
    )


def _stream(topic: str, rows: list[dict[str, float]], notes: Sequence[str]) -> Stream:
    """One topic's messages as columns `TOPIC.PATH`; NaN where a message lacks the field."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    check_size(len(rows), len(names))
    topic = topic.lstrip("/")
    columns = {
        f"{topic}.{name}": np.array([row.get(name, np.nan) for row in rows]) for name in names
    }
    return Stream(columns, {f"{topic}.time": "s"}, f"{topic}.time", notes=tuple(notes))
