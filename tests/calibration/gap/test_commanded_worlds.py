"""The worlds of servos that take an angle against closed forms, and what is said of their logs."""

from math import asin, exp, pi, sin, sqrt

import numpy as np
import pytest

from calibration.gap import investigate
from rig.log import Log
from rig.rigfile import read_rig
from tests.support.worlds import WORLDS, commanded
from tests.support.worlds import angle_servos as servos
from tests.support.worlds.loops import followed


def test_a_step_is_answered_by_a_straight_way_and_an_exponential():
    lag, rate, band = 0.05, 2.0, 0.01
    for goal in (0.3, -0.3):
        turn, early = 0.19 / rate, servos.answer(0.0, goal, lag, rate, band, 0.05)
        assert early == pytest.approx(np.sign(goal) * 0.1)
        late = abs(servos.answer(0.0, goal, lag, rate, band, turn + 0.07))
        assert late == pytest.approx(0.29 - 0.1 * exp(-0.07 / lag))
    assert servos.answer(0.295, 0.3, lag, rate, band, 1.0) == 0.295  # within the band
    halves = servos.answer(
        servos.answer(0.0, 0.3, lag, rate, band, 0.06), 0.3, lag, rate, band, 0.1
    )
    assert halves == pytest.approx(servos.answer(0.0, 0.3, lag, rate, band, 0.16))


def test_a_motor_that_takes_its_rate_at_once_is_a_lag():
    angle = rate = slow = 0.0
    for _ in range(2000):
        angle, rate = servos.driven(angle, rate, 0.1, 0.05, 9.0, 0.0, 1e-6, 5e-5)
    assert angle == pytest.approx(0.1 * (1.0 - exp(-0.1 / 0.05)), rel=2e-3)
    for _ in range(20000):
        slow, rate = servos.driven(slow, rate, 0.1, 0.05, 9.0, 0.01, 0.01, 5e-5)
    assert slow == pytest.approx(0.09, abs=1e-6)


def test_an_elastic_plate_swings_about_where_its_rods_are():
    phi = rate = 0.0
    h, hz, damping = 1e-5, 4.0, servos.SWING_DAMPING_1
    path = []
    for _ in range(30000):
        rate = followed(rate, 0.1 - phi, hz, damping, h)
        phi += h * rate
        path.append(phi)
    w = 2.0 * pi * hz
    free = w * sqrt(1.0 - damping**2)
    t = h * (1.0 + np.arange(len(path)))
    swing = np.cos(free * t) + damping * w / free * np.sin(free * t)
    np.testing.assert_allclose(path, 0.1 * (1.0 - np.exp(-damping * w * t) * swing), atol=2e-4)
    assert followed(3.0, 0.002, 0.0, damping, 0.001) == pytest.approx(2.0)


def test_a_play_is_held_by_friction_or_laid_over_by_the_ball():
    assert servos.behind_play(0.0, 0.004, 0.01, 0.001, 0.002) == 0.0
    assert servos.behind_play(0.0, 0.008, 0.01, 0.001, 0.002) == pytest.approx(0.003)
    assert servos.behind_play(0.0, 0.004, 0.01, 0.003, 0.002) == pytest.approx(0.009)
    assert servos.behind_play(0.0, 0.004, 0.01, -0.003, 0.002) == pytest.approx(-0.001)


def test_a_long_rod_tilts_by_the_ratio_of_arm_and_lever():
    assert servos.rod_tilt(0.3, 0.0, 0.02, 0.1, 50.0) == pytest.approx(
        asin(0.2 * sin(0.3)), abs=1e-4
    )
    short = servos.rod_tilt(0.3, 0.0, 0.02, 0.1, 0.05)
    assert servos.rod_gap(short, 0.3, 0.02, 0.1, 0.05) == pytest.approx(0.0, abs=1e-15)


def test_a_servo_is_drawn_off_by_what_acts_on_it():
    none = {name: np.zeros(2) for name in servos.Servos._fields}
    sprung = servos.Servos(**none | {"pull_rad": np.array([0.0, 0.02])})
    assert servos.drawn_off(sprung, 0, 0.3, 1.0) == 0.0
    assert servos.drawn_off(sprung, 1, 0.3, 1.0) == pytest.approx(0.02 * sin(4.0 * 0.3))
    held = servos.Servos(**none | {"cable_1": np.array([0.2, 0.0])})
    assert servos.drawn_off(held, 0, 0.3, 1.0) == pytest.approx(-0.2 * 0.25)
    assert servos.drawn_off(held, 0, -0.3, 1.0) == 0.0


