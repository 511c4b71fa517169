"""One line about the first fault in a file."""

import io
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field, ValidationError

from rig import files
from rig.files import (
    StrictModel,
    file_bytes,
    first_error_line,
    json_of,
    part_of,
    printable,
    put_aside,
    read_json,
    read_toml,
    write_whole,
)


class Inner(StrictModel):
    size_m: float = Field(default=1.0, gt=0)


class Outer(StrictModel):
    title: str
    one: Inner | None = None
    many: list[Inner] = Field(default_factory=list)
    named: dict[str, Inner] = Field(default_factory=dict)


@pytest.mark.parametrize(
    ("data", "line"),
    [
        (
            {"title": "a", "tilte": "b"},
            "unknown key 'tilte'; known: title, one, many, named; did you mean 'title'?",
        ),
        (
            {"title": "a", "one": {"size": 1}},
            "unknown key 'one.size'; known: size_m; did you mean 'size_m'?",
        ),
        (
            {"title": "a", "many": [{}, {"size": 1}]},
            "unknown key 'many.1.size'; known: size_m; did you mean 'size_m'?",
        ),
        ({"title": "a", "named": {"b": {"c": 1}}}, "unknown key 'named.b.c'; known: size_m"),
        ({"one": {"size_m": -1}, "x": 1}, "unknown key 'x'; known: title, one, many, named"),
        ({}, "key 'title' is missing; known: title, one, many, named"),
        (
            {"title": "a", "one": {"size_m": -1}},
            "one.size_m = -1: Input should be greater than 0 m",
        ),
        ({"title": ["a"]}, "title: Input should be a valid string"),
    ],
)
def test_the_line_names_place_value_and_known_keys(data: dict[str, Any], line: str):
    with pytest.raises(ValidationError) as caught:
        Outer.model_validate(data)
    assert first_error_line(caught.value, Outer) == line
    assert "\n" not in line


def test_a_section_checked_alone_is_named():
    with pytest.raises(ValidationError) as caught:
        Inner.model_validate({"size_m": "wide"})
    assert first_error_line(caught.value, within="ball").startswith("ball.size_m = 'wide': ")


@given(st.text() | st.text(st.characters(categories=["Cc", "Cf", "Cs", "Zl", "Zp"])))
def test_a_text_from_elsewhere_becomes_one_printable_line_of_unicode(text: str):
    found = printable(text)
    assert found.isprintable()
    assert found.encode() is not None
    assert printable(found) == found
    assert printable("a \x1b[1m\n b\ud800") == "a ?[1m b?"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("9" * 5000, "a number has too many digits"),
        ('{"a": -' + "9" * 301 + "}", "a number has too many digits"),  # which no float holds
        ("[" * 100_000, "its brackets are too deep"),
        ('"\\ud800"', "no Unicode"),
        ("{", "line 1 column 2"),
    ],
)
def test_a_bad_json_file_is_one_line(text: str, words: str):
    with pytest.raises(ValueError, match=words) as caught:
        read_json(text)
    assert str(caught.value).startswith("not a JSON file (")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a = " + "9" * 5000, "a number has too many digits"),
        ("a = " + "9" * 19, "beyond 64 bits"),
        ("a = " + "[" * 5000, "too deep"),
        (".".join("a" * 2500) + " = 1", "dotted keys are too deep"),
        (".".join("a" * 20_000) + " = 1", "dotted keys are too many"),  # took 1.7 GB
        ("[" + ".".join("a" * 2000) + "]\n" + "b = 1\n" * 10_000, "dotted keys are too many"),
    ],
)
def test_a_bad_toml_file_is_one_line(text: str, words: str):
    with pytest.raises(ValueError, match=words) as caught:
        read_toml(text)
    assert str(caught.value).startswith("not a TOML file (")


def test_an_editors_byte_order_mark_is_no_fault(tmp_path: Path):
    path = tmp_path / "any.json"
    path.write_bytes(b"\xef\xbb\xbf" + b'{"a": 1}')
    assert json_of(path) == {"a": 1}


