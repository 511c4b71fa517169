"""Which fitted effects are what their names say."""

from dataclasses import replace

import numpy as np
import pytest

from calibration.gap.model.data import Evidence
from calibration.gap.model.fit import ParameterFit, evaluate
from calibration.gap.model.parameters import NominalModel
from calibration.gap.model.state import State
from calibration.gap.name.refit import CandidateFit, _axes
from calibration.gap.name.screen import Screened
from tests.support.gap.tables import RIG, evidence_of, foreign

# The ball's weight comes behind a dead zone, and friction holds against it.
WEIGHTLESS = replace(RIG, ball=replace(RIG.ball, mass_kg=1e-6))
NOMINAL = NominalModel(WEIGHTLESS, load_friction=False)
TAU_S = NOMINAL.parameters[".time_constant_s.x"].nominal
HALF_WIDTH_V = 0.4


@pytest.fixture(scope="module")
def evidence() -> Evidence:
    hidden = {"dead_zone": {"x": {"half_width_V": HALF_WIDTH_V}}}
    return evidence_of(foreign("steps", seed=6, effects=hidden, duration_s=10.0))


def friction(evidence: Evidence, settling_s: float) -> ParameterFit:
    setting = {"friction_V": HALF_WIDTH_V, "settling_s": settling_s}
    named = {f"coulomb_friction.{key}.x": value for key, value in setting.items()}
    return evaluate(evidence, NOMINAL, named, ("servo_x",))


def test_friction_that_settles_as_the_motor_does_is_a_dead_zone(evidence: Evidence):
    """Its equation is the dead zone's: within the band either leaves exp(-h/tau) of the speed."""
    dead = evaluate(evidence, NOMINAL, {"dead_zone.half_width_V.x": HALF_WIDTH_V}, ("servo_x",))
    twin = friction(evidence, TAU_S)
    np.testing.assert_allclose(twin.z("servo_x"), dead.z("servo_x"), rtol=0, atol=0.01)
    assert np.abs(friction(evidence, 0.2 * TAU_S).z("servo_x") - dead.z("servo_x")).max() > 1.0


@pytest.mark.parametrize(("share", "is_friction"), [(0.0, True), (0.4, True), (1.0, False)])
def test_it_is_called_friction_only_where_it_stops_the_motor_sooner(
    evidence: Evidence, share: float, is_friction: bool
):
    fit = friction(evidence, share * TAU_S)
    state = State(evidence, NOMINAL, fit, (("coulomb_friction", "x"),))
    candidate = CandidateFit("coulomb_friction", ("x",), state, 1e3)
    assert candidate.is_identified("x") == is_friction
    assert (candidate.score > 0.0) == is_friction


def test_an_effect_is_tried_where_it_gains_most_though_another_gains_more_there():
    """Friction with play in the gears beside it: that which falls with speed gained more on x in
    the screen, so friction was tried on y alone."""
    gains = {"stribeck_friction": (203.0, 14.0), "coulomb_friction": (122.0, 18.0)}
    known = [
        Screened(name, axis, gain, {}, 0.0, {})
        for name, pair in gains.items()
        for axis, gain in zip("xy", pair, strict=True)
    ]
    known.sort(key=lambda one: -one.gain)
    friction = [one for one in known if one.name == "coulomb_friction"]
    assert [one.axis for one in _axes(friction, known, ())] == ["x", "y"]
    far = [one for one in known if one.name == "stribeck_friction"]
    assert [one.axis for one in _axes(far[:1], known, ())] == ["x"]


def test_in_the_place_of_a_name_it_is_tried_on_all_of_its_axes():
    """A lag of both servos that take an angle, for which a camera delay costs 4 more: since a dead
    band gained more on x alone, the delay was tried on y, cost 31 more, and the lag was certain."""
    gains = {"servo_dead_time": (17.0, 128.0), "command_dead_band": (38.0, 75.0)}
    known = [
        Screened(name, axis, gain, {}, 0.0, {})
        for name, pair in gains.items()
        for axis, gain in zip("xy", pair, strict=True)
    ]
    known.sort(key=lambda one: -one.gain)
    delay = [one for one in known if one.name == "servo_dead_time"]
    assert [one.axis for one in _axes(delay, known, ())] == ["y"]
    assert [one.axis for one in _axes(delay, known, ("x", "y"))] == ["y", "x"]


@pytest.mark.parametrize(("below", "told"), [(0.0, False), (0.3, True)])
def test_a_limit_is_told_from_a_gain_only_where_lower_volts_turn_the_motor(
    below: float, told: bool, evidence: Evidence
):
    """K min(|V|, L) is (K L/V0) V0 where |V| is always V0, as with a relay."""
    (run,) = evidence.runs
    turns = np.where(np.arange(len(run.t_s)) % 100 < 50, 4.0, -4.0)
    volts = np.column_stack([turns, turns])
    volts[: int(below * len(volts))] *= 0.4
    relay = replace(evidence, runs=[replace(run, volts_V=volts)])
    limit = {"saturation.limit_V.x": 3.0}
    state = State(relay, NOMINAL, ParameterFit(limit, {}, {}), (("saturation", "x"),))
    assert CandidateFit("saturation", ("x",), state, 1e3).is_identified("x") == told
