"""Recordings of another version of the rig, or into which a lab wrote its own, cut off by a kill:
what this version cannot hold is kept as it was."""

import json
import struct
from pathlib import Path

import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.writer import Writer

from experiments.records.recording import recover
from experiments.records.samples_file import TAGS, sample_schema
from tests.benchmarks.records.damage_campaign import recording

NEW_TAG = (100 << 3 | 1) & 0x7F | 0x80 | (100 << 3 | 1) >> 7 << 8  # of field 100, a double


def killed(folder: Path, *, columns: int = 0, topic: str = "") -> bytes:
    """A killed run of 400 rows with `columns` more or fewer than ours, and a lab's own topic."""
    original = recording(folder, finished=False, seed=5)
    kept = len(TAGS) + min(columns, 0)
    (folder / "run.json").write_text(original.meta)
    schema = FileDescriptorSet.FromString(sample_schema())
    message = schema.file[0].message_type[0]
    del message.field[kept:], message.oneof_decl[kept:]
    if columns > 0:
        message.oneof_decl.add(name="_motor_current_A")
        field = message.field.add()
        field.CopyFrom(message.field[0])
        field.name, field.number = "motor_current_A", 100
        field.oneof_index = len(message.oneof_decl) - 1
    path = folder / "samples.mcap"
    with path.open("wb") as file:
        writer = Writer(file, use_chunking=False)
        writer.start(library="another version")
        number = writer.register_schema("rig.Sample", "protobuf", schema.SerializeToString())
        samples = writer.register_channel("samples", "protobuf", number)
        other = writer.register_channel(topic, "json", 0) if topic else 0
        for i, row in enumerate(original.rows):
            data = b"".join(struct.pack("<Hd", int(TAGS[j]), row[j]) for j in range(kept))
            data += struct.pack("<Hd", NEW_TAG, 1.5) if columns > 0 else b""
            writer.add_message(samples, i, data, i, i)
            if topic:
                writer.add_message(other, i, b'{"N": 1}', i, i)
    return path.read_bytes()


@pytest.mark.parametrize(("columns", "topic"), [(1, ""), (0, "force"), (2, "force")])
def test_columns_and_topics_that_this_version_does_not_know_are_kept(
    tmp_path: Path, columns: int, topic: str
):
    written = killed(tmp_path / "run", columns=columns, topic=topic)
    assert len(recover(tmp_path / "run").log) == 400
    assert (tmp_path / "run/samples.damaged.mcap").read_bytes() == written


def test_a_run_with_fewer_columns_leaves_nothing_beside_it(tmp_path: Path):
    killed(tmp_path / "run", columns=-3)
    found = recover(tmp_path / "run")
    assert len(found.log) == 400
    assert found.meta["outcome"] == "killed"
    assert not (tmp_path / "run/samples.damaged.mcap").exists()


@pytest.mark.parametrize("what", ["schema's number", "encoding", "channel's number"])
def test_rows_whose_declaration_is_damaged_are_kept(tmp_path: Path, what: str):
    """Nothing says any more how they are to be read; whoever repairs the bit has them all."""
    bad = bytearray(killed(tmp_path / "run", columns=-3))
    at = 8
    wanted = {"schema's number": 3, "encoding": 3, "channel's number": 4}[what]
    while bad[at] != wanted:
        at += 9 + struct.unpack_from("<Q", bad, at + 1)[0]
    bad[bad.find(b"protobuf", at) if what == "encoding" else at + 10] ^= 1
    (tmp_path / "run/samples.mcap").write_bytes(bad)
    recover(tmp_path / "run")
    assert (tmp_path / "run/samples.damaged.mcap").read_bytes() == bad
    assert json.loads((tmp_path / "run/run.json").read_text())["outcome"] == "killed"
