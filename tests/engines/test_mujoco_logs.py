"""Logs of the MuJoCo table: closed forms where MuJoCo does the mechanics, and the foreign table.

Steps of 0.2 ms of first order: a tenth of a millisecond of the servo's way, and 1 ms between two
looks at forces. Its own dry friction is 0.012 V.
"""

from functools import cache

import numpy as np
import pytest

from experiments.benchmark.engines.foreign import table as foreign_table
from experiments.benchmark.engines.foreign.parts import Pilot
from experiments.benchmark.engines.foreign.plant import G
from experiments.benchmark.engines.foreign.table import completed
from experiments.benchmark.engines.foreign.truth import (
    EYE_KEYS,
    PLANT_KEYS,
    axes_of,
    plant_and_eye,
)
from experiments.benchmark.engines.mujoco_engine import logs as mujoco_logs
from experiments.benchmark.engines.mujoco_engine.hidden import (
    ARM_FRICTION_NM,
    BLOCK_S,
    JOINT_FRICTION_NM,
    HiddenTable,
    sine_as_cubic,
)
from rig.parameters import Servo
from tests.support.foreign.runs import SLACK, bang, nothing_odd, quiet, seen, slope
from tests.support.parts import need

need("mujoco")

FACTOR, RATIO = 0.6, 2 * 0.0254 / 0.275
OWN_FRICTION_V = (ARM_FRICTION_NM + JOINT_FRICTION_NM) / Servo().torque_per_volt_nm


def still(effects=None, *, ball=None, odd=None, seconds=1.0, pilot: Pilot = SLACK, **more):
    """A quiet run on the MuJoCo table."""
    return quiet(
        effects,
        ball=ball,
        odd=odd,
        seconds=seconds,
        pilot=pilot,
        engine=mujoco_logs.run,
        step_s=BLOCK_S,
        **more,
    )


def test_each_servo_answers_a_step_with_its_own_gain_time_constant_and_friction():
    gain, tau, dry = (1.60, 1.45), (0.030, 0.024), (OWN_FRICTION_V, 0.2)
    effects = {"coulomb_friction": {"y": {"friction_V": 0.2}}}
    log = still(effects, gain=gain, tau=tau, way=(1, -1), pilot=bang(0.8), seconds=0.4)
    t = log["t_s"]
    for a, K, T, F, sign in zip("xy", gain, tau, dry, (1, -1), strict=True):
        expected = sign * K * (0.8 - F) * (t - T * (1 - np.exp(-t / T)))
        assert np.abs(log[f"theta_{a}_rad"] - expected).max() < 0.003
        speed = log[f"motor_speed_{a}_rad_s"][-1]
        assert speed == pytest.approx(sign * K * (0.8 - F), rel=2e-3)


def test_stribeck_holds_at_rest_and_is_gone_at_speed():
    effects = {"stribeck_friction": {"x": {"extra_V": 0.3, "speed_rad_s": 0.1}}}
    log = still(effects, way=(1, 1), pilot=bang(0.3), seconds=0.4)
    assert np.abs(log["theta_x_rad"]).max() < 0.002
    assert log["theta_y_rad"][-1] > 0.1
    fast = still(effects, way=(1, 1), pilot=bang(1.0), seconds=0.4)
    assert fast["motor_speed_x_rad_s"][-1] == pytest.approx(1.53 * (1 - OWN_FRICTION_V), rel=3e-3)


def test_viscous_friction_that_differs_by_direction_gives_two_gains():
    effects = {"viscous_asymmetry": {"x": {"fraction_1": 0.2}, "y": {"fraction_1": -0.1}}}
    for way in (1, -1):
        log = still(effects, way=(way, way), pilot=bang(0.8), seconds=0.4)
        for axis, fraction in (("x", 0.2), ("y", -0.1)):
            expected = way * 1.53 * (0.8 - OWN_FRICTION_V) / (1 + way * fraction)
            assert log[f"motor_speed_{axis}_rad_s"][-1] == pytest.approx(expected, rel=3e-3)


