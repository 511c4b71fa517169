"""What was found beside what is known: names that contradict it are told, none above its proof."""

import json
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

from calibration.bundle import Draft
from calibration.gap.findings import Findings, Gap, Interval, Named, Where
from calibration.records import BacklashAxis, BacklashRecord, Value
from experiments.gap.beside import (
    AGREES,
    CONTRADICTS,
    DIFFERS,
    NEAR,
    NOT_NAMED,
    NOT_THERE,
    TOO_SMALL,
    beside_rows,
    calibrated_values,
    contradictions,
    found_values,
    true_values,
    truth_lines,
)
from experiments.gap.short_answer import WANTED, advice, details, missing_protocols, verdict
from rig.parameters import Rig
from rig.rigfile import write_rig

GEAR, JOINT, COG = (
    ("gear_backlash", "x", "play_rad"),
    ("joint_backlash", "x", "play_rad"),
    ("cogging", "y", "amplitude_V"),
)
DRY = ("coulomb_friction", "x", "friction_V")


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
    assert beside_rows({}, {}, {DRY: 0.2})[0][0] == "coulomb friction"
    known = {GEAR: Interval(0.0175, 0.017, 0.018)}
    rows = {row[0]: row for row in beside_rows(found, known, {GEAR: 0.0195, JOINT: 0.026})}
    assert rows["gear play"][-2:] == ["1.12 deg", AGREES]
    assert rows["joint play"][-1] == NOT_NAMED
    assert rows["cogging, amplitude"][-2:] == ["none", NOT_THERE]
    near = beside_rows(found_values(named(GEAR, half=0.0001)), known, {GEAR: 0.0215})
    assert near[0][-1] == NEAR
    assert contradictions(near) == ""
    (gear, cog) = beside_rows(found, known, None)
    assert gear[-1] == CONTRADICTS
    assert cog[-1] == ""
    assert "gear play" in contradictions([gear, cog])
    assert contradictions([cog]) == ""


def test_a_shape_that_the_truth_does_not_tell_is_at_its_null_and_means_nothing_without_its_effect():
    settles = ("coulomb_friction", "x", "settling_s")
    found = {DRY: Interval(0.05, 0.04, 0.06), settles: Interval(6e-5, -1.3e-3, 1.4e-3)}
    rows = beside_rows(found, {}, {DRY: 0.052})
    assert [row[-1] for row in rows] == [AGREES, AGREES]
    late = beside_rows(found | {settles: Interval(5e-3, 4e-3, 6e-3)}, {}, {DRY: 0.052})
    assert late[1][-1] == DIFFERS
    assert contradictions(late) == ""  # friction of this size is there: the name holds
    assert [row[-1] for row in beside_rows(found, {}, {GEAR: 0.02})] == [NOT_THERE, "", NOT_NAMED]


def test_a_dead_zone_is_compared_side_by_side_however_it_is_written():
    half, plus, minus = (
        ("dead_zone", "x", f"{k}_V") for k in ("half_width", "positive", "negative")
    )

    def verdicts(found, truth):
        rows = beside_rows(
            {p: Interval(v, v - 0.01, v + 0.01) for p, v in found.items()}, {}, truth
        )
        return {row[0].split(", ")[-1].split()[0]: row[-1] for row in rows}

    assert verdicts({plus: 0.1, minus: 0.3}, {plus: 0.1, minus: 0.3}) == dict.fromkeys(
        ("positive", "negative"), AGREES
    )
    assert set(verdicts({plus: 0.1, minus: 0.3}, {half: 0.1, minus: 0.2}).values()) == {AGREES}
    assert set(verdicts({half: 0.2}, {plus: 0.2, minus: 0.2}).values()) == {AGREES}
    assert verdicts({half: 0.2}, {half: 0.2}) == {"half": AGREES}
    assert list(verdicts({plus: 0.1, minus: 0.4}, {half: 0.2}).values()) == [CONTRADICTS] * 2
    assert list(verdicts({plus: 0.1, minus: 0.4}, {minus: 0.4}).values()) == [CONTRADICTS, AGREES]
    assert set(verdicts({plus: 0.1, minus: 0.4}, {DRY: 0.2}).values()) == {NOT_THERE, NOT_NAMED}


