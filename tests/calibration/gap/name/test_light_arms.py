"""Gear backlash whose arm stays where the teeth leave it, in a rig file without friction; and whose
arm coasts, in an engine of its own."""

from dataclasses import replace

import pytest

from calibration.gap.model.parameters import COAST_KEY, NominalModel
from calibration.gap.model.state import State
from calibration.gap.name.load_friction import _cost_with_same, friction_models
from calibration.gap.name.refit import rank
from calibration.gap.name.screen import screen
from calibration.gap.name.stepwise import name_effects, settled_baseline
from rig.log import Log
from rig.parameters import Drive
from tests.support.gap.tables import RIG, evidence_of, foreign

LIGHT = replace(RIG, drive=Drive(arm_friction_nm=0.0, joint_friction_nm=0.0))
PLAY_RAD = 0.035


def named(hidden: dict) -> State:
    """The best candidate beside arms that coast, on the servo of x."""
    log = foreign("steps", seed=8, effects=hidden, duration_s=15.0)
    nominal = NominalModel(LIGHT, load_friction=False)
    state = settled_baseline(evidence_of(log, rig=LIGHT), nominal)
    found = rank(state, screen(state, ["servo_x"]))[0]
    assert found.name == "gear_backlash"
    return found.state


@pytest.fixture(scope="module")
def held() -> State:
    return named({"gear_backlash": {"x": {"play_rad": PLAY_RAD}}})


def test_an_arm_that_stays_is_found_beside_a_model_of_arms_that_coast(held: State):
    """From an arm that coasts the fit ended beside it, with a time constant 20 % too long."""
    setting, servo = held.fit.setting, LIGHT.servo
    assert setting[f"gear_backlash.{COAST_KEY}.x"] == 0.0
    assert setting["gear_backlash.play_rad.x"] == pytest.approx(PLAY_RAD, rel=0.08)
    assert setting[".gain_rad_s_V.x"] == pytest.approx(servo.gain_rad_s_V, rel=0.05)
    assert setting[".time_constant_s.x"] == pytest.approx(servo.time_constant_s, rel=0.06)


def test_the_other_friction_model_has_its_own_way_for_arms(held: State):
    """How far an arm coasts in the one says nothing of the other."""
    key, other = f"gear_backlash.{COAST_KEY}.x", friction_models(LIGHT)[1]
    braked = replace(held, fit=replace(held.fit, setting=held.fit.setting | {key: 0.06}))
    costs = [_cost_with_same(state, other, ("servo_x",)) for state in (held, braked)]
    assert costs[0] == costs[1]


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2801, 2811])
def test_an_arm_that_coasts_in_mujoco_is_a_play_alone(seed: int):
    """The noise estimated beside the play lets its cost rise: other names were weighed against that
    and let in, a saturation first; of another seed the play was found 46 % too large."""
    pytest.importorskip("mujoco")
    from tests.support.worlds.default_mujoco import mujoco_gears

    nominal = NominalModel(LIGHT, load_friction=False)
    evidence = evidence_of(Log.from_columns(mujoco_gears(seed)[0]), rig=LIGHT)
    evidence = replace(evidence, masks={"servo_x": evidence.masks["servo_x"]})
    found = name_effects(settled_baseline(evidence, nominal))
    assert found.after.named == (("gear_backlash", "x"),)
    setting = found.after.fit.setting
    assert setting["gear_backlash.play_rad.x"] == pytest.approx(0.03, rel=0.15)
    assert setting[".gain_rad_s_V.x"] == pytest.approx(1.53, rel=0.05)
