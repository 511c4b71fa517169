"""The estimator: known numbers come back, its step solves the box's quadratic programme."""

from dataclasses import replace
from functools import cache
from math import inf

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from calibration.gap.model import noise
from calibration.gap.model.cost import HUBER_Z, loss, weights
from calibration.gap.model.data import Roll
from calibration.gap.model.fit import (
    bounded_step,
    differences,
    evaluate,
    fit,
    kept_columns,
    normal_equations,
)
from calibration.gap.model.parameters import BALL, SERVO, NominalModel
from calibration.gap.model.state import State, baseline, refit
from calibration.gap.name.stepwise import settled_baseline
from rig.log import Log
from tests.support.gap.tables import RIG, evidence_of, foreign, released, without_columns
from tests.support.worlds import WORLDS

GAIN, TAU = (1.72, 1.40), (0.031, 0.021)
OFFSET = {"x": 0.08, "y": -0.05}
ROBUST = 0.1  # as in test_noise.py


@cache
def servos() -> State:
    """Servos with other K, tau and a constant voltage, at their own noise levels."""
    hidden = {"voltage_offset": {a: {"offset_V": v} for a, v in OFFSET.items()}}
    log = foreign("steps", seed=5, imperfect=False, gain=GAIN, tau=TAU, effects=hidden)
    state = released(evidence_of(without_columns(log, "ball", "target")))
    truth = {f".gain_rad_s_V.{a}": g for a, g in zip("xy", GAIN, strict=True)}
    truth |= {f".time_constant_s.{a}": t for a, t in zip("xy", TAU, strict=True)}
    truth |= {f"voltage_offset.offset_V.{a}": v for a, v in OFFSET.items()}
    levels = noise.estimate(state.evidence, state.nominal.model(truth), SERVO)
    return released(state.evidence.with_levels(levels))


def wide(state: State, *effects: str) -> dict[str, tuple[float, float]]:
    """K and tau, and the first parameter of some effects, free in their whole range."""
    parameters = [k for k in state.nominal.parameters.values() if not k.effect]
    parameters += [state.nominal.of(name, axis)[0] for name in effects for axis in "xy"]
    return {parameter.name: parameter.range for parameter in parameters}


def test_gain_time_constant_and_offset_come_back():
    state = servos()
    done = fit(state.evidence, state.nominal, state.fit, wide(state, "voltage_offset"))
    for a, gain, tau in zip("xy", GAIN, TAU, strict=True):
        assert done.setting[f".gain_rad_s_V.{a}"] == pytest.approx(gain, rel=0.005)
        assert done.setting[f".time_constant_s.{a}"] == pytest.approx(tau, rel=0.03)
        assert done.setting[f"voltage_offset.offset_V.{a}"] == pytest.approx(OFFSET[a], abs=0.003)
    assert set(done.rolls) == set(SERVO)  # nobody saw a ball
    again = evaluate(state.evidence, state.nominal, done.setting, SERVO)
    assert again.cost == done.cost < state.fit.cost
    rms = [np.sqrt(np.mean(done.z(output)[5:] ** 2)) for output in SERVO]
    np.testing.assert_allclose(rms, 1.0, atol=ROBUST)


def test_far_nominal_values_are_found_too():
    """K and tau unknown: half and three times the true ones."""
    state = servos()
    off = {".gain_rad_s_V.x": 0.8, ".time_constant_s.x": 0.09}
    start = evaluate(state.evidence, state.nominal, off, ["servo_x"])
    names = [*off, "voltage_offset.offset_V.x"]
    bounds = {name: state.nominal.parameters[name].range for name in names}
    done = fit(state.evidence, state.nominal, start, bounds, iterations=12)
    assert done.setting[".gain_rad_s_V.x"] == pytest.approx(GAIN[0], rel=0.005)
    assert done.setting[".time_constant_s.x"] == pytest.approx(TAU[0], rel=0.03)


