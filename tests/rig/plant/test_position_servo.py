"""Servos that take an angle: closed forms of each part, nulls, the catalogue's effects."""

from dataclasses import replace
from math import exp, inf, pi

import numpy as np
import pytest
from scipy import signal

from rig.control.controllers import WITH
from rig.course import Course
from rig.effects import BY_NAME, effects_of
from rig.parameters import Rig, Servo
from rig.plant import plant, plant_record
from rig.plant.plant import ARM, BALL, PLATE
from rig.plant.position_plant import advance_commanded
from tests.support.simulated import TICK_S, run

FREE = Servo(
    kind="position", lag_s=0.0, rate_limit_rad_s=1e6, acceleration_limit_rad_s2=1e12, stop_rad=10.0,
    angle_limit_rad=0.6,
)  # fmt: skip
VISIBLE = {
    "servo_lag": {"lag_s": 0.03},
    "servo_dead_time": {"delay_s": 0.021},
    "rate_limit": {"limit_rad_s": 0.7},
    "command_dead_band": {"half_width_rad": 0.03},
    "angle_scale": {"fraction": 0.2},
    "angle_zero": {"offset_rad": 0.05},
}


def told(servo, commands, effects=None, rows=ARM):
    """Angles (ticks + 1, 2) of the arms of a table told `commands` (ticks, 2), tick by tick."""
    rig = Rig(servo=servo, effects=effects or {})
    p, s = plant_record.pack(rig), plant.rest()
    history, seen = plant_record.no_volts(rig), np.empty(7)
    out = [s[rows].copy()]
    for k, command in enumerate(commands):
        history[1:] = history[:-1].copy()
        history[0] = command
        advance_commanded(s, p, history, k * TICK_S, TICK_S, 0.0, 0.0, True, inf, seen)
        out.append(s[rows].copy())
    return np.array(out)


def step(size=0.2, seconds=0.6):
    return np.full((round(seconds / TICK_S), 2), size)


def times(angles):
    return TICK_S * np.arange(len(angles))


def test_a_step_of_a_lag_with_dead_time_is_an_exponential():
    angles = told(replace(FREE, lag_s=0.05, dead_time_s=0.0215), step())
    since = np.maximum(times(angles) - 0.0215, 0.0)
    np.testing.assert_allclose(angles[:, 0], 0.2 * (1 - np.exp(-since / 0.05)), atol=2e-4)
    whole = told(replace(FREE, lag_s=0.05, dead_time_s=0.02), step())
    since = np.maximum(times(whole) - 0.02, 0.0)
    np.testing.assert_allclose(whole[:, 1], 0.2 * (1 - np.exp(-since / 0.05)), atol=1e-12)


@pytest.mark.parametrize("motor_s", [0.005, 0.02])
def test_a_motor_that_takes_up_speed_makes_the_lag_one_of_second_order(motor_s):
    lag_s = 0.05
    angles = told(replace(FREE, lag_s=lag_s, motor_lag_s=motor_s), step())[:, 0]
    expected = signal.step(([0.2], [lag_s * motor_s, lag_s, 1.0]), T=times(angles))[1]
    np.testing.assert_allclose(angles, expected, atol=3e-4)
    assert (angles.max() > 0.2 * 1.001) == (motor_s > lag_s / 4)  # it overshoots where it swings


def test_each_axis_has_its_own_values():
    servo = replace(FREE, x={"lag_s": 0.066}, y={"lag_s": 0.046, "dead_time_s": 0.01})
    angles = told(servo, step())
    t = times(angles)
    np.testing.assert_allclose(angles[:, 0], 0.2 * (1 - np.exp(-t / 0.066)), atol=1e-12)
    late = np.maximum(t - 0.01, 0.0)
    np.testing.assert_allclose(angles[:, 1], 0.2 * (1 - np.exp(-late / 0.046)), atol=1e-12)


def test_a_ramp_is_followed_behind_by_lag_and_dead_time_and_dead_band():
    slope, lag, dead, band = 0.4, 0.05, 0.02, 0.01
    servo = replace(FREE, lag_s=lag, dead_time_s=dead, dead_band_rad=band)
    ramp = slope * TICK_S * np.arange(600)[:, None] * np.ones(2)
    angles = told(servo, ramp)
    # Held for a tick, a ramp is half a tick behind itself.
    expected = slope * (times(angles) - dead - lag - 0.5 * TICK_S) - band
    np.testing.assert_allclose(angles[-50:, 0], expected[-50:], atol=0.6 * slope * TICK_S)


