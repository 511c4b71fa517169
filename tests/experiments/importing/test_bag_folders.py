"""A ROS 2 bag of several files: one recording, or told what it is."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer

from experiments.importing.formats.choose import read_recording
from experiments.importing.recording import BadFileError

BEGIN_NS, STEP_NS, ROWS = 17 * 10**17, 20_000_000, 100
REST = "  duration:\n    nanoseconds: 5\n  files:\n    - path: nothing.mcap\n"


def part(path: Path, first: int, *, late_ns: int = 0) -> None:
    """A file of ROWS messages from row `first` of a recording."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("ball", "jsonschema", b"{}")
        channel = writer.register_channel("/ball", "json", schema)
        for row in range(first, first + ROWS):
            stamp_ns = BEGIN_NS + row * STEP_NS + late_ns
            writer.add_message(channel, stamp_ns, json.dumps({"x": row}).encode(), 0)
        writer.finish()


def bag(folder: Path, files: int = 11) -> Path:
    folder.mkdir()
    for k in range(files):
        part(folder / f"bag_{k}.mcap", k * ROWS)
    return folder


def listed(folder: Path, *names: str) -> None:
    """metadata.yaml as ros2 bag writes it."""
    lines = "".join(f"    - {name}\n" for name in names)
    words = f"rosbag2_bagfile_information:\n  version: 5\n  relative_file_paths:\n{lines}{REST}"
    (folder / "metadata.yaml").write_text(words)


@pytest.mark.parametrize("pattern", [None, "bag_{}.mcap", "bag/bag_{}.mcap", '"bag_{}.mcap.zstd"'])
def test_the_files_of_a_bag_are_one_recording(tmp_path: Path, pattern: str | None):
    """Also where they overlap by what waited while the next one was begun."""
    folder = bag(tmp_path / "bag")
    part(folder / "bag_10.mcap", 10 * ROWS, late_ns=-5 * STEP_NS // 2)
    if pattern:
        listed(folder, *(pattern.format(k) for k in range(11)))
    recording = read_recording(folder)
    assert sorted(recording.stream.columns["ball.x"]) == list(range(11 * ROWS))
    assert np.all(np.diff(recording.stream.columns["ball.time"]) > 0)
    assert recording.notes == ()


def test_a_copy_and_a_file_of_another_recording_are_refused(tmp_path: Path):
    """Their rows were mixed with the bag's before."""
    copied, mixed = bag(tmp_path / "copied"), bag(tmp_path / "mixed")
    shutil.copy(copied / "bag_1.mcap", copied / "bag_1 (copy).mcap")
    part(mixed / "other.mcap", 5 * ROWS + ROWS // 2, late_ns=STEP_NS // 2)
    for folder in (copied, mixed):
        with pytest.raises(BadFileError, match=r"hold /ball at the same time: .* keep the files"):
            read_recording(folder)


def test_a_file_that_the_bag_does_not_name_is_refused(tmp_path: Path):
    folder = bag(tmp_path / "bag", 2)
    part(folder / "yesterday.mcap", -4_000_000)
    listed(folder, "bag_0.mcap", "bag_1.mcap")
    with pytest.raises(BadFileError, match=r"yesterday\.mcap is no file of this bag"):
        read_recording(folder)


def test_a_file_that_is_missing_is_told(tmp_path: Path):
    folder = bag(tmp_path / "bag", 2)
    listed(folder, "bag_0.mcap", "bag_1.mcap", "bag_2.mcap.zstd")
    assert read_recording(folder).notes == ("bag_2.mcap.zstd of the bag is missing",)


def test_what_is_no_mcap_is_not_called_cut_off(tmp_path: Path):
    folder = bag(tmp_path / "bag", 1)
    (folder / "bag_1.mcap").write_bytes(b"hello world\n" * 50)
    with pytest.raises(BadFileError, match=r"bag_1\.mcap is no MCAP file"):
        read_recording(folder)


@pytest.mark.parametrize("name", ["bag_0.db3", "bag_0.mcap.zstd"])
def test_a_bag_that_is_no_mcap_is_told_how_to_become_one_without_its_index_too(tmp_path, name):
    (tmp_path / name).write_bytes(b"SQLite format 3")
    with pytest.raises(BadFileError, match=r"ros2 bag convert makes one of \.db3 files, zstd"):
        read_recording(tmp_path)
