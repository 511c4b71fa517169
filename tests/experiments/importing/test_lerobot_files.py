"""A LeRobot data set of several files: every frame once, and what is missing is told."""

import json
import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from experiments.importing.formats.choose import read_recording
from experiments.importing.recording import BadFileError

ROWS = 50


def data_set(folder: Path, files: int, **info: object) -> Path:
    """Files of one episode each; returns the folder of the data."""
    data = folder / "data/chunk-000"
    for path in (data, folder / "meta"):
        path.mkdir(parents=True)
    (folder / "meta/info.json").write_text(json.dumps({"features": {}, "fps": 50} | info))
    for k in range(files):
        columns = {
            "x": np.sin(np.arange(ROWS) + k),
            "timestamp": np.arange(ROWS) / 50,
            "frame_index": np.arange(ROWS),
            "episode_index": np.full(ROWS, k),
        }
        pq.write_table(pa.table(columns), data / f"file-{k:03}.parquet")
    return data


def test_a_copy_of_a_data_file_is_refused(tmp_path: Path):
    """Its episodes became logs of their own, and counted twice."""
    data = data_set(tmp_path, 2, total_frames=2 * ROWS)
    recording = read_recording(tmp_path)
    assert (len(recording.stream), recording.notes) == (2 * ROWS, ())
    shutil.copy(data / "file-001.parquet", data / "file-001 (1).parquet")
    with pytest.raises(BadFileError, match="hold 50 frames twice"):
        read_recording(tmp_path)


def test_data_files_and_columns_that_are_missing_are_told(tmp_path: Path):
    data = data_set(tmp_path, 2, total_frames=3 * ROWS)
    path = data / "file-001.parquet"
    table = pq.read_table(path).append_column("y", pa.array(np.zeros(ROWS)))
    pq.write_table(table, path)
    recording = read_recording(tmp_path)
    assert set(recording.stream.columns) == {"x", "timestamp", "episode_index"}
    assert recording.notes == (
        "100 of 150 frames of the data set are there: data files are missing",
        "left out, not in every data file: y",
    )
