"""Backward elimination: every name is judged once, on all axes on which it stands."""

from dataclasses import replace

import pytest

from calibration.gap.model.fit import evaluate
from calibration.gap.model.parameters import NominalModel
from calibration.gap.model.state import State
from calibration.gap.name import stepwise
from calibration.gap.name.stepwise import Accepted, _eliminated
from tests.support.gap.tables import RIG, evidence_of, foreign

BOTH = (("dead_zone", "x"), ("dead_zone", "y"))


@pytest.mark.parametrize(
    "named",
    [
        (("gain_asymmetry", "x"), ("dead_zone", "y")),
        (("dead_zone", "y"), ("gain_asymmetry", "x")),
    ],
)
def test_a_name_that_takes_anothers_place_stands_once(monkeypatch, named):
    """The gain's asymmetry on x turns out to be the dead zone that stands on y already."""
    evidence = evidence_of(foreign("steps", seed=1, effects={}, duration_s=2.0))
    nominal = NominalModel(RIG, load_friction=False)
    begun = State(evidence, nominal, evaluate(evidence, nominal, {}, evidence.outputs), named)
    asked = []

    def step(state: State, name: str, skip=()) -> tuple[State, Accepted]:
        asked.append(name)
        if name == "gain_asymmetry":
            return replace(state, named=BOTH), Accepted("dead_zone", ("x",), 40.0, ())
        axes = tuple(axis for effect, axis in state.named if effect == name)
        return state, Accepted(name, axes, 50.0 * len(axes), ())

    monkeypatch.setattr(stepwise, "backward_step", step)
    state, accepted = _eliminated(begun, ())
    assert [(one.name, set(one.axes), one.score) for one in accepted] == [
        ("dead_zone", {"x", "y"}, 100.0)
    ]
    assert state.named == BOTH
    assert asked[-1] == "dead_zone"


def test_a_name_that_went_with_another_is_not_asked_for_again(monkeypatch):
    """The asymmetry becomes a dead zone, and both go: that on y is no more when its turn comes."""
    evidence = evidence_of(foreign("steps", seed=1, effects={}, duration_s=2.0))
    nominal, named = NominalModel(RIG, load_friction=False), (("gain_asymmetry", "x"), BOTH[1])
    begun = State(evidence, nominal, evaluate(evidence, nominal, {}, evidence.outputs), named)

    def step(state: State, name: str, skip=()) -> tuple[State, Accepted | None]:
        assert name in {effect for effect, _ in state.named}
        if name == "gain_asymmetry":
            return replace(state, named=BOTH), Accepted("dead_zone", ("x",), 40.0, ())
        return replace(state, named=()), None

    monkeypatch.setattr(stepwise, "backward_step", step)
    state, accepted = _eliminated(begun, ())
    assert (state.named, accepted) == ((), ())