def test_long_lists_of_numbers_are_no_dotted_keys():
    line = "a = [" + ", ".join(["0.5"] * 1000) + "]\n"
    assert len(read_toml(line + "".join(f"b{i} = 1\n" for i in range(1000)))["a"]) == 1000


@pytest.mark.skipif(sys.platform != "linux", reason="memory is bounded for a process")
def test_a_small_file_takes_little_memory_however_long_it_might_be(tmp_path):
    """Of 1 MB, 4 GiB were asked for: a small machine could not read its own runs."""
    (tmp_path / "file").write_bytes(bytes(1 << 20))
    code = (
        "import resource, sys; from pathlib import Path; from rig.files import file_bytes\n"
        "resource.setrlimit(resource.RLIMIT_AS, (1 << 30, 1 << 30))\n"
        "print(len(file_bytes(Path(sys.argv[1]), 1 << 32)))"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "file")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.stdout.strip() == str(1 << 20), done.stderr[-300:]


class Growing(io.BytesIO):
    """A file that says what it was asked for."""

    def __init__(self, content: bytes) -> None:
        super().__init__(content)
        self.asked: list[int] = []

    def read(self, size: int | None = -1) -> bytes:
        self.asked.append(size or 0)
        return super().read(size)


@pytest.mark.parametrize("said", [0, 1, 99_999, 100_000])
@pytest.mark.parametrize("most", [1, 99_999, 100_000, 100_001, 1 << 30])
def test_a_file_that_grew_is_read_to_its_end_or_the_limit(said: int, most: int):
    file = Growing(bytes(100_000))
    assert len(files._read(file, said, most)) == min(most, 100_000)
    assert max(file.asked) <= min(most, max(said + 1, files.STEP))
    assert file.asked[0] == min(said + 1, most)


def test_a_file_has_as_many_bytes_as_are_allowed_and_no_more(tmp_path: Path):
    (tmp_path / "file").write_bytes(b"abc")
    assert file_bytes(tmp_path / "file", 3) == file_bytes(tmp_path / "file", None) == b"abc"
    with pytest.raises(ValueError, match="longer than 2 bytes"):
        file_bytes(tmp_path / "file", 2)
    if Path("/proc/self/status").exists():  # the system's own are 0 bytes long
        assert b"Name" in file_bytes(Path("/proc/self/status"))
        with pytest.raises(ValueError, match="longer than 9 bytes"):
            file_bytes(Path("/proc/self/status"), 9)


def test_a_file_of_somebody_named_as_a_part_is_left_alone(tmp_path: Path):
    """Half of a download, say."""
    file, part = tmp_path / "log.csv", tmp_path / "log.csv.part"
    part.write_text("half of a download")
    write_whole(file, b"whole")
    assert (file.read_bytes(), part.read_text()) == (b"whole", "half of a download")
    assert part_of(file) != part_of(file)
    write_whole(file, b"anew", room=part)  # this one was reserved
    assert file.read_bytes() == b"anew"
    assert not part.exists()


def test_what_is_put_aside_gets_the_next_free_number(tmp_path: Path):
    for text in ("first", "second"):
        (tmp_path / "map").write_text(text)
        put_aside(tmp_path / "map")
    assert (tmp_path / "map.1").read_text() == "first"
    assert (tmp_path / "map.2").read_text() == "second"
    assert not (tmp_path / "map").exists()


@pytest.mark.skipif(not hasattr(os.stat_result, "st_blocks"), reason="the system does not tell")
def test_a_file_that_is_mostly_a_hole_is_refused(tmp_path: Path):
    """64 kB on the disk took 7.8 GB and two minutes."""
    path = tmp_path / "samples.mcap"
    with path.open("wb") as file:
        file.write(b"begin")
        file.truncate(1 << 32)
    with pytest.raises(ValueError, match=r"^of its 4294967296 bytes \d+ are on the disk: a hole$"):
        file_bytes(path, 1 << 32)
