"""The worlds of `tests/support/worlds` against closed forms, and how an answer is scored."""

import ast
from pathlib import Path

import numpy as np
import pytest

from tests.support import ROOT
from tests.support.worlds import WORLDS, logs
from tests.support.worlds.belts import Belt, belt_step
from tests.support.worlds.loops import run_axis, run_positions
from tests.support.worlds.plant import TOOTH_RAD, G_m_s2, STEP_s, ball_step, servo_step
from tests.support.worlds.score import outcome

h = STEP_s


def roll(plate, seconds, start=(0.0, 0.0, 0.0, 0.0), tilt=(0.0, 0.0), heavy=(0.0, 0.0, -1.0)):
    """Path (n, 6) of a ball on a plate that stands still at `tilt` rad."""
    ball, still = np.array([*start, start[2], start[3]]), np.zeros(2)
    heavy, path = np.array(heavy), []
    for _ in range(int(seconds / h)):
        ball_step(ball, heavy, np.array(tilt), still, still, still, plate, h)
        path.append(ball.copy())
    return np.array(path)


def axis(volts, **changes):
    """(V, theta, omega) of a single axis under given volts, 500 rows a second."""
    zero = np.zeros(len(volts))
    return run_axis(
        logs.servo(**changes), 500.0, 1e9, 0.0, 99.0, zero, np.asarray(volts, float), zero
    )


@pytest.mark.parametrize(("spin", "factor"), [(logs.SOLID, 5 / 7), (logs.HOLLOW, 3 / 5)])
def test_a_constant_tilt_gives_the_rolling_balls_acceleration(spin, factor):
    path = roll(logs.ball(spin=spin), 1.0, tilt=(0.03, -0.01))
    expected = factor * G_m_s2 * np.sin([0.03, -0.01])
    np.testing.assert_allclose(path[-1, 2:4], expected, rtol=1e-9)
    np.testing.assert_allclose(path[-1, :2], 0.5 * expected, rtol=1e-3)


def test_energy_of_a_ball_without_friction_is_conserved():
    path = roll(logs.ball(bowl_1_s2=4.0), 5.0, start=(0.08, 0.0, 0.0, 0.1))
    energy = 0.5 * (path[:, 2] ** 2 + path[:, 3] ** 2) + 2.0 * (path[:, 0] ** 2 + path[:, 1] ** 2)
    np.testing.assert_allclose(energy, energy[0], rtol=1e-3)


def test_a_bowl_swings_with_the_root_of_its_stiffness():
    path = roll(logs.ball(bowl_1_s2=4.0), 3.0, start=(0.08, 0.0, 0.0, 0.0))
    t = h * np.arange(1, len(path) + 1)
    np.testing.assert_allclose(path[:, 0], 0.08 * np.cos(2.0 * t), atol=1e-4)


def test_a_jerk_of_the_plate_moves_the_ball_by_its_radius():
    """-r phi'': while the plate turns by phi in no time, the ball goes back by r phi."""
    plate, ball = logs.ball(), np.zeros(6)
    rate, none = np.array([4.0, 0.0]), np.zeros(2)
    for k in range(10):
        phi = rate * h * (k + 1)
        old = none if k == 0 else rate
        ball_step(ball, np.array([0.0, 0.0, -1.0]), phi, rate, old, none, plate, h)
    assert ball[0] == pytest.approx(-plate.radius_m * 10 * h * 4.0, rel=0.01)


def test_a_turning_plate_throws_the_ball_outwards():
    """k x phi_x'^2 along x and k x phi_x' phi_y' along y."""
    rate, none, plate = np.array([2.0, 1.0]), np.zeros(2), logs.ball()
    gained = []
    for x in (0.1, 0.0):
        ball = np.array([x, 0.0, 0.0, 0.0, *(plate.radius_m * rate)])
        ball_step(ball, np.array([0.0, 0.0, -1.0]), none, rate, rate, none, plate, h)
        gained.append(ball[2:4] / h)
    np.testing.assert_allclose(gained[0] - gained[1], [0.6 * 0.1 * 4.0, 0.6 * 0.1 * 2.0], rtol=1e-6)


def test_a_ball_on_oil_slides():
    path = roll(logs.ball(mu=0.004), 0.5, tilt=(0.05, 0.0))
    assert path[-1, 2] / 0.5 == pytest.approx(G_m_s2 * (np.sin(0.05) - 0.004), rel=1e-6)


