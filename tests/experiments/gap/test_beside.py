"""What was found beside what is known: names that contradict it are told, none above its proof."""

import json

from calibration.gap.findings import Findings, Gap, Interval, Named, Where
from experiments.gap.beside import (
    AGREES,
    CONTRADICTS,
    NOT_NAMED,
    NOT_THERE,
    beside_rows,
    contradictions,
    found_values,
    true_values,
)
from experiments.gap.short_answer import WANTED, advice, missing_protocols, short_answer

GEAR, JOINT, COG = (
    ("gear_backlash", "x", "play_rad"),
    ("joint_backlash", "x", "play_rad"),
    ("cogging", "y", "amplitude_V"),
)


def named(*places, value=0.02, half=0.001):
    """Findings that name these parameters, with this interval."""
    effects = tuple(
        Named(name, 0.995, (), {axis: {key: Interval(value, value - half, value + half)}})
        for name, axis, key in places
    )
    ahead = {"before": 9.96, "after": 1.96, "floor": 1.92}
    where = (Where("ball_x", "after the x servo reverses", 4.58),)
    return Findings("named", "The model lacks it", where, effects, gap=Gap(ahead_1s_mm=ahead))


def test_each_parameter_is_judged_by_the_truth_and_else_by_the_calibration():
    found = found_values(named(GEAR, COG))
    known = {GEAR: Interval(0.0175, 0.017, 0.018)}
    rows = {row[0]: row for row in beside_rows(found, known, {GEAR: 0.0195, JOINT: 0.026})}
    assert rows["gear backlash, play"][-2:] == ["1.12 deg", AGREES]
    assert rows["joint backlash, play"][-1] == NOT_NAMED
    assert rows["cogging, amplitude"][-2:] == ["none", NOT_THERE]
    (gear, cog) = beside_rows(found, known, None)
    assert gear[-1] == CONTRADICTS
    assert cog[-1] == ""
    assert "gear backlash" in contradictions([gear, cog])
    assert contradictions([cog]) == ""


def test_nothing_is_called_sure_that_the_runs_cannot_show_or_that_contradicts():
    found = named(JOINT)
    sure = short_answer(found, enough=True)
    assert sure[0].startswith("Missing: play in the joints (x play 1.15 [1.09, 1.20] deg)")
    assert "sure: > 99 %" in sure[0]
    assert any("1 s ahead to 2 mm instead of 10 (best possible: 1.9)" in line for line in sure)
    assert any("errors 4.6 times what noise alone gives" in line for line in sure)
    for doubtful in (
        short_answer(found, enough=False),
        short_answer(found, enough=True, contradiction="This contradicts"),
    ):
        assert doubtful[0].startswith("Suspected, not proven")
        assert not any("sure" in line for line in doubtful)


def test_runs_that_are_missing_are_named_with_their_length():
    assert missing_protocols(WANTED) == []
    assert advice(WANTED) == ""
    assert "run steps and servo-squares first, 45 s" in advice(["free-release", "free-release"])
    assert "run servo-squares first, 15 s" in advice(["steps"])


def test_the_truth_is_that_of_one_table_or_none(tmp_path):
    def table(name, play):
        folder = tmp_path / name
        folder.mkdir()
        effects = {"gear_backlash": {"x": {"play_rad": play}}, "no_such_effect": {"x": {"a": 1.0}}}
        (folder / "truth.json").write_text(json.dumps({"rig": {"effects": effects}}))
        return folder

    one, same, other = table("a", 0.01), table("b", 0.01), table("c", 0.02)
    assert true_values([one, same]) == {GEAR: 0.01}
    assert true_values([one, other]) is None
    assert true_values([one, tmp_path / "measured"]) is None