@pytest.mark.slow  # the solvers are compiled for half a minute
def test_three_arms_hold_the_tilt_that_they_are_set_for():
    frame = commanded.ARMS
    level = servos.level_arm_rad(frame)
    unknown, pose = np.zeros(9), np.zeros(6)
    unknown[5] = pose[5] = frame.height_m
    unknown[6:] = level
    servos.solve(unknown, np.array([0.08, -0.05]), frame)
    servos.solve(pose, unknown[6:].copy(), frame)
    assert servos.fallen_axes(pose) == pytest.approx((0.08, -0.05), abs=1e-9)
    assert pose[5] == pytest.approx(frame.height_m)
    # Without an x tilt the arm on the x axis keeps its height but for the plate's own shift.
    servos.solve(unknown, np.array([0.0, 0.05]), frame)
    assert unknown[6] == pytest.approx(level, abs=1e-3)
    assert unknown[7] < level < unknown[8]


def said_of(name: str, seed: int, tmp_path, without: tuple[str, ...] = ()):
    """What is said of a world's log without some of its columns."""
    columns, rig, _ = WORLDS[name](seed)
    columns = {key: values for key, values in columns.items() if key not in without}
    (tmp_path / "rig.toml").write_text(rig, "utf-8")
    log, table = Log.from_columns(columns), read_rig(tmp_path / "rig.toml")
    return investigate([log], table, until="name", quick=True).findings


@pytest.mark.slow
def test_a_zero_between_command_and_measured_angle_is_no_tilt_of_the_plate(tmp_path):
    found = said_of("crooked_bus_servo", 4100, tmp_path)
    assert found.verdict == "named"
    assert [one.name for one in found.effects] == ["angle_zero"]
    assert found.effects[0].twins == ("encoder_zero",)
    size = found.effects[0].parameters["x"]["offset_rad"]
    assert size.value == pytest.approx(0.5 * commanded.DEG, abs=0.06 * commanded.DEG)
    assert 0.0 < size.high - size.low < 0.001


@pytest.mark.slow
def test_a_servo_that_swings_about_its_command_has_a_rhythm_without_a_name(tmp_path):
    found = said_of("swaying_bus_servo", 4100, tmp_path)
    assert found.verdict == "unknown-effect"
    assert found.unknown.channel == "servo_y"
    rhythm, size = found.unknown.shape.split(", ")
    assert rhythm == "a rhythm of 1.70 Hz"
    assert float(size.removesuffix(" degrees")) == pytest.approx(0.3, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3900, 3901])
def test_a_plate_that_swings_behind_its_rods_is_no_certain_lateness(seed, tmp_path):
    assert said_of("elastic_plate", seed, tmp_path).verdict in ("undecided", "unknown-effect")


@pytest.mark.slow
def test_a_cable_on_one_side_of_a_servo_is_no_scale_of_its_angle(tmp_path):
    found = said_of("cable_bus_servo", 4100, tmp_path)
    assert found.verdict == "unknown-effect"
    assert "an angle beside the command of x" in found.unknown.shape


@pytest.mark.slow
@pytest.mark.parametrize("seed", [7000, 7001])
def test_a_spring_that_is_spent_at_large_angles_is_no_certain_scale(seed, tmp_path):
    found = said_of("sprung_bus_servo", seed, tmp_path)
    assert found.verdict == "undecided"
    assert not any(row.model.startswith("named") for row in found.proof)
    assert any("differs" in note and "servo's angle" in note for note in found.notes)


@pytest.mark.slow
def test_servos_that_read_their_angle_back_and_lack_nothing(tmp_path):
    assert said_of("healthy_bus_servos", 4100, tmp_path).verdict == "nothing-missing"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["healthy_waiting_rc_servos", "healthy_waiting_bus_servos"])
