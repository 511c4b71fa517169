"""Logs of commanded angles: the ball from the servos' answer, by the simulator's own equations."""

from dataclasses import replace
from math import inf
from pathlib import Path

import numpy as np
import pytest

from experiments.runs.assemble import known, load_rig
from rig.course import Course
from rig.discrepancy import Discrepancy
from rig.effects import ANGLES, effects_of
from rig.log import Log
from rig.parameters import Rig, Servo
from rig.plant.plant_record import pack
from rig.prediction.commanded import BEHIND, Answers, answers
from rig.prediction.innovations import (
    ball_ahead,
    noise,
    predict,
    read_back,
    servo_ahead,
    servo_innovations,
    signals,
)
from rig.simulation.simulate import draw, simulate
from tests.rig.plant.test_position_servo import VISIBLE
from tests.support import ROOT

LEVELS = noise(ball_process=1e-3, ball_measured=1e-4)


def shipped(name: str) -> Rig:
    rig = load_rig(Path(ROOT) / "experiments" / "rigs" / f"{name}.toml")
    return replace(rig, effects={}, camera=replace(rig.camera, noise_m=0.0))


def log_of(rig: Rig, seconds: int = 8) -> Log:
    rng = np.random.default_rng(0)
    targets = rng.uniform(-0.05, 0.05, (2 * seconds, 2)).repeat(250, axis=0)
    course = Course(targets, np.zeros_like(targets), (0.01, -0.02))
    return simulate(rig, known(rig), 0, course, draw(rng, rig, course)).log


def rms_m(rig: Rig, log: Log) -> np.ndarray:
    found = predict(rig, signals(log, camera_delay_s=rig.camera.delay_s), LEVELS).ball
    return np.sqrt(np.nanmean(found[10:] ** 2, axis=0))


@pytest.mark.parametrize(("name", "most_m"), [("hobby-two-servos", 2e-5), ("three-arms", 1e-4)])
def test_true_parameters_leave_next_to_nothing_and_the_command_is_not_the_angle(name, most_m):
    rig = shipped(name)
    log = log_of(rig)
    assert not log.has("theta_x_rad")
    right = rms_m(rig, log)
    assert right.max() < most_m
    known_ = signals(log, camera_delay_s=rig.camera.delay_s)
    assert known_.told_rad is not None
    as_angle = replace(known_, theta_rad=known_.told_rad, told_rad=None)
    wrong = predict(rig, as_angle, LEVELS).ball
    assert np.sqrt(np.nanmean(wrong[10:] ** 2, axis=0)).min() > 5 * right.max()


OF_EACH_ARM = ("servo_lag", "rate_limit", "command_dead_band")
OWN = [e.name for e in effects_of("position") if e.servos == ANGLES]


@pytest.mark.parametrize("name", OWN)
def test_an_effect_of_the_servo_is_the_simulators(name):
    """With it in the model the innovations vanish as they do without it; missing, they do not."""
    rig = shipped("hobby-two-servos")
    rig = replace(rig, servo=replace(rig.servo, quantum_rad=0.0))
    with_it = replace(rig, effects={name: {"x": VISIBLE[name]}})
    log = log_of(with_it, 5)
    right, missing = rms_m(with_it, log), rms_m(rig, log)
    assert right.max() < 2e-5
    assert missing[0] > 5 * right[0]


def test_answers_do_not_depend_on_how_often_the_log_was_written():
    servo = Servo(kind="position", lag_s=0.04, dead_time_s=0.013)
    p = pack(Rig(servo=servo))
    t = np.arange(0, 1.0, 0.01)
    told = 0.1 * np.sign(np.sin(9 * t))[:, None] * [1.0, -1.0]
    fine = np.arange(0, 0.9901, 0.002)
    row = np.searchsorted(t, fine + 1e-9, side="right") - 1
    at, angles = answers(p, t, told)
    fine_at, fine_angles = answers(p, fine, told[row])
    both = np.interp(fine_at, at, angles[:, 0])
    assert np.abs(both - fine_angles[:, 0])[20:].max() < 2e-3
    assert set(np.round(t, 9)) <= set(np.round(at, 9))


