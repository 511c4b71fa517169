"""Play in gears behind which little friction brakes the arm: it coasts through the gap."""

from dataclasses import replace
from pathlib import Path

import pytest

from calibration.gap.investigation import investigate
from experiments.runs.protocol import read_protocol
from experiments.runs.runner import RunRequest, simulate_run
from rig.parameters import Drive, Rig

LIGHT_NM, PLAY_RAD = 1.5e-3, 0.02


@pytest.mark.slow
def test_it_is_named_and_the_friction_that_brakes_the_arm_goes_into_the_model():
    drive = Drive(arm_friction_nm=LIGHT_NM, joint_friction_nm=0.0)
    hidden = {"gear_backlash": {"x": {"play_rad": PLAY_RAD}}}
    plant = replace(Rig(), drive=drive, effects=hidden)
    order = RunRequest(plant, read_protocol("steps"), "without", 4, Path(), kind=Rig())
    believed = replace(Rig(), drive=replace(drive, arm_friction_nm=0.0))
    found = investigate([simulate_run(order).log], believed, quick=True).findings
    assert [effect.name for effect in found.effects] == ["gear_backlash"], found.sentence
    (axis, pairs), *others = found.effects[0].parameters.items()
    assert (axis, others) == ("x", [])
    assert pairs["play_rad"].value == pytest.approx(PLAY_RAD, abs=0.0015)
    assert found.rig_after is not None
    assert found.rig_after.drive.arm_friction_nm == pytest.approx(LIGHT_NM, rel=0.5)
    assert found.rig_after.drive.joint_friction_nm == 0.0
