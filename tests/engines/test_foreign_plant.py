"""The foreign table against closed forms: one effect at a time, no noise, everything by hand."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.benchmark.engines.foreign.parts import packed
from experiments.benchmark.engines.foreign.plant import RATIO, G, _behind, _servo, _tilt
from experiments.benchmark.engines.foreign.table import CAMERA_DELAY_S
from experiments.benchmark.engines.foreign.truth import plant_and_eye
from tests.support.foreign.runs import bang, quiet, seen, slope

K, TAU, FACTOR = 1.53, 0.025, 0.6
COUNT = 2 * np.pi / 4096
RNG = np.random.default_rng


def test_a_positive_voltage_raises_the_angle_as_a_first_order_servo():
    log = quiet(way=(1, -1), pilot=bang(2.0))
    t = log["t_s"]
    expected = K * 2.0 * (t - TAU * (1 - np.exp(-t / TAU)))
    assert np.abs(log["theta_x_rad"] - expected).max() < 0.51 * COUNT
    assert np.abs(log["theta_y_rad"] + expected).max() < 0.51 * COUNT


@dataclass(frozen=True)
class Steady:
    """With `volts` on the terminals of x, and of y, the motor of x turns as with `effective`."""

    effect: str
    pairs: dict[str, float]
    volts: float
    effective: float


STEADY = [
    Steady("coulomb_friction", {"friction_V": 0.3}, 1.0, 0.7),
    Steady("coulomb_friction", {"friction_V": 0.3}, -1.0, -0.7),
    Steady("coulomb_friction", {"friction_V": 0.3}, 0.29, 0.0),
    Steady("stribeck_friction", {"extra_V": 0.3, "speed_rad_s": 0.1}, 1.0, 1.0),
    Steady("stribeck_friction", {"extra_V": 0.3, "speed_rad_s": 0.1}, 0.29, 0.0),
    Steady("dead_zone", {"half_width_V": 0.2}, 1.0, 0.8),
    Steady("dead_zone", {"positive_V": 0.2, "negative_V": 0.1}, -1.0, -0.9),
    Steady("dead_zone", {"positive_V": 0.2}, 0.19, 0.0),
    Steady("gain_asymmetry", {"fraction": 0.1}, 1.0, 1.1),
    Steady("gain_asymmetry", {"fraction": 0.1}, -1.0, -0.9),
    Steady("viscous_asymmetry", {"fraction_1": 0.25}, 1.0, 0.8),
    Steady("viscous_asymmetry", {"fraction_1": 0.2}, -1.0, -1.25),
    Steady("voltage_offset", {"offset_V": 0.1}, -1.0, -0.9),
    Steady("saturation", {"limit_V": 0.6}, -1.0, -0.6),
    Steady("gain_drift", {"rate_1_s": 0.1}, 1.0, 0.9 + 0.1 * (TAU + 0.002)),
    Steady("supply_sag", {"drop_1_V": 0.05}, 1.0, 0.9),
]


@pytest.mark.parametrize("case", STEADY, ids=lambda c: f"{c.effect} {c.volts}")
def test_what_the_volts_are_worth_after_a_second(case: Steady):
    where = "xy" if case.effect == "supply_sag" else "x"
    way = np.sign(case.volts) * np.ones(2)
    log = quiet({case.effect: {where: case.pairs}}, way=way, pilot=bang(abs(case.volts)))
    assert log["motor_speed_x_rad_s"][-1] == pytest.approx(K * case.effective, abs=2e-4 * K)
    if where == "x":
        assert log["motor_speed_y_rad_s"][-1] == pytest.approx(K * case.volts, abs=1e-6)


def test_cogging_pulls_towards_its_angles():
    """At rest: the zeros of A sin(n theta + phase) with falling slope hold; others are left."""
    pairs = {"amplitude_V": 0.3, "phase_rad": 0.5, "periods_per_turn": 20.0}
    log = quiet({"cogging": {"x": pairs}})
    assert log["theta_x_rad"][-1] == pytest.approx((np.pi - 0.5) / 20, abs=0.6 * COUNT)


def test_friction_stops_a_coasting_servo_where_the_closed_form_does():
    """omega = (w + c) exp(-t/tau) - c with c = K F, and then it stands; F holds up to F."""
    F, w, h = 0.3, 1.0, 2.5e-4
    effects = {"coulomb_friction": {"x": {"friction_V": F}}}
    plant = packed(plant_and_eye(effects, (K, K), (TAU, TAU), delay_s=0.0, factor=0.6)[0])
    theta, omega, steps = 0.0, w, 0
    while omega != 0.0:
        theta, omega = _servo(plant, 0, theta, omega, 0.0, h)
        steps += 1
    c = K * F
    stop = TAU * np.log((w + c) / c)
    assert steps * h == pytest.approx(stop, abs=h)
    assert theta == pytest.approx((w + c) * TAU * (1 - np.exp(-stop / TAU)) - c * stop, abs=1e-5)
    assert _servo(plant, 0, theta, 0.0, 0.999 * F, h) == (theta, 0.0)
    assert _servo(plant, 0, theta, 0.0, -1.001 * F, h)[1] < 0


@pytest.mark.parametrize("delay", [0.0007, 0.002, 0.0113])
def test_a_delayed_servo_is_a_shifted_one(delay: float):
    late = quiet({"input_delay": {"x": {"delay_s": delay}}}, way=(1, 1), pilot=bang(3.0))
    t = np.maximum(late["t_s"] - delay, 0)
    expected = K * 3.0 * (t - TAU * (1 - np.exp(-t / TAU)))
    assert np.abs(late["theta_x_rad"] - expected).max() < 0.51 * COUNT
    assert np.abs(late["motor_speed_x_rad_s"] - 3 * K * (1 - np.exp(-t / TAU))).max() < 0.02


@given(st.floats(0, 0.1), st.floats(-0.05, 0.05), st.lists(st.floats(-1, 1), max_size=30))
def test_what_is_behind_a_play_stays_unless_moved(width, middle, drive):
    """Within the play it stays where it was left, and it never leaves the play."""
    out = -middle
    for d in drive:
        new = _behind(out, d, width, middle)
        assert abs(d - middle - new) <= width / 2 + 1e-12
        if abs(d - middle - out) <= width / 2:
            assert new == pytest.approx(out, abs=1e-15)
        out = new


def test_gear_play_is_what_the_motor_turns_before_the_encoder_follows():
    way = np.where(np.arange(500) < 250, 1.0, -1.0)[:, None] * [1, 1]
    play = 0.05
    log = quiet({"gear_backlash": {"x": {"play_rad": play}}}, way=way, pilot=bang(2.0))
    motor, arm = log["theta_y_rad"], log["theta_x_rad"]
    assert arm[240] == pytest.approx(motor[240] - play / 2, abs=1.1 * COUNT)
    assert arm[-1] == pytest.approx(motor[-1] + play / 2, abs=1.1 * COUNT)


def sines(effects, theta) -> np.ndarray:
    """Tilt sines (n, 2) of a table that is led through the angles theta (n, 2)."""
    plant = packed(plant_and_eye(effects, (K, K), (TAU, TAU), delay_s=0.0, factor=0.6)[0])
    tilt: Any = _tilt  # compiled
    joint, out = np.zeros(2), np.zeros((len(theta), 2))
    for load, s in zip(np.array(theta, float), out, strict=True):
        tilt(plant, load, joint, s)
    return out


def test_linkage_and_ripple_are_the_catalogues_equations():
    theta = RNG(1).uniform(-0.4, 0.4, (20, 2))
    x, y = theta.T
    effects = {
        "transmission_ripple": {
            "x": {"amplitude_rad": 0.01, "phase_rad": 0.7, "periods_per_turn": 9.0}
        },
        "linkage_quadratic": {"y": {"coefficient_1_rad": 0.2}},
        "cross_coupling": {"y": {"fraction": 0.1}},
    }
    felt_x = x + 0.01 * (np.sin(9 * x + 0.7) - np.sin(0.7))
    felt_y = np.sin(y + 0.2 * y**2) + 0.1 * np.sin(felt_x)
    expected = RATIO * np.column_stack([np.sin(felt_x), felt_y])
    np.testing.assert_allclose(sines(effects, theta), expected, atol=1e-14)
    cubic = sines({"linkage_cubic": {"x": {"coefficient_1_rad2": 0.5}}}, theta)
    np.testing.assert_allclose(cubic[:, 0], RATIO * np.sin(x + 0.5 * x**3), atol=1e-14)


def test_joint_play_loses_its_width_at_a_reversal():
    up = np.linspace(0, 0.2, 50)
    theta = np.column_stack([np.concatenate([up, up[::-1]]), np.zeros(100)])
    effects = {"joint_backlash": {"x": {"play_rad": 0.04}}}
    found = np.arcsin(sines(effects, theta)[:, 0] / RATIO)
    assert found[49] == pytest.approx(0.18)
    back = np.interp(-0.1, -theta[50:, 0], found[50:])
    assert back == pytest.approx(0.12, abs=1e-3)


def test_a_ball_on_a_slope_and_the_camera_that_sees_it():
    """x = k g s t^2/2; frames are in use 12 ms after their light, by a tick at most."""
    log = quiet(slope(0.01, -0.02), ball=(0, 0, 0, 0, 0))
    t, xy = seen(log)
    np.testing.assert_allclose(
        xy, np.outer(t**2 / 2, FACTOR * G * np.array([0.01, -0.02])), atol=1e-9
    )
    late = log["t_s"][np.isfinite(log["ball_x_m"])] - t - CAMERA_DELAY_S
    assert late.min() > -1e-8
    assert late.max() < 0.002


CAMERA = {
    "camera_scale": ({"fraction": 0.02}, lambda x, y, t: (1.02 * x, 1.02 * y)),
    "camera_yaw": (
        {"angle_rad": 0.1},
        lambda x, y, t: (x * np.cos(0.1) - y * np.sin(0.1), x * np.sin(0.1) + y * np.cos(0.1)),
    ),
    "lens_distortion": (
        {"k1_1_m2": 2.0},
        lambda x, y, t: (x * (1 + 2 * (x * x + y * y)), y * (1 + 2 * (x * x + y * y))),
    ),
    "camera_delay": (
        {"extra_s": 0.02},
        lambda x, y, t: (x * ((t - 0.02) / t) ** 2, y * ((t - 0.02) / t) ** 2),
    ),
}


@pytest.mark.parametrize("name", CAMERA)
def test_what_a_wrong_camera_says(name: str):
    pairs, wrong = CAMERA[name]
    t, xy = seen(quiet(slope(0.01, 0.02) | {name: {"xy": pairs}}, ball=(0, 0, 0, 0, 0)))
    true = np.outer(t**2 / 2, FACTOR * G * np.array([0.01, 0.02]))
    np.testing.assert_allclose(xy, np.column_stack(wrong(*true.T, t)), atol=1e-9)  # pyright: ignore[reportCallIssue]


def test_level_drift_grows():
    t, xy = seen(quiet({"level_drift": {"x": {"rate_rad_s": 0.01}}}, ball=(0, 0, 0, 0, 0)))
    np.testing.assert_allclose(xy[:, 0], FACTOR * G * 0.01 * t**3 / 6, atol=1e-7)


def test_a_bowl_swings_the_ball_and_drag_and_rolling_slow_it():
    t, xy = seen(quiet({"plate_bowl": {"xy": {"stiffness_1_s2": 4.0}}}, ball=(0.05, 0, 0, 0.1, 0)))
    np.testing.assert_allclose(xy[:, 0], 0.05 * np.cos(2 * t), atol=1e-6)
    np.testing.assert_allclose(xy[:, 1], 0.05 * np.sin(2 * t), atol=1e-6)
    t, xy = seen(quiet({"viscous_drag": {"xy": {"rate_1_s": 0.8}}}, ball=(0, 0, 0.1, 0, 0)))
    np.testing.assert_allclose(xy[:, 0], 0.1 / 0.8 * (1 - np.exp(-0.8 * t)), atol=1e-6)
    effects = {"rolling_resistance": {"xy": {"deceleration_m_s2": 0.2}}}
    t, xy = seen(quiet(effects, ball=(0, 0, 0.06, -0.08, 0)))
    until = np.minimum(t, 0.5)
    way = (0.1 * until - 0.1 * until**2)[:, None] * [0.6, -0.8]
    np.testing.assert_allclose(xy, way, atol=2e-5)


def test_rolling_resistance_holds_a_ball_on_a_slope_below_it():
    for factor, moves in ((0.99, False), (1.01, True)):
        held = FACTOR * G * 0.01 / factor
        effects = {"rolling_resistance": {"xy": {"deceleration_m_s2": held}}}
        _, xy = seen(quiet(slope(0.01, 0) | effects, ball=(0.01, 0, 0, 0, 0)))
        assert (abs(xy[-1, 0] - 0.01) > 1e-5) == moves