def test_a_phase_is_the_same_a_turn_later():
    phase = ("cogging", "y", "phase_rad")
    found = {COG: Interval(0.1, 0.09, 0.11), phase: Interval(-3.13, -3.2, -3.06)}
    rows = beside_rows(found, {}, {COG: 0.1, phase: 3.12})
    assert [row[-1] for row in rows] == [AGREES, AGREES]


def test_a_calibration_of_another_virtual_table_is_no_measure_of_this_one(tmp_path: Path):
    file, play = tmp_path / "calibration.json", BacklashAxis(width_rad=Value.around(0.02, 0.001))
    made = datetime.now(UTC)
    Draft(made=made, source="simulated", play=BacklashRecord(plays={"gear": {"x": play}})).save(
        file
    )
    found, table = {GEAR: Interval(0.02, 0.019, 0.021)}, tmp_path / "table.toml"
    assert calibrated_values(file, table, {GEAR: 0.02}) == found  # nobody kept of which it is
    write_rig(Rig(effects={"gear_backlash": {"x": {"play_rad": 0.02}}}), table)
    assert calibrated_values(file, table, {GEAR: 0.02}) == calibrated_values(file, table) == found
    assert calibrated_values(file, table, {GEAR: 0.03}) == {}
    assert calibrated_values(tmp_path / "none.json", table, {GEAR: 0.02}) == {}


def test_lines_beside_the_truth_are_in_one_unit_and_say_whether_they_agree(tmp_path):
    truth = {"rig": {"effects": {"joint_backlash": {"x": {"play_rad": 0.0202}}}}}
    (tmp_path / "truth.json").write_text(json.dumps(truth))
    (line,) = truth_lines(named(JOINT), [tmp_path])
    assert line.startswith("joint play x: found 1.15 [")
    assert line.endswith(" deg, truth 1.16 deg: agrees")
    assert truth_lines(named(JOINT), [tmp_path / "measured"]) == []


def test_a_true_value_that_a_well_kept_rig_may_have_is_not_missed():
    friction = ("coulomb_friction", "y", "friction_V")  # tolerance 0.015 V
    for true, said in ((0.0092, TOO_SMALL), (-0.0092, TOO_SMALL), (0.05, NOT_NAMED)):
        (row,) = beside_rows({}, {}, {friction: true})
        assert row[-1] == said
    settles = ("coulomb_friction", "y", "settling_s")  # of which no tolerance is declared
    assert beside_rows({}, {}, {settles: 1e-6})[0][-1] == NOT_NAMED


def test_nothing_is_called_sure_that_the_runs_cannot_show_or_that_contradicts():
    found = named(JOINT)
    assert verdict(found, enough=True) == ["Missing: play in the joints (sure: > 99 %)."]
    more = details(found, logs=2)
    assert any(
        "1 s ahead to 2.0 mm instead of 10 (noise alone would leave 1.9)" in line for line in more
    )
    assert any("errors 4.6 times what noise alone gives" in line for line in more)
    for doubtful in (
        verdict(found, enough=False),
        verdict(found, enough=True, contradiction="This contradicts"),
    ):
        assert doubtful[0].startswith("Suspected, not proven")
        assert not any("sure" in line for line in doubtful)


def test_several_names_are_said_at_once_and_twins_by_themselves():
    found = named(JOINT, GEAR)
    (said,) = verdict(found, enough=True)
    assert said == "Missing: play in the joints, play in the gears (sure: > 99 % each)."
    joint, gear = found.effects
    doubted = replace(gear, probability=0.97, twins=("encoder_zero",))
    said = verdict(replace(found, effects=(joint, doubted)), enough=True)
    assert said[0] == "Missing: play in the joints (> 99 %), play in the gears (97 %)."
    assert said[1] == (
        "What is called play in the gears may be encoder zero: they move a table alike, no run "
        "tells them apart."
    )


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


def test_where_nothing_is_missing_no_extended_model_is_told_of():
    found = Findings("nothing-missing", "Nothing is missing.", gap=Gap(ahead_1s_mm={"before": 1.3}))
    assert not [line for line in details(found, logs=1) if "extended model" in line]
