"""A camera class that does not open: told in one line, and closed where it opens after all."""

import threading

import pytest

from tests.support.waiting import wait_for
from vision.sources import sources
from vision.sources.opening import open_within
from vision.sources.source_errors import UserCameraError
from vision.sources.sources import open_source

HANGS = """
import threading
GO = threading.Event()
CLOSED = threading.Event()
{}
class MyCamera:
    def __init__(self):
        {}
    def open(self):
        {}
    def read(self):
        pass
    def close(self):
        CLOSED.set()
"""


class Late:
    def __init__(self, go: threading.Event) -> None:
        go.wait()
        self.closed = False
        made.append(self)

    def close(self) -> None:
        self.closed = True


made: list[Late] = []


@pytest.mark.parametrize("place", range(3))
def test_a_file_or_class_that_never_opens_is_told_in_one_line(tmp_path, monkeypatch, place: int):
    parts = ["pass"] * 3
    parts[place] = "GO.wait()"
    file = tmp_path / "hangs.py"
    file.write_text(HANGS.format(*parts))
    monkeypatch.setattr(sources, "OPEN_S", 0.2)
    with pytest.raises(UserCameraError, match=r"does not open within 0\.2 s") as caught:
        open_source(f"{file}:MyCamera")
    assert str(caught.value).startswith(f"{file}:MyCamera: ")
    assert "\n" not in str(caught.value)


def test_what_opens_after_all_is_closed():
    go = threading.Event()
    with pytest.raises(UserCameraError, match="camera 7: does not open"):
        open_within(lambda: Late(go), "camera 7", 0.05)  # pyright: ignore
    assert not made
    go.set()
    wait_for("the close", lambda: made and made[0].closed)