def test_a_heavy_side_swings_about_the_bottom():
    """omega^2 = k g e / r^2 for small angles."""
    plate = logs.ball(off_centre_m=0.0002)
    omega = np.sqrt(0.6 * G_m_s2 * 0.0002) / plate.radius_m
    path = roll(plate, 3.0, start=(0.0, 0.0, 0.002, 0.0))
    t = h * np.arange(1, len(path) + 1)
    np.testing.assert_allclose(path[:, 0], 0.002 / omega * np.sin(omega * t), atol=3e-5)


def test_a_wall_keeps_the_ball_and_takes_energy():
    path = roll(logs.ball(walls=True), 2.0, start=(0.1, 0.0, 0.1, 0.0))
    assert path[:, 0].max() == pytest.approx(0.1375 - 0.019625)
    assert -0.1 < path[-1, 2] < -0.04


def test_a_step_of_volts_shows_gain_and_time_constant():
    t = np.arange(500) / 500.0
    expected = 1.53 * 2.0 * (t - 0.025 * (1.0 - np.exp(-t / 0.025)))
    np.testing.assert_allclose(axis(np.full(500, 2.0))[:, 1], expected, atol=2e-5)


@pytest.mark.parametrize(
    ("changes", "stays", "goes"),
    [({"dead_V": 1.3}, 1.29, 1.35), ({"friction_V": 0.17}, 0.169, 0.175)],
)
def test_nothing_moves_below_dead_zone_or_friction(changes, stays, goes):
    for sign in (1.0, -1.0):
        assert not axis(sign * np.full(200, stays), **changes)[:, 1].any()
        assert sign * axis(sign * np.full(200, goes), **changes)[-1, 1] > 1e-3


@pytest.mark.parametrize(
    ("changes", "lost_V"),
    [
        ({"friction_V": 0.2}, 0.2),
        ({"friction_V": 0.2, "softness_rad_s": 0.05}, 0.2),
        ({"dead_V": 1.3}, 1.3),
        ({"joint_V": 0.155}, 0.155),
        ({"offset_V": -0.1}, 0.1),
    ],
)
def test_speed_that_a_loss_of_volts_leaves(changes, lost_V):
    speed = axis(np.full(500, 3.0), **changes)[-1, 2]
    assert speed == pytest.approx(1.53 * (3.0 - lost_V), rel=1e-6)


def test_viscous_friction_differs_by_direction():
    up, down = (axis(np.full(2000, V), drag_V_s=0.1)[-1, 2] for V in (2.0, -2.0))
    assert up == pytest.approx(2.0 / (1.0 / 1.53 + 0.1), rel=1e-6)
    assert down == pytest.approx(-2.0 / (1.0 / 1.53 - 0.1), rel=1e-6)


def test_friction_of_one_direction_leaves_the_other_alone():
    up, down = (axis(np.full(500, V), one_way_V=0.2)[-1, 2] for V in (2.0, -2.0))
    assert up == pytest.approx(1.53 * 1.8, rel=1e-6)
    assert down == pytest.approx(-1.53 * 2.0, rel=1e-6)


def test_a_tooth_that_rubs_stops_the_shaft_where_its_friction_reaches_the_volts():
    """F exp(-((theta - theta_0)/w)^2) = V at theta_0 - w sqrt(ln(F/V)): there the speed that 0.2 V
    give is lost within tau."""
    tooth = {"tooth_V": 0.6, "tooth_rad": 0.2}
    stalled = axis(np.full(2000, 0.2), **tooth)[-1, 1]
    reached = 0.2 - TOOTH_RAD * np.sqrt(np.log(3.0))
    assert reached < stalled < reached + 1.53 * 0.2 * 0.025
    assert axis(np.full(2000, 0.7), **tooth)[-1, 1] > 0.5


def reversal(p, coming_V, going_V):
    """Shaft states (n, 6) after a second at one voltage and half a second at the other."""
    shaft, path = np.zeros(6), []
    for V, seconds in ((coming_V, 1.0), (going_V, 0.5)):
        for _ in range(int(seconds / h)):
            servo_step(shaft, V, 0.0, p, 0, h)
            path.append(shaft.copy())
    return np.array(path)


