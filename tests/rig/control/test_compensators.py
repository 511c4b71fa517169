"""The arms of the literature: each against its closed form, and the same bits everywhere."""

from math import exp, radians, sqrt, tanh

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rig.compiled import compiled
from rig.control import controllers
from rig.control.compensators import adaptive, disturbance, hybrid, neural, smooth
from rig.control.compensators.choice import FIRST_PUBLISHED, PUBLISHED
from rig.control.controllers import COMPENSATORS
from rig.loop.loop import Loop
from rig.plant.shaft import play_operator
from rig.rigfile import from_dict
from rig.simulation.batch import simulate_many
from rig.simulation.simulate import Task, draw, simulate
from rig.simulation.simulator import SimulatedTable
from rig.table import R_BALL, R_EXPOSED, R_NEW, R_THETA, R_TIME, blank_reading
from tests.support.simulated import TICK_S, random_steps, realistic

FEWER = settings(max_examples=50)
GAIN_M_S2, LEAST = 1.087, 0.003


def fresh(dtype: np.dtype) -> np.record:
    return np.zeros(1, dtype)[0]


# smooth feedforward inverse


@FEWER
@given(st.floats(0, 0.05), st.floats(-3, 3))
def test_smooth_shift_is_the_published_weighing_of_both_sides(half, rate):
    """alpha chi_r - alpha chi_l of Zhou, Zhang and Wen, with k = 1/WIDTH."""
    k = rate / smooth.WIDTH_RAD_S
    chi_r, chi_l = exp(k) / (exp(k) + exp(-k)), exp(-k) / (exp(k) + exp(-k))
    assert smooth.shift(half, rate) == pytest.approx(half * chi_r - half * chi_l, abs=1e-15)


def test_smooth_inverse_behind_its_play_misses_by_what_tanh_leaves():
    """A ramp of rate r through inverse and play: the error is alpha (1 - tanh(k r))."""
    s, joint, rate, plate, wanted = fresh(smooth.SMOOTH_STATE), 0.04, 0.15, 0.0, 0.0
    for k in range(1000):
        wanted = rate * k * TICK_S
        reference, _ = smooth.smooth_inverse(s, 0, wanted, joint, 0.0, 1.6, TICK_S)
        plate = play_operator(plate, reference, joint / 2, -joint / 2)
    left = joint / 2 * (1 - tanh(rate / smooth.WIDTH_RAD_S))
    assert wanted - plate == pytest.approx(left, abs=1e-6)


def test_smooth_gear_volts_carry_the_motor_over_the_whole_gap_at_a_reversal():
    """The integral of K volts over a reversal is the gap, whatever its course."""
    s, gear, gain, crossed = fresh(smooth.SMOOTH_STATE), 0.02, 1.6, 0.0
    t = np.arange(2000) * TICK_S
    for wanted in np.concatenate((2.0 * t, 2.0 * t[::-1])):
        _, volts = smooth.smooth_inverse(s, 1, wanted, 0.0, gear, gain, TICK_S)
        crossed += gain * volts * TICK_S * (wanted > 0)
    assert crossed == pytest.approx(-gear / 2, rel=1e-3)  # from 0 over + to - half the gap


# adaptive inverse


@FEWER
@given(st.lists(st.floats(-0.4, 0.4), min_size=1, max_size=30), st.floats(0, 0.05),
       st.floats(-0.05, 0))  # fmt: skip
def test_adaptive_inverse_is_exact_where_its_parameters_are(wanted, upper, lower):
    """Tao and Kokotovic's lemma, B(BI(u)) = u, for an ideal servo (turns counted at once)."""
    s, plate = fresh(adaptive.ADAPTIVE_STATE), 0.0
    s["turn"][0], begun = 0.0, False
    for want in wanted:
        way = s["way"][0]
        reference = adaptive.inverse(s, 0, want, upper, lower, 0.0)
        plate = play_operator(plate, reference, upper, lower)
        begun = begun or s["way"][0] != way or abs(want) > upper - lower
        if begun:
            assert plate == pytest.approx(want, abs=1e-12)


