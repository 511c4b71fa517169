"""The catalogue: names and keys as agreed, nulls that change no bit, equations as written."""

from dataclasses import replace
from math import inf, radians

import numpy as np
import pytest

from rig.control.controllers import WITH
from rig.course import Course
from rig.effects import BY_NAME, CATALOGUE, check, effects_of, values
from rig.parameters import Ball, CameraTiming, Gains, Rig
from rig.plant import effect_equations as equations
from rig.plant import plant, plant_record
from rig.plant.plant import ARM, BALL, MOTOR, MOTOR_RATE, PLATE
from tests.support.simulated import (
    TICK_S,
    ball_state,
    constant_volts,
    moved,
    run,
    smooth_rig,
    tilted,
)

# The agreed table: name -> (side, axes, {key: null or None where no null is named}).
TABLE = {
    "coulomb_friction": ("servo", "x y", {"friction_V": 0}),
    "stribeck_friction": ("servo", "x y", {"extra_V": 0, "speed_rad_s": None}),
    "dead_zone": ("servo", "x y", {"half_width_V": 0, "positive_V": None, "negative_V": None}),
    "gain_asymmetry": ("servo", "x y", {"fraction": 0}),
    "viscous_asymmetry": ("servo", "x y", {"fraction_1": 0}),
    "voltage_offset": ("servo", "x y", {"offset_V": 0}),
    "saturation": ("servo", "x y", {"limit_V": inf}),
    "input_delay": ("servo", "x y", {"delay_s": 0}),
    "cogging": ("servo", "x y", {"amplitude_V": 0, "phase_rad": None, "periods_per_turn": None}),
    "gain_drift": ("servo", "x y", {"rate_1_s": 0}),
    "supply_sag": ("servo", "xy", {"drop_1_V": 0}),
    "gear_backlash": ("servo", "x y", {"play_rad": 0}),
    "servo_lag": ("servo", "x y", {"lag_s": 0}),
    "servo_dead_time": ("servo", "x y", {"delay_s": 0}),
    "rate_limit": ("servo", "x y", {"limit_rad_s": inf}),
    "command_dead_band": ("servo", "x y", {"half_width_rad": 0}),
    "angle_scale": ("servo", "x y", {"fraction": 0}),
    "angle_zero": ("servo", "x y", {"offset_rad": 0}),
    "joint_backlash": ("ball", "x y", {"play_rad": 0}),
    "transmission_ripple": (
        "ball",
        "x y",
        {"amplitude_rad": 0, "phase_rad": None, "periods_per_turn": None},
    ),
    "linkage_quadratic": ("ball", "x y", {"coefficient_1_rad": 0}),
    "linkage_cubic": ("ball", "x y", {"coefficient_1_rad2": 0}),
    "cross_coupling": ("ball", "x y", {"fraction": 0}),
    "level_offset": ("ball", "x y", {"slope_rad": 0}),
    "level_drift": ("ball", "x y", {"rate_rad_s": 0}),
    "plate_bowl": ("ball", "xy", {"stiffness_1_s2": 0}),
    "rolling_resistance": ("ball", "xy", {"deceleration_m_s2": 0}),
    "viscous_drag": ("ball", "xy", {"rate_1_s": 0}),
    "camera_delay": ("camera", "xy", {"extra_s": 0}),
    "camera_scale": ("camera", "xy", {"fraction": 0}),
    "camera_yaw": ("camera", "xy", {"angle_rad": 0}),
    "lens_distortion": ("camera", "xy", {"k1_1_m2": 0}),
}

