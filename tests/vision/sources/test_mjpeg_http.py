"""MJPEG over HTTP from a local server: the frames, their order and their times."""

import time

import pytest

from tests.support.stream_server import BOUNDARY, Script, Server, jpeg, level_of, part
from tests.support.waiting import wait_for
from vision.sources.addresses import without_password
from vision.sources.mjpeg_http import PartClock, server_stamp
from vision.sources.sources import open_source

pytestmark = pytest.mark.realtime


def test_frames_come_with_size_and_index(server, script):
    with open_source(server.address) as source:
        assert source.live
        assert source.size == (64, 48)
        assert level_of(next(source)) == 10
        for level in (20, 30):
            script.put(part(jpeg(level)))
            frame = next(source)
            assert level_of(frame) == level
        assert frame.index == 2
        assert (source.dropped, source.duplicates) == (0, 0)


@pytest.mark.parametrize("length", [True, False])
@pytest.mark.parametrize("newline", [b"\r\n", b"\n"])
def test_headers_as_servers_have_them(server, script, length, newline):
    with open_source(server.address) as source:
        next(source)
        for level in range(20, 60, 10):  # each is there before the next one is sent
            script.put(part(jpeg(level), length=length, newline=newline))
            assert level_of(next(source)) == level


def test_chunked_transfer_and_a_regular_end():
    def script(send, k):
        data = part(jpeg(10)) + part(jpeg(20)) + f"--{BOUNDARY}--\r\n".encode()
        for i in range(0, len(data), 100):
            piece = data[i : i + 100]
            send(b"%x\r\n%s\r\n" % (len(piece), piece))
        send(b"0\r\n\r\n")

    head = (
        "HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n"
        f'Content-Type: multipart/x-mixed-replace; boundary="--{BOUNDARY}"\r\n\r\n'
    )
    with Server(script, head=head) as server, open_source(server.address) as source:
        assert level_of(list(source)[-1]) == 20  # and then it ends, without an error


def test_a_slow_reader_gets_the_newest_frame(server, script):
    with open_source(server.address) as source:
        next(source)
        for burst in range(4):
            script.put(*[part(jpeg(20 + 40 * burst + k)) for k in range(30)])
            wait_for("the count", lambda n=29 * (burst + 1): source.dropped == n)
            assert level_of(next(source)) == 20 + 40 * burst + 29
        assert source.dropped == 4 * 29


def test_the_first_frame_does_not_wait_for_a_late_reader(server, script):
    with open_source(server.address) as source:
        script.put(part(jpeg(20)), part(jpeg(30)))
        wait_for("the count", lambda: source.dropped == 1)
        frame = next(source)
        assert level_of(frame) == 30
        assert source.dropped == 2
        assert frame.index == 2


def test_stamps_of_the_server_are_the_frames_times(server, script):
    """They are late by very different delays, which an arrival time would show."""
    start_s = time.monotonic()
    wall_minus = time.time() - start_s
    times = []
    with open_source(server.address, start_s=start_s) as source:
        next(source)
        for k, delay_s in enumerate((0.0, 0.09, 0.01, 0.05)):
            taken_s = time.time()
            times.append(taken_s - wall_minus - start_s)
            time.sleep(delay_s)
            script.put(part(jpeg(20 + k), x_timestamp=f"{taken_s:.6f}"))
            assert next(source).t_s == pytest.approx(times[-1], abs=1e-3)
            assert source.stamped_by == "server"


def test_frames_without_stamps_are_dated_on_arrival(server, script):
    with open_source(server.address) as source:
        next(source)
        for level in (20, 30):
            before_s = time.monotonic()
            script.put(part(jpeg(level)))
            taken_s = next(source).t_s + source.start_s
            assert source.stamped_by == "arrival"
            assert before_s <= taken_s <= time.monotonic()


def test_the_same_frame_again_is_a_repeat_unless_it_is_stamped_anew(server, script):
    same = jpeg(20)
    with open_source(server.address) as source:
        next(source)
        script.put(part(same), part(same), part(same))
        wait_for("the count", lambda: source.duplicates == 2)
        next(source)
        for _ in range(3):
            script.put(part(same, x_timestamp=f"{time.time():.6f}"))
            next(source)
        assert source.duplicates == 2


def test_login_and_redirect():
    with Server(Script([part(jpeg(10))])) as server:
        head = f"HTTP/1.1 302 Found\r\nLocation: {server.address}?a=b\r\n\r\n"
        with (
            Server(lambda send, k: None, head=head) as front,
            open_source(front.address.replace("//", "//me:p%40ss@")) as source,
        ):
            assert level_of(next(source)) == 10
            assert "me" not in source.address
        assert "Authorization: Basic bWU6cEBzcw==" in front.requests[0]
        assert "Authorization" not in server.requests[0]  # another host: not its password
        assert server.requests[0].startswith("GET /stream?a=b ")
        server.script.put(None)


@pytest.mark.parametrize(
    ("headers", "stamp_s"),
    [
        ({"x-timestamp": "1700000000.25"}, 1700000000.25),
        ({"x-timestamp": "1700000000250"}, 1700000000.25),
        ({"x-timestamp": "1700000000250000"}, 1700000000.25),
        ({"x-timestamp": "12.5"}, 12.5),
        ({"x-timestamp": "5", "x-ustreamer-grab-time": "4.5"}, 4.5),
        ({"x-timestamp": "soon"}, None),
        ({"x-timestamp": "nan"}, None),
        ({"x-timestamp": "0"}, None),
        ({}, None),
    ],
)
def test_stamps_are_read_in_their_units(headers, stamp_s):
    assert server_stamp(headers) == stamp_s


def test_another_machines_clock_is_mapped_and_parts_of_one_chunk_stay_in_order():
    clock = PartClock(same_machine=False)
    assert clock.date(5.0, 100.0, 1.7e9) == 100.0
    assert clock.date(6.0, 101.3, 1.7e9) == pytest.approx(101.0)
    assert clock.date(None, 102.0, 1.7e9) < clock.date(None, 102.0, 1.7e9)


def test_passwords_are_not_shown():
    assert without_password("http://a:b@host/x@y") == "http://host/x@y"
    assert without_password("http://host/x@y") == "http://host/x@y"
    assert without_password("rtsp://a:p@ss:w@host:554/x") == "rtsp://host:554/x"
    query = "http://host/v.cgi?user=a&Password=hunter2&size=2&access_token=abc#x"
    shown = "http://host/v.cgi?user=a&Password=...&size=2&access_token=...#x"
    assert without_password(query) == shown
    assert without_password("film.mp4") == "film.mp4"
    assert without_password("") == ""