@compiled
def adapting(s, reading, symmetric, upper, lower, level, noise, found):
    """Fill `found` (ticks, 2) with the break points that the law finds for an ideal plate led to
    and fro under a frictionless ball kept near the centre; frames are 12 ms old."""
    plate = x = v = 0.0
    seen = np.zeros(found.shape[0])
    for k in range(found.shape[0]):
        t = k * TICK_S
        theta = 0.08 * np.sin(2 * np.pi * 0.6 * t) - 3.0 * x - 2.0 * v
        plate = play_operator(plate, theta, upper, lower)
        reading[R_TIME], reading[R_THETA], reading[R_NEW] = t, theta, 0.0
        seen[k] = x
        if k % 8 == 0 and k >= 6:
            reading[R_NEW], reading[R_EXPOSED] = 1.0, t - 6 * TICK_S
            reading[R_BALL] = seen[k - 6] + noise[k]
        adaptive.adaptive_inverse(s, 0, reading, theta, 1.0, GAIN_M_S2, TICK_S, LEAST, symmetric)
        found[k, 0], found[k, 1] = s.c[0, 0], s.c[0, 1]
        v += TICK_S * (GAIN_M_S2 * np.sin(plate) + level)
        x += TICK_S * v


def adapted(symmetric: bool, upper: float, lower: float, level: float, noise_m=0.0):
    """Mean of the found break points (2,) over the last second of a minute."""
    found = np.zeros((30000, 2))
    noise = noise_m * np.random.default_rng(1).standard_normal(30000)
    s = fresh(adaptive.ADAPTIVE_STATE)
    adapting(s, blank_reading(), symmetric, upper, lower, level, noise, found)
    return found[-500:].mean(axis=0)


@compiled
def learning(s, ticks):
    for _ in range(ticks):
        neural.learn(s, 0, 0.01, TICK_S)


@compiled
def rubbing(s, gain, errors, forgetful):
    """A motor u' + d sgn(rate) under the neural law; fills errors (n,)."""
    x = 0.0
    for k in range(errors.shape[0]):
        t = k * TICK_S
        wanted = 0.1 * np.sin(3 * t)
        speed = gain * neural.neural_volts(s, 0, wanted, x, 0.0, 14.0, gain, TICK_S)
        x += TICK_S * (speed - 0.3 * np.sign(np.cos(3 * t)))
        errors[k] = abs(wanted - x)
        if forgetful:
            s.weights[0, :] = 0.0


@pytest.mark.parametrize("play_deg", [0.0, 1.0, 3.0])
def test_symmetric_parameters_converge_to_the_truth_whatever_the_level(play_deg):
    half = radians(play_deg) / 2
    found = adapted(True, half, -half, 0.01, noise_m=3e-4)
    assert found == pytest.approx([half, -half], abs=radians(0.12))


def test_asymmetric_parameters_converge_to_both_break_points():
    upper, lower = radians(1.4), -radians(0.6)
    found = adapted(False, upper, lower, 0.0, noise_m=3e-4)
    assert found == pytest.approx([upper, lower], abs=radians(0.15))


def test_a_level_error_is_taken_for_the_middle_of_the_play():
    half, level = radians(0.8), 0.01
    upper, lower = adapted(False, half, -half, level)
    assert upper - lower == pytest.approx(2 * half, abs=radians(0.2))
    assert (upper + lower) / 2 == pytest.approx(-level / GAIN_M_S2, abs=radians(0.2))


# hybrid


def test_soft_landing_takes_the_time_of_constant_braking_and_arrives_slowly():
    """d' = -sqrt(2 a d) ends after sqrt(2 d/a), down to the slowest speed."""
    s, joint = fresh(hybrid.HYBRID_STATE), radians(2)
    s["shift"][0] = -joint / 2
    shifts = []
    while s["shift"][0] < joint / 2 and len(shifts) < 1000:
        hybrid.soft_reference(s, 0, 0.2, 0.0, joint, LEAST, TICK_S)
        shifts.append(float(s["shift"][0]))
    a, slow = hybrid.BRAKING_RAD_S2, hybrid.SLOWEST_RAD_S
    ideal = sqrt(2 * joint / a) - slow / a + slow / (2 * a)  # the rest at the slowest speed
    assert len(shifts) * TICK_S == pytest.approx(ideal, abs=3 * TICK_S)
    assert (shifts[-1] - shifts[-2]) / TICK_S < 3 * slow


def test_sliding_mode_keeps_to_its_surface_and_decays_by_lambda():
    """On s = 0 the motor tau w' + w = K V obeys e' = -lambda e exactly."""
    gain, motor_gain, lag, error = 14.0, 1.6, 0.04, 0.1
    rate = hybrid.LAMBDA_1_S * error
    volts = hybrid.sliding_volts(error, rate, gain, motor_gain, lag)
    acceleration = (motor_gain * volts - rate) / lag
    assert acceleration == pytest.approx(-hybrid.LAMBDA_1_S * rate)


