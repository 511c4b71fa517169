"""LQG and MPC against closed forms and another solver; they balance, and keep their limits."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import minimize

from rig import COMPENSATORS, Course, Rig, draw, simulate, simulate_many
from rig.control.optimal import design, lqg, mpc
from rig.parameters import Servo
from rig.simulation.simulate import Task
from tests.support.simulated import realistic

RIG, WEIGHTS = Rig(), design.Weights()


def test_a_step_is_the_exponential_of_the_axis():
    """p'' = b theta, tau omega' = K V - omega, from rest under 1 V, in closed form."""
    h, k, tau = 0.03, RIG.servo.gain_rad_s_V, RIG.servo.time_constant_s
    _, b = design.axis_step(RIG, h)
    decay = np.exp(-h / tau)
    theta = k * (h - tau * (1 - decay))
    speed = RIG.ball_gain_m_s2 * k * (h**2 / 2 - tau * h + tau**2 * (1 - decay))
    assert b[1:, 0] == pytest.approx([speed, theta, k * (1 - decay)], rel=1e-12)


def test_the_regulator_solves_its_riccati_equation_and_a_backward_recursion_gives_it():
    h = 0.02
    a, b = design.axis_step(RIG, h)
    q, r = (one * h for one in WEIGHTS.cost())
    k, p = design.regulator(RIG, h, WEIGHTS)
    gain = np.linalg.solve(r + b.T @ p @ b, b.T @ p @ a)
    assert a.T @ p @ a - a.T @ p @ b @ gain + q == pytest.approx(p, rel=1e-9, abs=1e-9)
    back = q.copy()
    for _ in range(3000):  # the finite horizon's recursion, which needs no solver
        gain = np.linalg.solve(r + b.T @ back @ b, b.T @ back @ a)
        back = a.T @ back @ (a - b @ gain) + q
    assert gain[0] == pytest.approx(k, rel=1e-6)
    assert np.max(np.abs(np.linalg.eigvals(a - b @ k[None]))) < 1.0


def test_the_filters_gain_is_that_of_the_covariance_recursion():
    f = np.zeros((3, 3))
    f[0, 1] = f[1, 2] = 1.0
    noise = np.diag([0.0, 0.02**2, 0.05**2])
    h, c, seen = 1 / 60, np.array([[1.0, 0.0, 0.0]]), 3e-4**2
    a, process = design.sampled(f, noise, h)
    assert a == pytest.approx(expm(f * h))
    gain, before = design.steady_gain(a, c, process, seen)
    s = np.eye(3)
    for _ in range(5000):
        l = s @ c.T / (c @ s @ c.T + seen)
        s = a @ (s - l @ c @ s) @ a.T + process
    assert before == pytest.approx(s, rel=1e-6)
    assert gain == pytest.approx((s @ c.T / (c @ s @ c.T + seen))[:, 0], rel=1e-6)


def test_process_noise_is_the_integral_that_it_stands_for():
    """Van Loan's block against a sum over the period."""
    f = np.array([[0.0, 1.0, 0.0], [0.0, -20.0, 30.0], [0.0, 0.0, 0.0]])
    noise, h = np.diag([0.0, 4.0, 9.0]), 0.05
    middles = (np.arange(2000) + 0.5) * h / 2000
    sums = sum(expm(f * s) @ noise @ expm(f * s).T for s in middles) * h / 2000
    assert design.sampled(f, noise, h)[1] == pytest.approx(sums, rel=1e-4, abs=1e-12)


def test_mpc_without_active_bounds_is_the_regulator():
    h, linear, _, _ = mpc.problem(RIG, WEIGHTS)
    k, _ = design.regulator(RIG, mpc.PERIOD_S, WEIGHTS)
    assert -np.linalg.solve(h, linear)[0] == pytest.approx(-k, rel=1e-9)
    q, start = mpc.settings(RIG, WEIGHTS), np.array([1e-3, 2e-3, 1e-3, 0.01])
    x = np.zeros(1, mpc.SOLVER)[0]
    for _ in range(20):  # warm starts: the fixed iterations go on
        mpc.solve(x, q, start, -6.0, 6.0, -0.5, 0.5)
    assert x["moves"][0] == pytest.approx(-k @ start, rel=1e-4)


def test_mpc_with_active_bounds_is_what_another_solver_finds():
    rng, q = np.random.default_rng(1), mpc.settings(RIG, WEIGHTS)
    h, linear, turned, free = mpc.problem(RIG, WEIGHTS)
    volts, angle = RIG.servo.voltage_limit_V, RIG.servo.angle_limit_rad
    active = compared = 0
    for _ in range(25):
        start = np.array(
            [rng.uniform(-0.12, 0.12), rng.uniform(-0.3, 0.3), rng.uniform(-0.4, 0.4), 0.0]
        )
        x = np.zeros(1, mpc.SOLVER)[0]
        mpc.solve(x, q, start, -volts, volts, -angle, angle)
        bounds = (
            {"type": "ineq", "fun": lambda u, s=start: angle - turned @ u - free @ s},
            {"type": "ineq", "fun": lambda u, s=start: angle + turned @ u + free @ s},
        )
        exact = minimize(
            lambda u, s=start: 0.5 * u @ h @ u + linear @ s @ u,
            np.zeros(mpc.MOVES),
            jac=lambda u, s=start: h @ u + linear @ s,
            method="SLSQP",
            bounds=[(-volts, volts)] * mpc.MOVES,
            constraints=bounds,
            options={"maxiter": 400, "ftol": 1e-10},
        )
        if not exact.success:
            continue
        compared += 1
        active += bool(np.any(np.abs(exact.x) > volts - 1e-6))
        first = min(max(float(x["moves"][0]), -volts), volts)
        assert abs(first - exact.x[0]) < 0.02 * volts
    assert compared >= 20
    assert active >= 10