def test_bounds_hold_and_the_cost_never_rises():
    state = servos()
    bounds = wide(state) | {
        "voltage_offset.offset_V.x": (-0.02, 0.02),
        "voltage_offset.offset_V.y": (0.01, 0.02),  # does not hold where the fit starts
    }
    costs = []
    for iterations in (0, 1, 2, 6):
        done = fit(state.evidence, state.nominal, state.fit, bounds, iterations=iterations)
        costs.append(done.cost)
        for name, (low, high) in bounds.items():
            slack = 1e-9 * (1 + abs(high))
            if name in done.setting:
                assert low - slack <= done.setting[name] <= high + slack
    assert costs == sorted(costs, reverse=True)
    assert done.setting["voltage_offset.offset_V.x"] == pytest.approx(0.02)
    assert done.setting["voltage_offset.offset_V.y"] == pytest.approx(0.01)


@st.composite
def programmes(draw):
    """J'J (k, k), b (k,), a box around 0 and scales: some parameters unfelt, some bounds open."""
    k = draw(st.integers(1, 7))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    scale = 10.0 ** rng.uniform(-4, 0, k)
    j = rng.standard_normal((draw(st.integers(1, 40)), k)) / scale
    j[:, rng.uniform(size=k) < 0.15] = 0.0
    b = j.T @ rng.standard_normal(len(j)) * draw(st.sampled_from([0.1, 1.0, 30.0]))
    low, high = -scale * rng.exponential(2, k), scale * rng.exponential(2, k)
    low[rng.uniform(size=k) < 0.2] = -inf
    high[rng.uniform(size=k) < 0.2] = inf
    low[rng.uniform(size=k) < 0.15] = 0.0
    return j.T @ j, b, low, high, scale


FREED_AGAIN = (  # takes more steps than it has parameters
    np.array(
        [
            [
                2.58952746e06,
                -1.41586688e04,
                6.05884494e04,
                1.20260980e05,
                1.94170153e03,
                -8.05418106e04,
            ],
            [
                -1.41586688e04,
                1.89662576e04,
                -1.75194116e03,
                1.42941557e04,
                -104.033367,
                -296.273342,
            ],
            [
                6.05884494e04,
                -1.75194116e03,
                2.73992011e03,
                2.15589497e03,
                97.2668902,
                -1.99121589e03,
            ],
            [
                1.20260980e05,
                1.42941557e04,
                2.15589497e03,
                3.96338800e04,
                -151.862601,
                -3.47258158e03,
            ],
            [1.94170153e03, -104.033367, 97.2668902, -151.862601, 5.34866086, -80.2703715],
            [
                -8.05418106e04,
                -296.273342,
                -1.99121589e03,
                -3.47258158e03,
                -80.2703715,
                3.04491059e03,
            ],
        ]
    ),
    np.array([-2971.33576, -27.1939462, -29.7823859, -20.3498761, -1.78468998, 86.7006695]),
    np.array([-0.00021723, -0.01682939, 0.0, -0.00044092, 0.0, -0.09138853]),
    np.array([0.00515615, 0.00838499, inf, 0.0393382, 2.55411001, 0.04196389]),
    np.array([0.00147597, 0.0082736, 0.03088439, 0.00833113, 0.72389908, 0.0321708]),
)


@settings(max_examples=150)
@given(programmes())
@example(FREED_AGAIN)
def test_the_step_meets_the_conditions_of_kuhn_and_tucker(programme):
    a, b, low, high, scale = programme
    step = bounded_step(a, b, low, high, scale) / scale
    low, high = low / scale, high / scale
    assert (low - 1e-9 <= step).all()
    assert (step <= high + 1e-9).all()
    h = a * np.outer(scale, scale) + 1e-3 * np.eye(len(b))
    gradient = h @ step + b * scale
    slack = 1e-6 * (1 + np.abs(b * scale) + np.abs(h) @ np.abs(step))
    at_low, at_high = step <= low + 1e-9, step >= high - 1e-9
    assert (gradient[~at_low] <= slack[~at_low]).all()  # else it would go further down
    assert (gradient[~at_high] >= -slack[~at_high]).all()


@settings(max_examples=40)
@given(programmes())
def test_no_other_solver_finds_a_lower_place(programme):
    a, b, low, high, scale = programme
    h = a * np.outer(scale, scale) + 1e-3 * np.eye(len(b))
    value = lambda d: 0.5 * d @ h @ d + b @ (scale * d)  # noqa: E731
    step = bounded_step(a, b, low, high, scale) / scale
    box = list(zip(low / scale, high / scale, strict=True))
    other = minimize(value, np.zeros(len(b)), method="L-BFGS-B", bounds=box)
    assert value(step) <= other.fun + 1e-6 * (1 + abs(other.fun))