def test_play_is_crossed_at_a_reversal():
    path = reversal(logs.servo(joint_rad=0.035), 1.0, -1.0)
    assert path[3999, 2] - path[3999, 4] == pytest.approx(0.0175)
    assert path[-1, 2] - path[-1, 4] == pytest.approx(-0.0175)
    gears = logs.servo(gear_rad=0.035, coast_1_s=4.0, coast_rad_s2=8.0)
    path = reversal(gears, 1.0, -1.0)
    assert path[3999, 0] - path[3999, 2] == pytest.approx(0.0175)
    assert path[-1, 0] - path[-1, 2] == pytest.approx(-0.0175)


def test_an_arm_coasts_through_the_gap_of_its_gears():
    gears = logs.servo(gear_rad=0.2, coast_rad_s2=20.0)
    path = reversal(gears, 1.0, 0.0)
    ahead = path[:, 2] - path[:, 0]
    assert ahead[3999] == pytest.approx(-0.1)
    assert ahead[-1] > -0.09


def test_a_loose_plate_does_not_load_the_arm():
    """At the flank the plate's friction holds the arm; back through the gap nothing does."""
    p = logs.servo(joint_rad=0.1, joint_V=0.5)
    assert reversal(p, 1.0, 0.49)[-1, 1] == pytest.approx(0.0, abs=1e-6)
    assert reversal(p, 1.0, -0.1)[-1, 1] == pytest.approx(-0.153, rel=1e-3)


def test_a_plate_falls_through_the_joint_to_the_side_of_the_ball_and_bounces():
    """Through a gap g under a constant acceleration a: after sqrt(2 g / a), with sqrt(2 g a)."""
    p = logs.servo(joint_rad=0.035, fall_1_m_s2=85.0, bounce=0.5)
    shaft, fallen = np.array([0.0, 0.0, 0.0, 0.0, -0.0175, 0.0]), []
    for _ in range(int(1.0 / h)):
        servo_step(shaft, 0.0, 0.05, p, 0, h)
        fallen.append(shaft[4:].copy())
    angle, rate = np.array(fallen).T
    a, g = 85.0 * 0.05, 0.035
    assert angle[-1] == pytest.approx(0.0175, abs=1e-6)
    assert rate.max() == pytest.approx(np.sqrt(2.0 * g * a), rel=0.01)
    assert rate.min() == pytest.approx(-0.5 * np.sqrt(2.0 * g * a), rel=0.01)
    assert h * (1 + rate.argmax()) == pytest.approx(np.sqrt(2.0 * g / a), rel=0.01)


@pytest.mark.parametrize("delay_s", [0.112, 0.262])
def test_the_delay_found_by_correlation_is_the_one_put_in(delay_s):
    rng = np.random.default_rng(0)
    n, hz = 6000, 100.0
    gains = {"kp_rad_m": 0.6, "kd_rad_s_m": 1.0, "ki_rad_m_s": 0.0, "speed_filter_s": 0.2}
    loop = logs.loop(rows_hz=hz, delay_s=delay_s, **gains)
    targets = np.stack([logs.steps(rng, n, hz, 0.05) for _ in range(2)], axis=1)
    push, noise = np.zeros((n, 2)), np.zeros((n, 2))
    log = run_positions(logs.ball(spin=logs.SOLID), loop, targets, push, noise)
    window = np.hanning(41) / np.hanning(41).sum()
    theta = np.convolve(log[:, 0], window, "same")[100:-100]
    force = np.convolve(np.gradient(np.gradient(log[:, 2])), window, "same")[100:-100]
    lags = np.arange(45)
    fit = [np.corrcoef(theta[: len(theta) - lag], force[lag:])[0, 1] for lag in lags]
    best = int(np.argmax(fit))
    assert fit[best] > 0.95
    assert best / hz == pytest.approx(delay_s, abs=0.011)


def test_noise_has_the_size_and_colour_asked_for():
    rng = np.random.default_rng(1)
    red = logs.coloured(rng, (50000, 2), 0.03, 0.3, 500.0)
    assert red.std() == pytest.approx(0.03, rel=0.15)
    lag = np.mean(red[150:] * red[:-150]) / np.mean(red**2)
    assert lag == pytest.approx(np.exp(-1.0), abs=0.1)
    power = np.abs(np.fft.rfft(logs.pink(rng, (2**16, 1), 0.02)[:, 0])) ** 2
    low, high = power[10:100].mean(), power[1000:10000].mean()
    assert low / high == pytest.approx(100.0, rel=0.4)


