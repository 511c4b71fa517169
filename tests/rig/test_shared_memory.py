"""The ring: every record once and in order, or counted as lost; a writer that never waits."""

import copy
import errno
import multiprocessing
import os
import pickle
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rig.shared_memory import SharedArray, SharedRing, encoded

ROW = np.dtype((np.float64, (3,)))


@settings(max_examples=60)
@given(st.lists(st.integers(0, 12), max_size=12), st.integers(2, 8))
def test_each_record_is_read_once_in_order_or_counted_as_lost(bursts: list[int], slots: int):
    ring = SharedRing(ROW, slots)
    try:
        sent, got = 0, []
        for burst in bursts:
            for _ in range(burst):
                ring.write((sent, sent + 0.25, -sent))
                sent += 1
            assert ring.news == (burst > 0)
            rows = ring.read()
            assert len(rows) == min(burst, slots - 1)  # the writer's own slot is not read
            got += [int(row[0]) for row in rows]
            np.testing.assert_array_equal(rows[:, 1], rows[:, 0] + 0.25)
            assert not ring.news
        assert got == sorted(set(got))
        assert len(got) + ring.lost == sent
    finally:
        ring.close()


class WeakMemory:
    """What another processor sees of an array: words of 8 bytes, stored in any order.

    Only stores to one and the same word keep their order, as on every processor that is built.
    """

    def __init__(self, array: np.ndarray) -> None:
        self.real, self.seen = array, array.copy()
        self._before = self._words(array).copy()
        self._waiting: dict[int, list[int]] = {}

    @staticmethod
    def _words(array: np.ndarray) -> np.ndarray:
        return array.view(np.int64).reshape(-1)

    def stored(self) -> None:
        """Take note of the words that were stored since the last call."""
        now = self._words(self.real)
        for place in np.flatnonzero(now != self._before):
            self._waiting.setdefault(int(place), []).append(int(now[place]))
        self._before = now.copy()

    def deliver(self, rng: np.random.Generator, share: float) -> None:
        """Make a random share of the waiting words visible."""
        words = self._words(self.seen)
        for place in list(self._waiting):
            while self._waiting.get(place) and rng.random() < share:
                words[place] = self._waiting[place].pop(0)
            if not self._waiting[place]:
                del self._waiting[place]


@pytest.mark.parametrize("seed", range(20))
def test_whole_records_in_order_though_stores_are_seen_in_any_order(seed: int):
    rng, ring, slots = np.random.default_rng(seed), SharedRing(ROW, 8), 8
    records, written = WeakMemory(ring._records.array), WeakMemory(ring._written.array)
    reader = copy.copy(ring)
    reader._records = SimpleNamespace(array=records.seen)  # type: ignore[assignment]
    reader._written = SimpleNamespace(array=written.seen)  # type: ignore[assignment]
    got, sent = [], 0
    try:
        for _ in range(400):
            if rng.random() < 0.6:
                ring.write(np.full(3, float(sent)))
                sent += 1
            for memory in (records, written):
                memory.stored()
                memory.deliver(rng, rng.random())
            got += list(reader.read()) if rng.random() < 0.5 else []
        for memory in (records, written):
            memory.deliver(rng, 1.0)
        got += list(reader.read())
    finally:
        ring.close()
    rows = np.array(got)
    assert np.all(rows == rows[:, :1])
    assert np.all(np.diff(rows[:, 0]) > 0)
    assert len(rows) + reader.lost == sent
    assert len(rows) > slots


def shared() -> set[Path]:
    folder = Path("/dev/shm")
    return set(folder.iterdir()) if folder.is_dir() else set()


@pytest.mark.skipif(not hasattr(os, "posix_fallocate"), reason="the system cannot take it at once")
def test_memory_that_is_full_is_one_line_and_nothing_is_left(monkeypatch):
    def full(file: int, offset: int, size: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.posix_fallocate", full, raising=False)
    before = shared()
    with pytest.raises(OSError, match=r"no room for 8000 bytes .*enlarge /dev/shm") as caught:
        SharedArray((1000,), np.dtype(np.float64))
    assert caught.value.errno == errno.ENOSPC
    assert shared() <= before


def _write(ring: SharedRing, count: int) -> None:
    for k in range(count):
        ring.write(np.full(3, float(k)))
        if k % 64 == 0:
            time.sleep(0.0005)
    ring.close()


def test_another_process_writes_while_this_one_reads():
    """No record is torn, whatever the reader's pace: its three numbers were written together."""
    ring, count = SharedRing(ROW, 64), 100_000  # a busy machine gives the reader few turns
    process = multiprocessing.get_context("spawn").Process(target=_write, args=(ring, count))
    process.start()
    got = [ring.read()]
    while process.is_alive() or ring.news:
        rows = ring.read()
        got.append(rows)
        if len(got) % 50 == 0:
            time.sleep(0.01)  # a slow reader
    process.join()
    rows = np.concatenate(got)
    assert np.all(rows == rows[:, :1])
    assert np.all(np.diff(rows[:, 0]) > 0)
    assert len(rows) + ring.lost == count
    assert len(rows) > 1000
    ring.close()


def test_an_array_is_the_same_memory_where_it_is_unpickled():
    one = SharedArray((2,), np.dtype(np.int64))
    other = pickle.loads(pickle.dumps(one))
    other.array[1] = 7
    assert one.array.tolist() == [0, 7]
    other.close()
    assert one.array.tolist() == [0, 7]  # who did not make it does not free it
    name = one._memory.name
    one.close()
    with pytest.raises(FileNotFoundError):
        SharedArray((2,), np.dtype(np.int64), name)


@given(text=st.text(st.characters()), size=st.integers(0, 40))
def test_any_text_becomes_as_much_utf_8_as_has_room(text: str, size: int):
    """Also names of files that are no UTF-8, which Python holds as lone surrogates."""
    readable = "".join("?" if "\ud800" <= one <= "\udfff" else one for one in text)
    told = encoded(text, size).decode()
    assert readable.startswith(told)
    rest = readable[len(told) : len(told) + 1]
    assert size - 4 < len(told.encode()) <= size or told == readable
    assert not rest or len((told + rest).encode()) > size
