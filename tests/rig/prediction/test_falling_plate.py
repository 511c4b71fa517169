"""The predictor's plate in the play of a joint without friction, against closed forms and a log."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from experiments.runs.assemble import load_rig
from rig.log import Log
from rig.parameters import Drive, Rig
from rig.plant.plant_record import pack
from rig.prediction import ball
from rig.prediction.innovations import noise, predict, signals
from tests.support.worlds import WORLDS

PLAY_RAD = 0.035
LOOSE = Drive(arm_friction_nm=0.0, joint_friction_nm=0.0)
TABLE = Rig(drive=LOOSE, effects={"joint_backlash": {"x": {"play_rad": PLAY_RAD}}})
STEP_S = 1e-4


def falling(share: float, place_m: float, seconds: float, *, rate_rad_s: float = 0.0):
    """Angle and rate (n, 2) in the play of a still arm, from its lower end; the ball at place_m."""
    p = pack(TABLE)
    p["joint_fall"][0] = share
    plate, path = np.array([-PLAY_RAD / 2, 0.0, rate_rad_s, 0.0]), []
    for _ in range(round(seconds / STEP_S)):
        plate[0], plate[2] = ball._fallen(p, 0, 0.0, 0.0, plate, place_m, STEP_S)
        path.append((plate[0], plate[2]))
    return np.array(path)


def acceleration(place_m: float) -> float:
    """m g n x / I, n the linkage's ratio of small angles."""
    inertia = TABLE.drive.plate_inertia_kg_m2
    return TABLE.ball.mass_kg * 9.81 * TABLE.linkage.ratio * place_m / inertia


def test_it_falls_through_its_play_in_the_time_of_a_constant_acceleration():
    path, a = falling(1.0, 0.08, 0.3), acceleration(0.08)
    landed = np.flatnonzero(np.diff(np.sign(path[:, 1])) < 0)[0]
    assert STEP_S * landed == pytest.approx(np.sqrt(2.0 * PLAY_RAD / a), rel=0.02)
    assert path[landed, 1] == pytest.approx(np.sqrt(2.0 * PLAY_RAD * a), rel=0.02)
    assert path[landed + 1, 1] == pytest.approx(-ball.RESTITUTION * path[landed, 1], rel=0.02)


def test_half_braked_it_stays_under_a_light_ball_and_coasts_when_thrown():
    assert acceleration(0.08) < ball.HALF_BRAKED_RAD_S2
    assert np.ptp(falling(0.5, 0.08, 1.0)[:, 0]) == 0.0
    thrown, brake = 0.5, ball.HALF_BRAKED_RAD_S2
    path = falling(0.5, 0.0, 0.2, rate_rad_s=thrown)
    assert path[-1, 0] == pytest.approx(-PLAY_RAD / 2 + thrown**2 / (2.0 * brake), rel=0.02)
    assert path[-1, 1] == 0.0


@pytest.mark.parametrize("place_m", [0.012, 0.02, 0.06])
def test_on_servos_that_take_an_angle_the_balls_weight_beyond_the_friction_turns_it(place_m: float):
    """By (m g n x - F)/I; below F it stays."""
    rig = replace(load_rig(Path("three-arms")), effects=TABLE.effects)
    p, drive = pack(rig), rig.drive
    free_nm = rig.ball.mass_kg * 9.81 * place_m - drive.joint_friction_nm
    t = np.arange(0.0, 1.0, 0.002)
    theta, plate, k, now = np.zeros((len(t), 2)), np.zeros(4), 0, 0.0
    plate[0], place = -PLAY_RAD / 2, np.array([place_m, 0.0])
    turns = max(free_nm, 0.0) / drive.plate_inertia_kg_m2
    lands_s = np.sqrt(2.0 * PLAY_RAD / turns) if turns else 0.5
    while now < lands_s - 0.01:
        k, now, _, _ = ball._follow(p, place, plate, t, theta, k, now, 0.9)
        fallen = plate[0] + PLAY_RAD / 2
        assert fallen == pytest.approx(0.5 * turns * now**2, abs=0.06 * PLAY_RAD)


@pytest.mark.parametrize("place_m", [-0.09, -0.02, 0.0, 0.05])
def test_it_never_leaves_its_play(place_m: float):
    path = falling(1.0, place_m, 1.0, rate_rad_s=3.0)
    assert np.abs(path[:, 0]).max() <= PLAY_RAD / 2 + 1e-12


def test_only_a_plate_without_friction_that_motors_turn_falls():
    assert list(pack(TABLE)["joint_fall"]) == [1.0, 0.0]
    assert not pack(replace(TABLE, effects={}))["joint_fall"].any()
    assert not pack(replace(TABLE, drive=Drive()))["joint_fall"].any()
    held = load_rig(Path("bus-servos"))
    assert not pack(replace(held, drive=LOOSE, effects=TABLE.effects))["joint_fall"].any()


def test_the_ball_of_another_generator_is_followed_better_than_by_a_plate_that_stays():
    """Half of the true play: bounces that the log does not show are predicted by no model."""
    columns, _, _ = WORLDS["falling_joint"](2100)
    known = signals(Log.from_columns(columns), camera_delay_s=TABLE.camera.delay_s)
    half = replace(TABLE, effects={"joint_backlash": {"x": {"play_rad": 0.5 * PLAY_RAD}}})

    def unexplained(rig: Rig) -> float:
        """Mean square of the innovations beyond the 0.3 mm of the camera [m2]."""
        return float(np.nanmean(predict(rig, known, noise()).ball[:, 0] ** 2)) - 3e-4**2

    stays = replace(half, drive=replace(LOOSE, joint_friction_nm=1e-9))
    none = replace(TABLE, effects={})
    assert unexplained(half) < 0.85 * min(unexplained(stays), unexplained(none))