def test_a_command_that_waits_for_the_servos_period_is_no_dead_time(name: str, tmp_path):
    assert said_of(name, 3966, tmp_path).verdict == "nothing-missing"


@pytest.mark.slow
def test_a_dead_time_beside_such_a_wait_is_told_as_uncertain_as_the_wait_is(tmp_path):
    found = said_of("dead_waiting_bus_servo", 3966, tmp_path)
    assert [(one.name, set(one.parameters)) for one in found.effects] == [
        ("servo_dead_time", {"x"})
    ]
    size = found.effects[0].parameters["x"]["delay_s"]
    assert size.low < 0.03 < size.high
    assert 0.005 < size.high - size.low < 0.02  # the period is 10 ms


@pytest.mark.slow
def test_frames_that_wait_for_their_row_are_no_late_camera(tmp_path):
    columns, file, _ = WORLDS["healthy_bus_servos"](3966)
    t_s, rng = columns["t_s"], np.random.default_rng(1)
    waits_s = rng.uniform(0.0, t_s[1] - t_s[0], len(t_s))
    for name in ("ball_x_m", "ball_y_m"):
        columns[name] = np.interp(t_s - waits_s, t_s, columns[name])
    (tmp_path / "rig.toml").write_text(file, "utf-8")
    log, table = Log.from_columns(columns), read_rig(tmp_path / "rig.toml")
    found = investigate([log], table, until="name", quick=True).findings
    assert found.verdict == "nothing-missing"


@pytest.mark.slow
def test_three_arms_that_read_their_angles_back_and_lack_nothing(tmp_path):
    assert said_of("healthy_bus_arms", 4100, tmp_path).verdict == "nothing-missing"


@pytest.mark.slow
def test_one_of_three_arms_that_turns_too_far_is_a_scale_of_the_axis_on_which_it_stands(tmp_path):
    found = said_of("far_bus_arm", 4100, tmp_path)
    assert found.verdict == "named"
    assert [one.name for one in found.effects] == ["angle_scale"]
    assert found.effects[0].twins == ("encoder_scale",)
    (size,) = found.effects[0].parameters["x"].values()
    assert size.value == pytest.approx(0.06, abs=0.01)  # tolerance: each arm's own half per cent


@pytest.mark.slow
@pytest.mark.parametrize("without", [("command_y_rad",), ("command_y_rad", "ball_y_m")])
def test_one_axis_that_is_told_angles_is_judged_alone(tmp_path, without: tuple[str, ...]):
    """As of a beam, or of a plate of which one axis is controlled."""
    found = said_of("late_servo", 4100, tmp_path, without)
    lags = [one for one in found.effects if one.name == "servo_lag"]
    assert found.verdict == "named"
    assert [set(one.parameters) for one in lags] == [{"x"}]
    assert lags[0].parameters["x"]["lag_s"].value == pytest.approx(0.04, abs=0.008)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["healthy_slow_motors", "healthy_pd_servos"])
def test_a_motor_that_takes_up_speed_is_no_effect_and_is_written_to_the_rig_file(name, tmp_path):
    found = said_of(name, 3921, tmp_path)
    assert found.verdict == "nothing-missing"
    assert "recalibrated" in found.sentence
    motor_s = 0.015 if name == "healthy_slow_motors" else 0.01
    for axis in "xy":
        size = found.calibrated[f"motor_lag_{axis}_s"]
        assert size.low < motor_s < size.high or size.value == pytest.approx(motor_s, abs=0.002)
        servo = found.rig_after.servo.on(axis)
        assert servo.motor_lag_s == size.value
        # A fit of lag and dead time had told the motor's lag as dead time.
        assert servo.lag_s + servo.dead_time_s == pytest.approx(0.05)
        assert (servo.dead_time_s < 0.005) == (name == "healthy_slow_motors")


@pytest.mark.slow
def test_a_longer_lag_is_named_beside_a_motor_that_takes_up_speed(tmp_path):
    found = said_of("late_pd_servo", 3921, tmp_path)
    assert [(one.name, tuple(one.parameters)) for one in found.effects] == [("servo_lag", ("x",))]
    size = found.effects[0].parameters["x"]["lag_s"]
    assert size.value == pytest.approx(0.02, abs=0.003)
