"""MJPEG over HTTP with every fault that a camera has: named, and over when the fault is."""

import contextlib
import random
import time
from itertools import pairwise

import pytest

from tests.support.stream_server import BOUNDARY, Script, Server, jpeg, level_of, part
from tests.support.waiting import wait_for
from vision.sources.source_errors import (
    GarbageError,
    GoneError,
    SizeChangedError,
    SourceError,
    StalledError,
)
from vision.sources.sources import open_source

pytestmark = pytest.mark.realtime


def sized(frame: bytes, width: int, height: int) -> bytes:
    """A JPEG whose head says another size."""
    at = frame.index(b"\xff\xc0") + 5
    size = height.to_bytes(2, "big") + width.to_bytes(2, "big")
    return frame[:at] + size + frame[at + 4 :]


def test_a_stall_is_named_and_goes_on(server, script):
    with open_source(server.address, patience_s=0.3) as source:
        next(source)
        with pytest.raises(StalledError, match=f"{server.port}/stream: no new frame"):
            next(source)
        script.put(part(jpeg(20)))
        wait_for("a newer frame", source._reader.newer)
        assert level_of(next(source)) == 20
        assert len(server.requests) == 1


def test_a_hanging_connection_is_replaced(server):
    with open_source(server.address, patience_s=0.3) as source:
        next(source)
        with pytest.raises(StalledError):
            next(source)
        assert level_of(next(source)) == 10  # the first of a new connection
        assert len(server.requests) == 2


@pytest.mark.parametrize("length", [True, False])
@pytest.mark.parametrize(
    "broken",
    [
        jpeg(20)[:-30],
        b"hello" * 50,
        jpeg(20)[:30] + b"\0" * 300,
        b"\xff\xd8\xff\xd9",
        sized(jpeg(20), 30_000, 30_000),  # 5 GB once unpacked
    ],
)
def test_garbage_is_named_and_the_next_frame_comes(server, script, length, broken, capfd):
    with open_source(server.address) as source:
        next(source)
        # Without a length, only the boundary after it shows the end of what is no JPEG.
        script.put(part(broken, length=length) + f"--{BOUNDARY}\r\n".encode())
        with pytest.raises(GarbageError, match=str(server.port)) as caught:
            next(source)
        assert "\n" not in str(caught.value)
        script.put(part(jpeg(30)))
        assert level_of(next(source)) == 30
        assert len(server.requests) == 1


def test_half_a_frame_at_the_beginning_does_not_matter():
    script = Script([jpeg(20)[100:], part(jpeg(20)[:-30]), part(jpeg(30))])
    with Server(script) as server, open_source(server.address) as source:
        assert level_of(next(source)) == 30
        script.put(None)


def test_nothing_but_garbage_is_named_at_the_opening():
    def script(send, k):
        while True:
            send(part(jpeg(20)[:-30]))
            time.sleep(0.002)

    with (
        Server(script) as server,
        pytest.raises(GarbageError, match=str(server.port)),
    ):
        open_source(server.address, patience_s=0.4)


def test_another_size_is_named_until_it_is_back(server, script):
    with open_source(server.address) as source:
        next(source)
        script.put(part(jpeg(20, (32, 24))))
        with pytest.raises(SizeChangedError, match="32x24 now and were 64x48"):
            next(source)
        script.put(part(jpeg(30)))
        assert level_of(next(source)) == 30


def test_a_closed_connection_is_named_and_comes_back(server, script):
    with open_source(server.address) as source:
        next(source)
        script.put(None)
        with pytest.raises(GoneError, match="closed the connection"):
            next(source)
        frame = next(source)
        assert level_of(frame) == 10
        script.put(part(jpeg(20)))
        assert next(source).t_s > frame.t_s


def test_a_server_that_vanishes_is_named_and_comes_back():
    levels = iter((10, 20))

    def script(send, k):
        send(part(jpeg(next(levels))))
        server.until_stopped()

    server = Server(script)
    with open_source(server.address, patience_s=0.3) as source:
        for frame in source:
            assert level_of(frame) == 10
            break
        server.stop()
        with pytest.raises(GoneError):
            next(source)
        with pytest.raises(ConnectionError, match="does not answer"):
            next(source)  # it was tried for 0.3 s
        server = Server(script, port=server.port)
        with server:
            frame = next(iter(source))
            assert level_of(frame) == 20
    assert source.dropped == 0


def test_nobody_there_is_one_clear_line():
    with Server(lambda send, k: None) as server:
        address = server.address.replace("//", "//me:secret@")
    with pytest.raises(GoneError, match="does not answer") as caught:
        open_source(address)
    assert "\n" not in str(caught.value)
    assert "secret" not in str(caught.value)


def test_a_server_that_does_not_answer_is_named_in_time():
    with Server(lambda send, k: server.until_stopped(), head=" ") as server:
        before_s = time.monotonic()
        with pytest.raises(GoneError, match="no answer in time"):
            open_source(server.address, patience_s=0.2)
        assert time.monotonic() - before_s < 2.0


@pytest.mark.parametrize(
    ("status", "words"), [("401 Unauthorized", "user:password@"), ("404 Not Found", "404")]
)
def test_refusals_are_named(status, words):
    head = f"HTTP/1.1 {status}\r\nContent-Length: 0\r\n\r\n"
    with (
        Server(lambda send, k: None, head=head) as server,
        pytest.raises(GoneError, match=words),
    ):
        open_source(server.address)


@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (2, 3))]
)
def test_whatever_happens_the_frames_are_right_and_come_back(seed):
    rng = random.Random(seed)
    faults = rng.choices(["frame", "torn", "junk", "size", "close", "silence", "cut"], k=30)
    levels = iter(range(11, 200, 3))
    left = iter(faults)

    def script(send, k):
        send(part(jpeg(next(levels))))  # so that the opening always finds one
        for fault in left:
            time.sleep(0.004)
            whole = part(jpeg(next(levels)), length=rng.random() < 0.5)
            if fault == "silence":
                time.sleep(0.25)
            elif fault in ("close", "cut"):
                send(whole[: len(whole) // 2 if fault == "cut" else 0])
                return
            bad = {"torn": part(jpeg(5)[:-99]), "junk": rng.randbytes(300)}
            send({**bad, "size": part(jpeg(5, (32, 24)))}.get(fault, whole))
        while True:
            time.sleep(0.004)
            send(part(jpeg(250), x_timestamp=f"{time.time():.6f}"))

    frames, deadline_s = [], time.monotonic() + 10
    with Server(script) as server, open_source(server.address, patience_s=0.2) as source:
        while not frames or level_of(frames[-1]) != 250:
            assert time.monotonic() < deadline_s
            with contextlib.suppress(SourceError):
                frames.append(next(source))
    seen = [level_of(f) for f in frames]
    assert all(a < b for a, b in pairwise(seen))  # none twice, none out of order
    assert set(seen) <= {*range(11, 200, 3), 250}
    assert all(a.t_s < b.t_s and a.index < b.index for a, b in pairwise(frames))
    assert all(f.image.shape == (48, 64, 3) for f in frames)
