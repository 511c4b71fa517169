"""Text as Windows writes it in Japan, China, Russia, Poland, Germany; text that gzip packed."""

import gzip
from pathlib import Path

import pytest

from experiments.importing.formats import packed
from experiments.importing.formats.choose import read_recording
from experiments.importing.recording import BadFileError

CHINESE = ["时间(s)", "球X(mm)", "舵机X(°)"]
JAPANESE = ["時刻[s]", "ボールX[mm]", "サーボX[°]"]
RUSSIAN = ["Время [с]", "Шар X [мм]", "Угол серво X [град]"]
POLISH = ["czas [s]", "kulka X [mm]", "kąt zadany X [°]"]
GERMAN = ["Zeit", "Größe", "Fußweg [°]"]


def table(names: list[str]) -> str:
    return ",".join(names) + "\r\n" + "".join(f"{i / 50},{i},{i % 9}\r\n" for i in range(60))


@pytest.mark.parametrize(
    ("names", "encoding"),
    [
        (CHINESE, "gb18030"),
        (JAPANESE, "cp932"),
        (GERMAN, "latin-1"),
        (["Größe", "Maß", "Öl"], "latin-1"),  # two high bytes side by side, as in Chinese
        (RUSSIAN, "cp1251"),
        (POLISH, "cp1250"),
        (["Temps", "Élevé", "créée [m³/s]"], "latin-1"),  # three accents side by side, and a sign
        (GERMAN, "utf-16"),
        (GERMAN, "utf-16-le"),
        (["t", "x", "y"], "utf-16-be"),
        (CHINESE, "utf-8"),
    ],
)
def test_names_are_read_in_their_own_letters(tmp_path: Path, names: list[str], encoding: str):
    path = tmp_path / "run.csv"
    path.write_bytes(table(names).encode(encoding))
    stream = read_recording(path).stream
    assert list(stream.columns) == names
    assert stream.columns[names[1]][:3].tolist() == [0.0, 1.0, 2.0]


def test_letters_far_from_the_beginning(tmp_path: Path):
    path = tmp_path / "run.csv"
    words = "60.0,時刻,ボール\r\n"
    path.write_bytes((table(["t", "x", "y"]) * 1 + words).encode("cp932"))
    assert read_recording(path).stream.unreadable["x"].first == "時刻"


@pytest.mark.parametrize("inside", ["run.csv", "run.jsonl", "run.npy"])
def test_what_gzip_packed_is_read_as_what_is_inside(tmp_path: Path, inside: str):
    import numpy as np

    whole = tmp_path / inside
    if inside.endswith(".npy"):
        np.save(whole, np.arange(90.0).reshape(30, 3))
    elif inside.endswith(".jsonl"):
        whole.write_text('{"t": 1, "x": 2}\n' * 30)
    else:
        whole.write_text(table(["t", "x", "y"]))
    path = tmp_path / f"{inside}.gz"
    path.write_bytes(gzip.compress(whole.read_bytes()))
    one, other = (read_recording(each).stream.columns for each in (path, whole))
    assert {name: v.tolist() for name, v in one.items()} == {
        n: v.tolist() for n, v in other.items()
    }


# Without the time: the names of tests are made of what they are given, in every process alike.
@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("a.csv.gz", b"no gzip", "not readable as gzip's"),
        (
            "a.csv.gz",
            gzip.compress(table(["t", "x", "y"]).encode(), mtime=0)[:-20],
            "not readable as gzip's",
        ),
        ("a.gz", gzip.compress(b"1,2", mtime=0), "no kind of recording"),
        ("a.tar.gz", gzip.compress(b"1,2", mtime=0), "no kind of recording"),
        (
            "a.csv.gz",
            gzip.compress(b"1,2\n" * 300_000, mtime=0),
            "unpacks to more than 1000000 bytes",
        ),
    ],
)
def test_damaged_or_strange_packed_files(tmp_path: Path, monkeypatch, name, content, says):
    monkeypatch.setattr(packed, "MAX_BYTES", 1_000_000)
    (tmp_path / name).write_bytes(content)
    with pytest.raises(BadFileError, match=says) as caught:
        read_recording(tmp_path / name)
    assert str(caught.value).startswith(str(tmp_path / name))


def test_a_small_packed_file_holds_no_billion_of_blank_lines(tmp_path: Path):
    """Reading them took minutes."""
    (tmp_path / "a.csv.gz").write_bytes(gzip.compress(b"\n" * 70_000_000, 6))
    with pytest.raises(BadFileError, match="unpacks to more than 67108864 bytes"):
        read_recording(tmp_path / "a.csv.gz")
