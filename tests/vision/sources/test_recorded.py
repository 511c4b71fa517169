"""Folders of pictures that nobody made well: named in a line, whatever they claim to hold."""

import os
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from vision.sources import encoded_image
from vision.sources.recorded import frame_numbers, open_file, open_folder


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes of POSIX")
def test_pictures_that_would_fill_the_memory_or_wait_for_ever_are_named(tmp_path):
    """A file of 2 kB whose head says a billion pixels, a pipe, a damaged file: one line each."""
    cv2.imwrite(str(tmp_path / "1.png"), np.zeros((8, 8, 3), np.uint8))
    whole = (tmp_path / "1.png").read_bytes()
    head = whole[:16] + struct.pack(">II", 40_000, 30_000) + whole[24:29]
    huge = head + struct.pack(">I", zlib.crc32(head[12:29])) + whole[33:]
    for name, data, says in (
        ("huge.png", huge, "pixels: make it smaller"),
        ("cut.png", whole[:40], "not an image that can be"),
        ("text.png", b"no picture", "not an image that can be"),
        ("pipe.png", None, "no file, but a folder, a pipe"),
    ):
        folder = tmp_path / name.split(".")[0]
        folder.mkdir()
        (folder / "1.png").write_bytes(whole)
        if data is None:
            os.mkfifo(folder / "2.png")
        else:
            (folder / "2.png").write_bytes(data)
        frames = open_folder(folder, 30.0)
        assert frames.read() is not None
        with pytest.raises(ValueError, match=says) as caught:
            frames.read()
        assert "2.png" in str(caught.value)
        assert "\n" not in str(caught.value)


def test_frames_beyond_measure_are_refused_before_the_first_is_read(tmp_path, monkeypatch):
    film = tmp_path / "big.avi"
    writer = cv2.VideoWriter(str(film), cv2.VideoWriter.fourcc(*"MJPG"), 30, (64, 48))
    for _ in range(5):
        writer.write(np.zeros((48, 64, 3), np.uint8))
    writer.release()
    cv2.imwrite(str(tmp_path / "1.png"), np.zeros((48, 64, 3), np.uint8))
    assert open_file(film).read() is not None
    assert open_folder(tmp_path, 30.0).read() is not None
    monkeypatch.setattr(encoded_image, "MOST_PX", 64 * 48 - 1)
    with pytest.raises(ValueError, match="64 x 48 px are more than 3,071: make it smaller"):
        open_file(film)
    with pytest.raises(ValueError, match="more than 3,071 pixels: make it smaller"):
        open_folder(tmp_path, 30.0).read()


ID3 = b"ID3\x03\x00\x00\x00\x00\x00\x0a" + bytes(10)


@pytest.mark.parametrize(
    "text",
    [
        "ffconcat version 1.0\nfile {name}\n",
        "#EXTM3U\n#EXT-X-TARGETDURATION:9\n#EXTINF:9,\n{name}\n#EXT-X-ENDLIST\n",
        "v=0\no=- 0 0 IN IP4 127.0.0.1\nc=IN IP4 127.0.0.1\nm=video 5004 RTP/AVP 96\n",
        "# VobSub index file, v7\n",
    ],
)
@pytest.mark.parametrize("before", [b"", ID3])
def test_a_list_is_not_followed_to_another_film(tmp_path, text, before):
    """Such a "film" led to any film on the disk, and hung where it named a pipe."""
    film = tmp_path / "secret.avi"
    writer = cv2.VideoWriter(str(film), cv2.VideoWriter.fourcc(*"MJPG"), 30, (64, 48))
    for _ in range(5):
        writer.write(np.zeros((48, 64, 3), np.uint8))
    writer.release()
    address = tmp_path / "film.mp4"
    address.write_bytes(before + text.format(name=film.name).encode())
    with pytest.raises(ValueError, match="a list of other files or addresses") as caught:
        open_file(address)
    assert "film.mp4" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert open_file(film).read() is not None


@pytest.mark.parametrize(
    ("names", "numbers"),
    [
        (["a"], [0]),
        (["f1", "f2", "f3"], [0, 1, 2]),
        (["f0007", "f0008", "f0010", "f0011", "f0012"], [0, 1, 3, 4, 5]),  # 9 is missing
        (["cam2_f10", "cam2_f15", "cam2_f20", "cam2_f35"], [0, 1, 2, 5]),  # every fifth was kept
        (["t1000", "t1033", "t1067", "t1100"], [0, 1, 2, 3]),  # milliseconds
        (["IMG_1", "IMG_17", "IMG_90"], [0, 1, 2]),  # chosen by hand
        (["a1", "b2", "b3"], [0, 1, 2]),
        (["s1_f1", "s1_f2", "s2_f1"], [0, 1, 2]),
        (["f1", "f1", "f2"], [0, 1, 2]),  # the same number twice: of two formats
        (["one", "two"], [0, 1]),
    ],
)
def test_a_frame_that_is_missing_in_the_numbering_leaves_a_hole_in_time(
    names: list[str], numbers: list[int]
):
    assert frame_numbers(names) == numbers


def test_the_pictures_of_a_folder_are_dated_by_their_numbers(tmp_path: Path):
    for number in (3, 4, 6, 7):
        cv2.imwrite(str(tmp_path / f"frame{number}.png"), np.full((4, 4, 3), number, np.uint8))
    frames, found = open_folder(tmp_path, 10.0), []
    while (got := frames.read()) is not None:
        found.append((int(got[0][0, 0, 0]), got[1]))
    assert found == [(3, 0.0), (4, 0.1), (6, 0.3), (7, 0.4)]
