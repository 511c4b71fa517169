"""The capture thread: newest frame only, troubles by name, back when the camera is."""

import threading
import time

import numpy as np
import pytest

from vision.sources.live import LiveReader
from vision.sources.source_errors import (
    GarbageError,
    GoneError,
    SizeChangedError,
    StalledError,
)

pytestmark = pytest.mark.realtime


class Feed:
    """Gives frames that a test puts in; an exception put in is raised."""

    def __init__(self):
        self.duplicates, self.stamped_by = 0, "test"
        self.closed = threading.Event()
        self._items = []
        self._news = threading.Condition()

    def put(self, *items):
        with self._news:
            self._items += items
            self._news.notify()

    def read(self):
        with self._news:
            self._news.wait_for(lambda: self._items)
            item = self._items.pop(0)
        if isinstance(item, Exception):
            raise item
        return item

    def decode(self, raw):
        if isinstance(raw, str):
            raise GarbageError(f"{raw} is no image")
        return raw

    def interrupt(self):
        self.put(None)

    def close(self):
        self.closed.set()


def frame(k, size=4):
    return np.full((size, size, 3), k, np.uint8), time.monotonic() + 1e-3 * k


def number(got):
    return int(got[0][0, 0, 0])


def drained(feed):
    deadline = time.monotonic() + 5
    while feed._items and time.monotonic() < deadline:
        time.sleep(0.001)
    time.sleep(0.01)


@pytest.fixture
def feeds():
    return [Feed()]


@pytest.fixture
def reader(feeds):
    def connect():
        if feeds[-1].closed.is_set():
            feeds.append(Feed())
            feeds[-1].put(frame(99))
        return feeds[-1]

    reader = LiveReader(connect, "cam", patience_s=0.15)
    yield reader
    reader.close()
    assert feeds[-1].closed.wait(5)


def test_keeps_the_newest_frame_counts_the_others_and_ends(feeds, reader):
    feeds[0].put(*[frame(k) for k in range(50)])
    drained(feeds[0])
    assert number(reader.read()) == 49  # the last one, not the first
    assert reader.dropped == 49
    feeds[0].put(frame(50), None)
    assert number(reader.read()) == 50
    assert reader.read() is None
    assert feeds[0].closed.wait(5)


def test_times_count_from_the_given_start():
    feed = Feed()
    start_s = time.monotonic() - 10.0
    reader = LiveReader(lambda: feed, start_s=start_s)
    image, taken_s = frame(1)
    feed.put((image, taken_s))
    got = reader.read()
    assert got is not None
    assert got[1] == pytest.approx(taken_s - start_s)
    reader.close()


def test_a_frame_that_is_not_newer_is_dropped(feeds, reader):
    image, taken_s = frame(1)
    feeds[0].put((image, taken_s))
    reader.read()
    feeds[0].put((image, taken_s))
    drained(feeds[0])
    feeds[0].put((image + 1, taken_s + 0.1))
    assert number(reader.read()) == 2


def test_a_stall_is_named_and_the_same_connection_goes_on(feeds, reader):
    with pytest.raises(StalledError, match=r"cam: no new frame for 0\.15 s"):
        reader.read()
    feeds[0].put(frame(3))
    drained(feeds[0])
    assert number(reader.read()) == 3
    assert reader.reconnects == 0


def test_a_lasting_stall_makes_a_new_connection(feeds, reader):
    with pytest.raises(TimeoutError):
        reader.read()
    assert number(reader.read()) == 99
    assert feeds[0].closed.is_set()
    assert reader.reconnects == 1


def test_garbage_is_named_once_and_costs_nothing_else(feeds, reader):
    feeds[0].put(frame(1), GarbageError("torn"), frame(2))
    drained(feeds[0])
    with pytest.raises(GarbageError, match="cam: torn"):
        reader.read()
    assert number(reader.read()) == 2
    feeds[0].put(("text", time.monotonic() + 1))
    with pytest.raises(ValueError, match="cam: text is no image"):
        reader.read()
    feeds[0].put(frame(4))
    assert number(reader.read()) == 4


def test_another_size_is_never_passed_on(feeds, reader):
    feeds[0].put(frame(1))
    reader.read()
    for k in (2, 3):
        feeds[0].put(frame(k, size=8))
        with pytest.raises(SizeChangedError, match="8x8 now and were 4x4"):
            reader.read()
    feeds[0].put(frame(4))
    assert number(reader.read()) == 4


def test_a_vanished_camera_gives_its_last_frame_is_named_and_comes_back(feeds, reader):
    feeds[0].put(frame(1), GoneError("cam: unplugged"))
    drained(feeds[0])
    assert number(reader.read()) == 1
    with pytest.raises(ConnectionError, match="unplugged"):
        reader.read()
    assert number(reader.read()) == 99
    assert len(feeds) == 2


def test_reconnect_tries_until_its_time_is_over():
    tries = []

    def connect():
        tries.append(time.monotonic())
        if 1 < len(tries) < 4:
            raise GoneError("cam: nobody there")
        feed = Feed()
        feed.put(frame(len(tries)))
        return feed

    reader = LiveReader(connect, "cam", patience_s=5.0)
    with pytest.raises(GoneError):
        reader.reconnect(0.0)
    reader.reconnect(5.0)
    assert number(reader.read()) == 4
    assert len(tries) == 4
    reader.close()


def test_a_fault_of_the_feed_itself_reaches_the_reader(feeds, reader):
    feeds[0].put(ZeroDivisionError("inside"))
    with pytest.raises(ZeroDivisionError, match="inside"):
        reader.read()
