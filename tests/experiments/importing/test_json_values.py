"""JSON as one value: a list of objects, an object of lists, and what is nested in them."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments.importing.formats import json_files
from experiments.importing.formats.choose import read_recording
from experiments.importing.recording import BadFileError

K = np.arange(30)


def read(folder: Path, value: Any) -> dict[str, np.ndarray]:
    path = folder / "run.json"
    path.write_text(value if isinstance(value, str) else json.dumps(value), encoding="utf-8-sig")
    return dict(read_recording(path).stream.columns)


def test_a_list_of_objects(tmp_path: Path):
    rows = [{"t": k / 50, "ball": [k, None if k == 3 else -k]} for k in K.tolist()]
    for value in (rows, {"lab": "3", "samples": rows}, json.dumps(rows, indent=2)):
        found = read(tmp_path, value)
        t, x, y = found.values()
        assert [name.split(".")[-1] for name in found] == ["t", "ball[0]", "ball[1]"]
        np.testing.assert_array_equal(x, K)
        assert np.isnan(y[3])
        assert np.isfinite(np.delete(y, 3)).all()
        np.testing.assert_allclose(t, K / 50)


def test_an_object_of_lists(tmp_path: Path):
    stamps = [f"2026-05-01T09:00:{k:02d}Z" for k in K.tolist()]
    place = [[k, 2 * k] for k in K.tolist()]
    odd = {"gain": 2, "names": ["a"], "mixed": [[1], [2, 3]]}
    value = {"time": stamps, "ball": place, "servo": {"x": K.tolist()}, **odd}
    found = read(tmp_path, value)
    assert list(found) == ["time", "ball[1]", "ball[2]", "servo.x"]
    np.testing.assert_array_equal(found["ball[2]"], 2 * K)
    np.testing.assert_array_equal(np.diff(found["time"]), 1.0)


def test_objects_a_line_under_the_other_ending(tmp_path: Path):
    lines = "".join(json.dumps({"t": k, "x": k}) + "\n" for k in K.tolist())
    np.testing.assert_array_equal(read(tmp_path, lines)["x"], K)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[1, 2", "not readable as JSON"),
        ("3", "no numbers were found"),
        ("[" * 100_000, "not readable as JSON"),
        ('{"a":' * 400 + "1" + "}" * 400, "no numbers|not JSON|not a JSON object|no rows"),
        ('[{"t": 1, "t": 2}]', "stands twice"),
        ("[" + "1" + "0" * 400 + ", 1]", "JSON|no numbers"),
    ],
)
def test_other_texts_get_one_line(text: str, says: str, tmp_path: Path):
    with pytest.raises(BadFileError, match=says):
        read(tmp_path, text)


def test_what_would_take_all_memory_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(json_files, "MAX_BYTES", 10)
    with pytest.raises(BadFileError, match="an object a line"):
        read(tmp_path, [{"t": 1.0}])
