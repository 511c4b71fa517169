"""A bag with damaged bytes is refused, or told where the file itself can know."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Chunk
from mcap.writer import CompressionType, Writer

from experiments.importing.formats import bags
from experiments.importing.formats.choose import read_recording
from experiments.importing.recording import BadFileError
from tests.support.parts import needs

T = np.arange(60) * 0.02


def bag(path: Path, **settings) -> bytes:
    """A bag of 60 messages; its bytes."""
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE, **settings)
        writer.start()
        schema = writer.register_schema("ball", "jsonschema", b"{}")
        channel = writer.register_channel("/ball", "json", schema)
        for t_s in T:
            data = json.dumps({"x": round(np.sin(t_s), 6)}).encode()
            writer.add_message(channel, 10**18 + round(1e9 * t_s), data, 0)
        writer.finish()
    return path.read_bytes()


def records(data: bytes) -> list[tuple[int, int]]:
    """Kind and place of every record."""
    found, at = [], 8
    while at + 9 <= len(data) - 8:
        kind, length = struct.unpack_from("<BQ", data, at)
        found.append((kind, at))
        at += 9 + length
    return found


def flipped(data: bytes, at: int, bit: int) -> bytes:
    return data[:at] + bytes((data[at] ^ bit,)) + data[at + 1 :]


@pytest.mark.parametrize(
    ("settings", "kind", "left"),
    [({"chunk_size": 512}, Opcode.CHUNK, 60), ({"use_chunking": False}, Opcode.MESSAGE, 59)],
)
def test_records_that_a_flipped_bit_hides_are_told(tmp_path: Path, settings, kind, left: int):
    """Of an unknown kind, they are passed over; the file's own count is what tells."""
    path = tmp_path / "a.mcap"
    data = bag(path, **settings)
    at = [at for one, at in records(data) if one == kind][3]
    path.write_bytes(flipped(data, at, 0x80))
    recording = read_recording(path)
    assert len(recording.stream) <= left
    assert any(
        "a.mcap is damaged" in note and "of its 60 messages" in note for note in recording.notes
    )


def test_a_wrong_checksum_of_the_data_is_refused(tmp_path: Path):
    path = tmp_path / "a.mcap"
    data = bag(path, use_chunking=False, enable_data_crcs=True)
    assert read_recording(path).notes == ()
    path.write_bytes(flipped(data, data.index(b'"x": 0.') + 7, 1))
    with pytest.raises(BadFileError, match=r"a\.mcap"):
        read_recording(path)


@needs("mcap_ros2")
@pytest.mark.parametrize("encoding", [b"\x00\x07", b"\x00\x0a", b"\x00\x03"])
def test_messages_that_are_no_plain_cdr_are_refused(tmp_path: Path, encoding: bytes):
    """There a double begins at a multiple of 4, or has a number before it: read as plain CDR it
    would be another."""
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("lab/msg/A", "ros2msg", b"int32 n\nfloat64 x\n")
        channel = writer.register_channel("/a", "cdr", schema)
        for i in range(30):
            data = encoding + b"\0\0" + struct.pack("<idd", i, 0.5, 0.0)
            writer.add_message(channel, 10**18 + i * 10**7, data, 0)
        writer.finish()
    with pytest.raises(BadFileError, match=f"encoded as 0x{encoding.hex()}"):
        read_recording(path)


@needs("mcap_ros2")
def test_a_topic_that_nothing_decodes_is_told(tmp_path: Path):
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("ball", "jsonschema", b"{}")
        ball = writer.register_channel("/ball", "json", schema)
        idl = writer.register_schema("lab/msg/A", "ros2idl", b"module lab { struct A {long n;}; };")
        other = writer.register_channel("/a", "cdr", idl)
        for i in range(30):
            writer.add_message(ball, 10**18 + i * 10**7, b'{"x": 0.5}', 0)
            writer.add_message(other, 10**18 + i * 10**7, b"\0\1\0\0" + struct.pack("<i", i), 0)
        writer.finish()
    recording = read_recording(path)
    assert recording.notes == ("/a is left out: nothing here reads cdr of ros2idl",)


def test_a_bag_holds_no_more_records_than_its_size_allows(tmp_path: Path, monkeypatch):
    """10 kB with seven million of a kind that nobody knows were looked at for half a minute."""
    path = tmp_path / "a.mcap"
    data = bag(path, chunk_size=512)
    monkeypatch.setattr(bags, "LEAST_RECORDS", 0)
    assert len(read_recording(path).stream) == 60
    flood = struct.pack("<BQ", 0x80, 0) * (len(data) + 100)
    chunk = Chunk("zstd", zstandard.compress(flood), 0, 0, 0, len(flood))
    builder = RecordBuilder()
    chunk.write(builder)
    path.write_bytes(data[:8] + builder.end() + data[8:])
    with pytest.raises(BadFileError, match="its chunks hold more records than the file has bytes"):
        read_recording(path)


def lists(path: Path, topic: str, messages: list[bytes]) -> Path:
    """A bag of messages that are declared as lists of messages of one byte."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2")
        text = f"pkg/B[] b\n{'=' * 80}\nMSG: pkg/B\nuint8[1] x\n"
        schema = writer.register_schema("pkg/msg/A", "ros2msg", text.encode())
        channel = writer.register_channel(topic, "cdr", schema)
        for i, data in enumerate(messages):
            writer.add_message(channel, i, data, 0)
        writer.finish()
    return path


@needs("mcap_ros2")
def test_a_message_of_elements_without_bytes_claims_no_billions_of_them(tmp_path: Path):
    """12 bytes took 20 s for every 2 GB, and all memory there was."""
    data = b"\0\1\0\0" + struct.pack("<I", 300_000)
    path = lists(tmp_path / "a.mcap", "/ball", [data])
    with pytest.raises(BadFileError, match="ends before its fields do"):
        read_recording(path)


@needs("mcap_ros2")
def test_long_lists_that_packed_small_are_not_unpacked_for_minutes(tmp_path: Path, monkeypatch):
    """16 kB of them took more than three minutes, and gave no number."""
    data = b"\0\1\0\0" + struct.pack("<I", 9_000) + bytes(9_000)
    path = lists(tmp_path / "a.mcap", "/scan", [data] * 60)
    with pytest.raises(BadFileError, match="no MCAP file of"):
        read_recording(path)
    monkeypatch.setattr(bags, "LEAST_LISTED", 100_000)
    with pytest.raises(BadFileError, match="of lists and texts, of which /scan has some"):
        read_recording(path)
