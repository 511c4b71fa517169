"""A part of the campaign of damages; the whole is tests/benchmarks/records/damage_campaign.py."""

from pathlib import Path

import numpy as np
import pytest

from experiments.records import samples_reading
from experiments.records.recording import read_run, recover
from experiments.records.samples_file import (
    CHANNEL,
    CHUNK,
    HEAD,
    MAGIC,
    RECORD,
    SCHEMA,
    finished_file,
    message_records,
    opening,
    plain_ending,
)
from experiments.records.samples_reading import read_samples
from rig.log import COLUMNS
from tests.benchmarks.records.damage_campaign import DAMAGES, campaign, recording


def test_no_row_that_a_damage_left_whole_is_lost():
    results = campaign(48, 7)
    assert {one.kind for one in results} == set(DAMAGES)
    assert not [one for one in results if one.lost or one.raised]
    assert sum(one.found for one in results) > 0.9 * sum(one.whole for one in results) > 5000


def test_a_row_without_its_end_does_not_swallow_the_next(tmp_path):
    original = recording(tmp_path / "run", finished=False, seed=1)
    begin, end = original.places[100]
    for missing in (1, 2, 7, 300):
        found = read_samples(original.content[: end - missing] + original.content[end:])
        wanted = np.delete(original.rows, 100, axis=0)
        assert found.rows.tobytes() == wanted.tobytes()
        assert found.unread == RECORD.itemsize - missing
    assert end - begin == RECORD.itemsize


def test_rows_are_known_without_their_declaration(tmp_path):
    original = recording(tmp_path / "run", finished=False, seed=2)
    name = original.content.index(b"rig.Sample")
    bad = bytearray(original.content)
    bad[name + 4 : name + 10] = b"Damage"
    assert read_samples(bytes(bad)).rows.tobytes() == original.rows.tobytes()


@pytest.mark.parametrize("finished", [True, False])
def test_one_flipped_bit_of_an_opcode_loses_no_row(tmp_path: Path, finished: bool):
    """Of a chunk, whose rows are found by its checksum, or of a row, which the kept file holds."""
    original = recording(tmp_path / "run", finished=finished, seed=3)
    begin = int(original.places[100][0])
    for bit in range(8):
        folder = tmp_path / f"bit{bit}"
        folder.mkdir()
        bad = bytearray(original.content)
        bad[begin] ^= 1 << bit
        (folder / "samples.mcap").write_bytes(bad)
        (folder / "run.json").write_text(original.meta)
        found = recover(folder)
        kept = folder / "samples.damaged.mcap"
        assert len(found.log) == len(original.rows) or kept.read_bytes() == bad
        assert len(found.log) >= len(original.rows) - 1


def _heads(content: bytes) -> list[int]:
    """Where the records of a whole file begin."""
    heads, at = [], len(MAGIC)
    while at < len(content) - len(MAGIC):
        heads.append(at)
        at += HEAD + int.from_bytes(content[at + 1 : at + HEAD], "little")
    return heads


def test_one_flipped_bit_of_a_records_head_loses_no_chunk_of_a_finished_file():
    """Where a record's length was wrong, all chunks after it were lost: of the file's first record,
    all rows, of which `rig recover` told none.
    """
    rows = np.random.default_rng(5).normal(size=(7000, len(COLUMNS)))
    rows[:, 0] = np.arange(len(rows)) * 0.002
    content = finished_file(rows, [{"t_s": 0.5, "text": "push"}], 0)
    heads = _heads(content)
    assert [content[at] for at in heads].count(CHUNK) >= 4
    for at in heads:
        for byte in (0, 1, 3, 8):
            bad = bytearray(content)
            bad[at + byte] ^= 1 << 6
            found = read_samples(bytes(bad))
            assert found.rows.tobytes() == rows.tobytes(), (content[at], byte)
            assert len(found.events) == 1
            # What declares and indexes may be damaged behind the rows, unseen.
            assert not found.complete or content[at] not in (SCHEMA, CHANNEL, CHUNK) or byte == 0


