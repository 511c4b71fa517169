"""`rig gap` with a lab's own effects, on logs of a plant that shares no code with the product."""

import pickle
from pathlib import Path

import numpy as np
import pytest

from calibration.gap import investigate
from calibration.gap.findings import Findings
from calibration.gap.model.parameters import NominalModel, released
from calibration.gap.name.candidates import own_starts
from rig.effects import BY_NAME
from rig.log import Log
from rig.parameters import Drive, Rig
from rig.plant.plant_record import pack
from rig.rigfile import read_rig, write_rig
from tests.support.gap.own_effects import example
from tests.support.worlds import WORLDS

BARE = Drive(arm_friction_nm=0.0, joint_friction_nm=0.0)
OWN = (example("hanging_arm"), example("pulling_cable"))


def test_the_nominal_model_knows_them_beside_the_catalogue():
    nominal = NominalModel(Rig(drive=BARE, own=OWN), load_friction=False)
    assert [e.name for e in nominal.effects[-2:]] == ["hanging_arm", "pulling_cable"]
    first, angle = nominal.of("hanging_arm", "x")
    assert (first.tolerance, first.outputs, first.range) == (0.0, ("servo_x",), (-2.0, 2.0))
    assert (angle.tolerance, angle.range) == (0.0, (-1.5, 1.5))
    assert released(nominal.catalogue["hanging_arm"], "x", nominal, {}) == [first, angle]
    assert not nominal.exceeds_minimum("hanging_arm", "x", {first.name: 0.023})
    assert nominal.exceeds_minimum("hanging_arm", "x", {first.name: -0.025})
    told = Rig(drive=BARE, own=OWN, effects={"hanging_arm": {"x": {"weight_V": 0.4}}})
    known = NominalModel(told, load_friction=False).of("hanging_arm", "x")[0]
    assert known.box == pytest.approx((0.38, 0.42))


def test_a_setting_is_the_rig_file_with_the_same_numbers():
    nominal = NominalModel(Rig(drive=BARE, own=OWN), load_friction=False)
    setting = {"pulling_cable.stiffness_V_rad.y": 3.0, "pulling_cable.slack_rad.y": -0.1}
    effects = {"pulling_cable": {"y": {"stiffness_V_rad": 3.0, "slack_rad": -0.1}}}
    written = pack(Rig(drive=BARE, own=OWN, effects=effects))["own"]
    assert nominal.model(setting).record["own"] == written
    assert nominal.model({}).record["own"] != written


def test_it_is_tried_all_over_its_range():
    nominal = NominalModel(Rig(own=OWN), load_friction=False)
    tried = [start for group in own_starts(OWN[1].effect, "x", nominal) for start in group]
    slack = sorted({start["pulling_cable.slack_rad.x"] for start in tried})
    assert -0.5 < slack[0] < -0.4
    assert 0.4 < slack[-1] < 0.5
    assert np.diff(slack).max() < 0.2
    assert {start["pulling_cable.stiffness_V_rad.x"] for start in tried} == {1.0, 6.0}


def test_models_with_addresses_of_this_process_stay_in_it():
    nominal = NominalModel(Rig(own=OWN), load_friction=False)
    for model in (nominal, nominal.model({})):
        with pytest.raises(TypeError, match="stays in its process"):
            pickle.dumps(model)


def asked(name: str, seed: int, own: tuple) -> Findings:
    """What is found in a world whose rig file names effects of one's own."""
    columns, _, _ = WORLDS[name](seed)
    rig = Rig(drive=BARE, own=own)
    return investigate([Log.from_columns(columns)], rig, quick=True).findings


SHOWN = {
    "pendulum": ("hanging_arm", {"weight_V": 0.5, "angle_rad": 0.0}),
    "cable": ("pulling_cable", {"stiffness_V_rad": 3.0, "slack_rad": 0.1}),
}


@pytest.mark.slow
@pytest.mark.parametrize("world", SHOWN)
def test_what_was_unknown_is_named_with_its_size(world: str, tmp_path: Path):
    name, truth = SHOWN[world]
    found = asked(world, 3000, OWN)
    assert (found.verdict, [one.name for one in found.effects]) == ("named", [name])
    for key, value in truth.items():
        interval = found.effects[0].parameters["x"][key]
        assert interval.low <= value <= interval.high
    assert found.rig_after is not None
    assert name in found.sentence
    write_rig(found.rig_after, tmp_path / "rig.toml")
    again = read_rig(tmp_path / "rig.toml")
    assert set(again.effects[name]["x"]) == set(truth)


@pytest.mark.slow
@pytest.mark.parametrize("world", SHOWN)
def test_without_the_file_no_name_of_the_catalogue_stands_in_for_it(world: str):
    found = asked(world, 3000, ())
    sure = [one.name for one in found.effects if one.probability > 0.9]
    assert found.verdict != "named" or not sure
    assert not set(sure) - set(BY_NAME)


@pytest.mark.slow
def test_on_a_healthy_axis_no_file_is_named():
    found = asked("healthy_axis", 3000, OWN)
    assert not {one.name for one in found.effects} & {"hanging_arm", "pulling_cable"}