@FEWER
@given(st.floats(-0.3, 0.3), st.floats(-0.05, 0.05), st.floats(0, 0.06))
def test_hybrid_knows_how_far_the_gap_is(error, twist, gear):
    left = hybrid.gap_left(error, twist, gear, LEAST)
    assert left == -hybrid.gap_left(-error, -twist, gear, LEAST)
    assert 0.0 <= left * np.sign(error) <= gear if left else True


# neural dynamic inversion


def test_neural_weights_end_where_learning_and_forgetting_balance():
    """A constant error: W -> -sigma sgn(tau~)/k, the bound of the published proof."""
    s = fresh(neural.NEURAL_STATE)
    neural.answer(s, 0, 0.05, 0.0, 0.01)
    learning(s, 30000)
    np.testing.assert_allclose(
        s["weights"][0], -s["sigma"][0] / neural.FORGETTING, rtol=1e-3, atol=1e-6
    )


def test_neural_net_without_what_it_learnt_is_the_proportional_servo():
    s = fresh(neural.NEURAL_STATE)
    assert neural.neural_volts(s, 0, 0.1, 0.04, 0.0, 14.0, 1.6, TICK_S) == pytest.approx(0.84)


def test_neural_net_learns_a_friction_that_depends_on_the_direction():
    """u' = K_b tau~ + rate - y against u' + d sgn(rate), beside the same with a net of zeros."""
    learnt, zeros = np.zeros(20000), np.zeros(20000)
    rubbing(fresh(neural.NEURAL_STATE), 1.6, learnt, False)
    rubbing(fresh(neural.NEURAL_STATE), 1.6, zeros, True)
    assert learnt[-4000:].mean() < 0.7 * zeros[-4000:].mean()


# disturbance observer


def test_a_disturbance_moves_the_motor_by_the_share_that_is_left():
    """First-order motor with its torque observed: steady speed under a constant torque d."""
    per_volt, damping, d, speed, volts, observed = 0.13, 0.08, 0.02, 0.0, 0.0, 0.0
    for _ in range(20000):
        observed += TICK_S / 0.02 * (per_volt * volts - damping * speed - observed)
        volts = disturbance.disturbance_volts(observed, per_volt)
        speed += TICK_S / 2e-3 * (per_volt * volts - damping * speed - d)
    assert speed == pytest.approx(-(1 - disturbance.SHARE) * d / damping, rel=1e-6)


# all of them


@pytest.mark.parametrize("arm", sorted(PUBLISHED))
def test_loop_kernel_and_batch_give_the_same_bits(arm):
    rig = realistic(gear_deg=1.5, joint_deg=2.0, joint_offset_rad=0.004)
    course, seen = random_steps(np.random.default_rng(2), 3.0), from_dict({})
    task = Task(rig, seen, COMPENSATORS[arm], course, draw(np.random.default_rng(3), rig, course))
    one = simulate(task.rig, task.known, task.compensator, task.course, task.draws)
    other = Task(rig, seen, COMPENSATORS["with"], course, task.draws)
    many = simulate_many([other, task, task])[1]
    np.testing.assert_array_equal(many.log.rows, one.log.rows)
    rows: list[np.ndarray] = []
    with SimulatedTable(rig, np.random.default_rng(3), start_m=course.start_m) as table:
        Loop(table, seen, COMPENSATORS[arm], course, keep=lambda row: rows.append(row.copy())).run()
    np.testing.assert_array_equal(np.array(rows), one.log.rows)
    assert not np.array_equal(
        one.log["wanted_voltage_x_V"], simulate_many([other])[0].log["wanted_voltage_x_V"]
    )


def test_names_and_numbers_are_apart_from_the_papers_arms():
    assert len(set(COMPENSATORS.values())) == len(COMPENSATORS)
    assert all(number >= FIRST_PUBLISHED for number in PUBLISHED.values())


def test_a_calibrated_play_and_its_error_reach_the_controller():
    rig = from_dict({"play": {"joint_x_rad": 0.02, "gear_y_rad": 0.01, "factor": 1.5}})
    g = controllers.settings(rig, COMPENSATORS["with"])
    assert list(g["joint_given"]) == [0.02, 0.0]
    assert list(g["gear_given"]) == [0.0, 0.01]
    assert g["backlash_factor"] == 1.5
