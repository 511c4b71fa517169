"""A state of the search: what is told of names does not hold an unnamed term."""

from dataclasses import replace

import numpy as np

from calibration.gap.model.fit import evaluate
from calibration.gap.model.state import plain, refit, settle
from rig.discrepancy import Discrepancy
from tests.support.gap.tables import evidence_of, foreign, released


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