# A value of each effect that must be visible within a second of hard work.
VISIBLE = {
    "coulomb_friction": {"friction_V": 0.2},
    "stribeck_friction": {"extra_V": 0.2, "speed_rad_s": 0.5},
    "dead_zone": {"half_width_V": 0.2},
    "gain_asymmetry": {"fraction": 0.1},
    "viscous_asymmetry": {"fraction_1": 0.3},
    "voltage_offset": {"offset_V": 0.1},
    "saturation": {"limit_V": 0.7},
    "input_delay": {"delay_s": 0.01},
    "cogging": {"amplitude_V": 0.2, "phase_rad": 1.0, "periods_per_turn": 8.0},
    "gain_drift": {"rate_1_s": 0.2},
    "supply_sag": {"drop_1_V": 0.05},
    "gear_backlash": {"play_rad": radians(2)},
    "joint_backlash": {"play_rad": radians(2)},
    "transmission_ripple": {"amplitude_rad": 0.02, "phase_rad": 1.0, "periods_per_turn": 8.0},
    "linkage_quadratic": {"coefficient_1_rad": 0.5},
    "linkage_cubic": {"coefficient_1_rad2": 2.0},
    "cross_coupling": {"fraction": 0.2},
    "level_offset": {"slope_rad": 0.02},
    "level_drift": {"rate_rad_s": 0.02},
    "plate_bowl": {"stiffness_1_s2": 1.0},
    "rolling_resistance": {"deceleration_m_s2": 0.05},
    "viscous_drag": {"rate_1_s": 0.5},
    "camera_delay": {"extra_s": 0.02},
    "camera_scale": {"fraction": 0.05},
    "camera_yaw": {"angle_rad": 0.1},
    "lens_distortion": {"k1_1_m2": 3.0},
}
ALL = sorted(e.name for e in effects_of("voltage"))  # of position servos: test_position_servo.py
SERVO, BALL_SIDE, CAMERA = (
    sorted(n for n in ALL if TABLE[n][0] == side) for side in ("servo", "ball", "camera")
)


def axes(name):
    return TABLE[name][1].split()


def on(name, axis=None, **pairs):
    """The effect with `pairs` (default: visible ones), on one axis or on all."""
    return {name: dict.fromkeys([axis] if axis else axes(name), pairs or VISIBLE[name])}


