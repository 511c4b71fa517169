"""The ring: every record once and in order, or counted as lost; a writer that never waits."""

import multiprocessing
import pickle
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rig.shared_memory import SharedArray, SharedRing

ROW = np.dtype((np.float64, (3,)))


@settings(deadline=None, max_examples=60)
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