REAL = {
    "coulomb_friction": {"friction_V": 0.15}, "dead_zone": {"positive_V": 0.15, "negative_V": 0.1},
    "stribeck_friction": {"extra_V": 0.3, "speed_rad_s": 0.5}, "gain_asymmetry": {"fraction": 0.1},
    "viscous_asymmetry": {"fraction_1": 0.2}, "voltage_offset": {"offset_V": 0.15},
    "saturation": {"limit_V": 0.5}, "input_delay": {"delay_s": 0.02},
    "cogging": {"amplitude_V": 0.2, "phase_rad": 0.3, "periods_per_turn": 24.0},
    "gain_drift": {"rate_1_s": 0.3}, "supply_sag": {"drop_1_V": 0.1},
    "gear_backlash": {"play_rad": 0.03}, "joint_backlash": {"play_rad": 0.03},
    "transmission_ripple": {"amplitude_rad": 0.03, "phase_rad": 0.5, "periods_per_turn": 10.0},
    "linkage_quadratic": {"coefficient_1_rad": 0.5}, "linkage_cubic": {"coefficient_1_rad2": 2.0},
    "cross_coupling": {"fraction": 0.2}, "level_offset": {"slope_rad": 0.01},
    "level_drift": {"rate_rad_s": 0.02}, "plate_bowl": {"stiffness_1_s2": 2.0},
    "rolling_resistance": {"deceleration_m_s2": 0.05}, "viscous_drag": {"rate_1_s": 0.5},
    "camera_delay": {"extra_s": 0.05}, "camera_scale": {"fraction": 0.1},
    "camera_yaw": {"angle_rad": 0.1}, "lens_distortion": {"k1_1_m2": 5.0},
}  # fmt: skip


@cache
def moved(effect: str, engine: str) -> dict[str, np.ndarray]:
    """Both servos to and fro under a rolling ball, with one effect of a real size."""
    turns = np.sign(np.sin(2 * np.pi * np.arange(500) / np.array([[220], [150]]) + 0.3)).T
    run = still if engine == "mujoco" else quiet
    effects = {effect: dict.fromkeys(axes_of(effect), REAL[effect])} if effect else {}
    return run(effects, way=turns, pilot=bang(0.9), ball=(0.02, -0.03, 0.05, 0.08, 0.0))


def change(effect: str, engine: str) -> np.ndarray:
    """By how much an effect moves the servos [rad], and the ball [m] at the times that are claimed
    for it, RMS (4,)."""
    bare, log = moved("", engine), moved(effect, engine)
    n = min(len(bare["t_s"]), len(log["t_s"]))
    servo = [log[f"theta_{a}_rad"][:n] - bare[f"theta_{a}_rad"][:n] for a in "xy"]
    (t, xy), (t_bare, xy_bare) = seen(log), seen(bare)
    both = t_bare < t[-1]
    ball = [np.interp(t_bare, t, xy[:, a])[both] - xy_bare[both, a] for a in range(2)]
    return np.array([np.sqrt(np.mean(np.square(one))) for one in (*servo, *ball)])


@pytest.mark.parametrize("effect", [*PLANT_KEYS, *EYE_KEYS])
def test_every_effect_acts_about_as_much_as_on_the_foreign_table(effect: str):
    mine, other = change(effect, "mujoco"), change(effect, "foreign")
    acts = other > (0.005, 0.005, 4e-4, 4e-4)
    assert acts.any()
    np.testing.assert_allclose(mine[acts] / other[acts], 1.0, atol=0.6)