def excited(seed=1, seconds=1.0):
    """A second in which both axes, both signs and the ball work."""
    n = round(seconds / TICK_S)
    rng = np.random.default_rng(seed)
    targets = np.repeat(rng.uniform(-0.08, 0.08, (n // 50 + 1, 2)), 50, axis=0)[:n]
    pushes = np.zeros((n, 2))
    pushes[100:150] = 0.5, -0.3
    return Course(targets, pushes, (0.03, -0.02))


def swinging(seconds=1.0):
    t = TICK_S * np.arange(round(seconds / TICK_S))
    return 1.2 * np.column_stack([np.sin(2 * np.pi * 2 * t), np.cos(2 * np.pi * 1.5 * t)])


# --- the list --------------------------------------------------------------------------------


def test_the_catalogue_holds_the_agreed_names_sides_axes_and_keys():
    assert {e.name for e in CATALOGUE} == set(TABLE)
    assert len(CATALOGUE) == len(TABLE) == len(BY_NAME)
    for name, (side, where, keys) in TABLE.items():
        effect = BY_NAME[name]
        assert effect.side == side, name
        assert effect.axes == tuple(where.split()), name
        nulls = {p.key: p.null for p in effect.parameters}
        assert set(keys) <= set(nulls), name
        for key, null in keys.items():
            assert null is None or nulls[key] == null, (name, key)
        assert effect.sentence.endswith(".")
        assert all(p.unit and p.low < p.high for p in effect.parameters)


@pytest.mark.parametrize(
    ("effects", "known"),
    [
        ({"backlash": {"x": {"play_rad": 0.1}}}, "gear_backlash"),
        ({"gear_backlash": {"xy": {"play_rad": 0.1}}}, "x, y"),
        ({"camera_yaw": {"x": {"angle_rad": 0.1}}}, "xy"),
        ({"gear_backlash": {"x": {"play_deg": 1.0}}}, "play_rad"),
        ({"saturation": {"z": {"limit_V": 1.0}}}, "x, y"),
    ],
)
def test_unknown_names_axes_and_keys_are_named_with_the_known_ones(effects, known):
    for use in (check, values, lambda e: plant_record.pack(Rig(effects=e))):
        with pytest.raises(ValueError, match=known):
            use(effects)


@pytest.mark.parametrize("value", [float("nan"), inf, -inf])
def test_numbers_that_are_none_are_refused(value):
    with pytest.raises(ValueError, match="offset_V"):
        check({"voltage_offset": {"x": {"offset_V": value}}})


@pytest.mark.parametrize(
    ("name", "key"),
    [("gear_backlash", "play_rad"), ("coulomb_friction", "friction_V"), ("input_delay", "delay_s")],
)
def test_negative_play_friction_and_delay_are_refused(name, key):
    with pytest.raises(ValueError, match=key):
        check({name: {"y": {key: -0.01}}})


# --- null and not null -----------------------------------------------------------------------


@pytest.mark.parametrize("name", ALL)
def test_null_changes_no_bit_of_an_excited_run(name):
    nulls = {p.key: p.null for p in BY_NAME[name].parameters}
    null_rig = Rig(effects={name: dict.fromkeys(axes(name), nulls)})
    bare, null = (run(r, WITH, excited(), 3) for r in (Rig(), null_rig))
    np.testing.assert_array_equal(null.log.rows, bare.log.rows)
    assert np.abs(bare.log["theta_x_rad"]).max() > 0.1


@pytest.mark.parametrize("name", ALL)
def test_a_visible_value_changes_the_run(name):
    bare, changed = (run(Rig(effects=e), WITH, excited(), 3) for e in ({}, on(name)))
    n = min(len(bare.log), len(changed.log))
    assert not np.array_equal(bare.log.rows[:n], changed.log.rows[:n], equal_nan=True)


@pytest.mark.parametrize("name", SERVO)
def test_servo_effects_change_the_servo_of_their_axis_alone(name):
    bare = moved(smooth_rig(), swinging())
    for axis in axes(name):
        changed = moved(smooth_rig(effects=on(name, axis)), swinging())
        n = min(len(bare), len(changed))
        gap = np.abs(changed[:n, ARM] - bare[:n, ARM]).max(axis=0)
        for a, letter in enumerate("xy"):
            if letter in axis:
                assert gap[a] > 1e-3
            else:
                assert gap[a] == 0.0


@pytest.mark.parametrize("name", [n for n in BALL_SIDE if n != "joint_backlash"])
def test_ball_effects_leave_the_servos_alone_bit_for_bit(name):
    """With a weightless ball: else its weight reaches the servo through the plate."""
    start = ball_state((0.03, -0.02), (0.1, 0.05))
    bare = moved(smooth_rig(), swinging(), state=start)
    for axis in axes(name):
        changed = moved(smooth_rig(effects=on(name, axis)), swinging(), state=start)
        n = min(len(bare), len(changed))  # until the ball falls
        rows = [MOTOR, ARM, PLATE]
        np.testing.assert_array_equal(changed[:n, rows], bare[:n, rows])
        assert n > 250
        assert np.abs(changed[n - 1, BALL] - bare[n - 1, BALL]).max() > 3e-4


def test_joint_play_shows_in_the_ball_and_hardly_in_the_encoder():
    """Without joint friction the servo feels only that the plate's small inertia comes and goes."""
    bare, changed = (
        moved(smooth_rig(effects=e), swinging(), held=True) for e in ({}, on("joint_backlash", "x"))
    )
    plate = np.abs(changed[:, PLATE, 0] - bare[:, PLATE, 0]).max()
    arm = np.abs(changed[:, ARM, 0] - bare[:, ARM, 0]).max()
    assert plate > radians(0.9)
    assert arm < 0.1 * plate
    np.testing.assert_array_equal(changed[:, ARM, 1], bare[:, ARM, 1])


def blind_table(effects):
    """A table whose controller asks for nothing; volts offsets and pushes move it instead."""
    gains = Gains(proportional_rad_m=0, derivative_rad_s_m=0, integral_rad_m_s=0)
    camera = CameraTiming(noise_m=0.0)
    offset = {"voltage_offset": {"x": {"offset_V": 0.8}, "y": {"offset_V": -0.5}}}
    return Rig(gains=gains, camera=camera, effects=offset | effects)


@pytest.mark.parametrize("name", CAMERA)
def test_camera_effects_leave_the_plant_alone_bit_for_bit(name):
    bare, changed = (run(blind_table(e), 0, excited(), 3).log for e in ({}, on(name)))
    for column in ("theta_x_rad", "theta_y_rad", "motor_speed_x_rad_s", "voltage_y_V"):
        np.testing.assert_array_equal(changed[column], bare[column])
    assert np.ptp(bare["theta_x_rad"]) > 0.02
    assert not np.array_equal(changed["ball_x_m"], bare["ball_x_m"], equal_nan=True)


# --- what each one says: camera --------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "pairs", "map_"),
    [
        ("camera_scale", {"fraction": 0.04}, lambda xy: 1.04 * xy),
        (
            "camera_yaw",
            {"angle_rad": 0.1},
            lambda xy: xy @ np.array([[np.cos(0.1), -np.sin(0.1)], [np.sin(0.1), np.cos(0.1)]]).T,
        ),
        (
            "lens_distortion",
            {"k1_1_m2": 2.0},
            lambda xy: xy * (1 + 2.0 * (xy**2).sum(axis=1, keepdims=True)),
        ),
    ],
)
def test_camera_effects_map_the_true_position(name, pairs, map_):
    _, true = run(blind_table({}), 0, excited(), 3).log.ball()
    _, measured = run(blind_table(on(name, **pairs)), 0, excited(), 3).log.ball()
    assert np.ptp(true, axis=0).min() > 0.005
    np.testing.assert_allclose(measured, map_(true), rtol=0, atol=1e-15)


def test_yaw_is_counter_clockwise():
    x, y = equations.camera_map(0.1, 0.0, 0.0, 0.2, 0.0)
    assert x == pytest.approx(0.1 * np.cos(0.2))
    assert y == pytest.approx(0.1 * np.sin(0.2))


def test_camera_delay_makes_observations_usable_later():
    bare, late = (
        run(blind_table(e), 0, excited(), 3).log for e in ({}, on("camera_delay", extra_s=0.02))
    )
    t_bare, t_late = (log["t_s"][~np.isnan(log["ball_x_m"])] for log in (bare, late))
    np.testing.assert_allclose(t_late - t_bare[: len(t_late)], 0.02, atol=1e-9)
    # The same light, only later.
    xy = bare.ball()[1]
    np.testing.assert_array_equal(late.ball()[1], xy[: len(t_late)])


# --- what each one says: servo ---------------------------------------------------------------


@pytest.mark.parametrize("volts", [0.6, -0.6])
@pytest.mark.parametrize(
    ("name", "pairs", "effective"),
    [
        ("coulomb_friction", {"friction_V": 0.1}, lambda v: v - 0.1 * np.sign(v)),
        ("dead_zone", {"half_width_V": 0.1}, lambda v: np.sign(v) * max(abs(v) - 0.1, 0)),
        (
            "dead_zone",
            {"positive_V": 0.1, "negative_V": 0.25},
            lambda v: max(v - 0.1, 0) + min(v + 0.25, 0),
        ),
        ("gain_asymmetry", {"fraction": 0.1}, lambda v: v * (1.1 if v > 0 else 0.9)),
        ("viscous_asymmetry", {"fraction_1": 0.2}, lambda v: v / (1.2 if v > 0 else 0.8)),
        ("voltage_offset", {"offset_V": -0.2}, lambda v: v - 0.2),
        ("saturation", {"limit_V": 0.4}, lambda v: np.clip(v, -0.4, 0.4)),
        ("gain_drift", {"rate_1_s": 0.01}, lambda v: v * (1 - 0.01 * 20)),
        ("supply_sag", {"drop_1_V": 0.05}, lambda v: v * (1 - 0.05 * (abs(v) + 0.5))),
    ],
)
def test_steady_speed_is_gain_times_the_effective_volts(name, pairs, effective, volts):
    """Ten time constants of constant volts, from t = 20 s minus that: omega = K V_effective."""
    rig = smooth_rig(effects=on(name, **pairs))
    states = moved(rig, constant_volts(volts, -0.5, 0.3), t_s=19.7, held=True)
    expected = rig.servo.gain_rad_s_V * effective(volts)
    assert states[-1, MOTOR_RATE, 0] == pytest.approx(expected, rel=1e-3)


def test_coulomb_friction_sticks_below_its_volts():
    rig = smooth_rig(effects=on("coulomb_friction", friction_V=0.2))
    assert np.all(moved(rig, constant_volts(0.199, -0.199, 0.2))[:, MOTOR] == 0.0)
    assert np.all(moved(rig, constant_volts(0.201, -0.201, 0.2))[-1, MOTOR] != 0.0)


@pytest.mark.parametrize("volts", [0.25, -0.15])
def test_soft_friction_creeps_under_less_than_its_volts(volts):
    """Steady speed solves omega = K (V - F tanh(omega/s))."""
    friction, soft = 0.2, 0.05
    rig = smooth_rig(effects=on("coulomb_friction", friction_V=friction, softness_rad_s=soft))
    omega = moved(rig, constant_volts(volts, 0.0, 0.5), held=True)[-1, MOTOR_RATE, 0]
    lost = friction * np.tanh(omega / soft)
    assert omega == pytest.approx(rig.servo.gain_rad_s_V * (volts - lost), rel=1e-3)
    assert 0.2 * friction < abs(lost) < 0.999 * friction


def test_friction_that_settles_holds_and_stops_with_its_time_constant():
    """Below its volts v = v_0 exp(-t/T), whatever the drive; at rest nothing creeps."""
    friction, settling_s, begin = 0.3, 0.02, 0.05
    rig = smooth_rig(effects=on("coulomb_friction", friction_V=friction, settling_s=settling_s))
    start = plant.rest()
    start[MOTOR_RATE] = begin
    states = moved(rig, constant_volts(0.1, -0.1, 0.06), state=start, held=True)
    t_s = np.linspace(0.0, 0.06, len(states))
    for a in range(2):
        expected = begin * np.exp(-t_s / settling_s)
        np.testing.assert_allclose(states[:, MOTOR_RATE, a], expected, rtol=0.02, atol=1e-6)
    assert np.all(moved(rig, constant_volts(0.299, -0.299, 0.2))[:, MOTOR] == 0.0)
    assert np.all(moved(rig, constant_volts(0.301, -0.301, 0.2))[-1, MOTOR] != 0.0)


def test_of_both_shapes_of_friction_the_soft_one_holds():
    soft, both = (
        smooth_rig(effects=on("coulomb_friction", friction_V=0.2, softness_rad_s=0.05, **more))
        for more in ({}, {"settling_s": 0.02})
    )
    runs = [moved(rig, constant_volts(0.25, -0.1, 0.1)) for rig in (soft, both)]
    np.testing.assert_array_equal(*runs)


def test_stribeck_friction_falls_with_speed():
    """Steady speed solves omega = K (V - F - E exp(-(omega/speed)^2))."""
    friction, extra, speed = 0.1, 0.2, 0.4
    effects = on("coulomb_friction", friction_V=friction)
    effects |= on("stribeck_friction", extra_V=extra, speed_rad_s=speed)
    rig = smooth_rig(effects=effects)
    start = plant.rest()
    for row in (MOTOR_RATE, plant.ARM_RATE, plant.PLATE_RATE):
        start[row] = 0.6, -0.6
    states = moved(rig, constant_volts(0.5, -0.5, 0.5), state=start, held=True)
    omega = states[-1, MOTOR_RATE, 0]
    lost = friction + extra * np.exp(-((omega / speed) ** 2))
    assert omega == pytest.approx(rig.servo.gain_rad_s_V * (0.5 - lost), rel=1e-3)
    assert 0.01 < extra * np.exp(-((omega / speed) ** 2)) < 0.19  # the excess matters here
    # From rest the full excess holds.
    assert np.all(moved(rig, constant_volts(0.299, -0.299, 0.2))[:, MOTOR] == 0.0)
    assert np.all(moved(rig, constant_volts(0.301, -0.301, 0.2))[-1, MOTOR] != 0.0)


def test_cogging_pulls_to_its_stable_angle():
    """No volts: rest where n theta + phase = pi, a falling zero of the sine."""
    pairs = {"amplitude_V": 0.5, "phase_rad": 0.5, "periods_per_turn": 10.0}
    states = moved(smooth_rig(effects=on("cogging", **pairs)), constant_volts(0, 0, 1.0), held=True)
    np.testing.assert_allclose(states[-1, ARM], (np.pi - 0.5) / 10, atol=2e-4)


def test_gain_drift_uses_the_runs_time():
    rig = smooth_rig(effects=on("gain_drift", rate_1_s=0.01))
    early, late = (moved(rig, constant_volts(0.5, 0, 0.2), t_s=t)[-1, ARM, 0] for t in (0, 50))
    assert late / early == pytest.approx(0.5, abs=0.002)


# --- what each one says: ball ----------------------------------------------------------------

STILL = np.zeros((500, 2))
T = TICK_S * np.arange(501)
GAIN = 3 / 5 * 9.81


@pytest.mark.parametrize(
    ("name", "pairs", "felt"),
    [
        ("linkage_quadratic", {"coefficient_1_rad": 0.5}, lambda q: q + 0.5 * q**2),
        ("linkage_cubic", {"coefficient_1_rad2": -1.5}, lambda q: q - 1.5 * q**3),
        (
            "transmission_ripple",
            {"amplitude_rad": 0.02, "phase_rad": 0.7, "periods_per_turn": 9.0},
            lambda q: q + 0.02 * (np.sin(9 * q + 0.7) - np.sin(0.7)),
        ),
    ],
)
@pytest.mark.parametrize("theta", [0.2, -0.3, 0.0])
def test_plate_feels_another_angle(name, pairs, felt, theta):
    rig = smooth_rig(effects=on(name, "x", **pairs))
    states = moved(rig, STILL[:200], state=tilted(plant.rest(), theta, 0.1))
    pull = GAIN * rig.linkage.ratio * np.sin([felt(theta), 0.1])
    t = T[200]
    np.testing.assert_allclose(
        states[200, BALL], 0.5 * pull * t * (t + 1e-4), rtol=1e-9, atol=1e-15
    )


@pytest.mark.parametrize("name", ["linkage_cubic", "transmission_ripple", "linkage_quadratic"])
def test_plates_rate_is_the_derivative_of_the_felt_angle(name):
    p = plant_record.pack(smooth_rig(effects=on(name)))
    s, e, rates = plant.rest(), 1e-5, (0.9, -0.6)
    s[PLATE] = 0.2, -0.15
    s[plant.PLATE_RATE] = rates
    before, after = s.copy(), s.copy()
    before[PLATE] -= e * s[plant.PLATE_RATE]
    after[PLATE] += e * s[plant.PLATE_RATE]
    lower, upper = (np.array(plant.plate_motion(state, p)[:2]) for state in (before, after))
    s_x, s_y, o1, o2 = plant.plate_motion(s, p)
    c = np.sqrt(1 - s_x**2 - s_y**2)
    np.testing.assert_allclose([o2 * c, -o1 * c], (upper - lower) / (2 * e), rtol=1e-6)


@pytest.mark.parametrize(("axis", "other"), [("x", 1), ("y", 0)])
def test_cross_coupling_is_named_by_the_axis_that_receives(axis, other):
    rig = smooth_rig(effects=on("cross_coupling", axis, fraction=0.2))
    theta = np.zeros(2)
    theta[other] = 0.25
    states = moved(rig, STILL[:100], state=tilted(plant.rest(), *theta))
    got = states[100, BALL]
    assert got[1 - other] / got[other] == pytest.approx(0.2, rel=1e-9)
    alone = moved(rig, STILL[:100], state=tilted(plant.rest(), *theta[::-1]))[100, BALL]
    assert alone[other] == 0.0  # nothing the other way


def test_level_offset_is_a_constant_slope():
    rig = smooth_rig(
        effects={"level_offset": {"x": {"slope_rad": 0.01}, "y": {"slope_rad": -0.02}}}
    )
    ball = moved(rig, STILL)[:, BALL]
    expected = 0.5 * GAIN * np.array([0.01, -0.02]) * (T * (T + 1e-4))[:, None]
    np.testing.assert_allclose(ball, expected, rtol=1e-6, atol=1e-12)


def test_level_drift_grows_with_the_runs_time():
    rig = smooth_rig(effects=on("level_drift", "x", rate_rad_s=0.02))
    ball = moved(rig, STILL)[:, BALL, 0]
    np.testing.assert_allclose(ball, GAIN * 0.02 * T**3 / 6, atol=1e-5)
    later = moved(rig, STILL[:250], t_s=5.0)[-1, BALL, 0]
    t = T[250]
    assert later == pytest.approx(GAIN * (0.1 * t**2 / 2 + 0.02 * t**3 / 6), rel=1e-3)


def test_plate_bowl_is_a_spring_per_mass():
    rig = smooth_rig(effects=on("plate_bowl", stiffness_1_s2=20.0))
    ball = moved(rig, STILL, state=ball_state((0.05, -0.03)))[:, BALL]
    expected = np.cos(np.sqrt(20.0) * T)[:, None] * [0.05, -0.03]
    np.testing.assert_allclose(ball, expected, atol=3e-5)


def test_viscous_drag_decays_the_speed():
    rig = smooth_rig(effects=on("viscous_drag", rate_1_s=0.8))
    ball = moved(rig, STILL, state=ball_state((0, 0), (0.1, -0.05)))[:, BALL]
    expected = ((1 - np.exp(-0.8 * T)) / 0.8)[:, None] * [0.1, -0.05]
    np.testing.assert_allclose(ball, expected, atol=1e-5)


def test_rolling_resistance_brings_the_ball_to_rest_and_holds_it():
    d, speed = 0.08, np.array([0.03, -0.04])
    rig = smooth_rig(effects=on("rolling_resistance", deceleration_m_s2=d))
    ball = moved(rig, STILL[:450], state=ball_state((0, 0), speed))[:, BALL]
    size = np.hypot(*speed)
    t = np.minimum(T[:451], size / d)
    path = (size * t - 0.5 * d * t**2)[:, None] * speed / size
    np.testing.assert_allclose(ball, path, atol=1e-5)
    np.testing.assert_array_equal(ball[-1], ball[-50])


@pytest.mark.parametrize(("share", "sticks"), [(0.99, True), (1.01, False)])
def test_rolling_resistance_holds_on_a_slope_that_is_gentle_enough(share, sticks):
    slope = share * 0.05 / GAIN
    effects = on("rolling_resistance", deceleration_m_s2=0.05)
    effects |= on("level_offset", "y", slope_rad=slope)
    ball = moved(smooth_rig(effects=effects), STILL)[-1, BALL, 1]
    assert bool(ball == 0.0) == sticks


def test_a_solid_ball_looks_like_a_hollow_one_under_a_scaled_camera():
    """Twins: on a plate at rest ball inertia and camera scale give the same parabola."""
    theta, t = 0.05, T[200]
    solid = smooth_rig(effects={})
    solid = replace(solid, ball=Ball(mass_kg=0.0, hollow=False))
    place = [
        moved(rig, STILL[:200], state=tilted(plant.rest(), theta, 0.0))[-1, BALL, 0]
        for rig in (smooth_rig(), solid)
    ]
    scaled, _ = equations.camera_map(place[0], 0.0, (5 / 7) / (3 / 5) - 1, 0.0, 0.0)
    assert scaled == pytest.approx(place[1], rel=1e-9)
    assert place[0] == pytest.approx(0.5 * Rig().ball_gain_m_s2 * np.sin(theta) * t**2, rel=1e-3)
