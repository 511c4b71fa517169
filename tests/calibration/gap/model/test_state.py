"""A state of the search: what is told of names does not hold an unnamed term."""

from dataclasses import replace

import numpy as np

from calibration.gap.model.fit import evaluate
from calibration.gap.model.parameters import NominalModel
from calibration.gap.model.state import (
    State,
    at_noise,
    drop_effects,
    fall_of_cost,
    moved_by,
    plain,
    refit,
    settle,
)
from rig.discrepancy import Discrepancy
from tests.support.gap.tables import RIG, evidence_of, foreign, released


def test_a_state_without_its_unnamed_term_is_predicted_without():
    log = foreign("steps", seed=4, effects={}, duration_s=8.0)
    state = settle(released(evidence_of(log)), ["servo_x", "servo_y"])
    state = refit(state, state.bounds(state.evidence.outputs))
    assert plain(state) is state
    unknown = Discrepancy(servo_map_x=(0.3, 0.0, 0.0, 0.0))
    found = plain(replace(state, nominal=state.nominal.with_unknown(unknown)))
    assert found.nominal.rig.unknown == Discrepancy()
    again = evaluate(found.evidence, found.nominal, found.fit.setting, found.evidence.outputs)
    np.testing.assert_array_equal(found.fit.z("servo_x"), again.z("servo_x"))


def test_a_play_that_is_dropped_is_dropped_from_the_servo_that_it_freed():
    """Friction holds the plate while its arm turns through the joint's play: the servo feels it."""
    hidden = {"joint_backlash": {"x": {"play_rad": 0.03}}}
    evidence = evidence_of(foreign("steps", seed=4, effects=hidden, duration_s=8.0))
    nominal, key = NominalModel(RIG, load_friction=True), ("joint_backlash", "x")
    assert moved_by(nominal, [key]) == ("servo_x", "ball")
    played = {"joint_backlash.play_rad.x": 0.03}
    at = evaluate(evidence, nominal, played, evidence.outputs)
    bare = drop_effects(State(evidence, nominal, at, (key,)), [key])
    again = evaluate(bare.evidence, nominal, bare.fit.setting, evidence.outputs)
    assert bare.fit.costs == again.costs
    assert bare.fit.setting[".time_constant_s.x"] != nominal.rig.servo.time_constant_s


def test_no_cost_falls_by_other_noise_alone():
    """Costs at different noise differ by thousands, for one and the same model."""
    hidden = {"gear_backlash": {"x": {"play_rad": 0.02}}}
    evidence = evidence_of(foreign("steps", seed=4, effects=hidden, duration_s=8.0))
    state = settle(released(evidence), ["servo_x"])
    levels = state.evidence.levels.copy()
    levels["servo_process"][0] *= 0.5
    other = at_noise(state, levels)
    assert abs(state.fit.costs["servo_x"] - other.fit.costs["servo_x"]) > 100.0
    for one, two in ((state, other), (other, state)):
        assert abs(fall_of_cost(one, two, ["servo_x"])) < 1.0
    assert fall_of_cost(state, state, ["servo_x"]) == 0.0
