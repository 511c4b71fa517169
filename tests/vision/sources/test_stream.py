"""Streams that OpenCV decodes, and videos on a server, from sockets on this machine."""

import socket
import threading
import time

import numpy as np
import pytest

from tests.support.footage import rolling
from tests.support.stream_server import Server
from tests.vision.sources.test_sources import write_video
from vision.sources.source_errors import GoneError
from vision.sources.sources import open_source

pytestmark = pytest.mark.realtime


@pytest.fixture(scope="module")
def images():
    return [f.image for f in rolling("green", seconds=1.0, size=(160, 120), rest_s=0.0).frames]


def serve_once(serve):
    """An address on which `serve(client)` runs for one connection, and the thread."""
    listener = socket.create_server(("127.0.0.1", 0))

    def run():
        with listener:
            client, _ = listener.accept()
            with client:
                serve(client)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    return f"tcp://127.0.0.1:{listener.getsockname()[1]}", thread


def test_a_stream_is_dated_on_arrival_and_named_when_it_breaks_off(tmp_path, images):
    data = write_video(tmp_path / "v.ts", images).read_bytes()
    address, thread = serve_once(lambda client: client.sendall(data))
    start_s = time.monotonic()
    with open_source(address, start_s=start_s) as source:
        assert source.live
        assert source.size == (160, 120)
        times = [next(source).t_s]
        with pytest.raises(GoneError, match="ended or broke off"):
            times.extend(frame.t_s for frame in source)
    assert 0 < times[0] < time.monotonic() - start_s
    assert np.all(np.diff(times) > 0)
    thread.join(5)


def test_a_silent_stream_is_named_in_time(capfd):
    done = threading.Event()
    address, thread = serve_once(lambda client: done.wait(5))
    before_s = time.monotonic()
    with pytest.raises(GoneError, match="does not answer"):
        open_source(address, patience_s=0.3)
    assert time.monotonic() - before_s < 3
    done.set()
    thread.join(5)
    assert capfd.readouterr().err == ""


def test_a_video_on_a_server_is_read_whole_and_at_its_times(tmp_path, images):
    data = write_video(tmp_path / "v.mkv", images, codec="mpeg4").read_bytes()
    head = (
        "HTTP/1.1 200 OK\r\nContent-Type: video/x-matroska\r\n"
        f"Content-Length: {len(data)}\r\nConnection: close\r\n\r\n"
    )
    with (
        Server(lambda send, k: send(data), head=head) as server,
        open_source(server.address) as source,
    ):
        assert not source.live
        frames = list(source)
    assert len(frames) == len(images)
    assert frames[9].t_s == pytest.approx(9 / 30, abs=0.002)


def test_a_page_is_no_video():
    head = "HTTP/1.1 200 OK\r\nContent-Type: text/html\r\nContent-Length: 5\r\n\r\n"
    with (
        Server(lambda send, k: send(b"hello"), head=head) as server,
        pytest.raises(ValueError, match="not an MJPEG stream but text/html, nor a video"),
    ):
        open_source(server.address)