def test_level_bowl_and_drag_move_the_ball_as_the_catalogue_says():
    t, xy = seen(still(slope(0.01, -0.02), ball=(0, 0, 0, 0, 0), seconds=0.7))
    expected = np.outer(t**2 / 2, FACTOR * G * np.array([0.01, -0.02]))
    np.testing.assert_allclose(xy, expected, atol=3e-5)
    effects = {"plate_bowl": {"xy": {"stiffness_1_s2": 4.0}}}
    t, xy = seen(still(effects, ball=(0.05, 0, 0, 0.1, 0), seconds=0.7))
    expected = 0.05 * np.column_stack([np.cos(2 * t), np.sin(2 * t)])
    np.testing.assert_allclose(xy, expected, atol=6e-5)
    effects = {"viscous_drag": {"xy": {"rate_1_s": 0.8}}}
    t, xy = seen(still(effects, ball=(0, 0, 0.1, 0, 0), seconds=0.7))
    np.testing.assert_allclose(xy[:, 0], 0.1 / 0.8 * (1 - np.exp(-0.8 * t)), atol=6e-5)


def test_rolling_resistance_brakes_and_holds():
    effects = {"rolling_resistance": {"xy": {"deceleration_m_s2": 0.2}}}
    t, xy = seen(still(effects, ball=(0, 0, 0.06, -0.08, 0)))
    until = np.minimum(t, 0.5)
    way = (0.1 * until - 0.1 * until**2)[:, None] * [0.6, -0.8]
    np.testing.assert_allclose(xy, way, atol=1e-4)
    held = {"rolling_resistance": {"xy": {"deceleration_m_s2": 0.06}}} | slope(0.005, 0)
    _, xy = seen(still(held, ball=(0.01, 0, 0, 0, 0), seconds=0.5))
    assert abs(xy[-1, 0] - 0.01) < 1e-4  # it creeps by half of 0.24 mm/s


def test_cams_and_pulleys_are_the_catalogues_equations():
    ripple = {"amplitude_rad": 0.02, "phase_rad": 0.7, "periods_per_turn": 9.0}
    effects = {
        "transmission_ripple": {"x": ripple},
        "linkage_quadratic": {"y": {"coefficient_1_rad": 0.3}},
        "linkage_cubic": {"y": {"coefficient_1_rad2": -1.0}},
        "cross_coupling": {"x": {"fraction": 0.1}, "y": {"fraction": -0.2}},
    }
    plant, _ = plant_and_eye(effects, (1.53,) * 2, (0.025,) * 2, delay_s=0.0, factor=0.6)
    found, told = [], []
    hidden = HiddenTable(plant, nothing_odd(), None, 2e-4)
    for k in range(300):
        volts = 2.0 * np.array([np.cos(k / 30), np.sin(k / 37)])
        hidden.move(volts, np.zeros(2), None, 1e-3 * k, 5)  # pyright: ignore[reportArgumentType]
        x, y = hidden.table.angles()[1]
        felt_x = np.sin(x + 0.02 * (np.sin(9 * x + 0.7) - np.sin(0.7)))
        felt_y = np.sin(y + 0.3 * y**2 - y**3)
        told.append(RATIO * np.array([felt_x + 0.1 * felt_y, felt_y - 0.2 * felt_x]))
        found.append(hidden.table.sines())
    assert np.ptp(told, axis=0).min() > 0.02
    assert np.abs(np.subtract(found, told)).max() < 3e-4  # 1.6 mrad at the servo, steps and shafts


def test_a_sine_and_its_cubic_touch():
    at = 0.3
    near = at + np.linspace(-0.005, 0.005, 11)
    cubic = np.polynomial.polynomial.polyval(near, sine_as_cubic(at, 13.0, 1.0))
    np.testing.assert_allclose(cubic, np.sin(13 * near + 1), atol=(13 * 0.005) ** 4 / 24 * 1.01)