def test_a_damaged_chunk_costs_its_own_rows_alone():
    """Its name, its checksum, its length of data, its data; a hole through it and its index."""
    rows = np.random.default_rng(6).normal(size=(7000, len(COLUMNS)))
    rows[:, 0] = np.arange(len(rows)) * 0.002
    content = finished_file(rows, [], 0)
    first, second, third = [at for at in _heads(content) if content[at] == CHUNK][:3]
    held = len(read_samples(content[:second]).rows)
    wanted = np.delete(rows, np.s_[held : held + len(read_samples(content[:third]).rows) - held], 0)
    for begin, end in ((33, 37), (37, 45), (45, 53), (53, 80), (0, 80), (5000, third - second - 1)):
        bad = bytearray(content)
        bad[second + begin : second + end] = bytes(end - begin)
        found = read_samples(bytes(bad))
        whole = begin in (33, 45)  # without its checksum, or with its record's length, it is read
        assert found.rows.tobytes() == (rows if whole else wanted).tobytes(), begin
        assert not found.complete or begin == 33
    assert first < second


def test_one_row_without_its_time_costs_itself_alone(tmp_path: Path):
    original = recording(tmp_path / "run", finished=False, seed=4)
    begin = int(original.places[100][0])
    record = np.frombuffer(original.content, RECORD, 1, begin).copy()
    record["cells"]["value"][0, 0] = np.inf
    folder = tmp_path / "bad"
    folder.mkdir()
    bad = original.content[:begin] + record.tobytes() + original.content[begin + RECORD.itemsize :]
    (folder / "samples.mcap").write_bytes(bad)
    (folder / "run.json").write_text(original.meta)
    found = recover(folder)
    assert found.log.rows.tobytes() == np.delete(original.rows, 100, axis=0).tobytes()
    assert (folder / "samples.damaged.mcap").read_bytes() == bad


@pytest.mark.parametrize("column", [0, 5])
def test_a_damaged_tag_takes_no_value_with_it(tmp_path: Path, column: int):
    original = recording(tmp_path / "run", finished=False, seed=5)
    begin = int(original.places[100][0])
    record = np.frombuffer(original.content, RECORD, 1, begin).copy()
    record["cells"]["tag"][0, column] ^= 8
    bad = original.content[:begin] + record.tobytes() + original.content[begin + RECORD.itemsize :]
    assert read_samples(bad).rows.tobytes() == original.rows.tobytes()


def test_rows_that_stand_there_twice_are_taken_once_and_told(tmp_path: Path):
    """9315 rows of 8315 were recovered, exported and reported without a word."""
    original = recording(tmp_path / "run", finished=False, seed=6)
    begin, end = int(original.places[100][0]), int(original.places[149][1])
    again = original.content[begin:end]
    later = int(original.places[300][0])
    for at in (end, later, int(original.places[20][0])):
        found = read_samples(original.content[:at] + again + original.content[at:])
        assert sorted(found.rows[:, 0]) == sorted(original.rows[:, 0])
        assert found.unread == 50 * RECORD.itemsize
        assert not found.complete
    folder = tmp_path / "twice"
    folder.mkdir()
    bad = original.content[:later] + again + original.content[later:]
    (folder / "samples.mcap").write_bytes(bad)
    (folder / "run.json").write_text(original.meta)
    assert read_run(folder).meta["truncated"]
    assert recover(folder).log.rows.tobytes() == original.rows.tobytes()
    assert (folder / "samples.damaged.mcap").read_bytes() == bad


def test_rows_of_one_number_are_kept_where_they_differ(tmp_path: Path):
    """Of a second recorder, of chunks in another order, or of a tool that counts nothing."""
    original = recording(tmp_path / "run", finished=False, seed=8)
    records = message_records(original.rows[:50], 0)
    other = records.copy()
    other["cells"]["value"][:, 5] += 1.0
    uncounted = records.copy()
    uncounted["sequence"] = 0
    for block in (records[::-1], uncounted, np.concatenate([records, other])):
        found = read_samples(opening() + block.tobytes() + plain_ending())
        assert found.rows.tobytes() == block["cells"]["value"].tobytes()
        assert found.complete
    twice = np.concatenate([uncounted, other, uncounted])
    found = read_samples(opening() + twice.tobytes() + plain_ending())
    assert found.rows.tobytes() == twice["cells"]["value"][:100].tobytes()
    assert found.unread == 50 * RECORD.itemsize


def test_a_number_or_a_time_alone_makes_no_second_row():
    rows = np.zeros((4, len(COLUMNS)))
    assert samples_reading._stand_again(rows, np.arange(4)) == []
    assert samples_reading._stand_again(rows, np.array([3, 2, 1, 0])) == []
    rows[:, 0] = 0.5, 1.0, 0.5, 1.0
    assert samples_reading._stand_again(rows, np.array([7, 7, 7, 7])) == [2, 3]
    assert samples_reading._stand_again(rows, np.array([7, 7, 8, 7])) == [3]
