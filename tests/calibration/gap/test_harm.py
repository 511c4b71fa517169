"""A name on both servos that is right on one: by predictions of data that were not fitted."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calibration.gap import harm
from calibration.gap.held_out import Prediction
from calibration.gap.model.parameters import BALL, SERVO
from rig.effects import BY_NAME

NAME: Any = SimpleNamespace(name="coulomb_friction", axes=("x", "y"))
DECISION: Any = SimpleNamespace(state=SimpleNamespace(nominal=SimpleNamespace(catalogue=BY_NAME)))


def errors(size_rad: float, seed: int = 0) -> Prediction:
    """Sixty errors 1 s ahead of this size, and what they cost."""
    z = np.random.default_rng(seed).normal(size=60)
    return Prediction(size_rad * z, np.full(60, (1e3 * size_rad) ** 2))


@pytest.fixture
def without(monkeypatch: pytest.MonkeyPatch):
    """What is predicted without the name."""
    told = {SERVO[0]: errors(0.004), SERVO[1]: errors(0.004), BALL: errors(0.002)}
    monkeypatch.setattr(harm, "drop_effects", lambda state, keys: state)
    monkeypatch.setattr(harm, "held_out", lambda state, outputs: {o: told[o] for o in outputs})
    return told


def test_the_axis_on_which_a_name_harms_is_taken_back_where_the_other_proves_it(without):
    after = {SERVO[0]: errors(0.001), SERVO[1]: errors(0.008)}
    (found,) = harm.harmed_axes(DECISION, NAME, after).items()
    assert found[0] == "y"
    assert found[1].startswith("not named on servo y: coulomb_friction: 1 s ahead")


@pytest.mark.parametrize(
    "after",
    [
        {SERVO[0]: errors(0.001), SERVO[1]: errors(0.001)},  # right on both
        {SERVO[0]: errors(0.008), SERVO[1]: errors(0.008)},  # wrong on both: no name at all
        {SERVO[0]: errors(0.004, seed=1), SERVO[1]: errors(0.008)},  # on neither is it proven
        {SERVO[1]: errors(0.008)},  # nobody knows of x
    ],
)
def test_without_harm_on_one_and_proof_on_the_other_a_name_is_judged_as_a_whole(without, after):
    assert harm.harmed_axes(DECISION, NAME, after) == {}


@pytest.mark.parametrize("effect", [e for e in BY_NAME.values() if e.side != "ball"])
def test_every_effect_of_servos_can_be_judged_with_harm_on_one_of_them(without, effect):
    """One supply feeds both servos: there is no axis to take it back on."""
    one: Any = SimpleNamespace(name=effect.name, axes=effect.axes)
    found = harm.harmed_axes(DECISION, one, {SERVO[0]: errors(0.001), SERVO[1]: errors(0.008)})
    assert list(found) == (["y"] if effect.axes == ("x", "y") and effect.side == "servo" else [])


def test_what_shows_in_one_output_is_judged_as_a_whole(without):
    ball: Any = SimpleNamespace(name="joint_backlash", axes=("x", "y"))
    assert harm.harmed_axes(DECISION, ball, {BALL: errors(0.008)}) == {}


@pytest.mark.parametrize(("costs", "doubted"), [(0.0, True), (-0.1, True), (0.5, False)])
def test_beside_what_has_no_name_a_rival_has_to_be_worse_for_certain(monkeypatch, costs, doubted):
    """`costs`: what the rival costs more, second by second, with a spread of 0.3."""
    spread = np.random.default_rng(1).normal(0.0, 0.3, 60)
    told = {"own": np.zeros(60), "other": costs + spread - spread.mean()}
    evidence = SimpleNamespace(levels=None, with_levels=lambda levels: evidence)
    nominal = SimpleNamespace(catalogue=BY_NAME)

    def state(which: str) -> Any:
        return harm.State(evidence, nominal, SimpleNamespace(which=which))  # pyright: ignore

    monkeypatch.setattr(
        harm, "held_out", lambda s, outputs: {BALL: Prediction(np.zeros(60), told[s.fit.which])}
    )
    rival = SimpleNamespace(name="transmission_ripple", nameable=True, state=state("other"))
    one: Any = SimpleNamespace(name="camera_scale", axes=("xy",), rivals=(rival,))
    found = harm.rival_as_good(state("own"), one, BALL)
    assert ("transmission_ripple in its place predicts as well" in found) == doubted
    assert harm.rival_as_good(state("own"), one, SERVO[0]) == ""