@pytest.mark.parametrize("period_s", [0.0, 0.02])
def test_the_answer_is_a_smooth_function_of_the_dead_time(period_s):
    t = np.arange(0, 1.0, 0.01)
    told = 0.1 * np.sign(np.sin(9 * t))[:, None] * [1.0, 1.0]
    sums = []
    for dead in np.arange(0.02, 0.03, 0.0005):
        servo = Servo(kind="position", lag_s=0.05, dead_time_s=dead, rate_limit_rad_s=1e3)
        p = pack(Rig(servo=replace(servo, period_s=period_s)))
        _, angles = answers(p, t, told)
        sums.append(angles[:, 0].sum())
    assert np.abs(np.diff(sums)).min() > 0.2 * np.abs(np.diff(sums)).max()


def test_blank_commands_hold_the_last():
    nan = np.nan
    columns = {"t_s": [0.0, 0.1, 0.2, 0.3], "command_x_rad": [nan, 0.1, nan, 0.2]}
    columns |= {"command_y_rad": [0.0, nan, nan, nan], "ball_x_m": [0.0, 0.1, 0.2, 0.3]}
    log = Log.from_columns({name: np.array(v) for name, v in columns.items()})
    told = signals(log, camera_delay_s=0.0).told_rad
    assert told is not None
    assert told[:, 0].tolist() == [0.0, 0.1, 0.1, 0.2]
    measured = Log.from_columns({name: np.array(v) for name, v in columns.items()} | {
        "theta_x_rad": np.zeros(4), "theta_y_rad": np.zeros(4)})  # fmt: skip
    assert signals(measured, camera_delay_s=0.0).told_rad is None


def test_an_answer_is_kept_for_all_that_lies_behind_the_servos_and_for_nothing_else():
    rig = replace(shipped("hobby-two-servos"), effects={})
    p, t = pack(rig), np.arange(0, 1.0, 0.01)
    told = 0.1 * np.sign(np.sin(9 * t))[:, None] * [1.0, -1.0]
    kept = Answers()
    first = kept.of(p, t, told)
    for name in BEHIND:
        other = p.copy()
        if other[name].dtype.kind == "f":
            other[name] += 0.01
        assert kept.of(other, t, told) is first, name
        np.testing.assert_array_equal(answers(other, t, told)[1], first[1], err_msg=name)
    for name in OWN:
        other = pack(replace(rig, effects={name: {"x": VISIBLE[name]}}))
        np.testing.assert_array_equal(kept.of(other, t, told)[1], answers(other, t, told)[1])
        assert np.abs(kept.of(other, t, told)[1] - first[1]).max() > 1e-4, name
    again = kept.of(p, t, told)
    assert kept.of(p, t.copy(), told) is not again
    assert kept.of(p, t, told) is again


def test_a_heavy_ball_lays_the_plate_over_in_its_play():
    """By the friction alone, as behind motors, the predicted plate would stay where it was left."""
    rig = replace(shipped("three-arms"), effects={"joint_backlash": {"x": {"play_rad": 0.004}}})
    rig = replace(rig, servo=replace(rig.servo, quantum_rad=0.0))
    log, p = log_of(rig), pack(rig)
    known_ = signals(log, camera_delay_s=rig.camera.delay_s)
    light = p.copy()
    light["weight"] = 0.0
    laid, held = (np.nanstd(ball_ahead(q, known_, LEVELS)[0][:, 0]) for q in (p, light))
    assert laid < 0.5 * held


def read_errors_rad(rig: Rig, log: Log) -> np.ndarray:
    """RMS of the angle's errors 0.2 s ahead by the commands alone, x and y."""
    known_ = read_back(log, signals(log, camera_delay_s=rig.camera.delay_s))
    levels = noise(servo_process=0.05, servo_measured=1e-5)
    errors = [
        servo_ahead(
            pack(rig), known_, levels, (1, 1), (0.025, 0.025), a, horizon_s=0.2, every_s=0.1
        )
        for a in (0, 1)
    ]
    return np.sqrt(np.nanmean([found**2 for found, _ in errors], axis=1))


