"""Sizes by log: one size serves all logs of a table; a table that changed between them is told."""

from functools import cache

import pytest

from calibration.gap.agreement import _agree, sentences, sizes_by_log
from calibration.gap.findings import Interval, Named, SizeByLog
from calibration.gap.model.parameters import PERIODIC
from calibration.gap.model.state import refit
from tests.support.gap.tables import evidence_of, foreign, released

NAME = "joint_backlash"


@cache
def told(*plays_rad: float) -> tuple[SizeByLog, ...]:
    """What runs of the foreign table with these joint plays in x say alone."""
    logs = [
        foreign("steps", seed=i, effects={NAME: {"x": {"play_rad": play}}}, duration_s=12.0)
        for i, play in enumerate(plays_rad, 1)
    ]
    evidence = evidence_of(*logs)
    state = released(evidence, (NAME, "x"))
    for output in evidence.outputs:
        state = refit(state, state.bounds((output,)))
    size = Interval(0.03, 0.02, 0.04)
    return sizes_by_log(state, [Named(NAME, 1.0, (), {"x": {"play_rad": size}})])


def test_each_log_gives_its_own_size():
    (one,) = told(0.03, 0.03)
    assert (one.name, one.axis, one.key) == (NAME, "x", "play_rad")
    assert [size.value for size in one.sizes if size] == pytest.approx([0.03, 0.03], abs=0.004)
    assert one.agree
    (said,) = sentences([one], ())
    assert said.startswith("the logs agree: joint_backlash: x play is 1.")
    assert said.endswith("in log 2")


def test_a_table_that_changed_between_two_logs_is_told_with_both_sizes():
    found = told(0.02, 0.05)
    sizes = [size.value for size in found[0].sizes if size]
    assert sizes == pytest.approx([0.02, 0.05], abs=0.005)
    (said,) = sentences(found, ("monday.csv", "friday.csv"))
    assert said.startswith("the logs disagree: joint_backlash: x play is ")
    assert "deg in monday.csv, " in said
    assert said.endswith("in friday.csv")


def test_one_log_has_nobody_to_agree_with():
    assert told(0.03) == ()


def test_a_size_that_one_log_alone_tells_is_no_agreement():
    one = SizeByLog(NAME, "x", "play_rad", (Interval(0.03, 0.02, 0.04), None), agree=True)
    assert sentences([one], ()) == ()


def test_a_size_that_differs_by_no_more_than_a_healthy_tables_is_one_size():
    narrow = tuple(Interval(v, v - 1e-5, v + 1e-5) for v in (0.03, 0.031))
    assert _agree(narrow, tolerance=0.0014)
    assert not _agree(narrow, tolerance=0.0)
    assert not _agree(narrow, tolerance=0.0001)


@pytest.mark.parametrize("name", PERIODIC)
def test_an_amplitude_is_compared_like_any_other_size(name: str):
    """It is fitted as a sine and a cosine, and told under the catalogue's key."""
    logs = [foreign("steps", seed=i, effects={}, duration_s=8.0) for i in (1, 2)]
    state = released(evidence_of(*logs), (name, "x"))
    named = Named(name, 1.0, (), {"x": {PERIODIC[name]: Interval(0.1, 0.0, 0.2)}})
    (one,) = sizes_by_log(state, [named])
    assert (one.name, one.axis, one.key) == (name, "x", PERIODIC[name])
    assert len(one.sizes) == 2