def ran(arm: str, rig: Rig, known: Rig, seconds: float, start_m=(-0.1, 0.1), target=(0.0, 0.0)):
    n = round(seconds * rig.control_rate_hz)
    course = Course(np.tile(target, (n, 1)), np.zeros((n, 2)), start_m=start_m, hold_s=0.5)
    numbers = draw(np.random.default_rng(3), rig, course)
    return Task(rig, known, COMPENSATORS[arm], course, numbers)


@pytest.mark.parametrize("arm", ["lqg", "mpc"])
def test_the_ball_is_balanced_and_one_run_has_the_bits_of_many(arm: str):
    rig = realistic()
    task = ran(arm, rig, replace(rig, effects={}), 10.0)
    alone = simulate(task.rig, task.known, task.compensator, task.course, task.draws)
    many = simulate_many([task] * 3)
    assert alone.outcome == "completed"
    assert np.array_equal(alone.log.rows, many[2].log.rows, equal_nan=True)
    late = alone.log.where(slice(-1500, None))
    place = np.column_stack([late["ball_x_m"], late["ball_y_m"]])
    assert np.sqrt(np.nanmean(place**2)) < 0.003
    assert np.nanmax(np.abs(alone.log["voltage_x_V"])) <= rig.servo.voltage_limit_V


@pytest.mark.parametrize("arm", ["lqg", "mpc"])
def test_a_tight_angle_limit_is_held(arm: str):
    limit = 0.12
    rig = Rig(servo=Servo(angle_limit_rad=limit))
    task = ran(arm, rig, rig, 6.0)
    run = simulate(task.rig, task.known, task.compensator, task.course, task.draws)
    assert run.outcome == "completed"
    angles = np.column_stack([run.log["theta_x_rad"], run.log["theta_y_rad"]])
    assert np.abs(angles).max() > 0.8 * limit
    assert np.abs(angles).max() < limit + np.radians(0.3)  # what the limiter holds of anybody
    wanted = np.column_stack([run.log["desired_theta_x_rad"], run.log["desired_theta_y_rad"]])
    assert np.nanmax(np.abs(wanted)) <= limit + 1e-12


@pytest.mark.parametrize("arm", ["lqg", "mpc"])
def test_a_table_off_level_is_no_offset_of_the_ball(arm: str):
    slopes = {"level_offset": {"x": {"slope_rad": 0.004}, "y": {"slope_rad": -0.003}}}
    rig = Rig(effects=slopes)
    task = ran(arm, rig, Rig(), 12.0, start_m=(0.0, 0.0))
    run = simulate(task.rig, task.known, task.compensator, task.course, task.draws)
    late = run.log.where(slice(-2000, None))
    mean = [np.nanmean(late["ball_x_m"]), np.nanmean(late["ball_y_m"])]
    assert np.abs(mean).max() < 0.001


def test_servos_that_take_an_angle_are_refused():
    from rig.control import tick

    with pytest.raises(ValueError, match="commands volts"):
        tick.settings(Rig(servo=Servo(kind="position")), COMPENSATORS["mpc"])


def test_a_frame_that_comes_late_corrects_what_was_then():
    """On a ball that rolls as the model says, frames of any age leave the filter on its path."""
    from rig.control import controllers
    from rig.table import R_BALL, R_EXPOSED, R_NEW, R_THETA, R_TIME, READING_SIZE

    q, g = lqg.settings(RIG, WEIGHTS), controllers.settings(RIG, COMPENSATORS["lqg"])
    s, reading = np.zeros(1, lqg.LQG_STATE)[0], np.zeros(READING_SIZE)
    for k in range(500):
        t = k * g["tick_s"]
        reading[R_TIME], reading[R_THETA], reading[R_NEW] = t, 0.0, float(k % 8 == 0)
        reading[R_EXPOSED] = t - 0.012 - 0.01 * (k % 16 == 0)  # late, and in order
        reading[R_BALL] = 0.01 + 0.05 * reading[R_EXPOSED]
        lqg.estimate(s, q, g, reading, 0, 0.01, 0.0)
    ball = s["axes"][0]["ball"]
    assert ball[0] == pytest.approx(0.01 + 0.05 * t, abs=2e-5)
    assert ball[1] == pytest.approx(0.05, abs=1e-3)
