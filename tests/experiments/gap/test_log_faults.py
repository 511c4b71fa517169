"""Spoiled logs get an answer or one line: a sample of tests/benchmarks/gap/log_faults.py."""

import pytest

from tests.benchmarks.gap.log_faults import ask


@pytest.mark.parametrize("number", [0, 1, 2])
def test_a_spoiled_log_gets_an_answer_or_one_line(number: int):
    found = ask(number, seed=1)
    assert not found.bad, found


@pytest.mark.slow
@pytest.mark.parametrize("first", range(0, 120, 20))
def test_no_spoiled_log_is_answered_by_a_traceback_or_by_words_of_arrays(first: int):
    asked = [ask(number, seed=3) for number in range(first, first + 20)]
    assert not [found for found in asked if found.bad]


@pytest.mark.slow
def test_a_log_with_one_gap_of_more_than_half_of_it_gets_an_answer():
    found = ask(37, seed=1)
    assert found.outcome == "answered"
    assert not found.bad, found