def test_a_parameter_that_nothing_feels_stays():
    a = np.diag([4.0, 0.0])
    step = bounded_step(a, np.array([-8.0, 0.0]), np.full(2, -5.0), np.full(2, 5.0), np.ones(2))
    np.testing.assert_allclose(step, [2.0, 0.0], atol=1e-3)


@settings(max_examples=60)
@given(z=st.lists(st.floats(-40, 40).filter(lambda v: abs(abs(v) - HUBER_Z) > 1e-3), min_size=1),
       log_std=st.floats(-3, 3))  # fmt: skip
def test_hubers_loss_is_square_inside_straight_outside_and_its_slope_is_the_weights(z, log_std):
    z = np.array([*z, 0.5])
    mask = (np.arange(len(z)) % 3 != 1).astype(float)
    spread = np.full(len(z), log_std)
    inside, size = np.abs(z) <= HUBER_Z, np.abs(z)
    rho = np.where(inside, z**2 / 2, HUBER_Z * size - HUBER_Z**2 / 2)
    assert loss(Roll(z, spread), mask) == pytest.approx(float(mask @ (rho + spread)), abs=1e-9)
    e = 1e-6
    for i in range(len(z)):
        bump = np.zeros(len(z))
        bump[i] = e
        slope = (loss(Roll(z + bump, spread), mask) - loss(Roll(z - bump, spread), mask)) / (2 * e)
        assert slope == pytest.approx((weights(z, mask) * z)[i], abs=1e-3)
    assert (weights(z, mask)[inside] == mask[inside]).all()


def test_a_roll_out_that_broke_down_costs_infinitely_much():
    assert loss(Roll(np.zeros(5), np.zeros(5)), np.ones(5)) == inf


@cache
def both() -> State:
    log = foreign("steps", seed=2, duration_s=6.0)
    return released(evidence_of(log))


@pytest.mark.parametrize(
    ("name", "linear"),
    [
        ("voltage_offset.offset_V.x", True),
        ("level_offset.slope_rad.y", True),
        (".gain_rad_s_V.x", True),
        ("camera_yaw.angle_rad.xy", True),
        ("coulomb_friction.friction_V.y", False),
        ("joint_backlash.play_rad.x", False),
        ("supply_sag.drop_1_V.xy", False),
    ],
)
def test_differences_are_the_secants_of_the_roll_outs(name: str, linear: bool):
    state = both()
    parameter, nominal = state.nominal.parameters[name], state.nominal
    columns = differences(state.evidence, nominal, state.fit, [parameter], {name: parameter.range})
    for output, roll in state.fit.rolls.items():
        secants = []
        for step in (parameter.step, 0.1 * parameter.step):
            moved = state.evidence.roll(nominal.model({name: parameter.nominal + step}), output)
            secants.append((moved.z - roll.z) / step)
        np.testing.assert_allclose(columns[output][:, 0], secants[0], rtol=1e-9, atol=1e-12)
        size = np.linalg.norm(secants[0])
        assert (size > 0) == (output in parameter.outputs)
        if linear and size > 0:
            assert np.linalg.norm(secants[1] - secants[0]) < 0.05 * size


@cache
def narrow_valley() -> State:
    """An axis with fine counts and hardly any friction: secants over a whole step lead nowhere, and
    a play of a tenth of a count is a ditch."""
    columns, _, _ = WORLDS["healthy_axis"](2000)
    evidence = evidence_of(Log.from_columns(columns))
    return baseline(evidence, NominalModel(RIG, load_friction=False, coasts=False))


def test_in_a_narrow_valley_the_fit_ends_as_low_as_powells_method():
    state = narrow_valley()
    evidence, nominal = state.evidence, state.nominal
    names, box = zip(*state.bounds(("servo_x",)).items(), strict=True)
    scale = np.array([nominal.parameters[name].step for name in names])
    low, high = np.array(box).T / scale

    def cost(x: np.ndarray) -> float:
        setting = dict(zip(names, np.clip(x, low, high) * scale, strict=True))
        return evaluate(evidence, nominal, setting, ["servo_x"]).cost

    first = np.array([nominal.parameters[name].nominal for name in names]) / scale
    other = minimize(cost, first, method="Powell", bounds=list(zip(low, high, strict=True)))
    assert cost(first) - other.fun > 300.0
    assert cost(first) - state.fit.cost > 0.97 * (cost(first) - other.fun)