def finely_read(name: str) -> Rig:
    """A shipped rig with servos of 30 ms at least, whose angles are read to 16 microradians."""
    rig = shipped(name)
    late = {"lag_s": max(rig.servo.lag_s, 0.03), "acceleration_limit_rad_s2": inf}
    fine = {"quantum_rad": 0.0, "encoder_counts_per_rev": 400_000, "angle_measured": True}
    return replace(rig, servo=replace(rig.servo, **late, **fine))


READ = [("bus-servos", False), ("three-arms", True)]


@pytest.mark.parametrize(("table", "arms"), READ)
@pytest.mark.parametrize("name", OWN)
def test_the_angle_that_is_read_back_is_the_simulators(table, arms, name):
    """On three arms what each arm does shows in both tilts, what befalls a command in its own."""
    rig = finely_read(table)
    with_it = replace(rig, effects={name: {"x": VISIBLE[name]}})
    log = log_of(with_it, 5)
    right, missing = read_errors_rad(with_it, log), read_errors_rad(rig, log)
    assert right.max() < (2e-5 if arms else 1e-3)
    assert missing[0] > 4 * right[0]
    if not arms:
        assert missing[1] == pytest.approx(right[1])
    else:
        assert missing[1] > 20 * right[1] or name not in OF_EACH_ARM


UNNAMED = {
    "map": Discrepancy(servo_map_x=(0.0, 0.02, 0.02, 0.0)),
    "speed": Discrepancy(servo_speed_x=(0.02, 0.0, 0.0, 0.0)),
    "rhythm": Discrepancy(servo_rhythm_x=(0.01, 0.01), servo_rhythm_hz=1.3),
    "segment": Discrepancy(servo_segment=(0.03, 0.0), servo_segment_s=(2.0, 2.5)),
}


@pytest.mark.parametrize(("table", "arms"), READ)
@pytest.mark.parametrize("kind", UNNAMED)
def test_an_angle_beside_the_command_without_a_name_is_the_simulators(table, arms, kind):
    rig = finely_read(table)
    with_it = replace(rig, unknown=UNNAMED[kind])
    log = log_of(with_it, 5)
    right, missing = read_errors_rad(with_it, log), read_errors_rad(rig, log)
    assert right.max() < 1e-3
    assert missing[0] > 4 * right[0]
    assert missing[1] == pytest.approx(right[1]) or arms


def test_a_tilt_of_three_arms_that_nobody_read_follows_from_its_commands():
    rig = finely_read("three-arms")
    log = log_of(rig, 2)
    both = read_back(log, signals(log, camera_delay_s=0.0))
    one = replace(both, driven=(True, False))
    p, levels = pack(rig), noise(servo_process=0.05, servo_measured=1e-5)
    out, std = servo_innovations(p, one, levels, (1, 1), (0.025, 0.025))
    assert np.isnan(out[:, 1]).all()
    assert np.isnan(std[:, 1]).all()
    assert np.abs(out[1:, 0]).max() < 1e-3
    alone, _ = servo_innovations(p, both, levels, (1, 1), (0.025, 0.025), (1,))
    assert np.isnan(alone[:, 0]).all()
    assert np.isfinite(alone[1:, 1]).all()


def test_commands_that_led_to_no_angle_or_to_no_commands_are_no_servo_output():
    rig = shipped("hobby-two-servos")
    log = log_of(rig, 1)
    unread = signals(log, camera_delay_s=0.0)
    assert read_back(log, unread) is unread
    silent = Log.from_columns({"t_s": log["t_s"], "theta_x_rad": log["t_s"]})
    known_ = signals(silent, camera_delay_s=0.0)
    assert read_back(silent, known_) is known_
