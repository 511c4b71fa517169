"""The shaft with play against the paper's Eqs. 1 to 8, written out here once more."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from rig.plant.shaft import (
    DEAD_ZONE,
    EXACT,
    NONE,
    backlash_angle,
    dead_zone,
    play_operator,
    relaxation,
    shaft_torque,
)

K, C, ALPHA = 30.0, 0.02, 0.015  # N m/rad, N m s/rad, rad
ANGLE = st.floats(-0.3, 0.3)
HALF = st.floats(0.0, 0.1)


def exact_course(theta_d, h, *, k=K, c=C, beta_1=ALPHA, beta_2=-ALPHA, theta_b=0.0):
    """theta_b and T_s of the exact model along samples of theta_d (n,)."""
    decay, lost, torque = relaxation(k, c, h), [theta_b], []
    for before, after in pairwise(theta_d):
        theta_b = backlash_angle(before, after, theta_b, beta_1, beta_2, decay)
        rate = (after - before) / h
        torque.append(shaft_torque(EXACT, after, rate, theta_b, beta_1, beta_2, k, c))
        lost.append(theta_b)
    return np.array(lost), np.array(torque)


def test_free_twist_relaxes_as_eq_5():
    h, n, start = 1e-4, 40, 0.004
    t = h * np.arange(n + 1)
    lost, torque = exact_course(np.full(n + 1, start), h)
    np.testing.assert_allclose(start - lost, start * np.exp(-K / C * t), rtol=1e-9)
    assert np.all(torque == 0.0)  # no contact, no torque


def test_free_relaxation_does_not_depend_on_how_the_twist_moves():
    """Eq. 4 names theta_d - theta_b alone: a moving theta_d carries theta_b along."""
    h, n = 1e-4, 30
    t = h * np.arange(n + 1)
    theta_d = 0.003 * np.sin(400 * t) + 0.002
    lost, _ = exact_course(theta_d, h)
    np.testing.assert_allclose(theta_d - lost, 0.002 * np.exp(-K / C * t), rtol=1e-9, atol=1e-15)


def test_relaxation_factor_is_the_exponential_and_zero_without_damping():
    assert relaxation(30.0, 0.02, 1e-4) == pytest.approx(np.exp(-0.15), rel=1e-12)
    assert relaxation(30.0, 0.0, 1e-4) == 0.0


def eq_6(theta_d, t_end):
    """theta_b of Eq. 6 for a smooth theta_d(t) -> (angle, rate), events resolved by tiny steps."""
    h = 2e-7
    theta_b, lost = 0.0, []
    for i in range(round(t_end / h)):
        angle, rate = theta_d(i * h)
        free = rate + K / C * (angle - theta_b)
        if theta_b >= ALPHA:
            free = min(0.0, free)
        elif theta_b <= -ALPHA:
            free = max(0.0, free)
        theta_b = min(max(theta_b + h * free, -ALPHA), ALPHA)
        lost.append(theta_b)
    return np.array(lost)


def test_exact_model_is_eq_6_integrated():
    def theta_d(t):
        return 0.03 * np.sin(300 * t), 9.0 * np.cos(300 * t)

    t_end, errors = 0.03, []
    truth = eq_6(theta_d, t_end)
    for h in (2e-4, 1e-4):
        t = h * np.arange(round(t_end / h) + 1)
        lost, _ = exact_course(theta_d(t)[0], h)
        errors.append(np.abs(lost[1:] - truth[round(h / 2e-7) - 1 :: round(h / 2e-7)]).max())
    # What is left is when within a step contact begins or ends.
    assert errors[1] < 2e-4
    assert errors[1] < 0.8 * errors[0]


def test_contact_pushes_and_never_pulls():
    h = 1e-4
    t = h * np.arange(4001)
    lost, torque = exact_course(0.04 * np.sin(60 * t), h)
    lost = lost[1:]
    assert torque.max() > 0.3
    assert torque.min() < -0.3
    assert np.all(lost[torque > 0] == ALPHA)
    assert np.all(lost[torque < 0] == -ALPHA)
    assert np.all(torque[np.abs(lost) < ALPHA] == 0)
    assert np.all(np.abs(lost) <= ALPHA)


def test_torque_in_contact_is_eq_1():
    args = (ALPHA, ALPHA, -ALPHA, K, C)
    assert shaft_torque(EXACT, 0.02, 3.0, *args) == pytest.approx(K * 0.005 + C * 3.0)
    assert shaft_torque(EXACT, 0.02, -30.0, *args) == 0.0  # parting faster than the spring follows


@given(ANGLE, HALF)
def test_dead_zone_is_eq_8(theta_d, alpha):
    if theta_d > alpha:
        expected = theta_d - alpha
    elif theta_d < -alpha:
        expected = theta_d + alpha
    else:
        expected = 0.0
    assert dead_zone(theta_d, alpha, -alpha) == expected
    assert shaft_torque(DEAD_ZONE, theta_d, 7.0, 0.0, alpha, -alpha, K, C) == K * expected


@given(ANGLE, HALF)
def test_dead_zone_is_odd(theta_d, alpha):
    assert dead_zone(-theta_d, alpha, -alpha) == -dead_zone(theta_d, alpha, -alpha)


@given(ANGLE, ANGLE, HALF, HALF)
def test_dead_zone_is_monotone_and_never_steeper_than_one(a, b, up, down):
    low, high = sorted((a, b))
    rise = dead_zone(high, up, -down) - dead_zone(low, up, -down)
    assert -1e-16 <= rise <= high - low + 1e-15


def test_dead_zone_with_unequal_break_points():
    assert dead_zone(0.05, 0.03, -0.01) == pytest.approx(0.02)
    assert dead_zone(0.029, 0.03, -0.01) == 0.0
    assert dead_zone(-0.009, 0.03, -0.01) == 0.0
    assert dead_zone(-0.05, 0.03, -0.01) == pytest.approx(-0.04)
    assert dead_zone(0.01, 0.03, 0.02) == pytest.approx(-0.01)  # play wholly on one side


def test_exact_model_tends_to_the_dead_zone_as_damping_vanishes():
    """Slow twist, c falling by tens: the largest torque difference falls in proportion to c."""
    h = 1e-5
    t = h * np.arange(20001)
    theta_d = 0.03 * np.sin(2 * np.pi * 10 * t)
    simple = np.array([K * dead_zone(x, ALPHA, -ALPHA) for x in theta_d[1:]])
    gaps = [np.abs(exact_course(theta_d, h, c=c)[1] - simple).max() for c in (2e-2, 2e-3, 2e-4)]
    assert gaps[0] < 0.1 * np.abs(simple).max()
    for wide, narrow in pairwise(gaps):
        assert 6 < wide / narrow < 16


@given(ANGLE, st.floats(-20, 20))
def test_none_is_a_spring_and_damper(theta_d, omega_d):
    torque = shaft_torque(NONE, theta_d, omega_d, 0.7, ALPHA, -ALPHA, K, C)
    assert torque == K * theta_d + C * omega_d


@given(ANGLE, st.floats(-20, 20))
def test_exact_model_without_play_is_none(theta_d, omega_d):
    exact = shaft_torque(EXACT, theta_d, omega_d, 0.0, 0.0, 0.0, K, C)
    assert exact == shaft_torque(NONE, theta_d, omega_d, 0.0, 0.0, 0.0, K, C)
    assert backlash_angle(theta_d, theta_d + 0.01, 0.0, 0.0, 0.0, 0.5) == 0.0


@given(ANGLE, st.floats(-20, 20), ANGLE, HALF)
def test_exact_torque_is_odd(theta_d, omega_d, theta_b, alpha):
    theta_b = min(max(theta_b, -alpha), alpha)
    up = shaft_torque(EXACT, theta_d, omega_d, theta_b, alpha, -alpha, K, C)
    down = shaft_torque(EXACT, -theta_d, -omega_d, -theta_b, alpha, -alpha, K, C)
    assert up == -down


@given(ANGLE, ANGLE, ANGLE, HALF, st.floats(0, 1))
def test_backlash_angle_is_odd_and_stays_inside(before, after, theta_b, alpha, decay):
    up = backlash_angle(before, after, theta_b, alpha, -alpha, decay)
    assert -alpha <= up <= alpha
    assert backlash_angle(-before, -after, -theta_b, alpha, -alpha, decay) == -up


def test_backlash_angle_with_unequal_break_points():
    beta_1, beta_2 = 0.03, -0.01
    assert backlash_angle(0.0, 0.2, 0.0, beta_1, beta_2, 0.5) == beta_1
    assert backlash_angle(0.0, -0.2, 0.0, beta_1, beta_2, 0.5) == beta_2


@given(ANGLE, ANGLE, HALF, HALF)
def test_play_operator_is_idempotent(theta_p, theta, up, down):
    once = play_operator(theta_p, theta, up, -down)
    assert play_operator(once, theta, up, -down) == once
    assert theta - up <= once <= theta + down


@given(ANGLE, ANGLE, ANGLE, ANGLE, HALF)
def test_play_operator_is_monotone_and_continuous(p_1, p_2, theta_1, theta_2, alpha):
    assume(p_1 <= p_2)
    theta_1, theta_2 = sorted((theta_1, theta_2))
    low = play_operator(p_1, theta_1, alpha, -alpha)
    high = play_operator(p_2, theta_2, alpha, -alpha)
    assert low <= high
    assert high - low <= max(p_2 - p_1, theta_2 - theta_1) + 1e-15


@given(ANGLE, ANGLE, HALF)
def test_play_operator_is_odd(theta_p, theta, alpha):
    up = play_operator(theta_p, theta, alpha, -alpha)
    assert play_operator(-theta_p, -theta, alpha, -alpha) == -up


@given(st.lists(ANGLE, min_size=1, max_size=8), st.integers(1, 7), HALF)
def test_play_operator_is_rate_independent(turns, parts, alpha):
    """Only the turning points count, not how fast or in how many pieces they are reached."""
    coarse = fine = at = 0.0
    for target in turns:
        coarse = play_operator(coarse, target, alpha, -alpha)
        for theta in [*np.linspace(at, target, parts + 1)[1:-1], target]:
            fine = play_operator(fine, float(theta), alpha, -alpha)
        at = target
    assert fine == pytest.approx(coarse, abs=1e-15)


def test_play_operator_loses_the_full_width_at_a_reversal():
    up = play_operator(0.0, 0.2, 0.015, -0.015)
    down = play_operator(up, -0.2, 0.015, -0.015)
    assert up == pytest.approx(0.185)
    assert down == pytest.approx(-0.185)
    assert play_operator(up, 0.2 - 0.0299, 0.015, -0.015) == up  # still inside the gap


def test_two_masses_with_exact_shaft_match_a_stiff_solver():
    """Shaft functions in a two-mass drive against scipy on Eqs. 1, 2 and 6 (start in contact)."""
    j_1, j_2 = 2e-3, 1e-4
    end, h = 0.02, 1e-5

    def rhs(_, y):
        a, b, v_a, v_b = y
        torque = max(K * (a - b - ALPHA) + C * (v_a - v_b), 0.0)
        return [v_a, v_b, (0.1 - torque) / j_1, torque / j_2]

    y0 = [ALPHA, 0.0, 0.0, 0.0]  # pushed on from the first moment: contact never ends
    truth = solve_ivp(rhs, (0, end), y0, rtol=1e-9, atol=1e-12, method="LSODA").y[:, -1]
    a, b, v_a, v_b = y0
    lost, decay = ALPHA, relaxation(K, C, h)
    for _ in range(round(end / h)):
        twist = a - b
        torque = shaft_torque(EXACT, twist, v_a - v_b, lost, ALPHA, -ALPHA, K, C)
        v_a, v_b = v_a + h * (0.1 - torque) / j_1, v_b + h * torque / j_2
        a, b = a + h * v_a, b + h * v_b
        lost = backlash_angle(twist, a - b, lost, ALPHA, -ALPHA, decay)
    assert lost == ALPHA
    np.testing.assert_allclose([a, b, v_a, v_b], truth, rtol=3e-3)
