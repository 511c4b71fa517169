"""A film through a live source's troubles."""

import json
import threading

import cv2
import pytest

from experiments.track.live_frames import frames_of
from experiments.track.track import track_video
from tests.support.footage import rolling
from tests.support.stream_server import BOUNDARY, Server, part
from vision.sources.source_errors import GarbageError, GoneError


class Source:
    """Gives numbers; raises what a test put between them; `now` counts what was asked for."""

    def __init__(self, *items):
        self.items, self.asked = list(items), 0

    def now(self):
        return float(self.asked)

    def __iter__(self):
        return self

    def __next__(self):
        self.asked += 1
        if not self.items:
            raise StopIteration
        item = self.items.pop(0)
        if isinstance(item, Exception):
            raise item
        return item


def followed(*items, give_up_s=5.0):
    source, troubles = Source(*items), []
    return list(frames_of(source, troubles, give_up_s=give_up_s, now=source.now)), troubles


def test_without_trouble_nothing_is_said():
    assert followed(1, 2, 3) == ([1, 2, 3], [])


def test_troubles_are_said_once_with_their_count():
    torn, gone = GarbageError("cam: torn"), GoneError("cam: gone")
    frames, troubles = followed(1, torn, 2, gone, torn, 3)
    assert frames == [1, 2, 3]
    assert troubles == ["cam: torn (2 times)", "cam: gone (1 time)"]


def test_it_gives_up_when_no_frame_comes_any_more():
    frames, troubles = followed(1, *[GoneError("cam: gone")] * 100)
    assert frames == [1]
    assert troubles == ["cam: gone (5 times)"]


def test_other_errors_pass():
    with pytest.raises(ZeroDivisionError):
        followed(1, ZeroDivisionError())


def test_a_stream_with_a_torn_frame_is_tracked_to_its_end(tmp_path):
    film = rolling("orange", seconds=1.0, size=(320, 240))
    sent = [cv2.imencode(".jpg", f.image)[1].tobytes() for f in film.frames]
    sent[10] = sent[10][:500]
    opened = threading.Event()

    def script(send, k):
        for i, body in enumerate(sent):
            send(part(body))
            assert i != 5 or opened.wait(5)
        send(f"--{BOUNDARY}--\r\n".encode())

    with Server(script) as server:
        summary = track_video(server.address, tmp_path, progress=lambda *_: opened.set())
    assert summary["frames"] + summary["dropped"] == len(sent) - 1
    assert "corrupt JPEG: cut off (1 time)" in " ".join(summary["notes"])
    assert json.loads((tmp_path / "results.json").read_text())["frames"] == summary["frames"]