def test_a_fit_is_given_up_only_where_what_it_needs_is_far():
    state, outputs = narrow_valley(), ("servo_x",)
    bounds = state.bounds(outputs)
    first = evaluate(state.evidence, state.nominal, {}, outputs)
    whole = fit(state.evidence, state.nominal, first, bounds)
    gained = first.cost - whole.cost
    for share, ends in ((0.5, True), (20.0, False)):
        needed = whole.cost - share * gained
        done = fit(state.evidence, state.nominal, first, bounds, needed=needed)
        assert (done.setting == whole.setting) == ends
        assert first.cost - done.cost > 0.5 * gained


def test_at_the_upper_bound_the_difference_goes_down():
    state, name = both(), "voltage_offset.offset_V.x"
    parameter, nominal = state.nominal.parameters[name], state.nominal
    top = evaluate(state.evidence, nominal, {name: 0.02}, ["servo_x"])
    column = differences(state.evidence, nominal, top, [parameter], {name: (-0.02, 0.02)})[
        "servo_x"
    ]
    below = state.evidence.roll(nominal.model({name: 0.02 - parameter.step}), "servo_x").z
    np.testing.assert_allclose(column[:, 0], (top.z("servo_x") - below) / parameter.step)


def test_columns_that_are_known_are_not_taken_again():
    state = both()
    names = ["voltage_offset.offset_V.x", "coulomb_friction.friction_V.x"]
    parameters = [state.nominal.parameters[name] for name in names]
    bounds = {parameter.name: parameter.range for parameter in parameters}
    columns = differences(state.evidence, state.nominal, state.fit, parameters, bounds)
    kept = kept_columns(columns, parameters[:1])
    assert set(kept) == {("servo_x", names[0])}
    marked = {key: column + 7.0 for key, column in kept.items()}
    again = differences(
        state.evidence, state.nominal, replace(state.fit, columns=marked), parameters, bounds
    )
    np.testing.assert_array_equal(again["servo_x"][:, 0], columns["servo_x"][:, 0] + 7.0)
    np.testing.assert_array_equal(again["servo_x"][:, 1], columns["servo_x"][:, 1])


def test_from_near_and_from_far_a_fit_ends_as_low():
    """A gain asymmetry beside play, dead zone and friction within their tolerances, on a sweep."""
    hidden = {"gain_asymmetry": {"x": {"fraction": -0.054}}}
    log = without_columns(foreign("sweep", seed=3, effects=hidden), "ball", "target")
    before = settled_baseline(evidence_of(log), NominalModel(RIG, load_friction=False))
    ends = []
    for size in (-0.02, -0.03, -0.1, -0.2):
        setting = before.fit.setting | {"gain_asymmetry.fraction.x": size}
        begun = evaluate(before.evidence, before.nominal, setting, before.fit.rolls)
        begun = replace(begun, columns=before.fit.columns)
        state = replace(before, named=(("gain_asymmetry", "x"),), fit=begun)
        ends.append(refit(state, state.bounds(("servo_x",))).fit.cost)
    assert max(ends) - min(ends) < 20.0


def test_the_normal_equations_sum_over_parts_with_hubers_weights():
    state = both()
    parameter = state.nominal.parameters["camera_delay.extra_s.xy"]
    columns = differences(
        state.evidence, state.nominal, state.fit, [parameter], {parameter.name: (-1, 1)}
    )
    a, b = normal_equations(state.evidence, state.fit, columns)
    j, z = columns[BALL][:, 0], state.fit.z(BALL)
    w = weights(z, state.evidence.masks[BALL])
    assert a.item() == pytest.approx(float(np.sum(w * j * j)))
    assert b.item() == pytest.approx(float(np.sum(w * j * z)))


def test_the_rigs_own_numbers_are_where_the_search_starts():
    nominal = both().nominal
    assert nominal.parameters[".gain_rad_s_V.x"].nominal == RIG.servo.gain_rad_s_V