def test_a_log_has_the_contracts_columns():
    columns, rig, truth = WORLDS["five_runs"](0)
    assert list(columns)[:5] == "t_s voltage_x_V voltage_y_V theta_x_rad theta_y_rad".split()
    assert np.count_nonzero(np.diff(columns["t_s"]) < 0) == 4
    seen = np.mean(np.isfinite(columns["ball_x_m"]))
    assert seen == pytest.approx(60.0 / 500.0, rel=0.01)
    assert "[drive]" in rig
    assert truth["kind"] == "effect"


def test_the_worlds_share_no_code_with_the_product():
    for path in Path(ROOT, "tests/support/worlds").glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            roots = {name.split(".")[0] for name in names}
            assert not roots & {"rig", "vision", "calibration", "experiments"}, path


def told(verdict, *effects, **more):
    entries = [{"name": n, "probability": p, "twins": []} for n, p in effects]
    return {"verdict": verdict, "effects": entries} | more


DELAY = logs.truth({"camera_delay": {"xy": {"extra_s": 0.1}}}, "level_offset")
GAIN = logs.truth({}, kind="recalibrate", calibrated={"gain_x_rad_s_V": 2.9})
STRANGE = logs.truth({}, "cogging", kind="unknown")
SURE_DELAY, SURE_LENS = ("camera_delay", 1.0), ("lens_distortion", 0.95)


@pytest.mark.parametrize(
    ("expected", "truth", "answer"),
    [
        ("right", DELAY, told("named", SURE_DELAY, ("level_offset", 0.99))),
        ("wrong", DELAY, told("named", SURE_DELAY, SURE_LENS)),
        ("missed", DELAY, told("named", ("level_offset", 0.99))),
        ("missed", DELAY, told("nothing-missing")),
        ("honest", DELAY, told("undecided", SURE_LENS)),
        ("failed", DELAY, None),
        ("right", logs.truth({}, kind="healthy"), told("nothing-missing")),
        ("wrong", logs.truth({}, kind="healthy"), told("named", SURE_LENS)),
        ("honest", logs.truth({}, kind="healthy"), told("unknown-effect")),
        ("right", STRANGE, told("unknown-effect")),
        ("right", STRANGE, told("named", ("cogging", 1.0))),
        ("missed", STRANGE, told("nothing-missing")),
        ("missed", GAIN, told("nothing-missing", calibrated={})),
        ("right", GAIN, told("nothing-missing", calibrated={"gain_x_rad_s_V": {"value": 2.85}})),
    ],
)
def test_how_an_answer_is_scored(expected, truth, answer):
    assert outcome(answer, truth) == expected


def swung(belt: Belt, volts: float, seconds: float) -> np.ndarray:
    """States (n, 4) of a servo with a belt under constant volts."""
    state, path = np.zeros(4), []
    for _ in range(int(seconds / h)):
        belt_step(state, volts, belt, h)
        path.append(state.copy())
    return np.array(path)


def test_behind_a_belt_both_masses_turn_with_the_motors_gain():
    belt = Belt(0.3, 9.0, 0.1, friction_V=0.1)
    end = swung(belt, 2.0, 3.0)[-1]
    np.testing.assert_allclose(end[[1, 3]], belt.gain_rad_s_V * 1.9, rtol=1e-6)


def test_an_arm_on_a_belt_swings_against_its_motor():
    """Without the motor's damping at (w0^2/(1 - s))^1/2, the arm's own frequency being w0."""
    belt = Belt(0.25, 9.0, 0.0, friction_V=0.0, tau_s=1e6)
    state, twists = np.array([0.1, 0.0, 0.0, 0.0]), []
    for _ in range(int(2.0 / h)):
        belt_step(state, 0.0, belt, h)
        twists.append(state[0] - state[2])
    t = h * np.arange(1, len(twists) + 1)
    expected = 0.1 * np.cos(2.0 * np.pi * 9.0 / np.sqrt(0.75) * t)
    np.testing.assert_allclose(twists, expected, atol=0.002)
