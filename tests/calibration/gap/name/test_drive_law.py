"""The law of a drive as a second start: friction, offset and play that act together."""

from pathlib import Path

import numpy as np
import pytest

from calibration.gap import investigate
from calibration.gap.name.drive_law import LAW, begun_with_law
from calibration.gap.name.stepwise import name_effects, settled_baseline
from rig.log import Log
from rig.rigfile import read_rig
from tests.support.gap.tables import evidence_of, foreign, released
from tests.support.worlds import WORLDS

HIDDEN = {
    "gear_backlash": {"x": {"play_rad": 0.03}},
    "coulomb_friction": {"x": {"friction_V": 0.08}},
    "voltage_offset": {"x": {"offset_V": -0.13}},
}
TRUE = {f"{name}.{key}.x": v for name, by in HIDDEN.items() for key, v in by["x"].items()}


@pytest.fixture(scope="module")
def evidence():
    return evidence_of(foreign("steps", seed=4, effects=HIDDEN, duration_s=12.0))


def test_what_acts_together_is_found_in_the_place_of_two_names(evidence):
    starts = begun_with_law(released(evidence, ("dead_zone", "x"), ("gain_asymmetry", "x")))
    best = min(starts, key=lambda one: one.fit.costs["servo_x"])
    assert {(name, "x") for name in LAW} <= set(best.named)
    assert not {name for name, _ in best.named} & {"dead_zone", "gain_asymmetry"}
    for key, size in TRUE.items():
        assert best.fit.setting[key] == pytest.approx(size, rel=0.12), key


def test_names_of_the_ball_and_servos_without_a_name_are_left_alone(evidence):
    state = released(evidence, ("dead_zone", "x"), ("cogging", "x"), ("level_offset", "y"))
    for start in begun_with_law(state):
        assert ("level_offset", "y") in start.named
        assert {name for name, axis in start.named if axis == "y"} <= {"level_offset"}


def test_a_part_of_the_law_that_is_not_there_is_dropped():
    log = foreign(
        "steps", seed=5, effects={"voltage_offset": HIDDEN["voltage_offset"]}, duration_s=8.0
    )
    state = released(evidence_of(log), ("dead_zone", "x"), ("gain_asymmetry", "x"))
    best = min(begun_with_law(state), key=lambda one: one.fit.costs["servo_x"])
    assert best.named == (("voltage_offset", "x"),)


@pytest.mark.parametrize(
    "named", [(), (("dead_zone", "x"),), (("dead_zone", "x"), ("dead_zone", "y"))]
)
def test_one_name_a_servo_is_no_reason(evidence, named):
    assert begun_with_law(released(evidence, *named)) == []


def test_a_law_of_which_a_part_is_barred_is_not_tried(evidence):
    state = released(evidence, ("dead_zone", "x"), ("gain_asymmetry", "x"))
    assert begun_with_law(state, [("voltage_offset", "x")]) == []


@pytest.mark.slow
def test_selection_ends_with_the_law_and_nothing_else(evidence):
    found = name_effects(settled_baseline(evidence, released(evidence).nominal))
    assert {one.name for one in found.accepted} == set(HIDDEN)
    assert np.all([one.axes == ("x",) for one in found.accepted])


@pytest.mark.slow
def test_friction_that_settles_is_no_dead_zone_beside_half_of_it(tmp_path: Path):
    """Another engine's dry friction of 0.4 V settles within 10 ms. A dead zone gains most alone."""
    pytest.importorskip("mujoco", reason="uv sync --extra benchmark")
    columns, rig, _ = WORLDS["mujoco_friction_of_one_axis"](2700)
    (tmp_path / "rig.toml").write_text(rig, "utf-8")
    log = Log.from_columns(columns)
    found = investigate([log], read_rig(tmp_path / "rig.toml"), until="name", quick=True).findings
    sizes = {one.name: one.parameters for one in found.effects}
    assert set(sizes) <= {"coulomb_friction", "camera_scale"}
    assert set(sizes["coulomb_friction"]) == {"y"}
    assert sizes["coulomb_friction"]["y"]["friction_V"].value == pytest.approx(0.4, abs=0.01)
