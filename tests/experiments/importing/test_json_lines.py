"""JSON Lines: the logs of web pages and Python programs."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from experiments.importing.formats.choose import read_recording
from experiments.importing.formats.json_files import read_json_lines
from experiments.importing.recording import BadFileError


def written(folder: Path, *objects: object, ending: str = "", name: str = "log.jsonl") -> Path:
    path = folder / name
    path.write_text("".join(json.dumps(one) + "\n" for one in objects) + ending, encoding="utf-8")
    return path


@pytest.mark.parametrize("name", ["log.jsonl", "log.ndjson", "LOG.JSONL"])
def test_paths_are_the_columns_and_a_field_that_lacks_is_no_number(name: str, tmp_path: Path):
    rows = [{"t": k / 50, "ball": {"x": k, "y": -k}, "servo": [k, 2 * k]} for k in range(30)]
    del rows[3]["ball"]
    rows[4]["ball"] = None
    stream = read_recording(written(tmp_path, *rows, name=name)).stream
    assert list(stream.columns) == ["t", "ball.x", "ball.y", "servo[0]", "servo[1]"]
    k = np.arange(30.0)
    np.testing.assert_array_equal(stream.columns["servo[1]"], 2 * k)
    k[[3, 4]] = np.nan
    np.testing.assert_array_equal(stream.columns["ball.y"], -k)


def test_texts_that_are_times_are_seconds_and_others_nothing(tmp_path: Path):
    rows = [{"at": f"2026-05-01T09:00:{k:02d}.5Z", "mode": "run", "x": k} for k in range(30)]
    (stream,) = read_json_lines(written(tmp_path, *rows))
    assert list(stream.columns) == ["at", "x"]
    assert stream.units == {"at": "s"}
    np.testing.assert_allclose(np.diff(stream.columns["at"]), 1.0)
    (nested,) = read_json_lines(written(tmp_path, *({"header": row} for row in rows)))
    assert nested.units == {"header.at": "s"}
    np.testing.assert_array_equal(nested.columns["header.at"], stream.columns["at"])


def test_a_stamp_of_ros_is_one_number_and_what_only_looks_like_it_is_none(tmp_path: Path):
    stamp = {"sec": 5, "nanosec": 250_000_000}
    (stream,) = read_json_lines(written(tmp_path, {"at": stamp, "x": 1}))
    assert {name: values.tolist() for name, values in stream.columns.items()} == {
        "at": [5.25],
        "x": [1.0],
    }
    odd = {"sec": "five", "nanosec": None}
    (stream,) = read_json_lines(written(tmp_path, {"at": odd, "x": 1}))
    assert list(stream.columns) == ["x"]


def test_a_last_line_that_was_cut_off_is_left_out_and_told(tmp_path: Path):
    path = written(tmp_path, *({"t": k, "x": k} for k in range(50)), ending='{"t": 50, "x')
    (stream,) = read_json_lines(path)
    assert len(stream) == 50
    assert stream.notes == ("lines that are not a JSON object, left out: 1 of 51",)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "no numbers"),
        ("\n\n", "no numbers"),
        ('{"name": "a"}\n' * 9, "no numbers"),
        ("[1, 2]\n" * 9, "9 of 9 lines are not a JSON object"),
        ('{"a": 1}\nhello\nhello\n', "2 of 3 lines"),
        ("[" * 100_000 + "\n" + "1\n", "2 of 2 lines"),
        ('{"a": 1' + "0" * 400 + "}\n" + "1\n", "2 of 2 lines"),
        ("{" + ",".join(f'"c{i}": {i}' for i in range(5000)) + "}\n", "columns (limit"),
    ],
)  # fmt: skip
def test_what_is_no_log_gets_one_line(text: str, says: str, tmp_path: Path):
    path = tmp_path / "log.jsonl"
    path.write_text(text)
    with pytest.raises(BadFileError) as caught:
        read_recording(path)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_windows_own_encoding_is_read(tmp_path: Path):
    path = tmp_path / "log.jsonl"
    path.write_bytes('{"t": 1}\n{"t": 2}\n'.encode("utf-16"))
    assert read_recording(path).stream.columns["t"].tolist() == [1.0, 2.0]


SCALARS = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=9)
KEYS = st.text(st.characters(exclude_characters=".["), min_size=1, max_size=4)  # paths stand once
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner),
    max_leaves=8,
)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.dictionaries(KEYS, VALUES, max_size=4), max_size=6))
def test_any_objects_are_columns_of_one_length_or_one_line(tmp_path_factory, rows):
    path = written(tmp_path_factory.mktemp("any"), *rows)
    numbers = any(any(_is_told(value) for value in row.values()) for row in rows)
    if not numbers:
        with pytest.raises(BadFileError, match="no numbers"):
            read_json_lines(path)
        return
    (stream,) = read_json_lines(path)
    assert {len(values) for values in stream.columns.values()} == {len(rows)}


def _is_told(value: object) -> bool:
    """Whether there is a number in a value."""
    if isinstance(value, list):
        return any(map(_is_told, value))
    if isinstance(value, dict):
        return any(map(_is_told, value.values()))
    return isinstance(value, bool | int | float)
