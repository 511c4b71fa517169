"""Calls on several threads: the results of one, whatever calls what."""

import threading

import pytest

from calibration.gap.model.side_by_side import side_by_side


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_the_results_are_those_of_one_thread_in_their_order(threads: int):
    assert side_by_side(lambda x: x * x, iter(range(50)), threads) == [x * x for x in range(50)]
    assert side_by_side(str, [], threads) == []


@pytest.mark.parametrize("threads", [2, 3])
def test_a_call_may_call_in_its_turn(threads: int):
    def sums(depth: int) -> int:
        return sum(side_by_side(sums, [depth - 1] * 3, threads)) if depth else 1

    assert sums(5) == 3**5


def test_two_calls_are_under_way_at_once():
    meeting = threading.Barrier(2, timeout=60.0)
    assert sorted(side_by_side(lambda _: meeting.wait(), range(2), 2)) == [0, 1]


def test_an_exception_is_raised_and_what_has_not_begun_is_left():
    called = []

    def call(x: int) -> None:
        called.append(x)
        raise ValueError(x)

    with pytest.raises(ValueError, match=r"^[01]$"):
        side_by_side(call, range(1000), 2)
    assert len(called) <= 2