def test_a_bump_passes_and_an_unbalanced_ball_rocks():
    odd = nothing_odd()._replace(bump=np.array([0.0, 0.01]), bump_from=0.2, bump_to=0.5)
    t, xy = seen(still(odd=odd, ball=(0, 0, 0, 0, 0), seconds=0.8))
    in_it, after = np.clip(t - 0.2, 0, 0.3), np.maximum(t - 0.5, 0)
    expected = FACTOR * G * 0.01 * (in_it**2 / 2 + 0.3 * after)
    np.testing.assert_allclose(xy[:, 1], expected, atol=5e-5)
    e, r = 3e-4, 0.019625
    odd = nothing_odd()._replace(heavy=e * np.array([np.sin(0.3), 0, -np.cos(0.3)]))
    t, xy = seen(still(odd=odd, ball=(0, 0, 0, 0, 0), seconds=2.0))
    both = seen(quiet(odd=odd, ball=(0, 0, 0, 0, 0), seconds=2.0))[1]
    np.testing.assert_allclose(xy, both, atol=0.04 * 0.3 * r)  # first order in e/r there
    assert np.ptp(xy[:, 0]) == pytest.approx(2 * 0.3 * r, rel=0.02)


CASES = {
    "plain": ("steps", {}, 3e-4),
    "corner": ("corner", {}, 4e-4),
    "pushed": ("pushed", {"viscous_drag": {"xy": {"rate_1_s": 0.2}}}, 4e-4),
    "ripple": ("steps", {"transmission_ripple": {"x": {"amplitude_rad": 0.03}}}, 4e-4),
    "joint play": ("steps", {"joint_backlash": {"x": {"play_rad": 0.035}}}, 2.5e-3),
    "gear play": ("steps", {"gear_backlash": {"y": {"play_rad": 0.035}}}, 1.5e-3),
}


@pytest.mark.parametrize("case", CASES)
def test_both_tables_make_nearly_the_same_log(case: str):
    """No noise, so closed loops stay together; a plate's inertia carries it on inside its play."""
    protocol, effects, apart_m = CASES[case]
    theirs, ours = (
        make_log(
            protocol, effects=effects, seed=3, duration_s=4.0, process_scale=0.0, noise_scale=0.0
        )
        for make_log in (mujoco_logs.make_log, foreign_table.make_log)
    )
    assert list(theirs) == list(ours)
    assert completed(theirs, protocol, 4.0)
    for name in ("t_s", "target_x_m", "target_y_m", "push", "ball_exposed_s"):
        np.testing.assert_allclose(theirs[name], ours[name])
    apart = [theirs[f"ball_{a}_m"] - ours[f"ball_{a}_m"] for a in "xy"]
    assert np.nanstd(apart) < apart_m
    assert np.nanstd([ours[f"ball_{a}_m"] for a in "xy"]) > 5 * apart_m


@pytest.mark.parametrize("rate_hz", [20.0, 300.0, 2500.0])
def test_any_rate_and_servos_alone(rate_hz: float):
    log = mujoco_logs.make_log("squares", seed=2, rate_hz=rate_hz, duration_s=1.5, tachometer=True)
    assert np.isnan(log["ball_x_m"]).all()
    assert np.ptp(log["theta_x_rad"]) > 0.1
    other = foreign_table.make_log("squares", seed=2, rate_hz=rate_hz, duration_s=1.5)
    assert np.abs(log["theta_x_rad"] - other["theta_x_rad"]).max() < 0.02


def test_gain_and_time_constant_can_be_found_in_a_log():
    """theta = -tau omega + K int(V - F sgn omega) + drift; an input delay adds to tau."""
    log = mujoco_logs.make_log("squares", seed=1, duration_s=5.0, tachometer=True)
    truth = foreign_table.hidden(effects=None, seed=1, seconds=5.0)
    t = log["t_s"]
    for i, a in enumerate("xy"):
        speed, volts = log[f"motor_speed_{a}_rad_s"], log[f"voltage_{a}_V"]
        summed = [
            np.concatenate([[0.0], np.cumsum(v)[:-1]]) * t[1]
            for v in (volts, -np.sign(speed) * (np.abs(speed) > 0.03))
        ]
        model = np.column_stack([-speed, *summed, t, np.ones_like(t)])
        tau, gain, *_ = np.linalg.lstsq(model, log[f"theta_{a}_rad"], rcond=None)[0]
        late = truth.effects["input_delay"][a]["delay_s"]
        assert gain == pytest.approx(truth.gain[i], rel=0.025)
        assert tau == pytest.approx(truth.tau[i] + late, rel=0.06)
