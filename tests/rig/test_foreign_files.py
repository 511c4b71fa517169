"""Files that anybody may have made: read as they are, or refused in one line and at once."""

import os
from pathlib import Path

import pytest

from rig.files import file_bytes, file_text, json_of, toml_of

PIPES = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no pipes with a name")


def test_a_file_is_read_as_it_is(tmp_path: Path):
    file = tmp_path / "a.json"
    file.write_bytes(b'{"a":\r\n 1}')
    assert file_bytes(file) == file_bytes(file, None) == b'{"a":\r\n 1}'
    assert file_text(file) == '{"a":\n 1}'
    assert json_of(file) == {"a": 1}
    link = tmp_path / "link.toml"
    link.symlink_to(file)
    assert file_bytes(link, 11) == file_bytes(file)
    file.write_text("a = 1")
    assert toml_of(link) == {"a": 1}


def test_what_is_longer_is_refused(tmp_path: Path):
    file = tmp_path / "a"
    with file.open("wb") as sparse:
        sparse.truncate(1 << 36)
    with pytest.raises(ValueError, match="longer than 16777216 bytes"):
        file_bytes(file)
    with pytest.raises(ValueError, match="longer than 1048576 bytes"):
        toml_of(file)


@PIPES
def test_pipes_devices_and_folders_are_refused_and_not_waited_for(tmp_path: Path):
    pipe, device = tmp_path / "pipe", tmp_path / "device"
    os.mkfifo(pipe)
    device.symlink_to("/dev/zero")
    for path in (pipe, device, tmp_path):
        for longest in (None, 100):
            with pytest.raises(ValueError, match="no file, but a folder, a pipe or a device"):
                file_bytes(path, longest)
    for _ in range(2000):  # more than may be open at once: each is closed again
        with pytest.raises(ValueError, match="no file"):
            file_text(pipe)


def test_what_is_no_text_or_not_there_is_said(tmp_path: Path):
    file = tmp_path / "a"
    file.write_bytes(b"ab\xff")
    with pytest.raises(ValueError, match=r"no text in UTF-8 \(invalid start byte at byte 2\)"):
        file_text(file)
    with pytest.raises(FileNotFoundError):
        file_text(tmp_path / "b")
