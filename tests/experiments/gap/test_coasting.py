"""Play in gears behind which little friction brakes the arm: it coasts through the gap."""

from dataclasses import replace
from pathlib import Path

import pytest

from calibration.gap.investigation import investigate, levels_of, usable_runs
from calibration.gap.model.data import gather
from calibration.gap.model.parameters import NominalModel
from calibration.gap.name.load_friction import choose_friction_model
from calibration.gap.name.screen import screen
from calibration.gap.name.stepwise import settled_baseline
from experiments.runs.protocol import Protocol, read_protocol
from experiments.runs.runner import RunRequest, simulate_run
from rig.log import Log
from rig.parameters import Drive, Rig

LIGHT_NM, PLAY_RAD = 1.5e-3, 0.02


DRIVE = Drive(arm_friction_nm=LIGHT_NM, joint_friction_nm=0.0)
BELIEVED = replace(Rig(), drive=replace(DRIVE, arm_friction_nm=0.0))


def recorded(protocol: Protocol) -> Log:
    hidden = {"gear_backlash": {"x": {"play_rad": PLAY_RAD}}}
    plant = replace(Rig(), drive=DRIVE, effects=hidden)
    return simulate_run(RunRequest(plant, protocol, "without", 4, Path(), kind=Rig())).log


def test_it_is_the_first_guess_of_a_short_log():
    log = recorded(read_protocol("steps").model_copy(update={"duration_s": 12.0}))
    evidence = gather(usable_runs([log], BELIEVED), levels_of(BELIEVED))
    before = settled_baseline(evidence, NominalModel(BELIEVED, load_friction=False))
    first = max(screen(before, ("servo_x",)), key=lambda one: one.worth)
    assert (first.name, first.axis) == ("gear_backlash", "x")
    assert first.start["gear_backlash.play_rad.x"] == pytest.approx(PLAY_RAD, rel=0.15)
    assert first.start["gear_backlash.coast_s2_rad.x"] > 0.0


@pytest.mark.parametrize("play_rad", [0.0, 1.5e-4, 3.3e-4])
def test_a_gap_below_a_count_is_no_delay(play_rad: float):
    """Held in it, the arm would look 1 ms late and its motor 5 % too fast."""
    plan = read_protocol("steps").model_copy(update={"duration_s": 12.0})
    hidden = {"gear_backlash": {axis: {"play_rad": play_rad} for axis in "xy"}}
    plant = replace(BELIEVED, effects=hidden)
    log = simulate_run(RunRequest(plant, plan, "without", 5, Path(), kind=Rig())).log
    evidence = gather(usable_runs([log], BELIEVED), levels_of(BELIEVED))
    setting = settled_baseline(evidence, choose_friction_model(evidence, BELIEVED, {})).fit.setting
    for axis in "xy":
        assert setting[f"input_delay.delay_s.{axis}"] < 6e-4
        assert setting[f".time_constant_s.{axis}"] == pytest.approx(0.025, rel=0.035)


@pytest.mark.slow
@pytest.mark.parametrize("limit_V", [0.15, 0.25])
def test_volts_cut_far_below_the_largest_are_named(limit_V: float):
    """A twentieth of what the controller asks for: K alone would come out at a tenth."""
    plant = replace(BELIEVED, effects={"saturation": {"x": {"limit_V": limit_V}}})
    run = RunRequest(plant, read_protocol("steps"), "without", 5, Path(), kind=Rig())
    found = investigate([simulate_run(run).log], BELIEVED, quick=True).findings
    assert [effect.name for effect in found.effects] == ["saturation"], found.sentence
    size = found.effects[0].parameters["x"]["limit_V"].value
    assert size == pytest.approx(limit_V, rel=0.05)


@pytest.mark.slow
def test_it_is_named_and_the_friction_that_brakes_the_arm_goes_into_the_model():
    found = investigate([recorded(read_protocol("steps"))], BELIEVED, quick=True).findings
    assert [effect.name for effect in found.effects] == ["gear_backlash"], found.sentence
    (axis, pairs), *others = found.effects[0].parameters.items()
    assert (axis, others) == ("x", [])
    assert pairs["play_rad"].value == pytest.approx(PLAY_RAD, abs=0.0015)
    assert found.rig_after is not None
    assert found.rig_after.drive.arm_friction_nm == pytest.approx(LIGHT_NM, rel=0.5)
    assert found.rig_after.drive.joint_friction_nm == 0.0
