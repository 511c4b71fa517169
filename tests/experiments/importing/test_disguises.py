"""Any unit, sign, name and order of a recorded table is found, or asked; never silently wrong."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from experiments.importing.conversion import convert
from experiments.importing.import_map import with_answers
from experiments.importing.proposal import Proposal, propose
from experiments.importing.recording import Stream
from tests.support.other_labs.disguise import Disguise, disguised

MOST_QUESTIONS = 20


def imported(lab: Disguise) -> tuple[Proposal, int]:
    """The proposal after a person who knows the lab has answered, and how often they were asked."""
    stream, said = Stream(lab.columns), {}
    for asked in range(MOST_QUESTIONS):
        found = propose(stream, said)
        if not found.doubts:
            return found, asked
        doubt = found.doubts[0]
        answer = lab.answer(doubt.place, doubt.key, dict(found.draft["signals"]))
        said = with_answers(said, f"{doubt.place}.{doubt.key}={answer}")
    raise AssertionError(f"more than {MOST_QUESTIONS} questions")


@settings(max_examples=3, derandomize=True)
@given(seed=st.integers(0, 2**31), number=st.sampled_from((7, 8)))
def test_found_or_asked(seed: int, number: int):
    lab = disguised(np.random.default_rng(seed), number)
    found, _ = imported(lab)
    log = convert(Stream(lab.columns), found.map())[0]
    assert lab.truth.faults(log) == []


@pytest.mark.slow
@settings(max_examples=150, derandomize=True)
@given(seed=st.integers(0, 2**31), habits=st.booleans(), named=st.sampled_from((0.6, 1.0)))
def test_found_or_asked_on_every_bench(seed: int, habits: bool, named: float):
    lab = disguised(np.random.default_rng(seed), habits=habits, named=named)
    found, _ = imported(lab)
    log = convert(Stream(lab.columns), found.map())[0]
    assert lab.truth.faults(log) == []


def test_named_units_and_kinds_leave_nothing_to_ask():
    names = {
        "ball": "ball {} [mm]",
        "command": "servo command {} [deg]",
        "theta": "encoder {} [deg]",
    }
    sizes = {"ball": 0.001, "command": np.pi / 180, "theta": np.pi / 180}
    rng = np.random.default_rng(5)
    for _ in range(4):
        lab = disguised(rng, 8)
        columns = {"time [s]": lab.truth.axes[0].t}
        for log_name, keys in lab.keys.items():
            kind, axis = log_name.split("_")[:2]
            si = keys["scale"] * (lab.columns[keys["column"]] - keys["offset"])
            columns[names[kind].format(axis)] = si / sizes[kind]
        found = propose(Stream(columns))
        assert found.doubts == ()
        assert lab.truth.faults(convert(Stream(columns), found.map())[0]) == []


def test_whose_angle_is_whose_is_asked_where_nothing_follows_either():
    """A short run that lost its ball; what is called X tilts y. The names decided once."""
    lab = disguised(np.random.default_rng(82146854), habits=True, named=0.6)
    said = {"angle": {"kind": "measured"}}
    asked = [d for d in propose(Stream(lab.columns), said).doubts if d.key == "column"]
    assert [d.place for d in asked] == ["theta_x_rad"]
    assert set(asked[0].options) == {"Winkel X_us", "Winkel Y_us"}
    found, _ = imported(lab)
    assert lab.truth.faults(convert(Stream(lab.columns), found.map())[0]) == []


def test_a_level_is_where_the_ball_rests_while_the_other_axis_is_level():
    """An offset of the other axis, in counts, once moved the level of this one."""
    lab = disguised(np.random.default_rng(32), habits=True, named=1.0)
    found, _ = imported(lab)
    log = convert(Stream(lab.columns), found.map())[0]
    assert lab.truth.faults(log) == []


@pytest.mark.parametrize("seed", [2, 67])
def test_a_zero_for_no_ball_is_seen_beside_a_ball_near_the_centre(seed: int):
    lab = disguised(np.random.default_rng(seed), habits=True, named=1.0)
    found, _ = imported(lab)
    assert found.draft["signals"]["ball_x_m"]["absent"] == (0.0,)