@pytest.mark.parametrize("hz", [0.5, 2.0, 6.0])
def test_a_sine_has_gain_and_phase_of_a_lag_with_dead_time(hz):
    lag, dead, size = 0.05, 0.02, 0.1
    w, n = 2 * pi * hz, round(6 / TICK_S)
    t = TICK_S * np.arange(n)
    angles = told(
        replace(FREE, lag_s=lag, dead_time_s=dead), size * np.sin(w * t)[:, None] * [1, 1]
    )
    late = angles[n // 2 :, 0]
    at = times(angles)[n // 2 :]
    found = 2 * np.mean(late * np.exp(-1j * w * at)) / (size / 1j)
    hold = np.exp(-0.5j * w * TICK_S)  # of a command held for a tick
    assert found == pytest.approx(np.exp(-1j * w * dead) / (1 + 1j * w * lag) * hold, abs=4e-3)


def test_without_lag_a_dead_band_is_the_play_operator():
    t = TICK_S * np.arange(1500)
    command, band = 0.2 * np.sin(2 * pi * 1.1 * t) * np.exp(-t), 0.03
    expected = [0.0]
    for u in command:
        expected.append(min(max(expected[-1], u - band), u + band))
    angles = told(replace(FREE, dead_band_rad=band), command[:, None] * [1, 1])
    np.testing.assert_allclose(angles[:, 0], expected, atol=1e-12)
    assert np.abs(angles).max() > 0.1


def test_nothing_moves_within_the_dead_band_and_a_step_stops_that_far_short():
    servo = replace(FREE, lag_s=0.03, dead_band_rad=0.02)
    assert not told(servo, step(0.0199)).any()
    assert told(servo, step(0.1))[-1, 0] == pytest.approx(0.08, abs=1e-6)


def test_a_rate_limit_makes_a_step_a_ramp():
    angles = told(replace(FREE, rate_limit_rad_s=0.5), step(0.2))
    np.testing.assert_allclose(angles[:, 0], np.minimum(0.5 * times(angles), 0.2), atol=1e-12)


def test_an_acceleration_limit_makes_a_step_a_triangle_of_speed_that_ends_at_its_target():
    size, a = 0.2, 20.0
    angles = told(replace(FREE, acceleration_limit_rad_s2=a), step(size))[:, 0]
    t, half = times(angles), (size / a) ** 0.5
    left = np.maximum(2 * half - t, 0.0)
    expected = np.where(t < half, 0.5 * a * t**2, size - 0.5 * a * left**2)
    np.testing.assert_allclose(angles, expected, atol=3e-4)
    assert angles.max() <= size + 1e-12
    speed = np.diff(told(replace(FREE, acceleration_limit_rad_s2=a), step(size))[:, 0]) / TICK_S
    assert np.abs(np.diff(speed)).max() / TICK_S < 1.01 * a


def test_a_clock_of_its_own_and_a_coarse_command():
    slope = 0.3
    ramp = slope * TICK_S * np.arange(300)[:, None] * np.ones(2)
    angles = told(replace(FREE, period_s=0.02), ramp)[:, 0]
    pulses = 0.02 * np.floor(times(angles)[:-1] / 0.02 + 1e-9)
    np.testing.assert_allclose(angles[1:], slope * pulses, atol=1e-12)
    coarse = told(replace(FREE, quantum_rad=0.004), ramp)[1:, 0]
    np.testing.assert_allclose(coarse, 0.004 * np.floor(ramp[:, 0] / 0.004 + 0.5), atol=1e-12)


def test_scale_and_zero():
    effects = {
        "angle_scale": {"x": {"fraction": 0.1}},
        "angle_zero": {"x": {"offset_rad": 0.02}, "y": {"offset_rad": -0.01}},
    }
    assert told(FREE, step(0.2), effects)[-1] == pytest.approx([0.24, 0.19], abs=1e-12)


def test_the_effects_add_to_what_the_rig_file_says():
    rest = {"lag_s": 0.02, "dead_time_s": 0.01, "dead_band_rad": 0.004, "rate_limit_rad_s": 2.0}
    more = {
        "servo_lag": {"lag_s": 0.03},
        "servo_dead_time": {"delay_s": 0.02},
        "command_dead_band": {"half_width_rad": 0.006},
        "rate_limit": {"limit_rad_s": 1.0},
    }
    both = {name: {"x": values, "y": values} for name, values in more.items()}
    one = told(replace(FREE, **rest), step(), both)
    all_ = {"lag_s": 0.05, "dead_time_s": 0.03, "dead_band_rad": 0.01, "rate_limit_rad_s": 1.0}
    np.testing.assert_allclose(one, told(replace(FREE, **all_), step()), atol=1e-14)


# --- lag, dead time, rate limit and dead band given back -------------------------------------


def test_steps_and_a_sweep_give_lag_dead_time_rate_limit_and_dead_band_back():
    """By formulas alone: no part of the model is fitted with itself."""
    lag, dead, limit, band = 0.035, 0.0155, 3.0, 0.0046
    servo = replace(FREE, lag_s=lag, dead_time_s=dead, rate_limit_rad_s=limit, dead_band_rad=band)
    small, large = told(servo, step(0.08))[:, 0], told(servo, step(0.5))[:, 0]
    assert 0.08 - small[-1] == pytest.approx(band, rel=1e-3)  # it stops that far short
    assert np.diff(large).max() / TICK_S == pytest.approx(limit, rel=1e-6)
    t, left = times(small), 1 - small / small[-1]
    use = (left < 0.9) & (left > 0.02)
    slope, start = np.polyfit(t[use], np.log(left[use]), 1)
    assert -1 / slope == pytest.approx(lag, rel=0.01)
    assert -start / slope == pytest.approx(dead, abs=3e-4)
    # The phase of small sines over a bias that keeps the band on one side: -w t_d - atan(w T).
    hz = np.array([0.7, 5.0])
    phases = []
    for w in 2 * pi * hz:
        n = round(8 / TICK_S)
        at = TICK_S * np.arange(n)
        rising = 0.05 * at + 0.002 * np.sin(w * at)  # never turns round by more than the band
        free = told(replace(servo, dead_band_rad=0.0), rising[:, None] * [1, 1])[1:, 0]
        end = TICK_S * np.arange(1, n + 1)
        whole = np.flatnonzero(end >= 8 - np.floor(6 * w / 2 / pi) * 2 * pi / w)
        trend = np.polyval(np.polyfit(end[whole], free[whole], 1), end[whole])
        phases.append(np.angle(np.sum((free[whole] - trend) * np.exp(-1j * w * end[whole])) * 1j))
    w = 2 * pi * hz
    expected = -w * (dead + 0.5 * TICK_S) - np.arctan(w * lag)
    assert np.array(phases) == pytest.approx(expected, abs=0.03)


# --- nulls and visible values ----------------------------------------------------------------


def position_rig(**more):
    servo = Servo(kind="position", lag_s=0.05, dead_time_s=0.01, rate_limit_rad_s=6.0)
    return Rig(servo=servo, **more)


def excited(seed=1, seconds=1.0):
    n = round(seconds / TICK_S)
    rng = np.random.default_rng(seed)
    targets = np.repeat(rng.uniform(-0.08, 0.08, (n // 50 + 1, 2)), 50, axis=0)[:n]
    return Course(targets, np.zeros((n, 2)), (0.03, -0.02))


@pytest.mark.parametrize("name", sorted(e.name for e in effects_of("position")))
def test_null_changes_no_bit_of_an_excited_run(name):
    effect = BY_NAME[name]
    nulls = {p.key: p.null for p in effect.parameters}
    null_rig = position_rig(effects={name: dict.fromkeys(effect.axes, nulls)})
    bare, null = (run(r, WITH, excited(), 3) for r in (position_rig(), null_rig))
    np.testing.assert_array_equal(null.log.rows, bare.log.rows)
    assert np.abs(bare.log["command_x_rad"]).max() > 0.1


@pytest.mark.parametrize("name", sorted(VISIBLE))
@pytest.mark.parametrize("axis", ["x", "y"])
def test_a_visible_value_changes_the_servo_of_its_axis_alone(name, axis):
    t = TICK_S * np.arange(500)
    swing = 0.2 * np.column_stack([np.sin(9 * t), np.cos(7 * t)])
    bare = told(position_rig().servo, swing)
    changed = told(position_rig().servo, swing, {name: {axis: VISIBLE[name]}})
    a = "xy".index(axis)
    assert np.abs(changed[:, a] - bare[:, a]).max() > 1e-3
    np.testing.assert_array_equal(changed[:, 1 - a], bare[:, 1 - a])


def test_every_effect_of_position_servos_has_a_visible_value_here():
    own = {e.name for e in effects_of("position")} - {e.name for e in effects_of("voltage")}
    assert own == set(VISIBLE)


# --- what lies behind the servo ---------------------------------------------------------------


def test_the_plate_follows_the_servos_answer_and_never_the_command():
    """A command that jumps by 0.3 rad throws no ball: the plate turns at the servo's own rate."""
    servo = Servo(kind="position", lag_s=0.1, rate_limit_rad_s=1.0)
    plate = told(servo, step(0.3, 0.2), rows=PLATE)[:, 0]
    assert np.abs(np.diff(plate)).max() / TICK_S < 1.6
    p, s = plant_record.pack(Rig(servo=servo)), plant.rest((0.02, 0.0))
    history, seen = np.full((2, 2), 0.3), np.empty(7)
    advance_commanded(s, p, history, 0.0, TICK_S, 0.0, 0.0, False, inf, seen)
    moved = s[BALL, 0] - 0.02
    r_phi = Rig().ball.radius_m * Rig().linkage.ratio * s[PLATE, 0]  # -r phi'' of the ball's centre
    assert -1.6 * r_phi < moved < 0.0
    assert r_phi < 1e-5


def test_joint_play_lies_behind_the_servo():
    t = TICK_S * np.arange(1000)
    swing = 0.2 * np.sin(6 * t)[:, None] * [1, 1]
    effects = {"joint_backlash": {"x": {"play_rad": 0.04}}}
    arm, plate = (told(replace(FREE, lag_s=0.03), swing, effects, rows) for rows in (ARM, PLATE))
    assert np.abs(arm - plate)[200:, 0].max() == pytest.approx(0.02, abs=2e-3)
    assert np.abs(arm - plate)[200:, 1].max() < 3e-3
    bare = told(replace(FREE, lag_s=0.03), swing)
    np.testing.assert_array_equal(arm, bare)


def test_the_exact_step_does_not_depend_on_the_time_step():
    servo = replace(FREE, lag_s=0.05)
    assert told(servo, step(seconds=0.05))[-1, 0] == pytest.approx(0.2 * (1 - exp(-1.0)), abs=1e-13)
