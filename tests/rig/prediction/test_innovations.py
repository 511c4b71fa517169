"""The predictor on noise-free logs: innovations vanish with the tick, each in its channel."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from rig.effects import BY_NAME, effects_of
from rig.parameters import Ball, Drive, Rig
from rig.plant import plant, plant_record
from rig.plant.effect_equations import camera_map
from rig.prediction.innovations import Innovations, Signals, noise, predict, signals

# Shafts so stiff and free of friction that the predictor's rigid ones are the truth; where play is
# under test friction must hold the driven side.
STIFF = Drive(
    gear_stiffness_nm_rad=3000, joint_stiffness_nm_rad=3000, gear_damping_nm_s=0.2,
    joint_damping_nm_s=0.2, arm_friction_nm=0, joint_friction_nm=0,
)  # fmt: skip
HELD = {
    "gear_backlash": replace(STIFF, arm_friction_nm=0.002, joint_friction_nm=0.02),
    "joint_backlash": replace(STIFF, joint_friction_nm=0.02),
}
SIZES = {
    "friction_V": 0.2, "extra_V": 0.15, "speed_rad_s": 0.3, "half_width_V": 0.15,
    "fraction": 0.05, "fraction_1": 0.1, "offset_V": 0.2, "limit_V": 0.8,
    "delay_s": 0.008, "amplitude_V": 0.2, "phase_rad": 0.5,
    "periods_per_turn": 13.0, "rate_1_s": 0.05, "drop_1_V": 0.03, "play_rad": 0.02,
    "amplitude_rad": 0.01, "coefficient_1_rad": 0.3, "coefficient_1_rad2": 1.0, "slope_rad": 0.005,
    "rate_rad_s": 0.001, "stiffness_1_s2": 0.5, "deceleration_m_s2": 0.01, "extra_s": 0.015,
    "angle_rad": 0.05, "k1_1_m2": 10.0,
}  # fmt: skip
SECONDS, SETTLED_S, SETTLED_FRAMES = 3.0, 0.4, 20
LEVELS = noise(servo_process=0.05)


def table(name: str | None, rate_hz: float) -> Rig:
    effects = {}
    if name is not None:
        effect = BY_NAME[name]
        keys = {p.key: SIZES[p.key] for p in effect.parameters if p.key in SIZES}
        effects = {name: dict.fromkeys(effect.axes, keys)}
    drive = HELD.get(name or "", STIFF)
    return Rig(control_rate_hz=rate_hz, drive=drive, ball=Ball(mass_kg=1e-6), effects=effects)


@cache
def log(name: str | None, rate_hz: float) -> Signals:
    return simulated(table(name, rate_hz))


def simulated(rig: Rig) -> Signals:
    """A closed-loop log without noise: exact angles, exact ball at 60 exposures a second."""
    rate_hz = rig.control_rate_hz
    p, s = plant_record.pack(rig, step_s=2e-5), plant.rest((0.01, -0.02))
    history, seen = plant_record.no_volts(rig), np.full(7, np.nan)
    rows, frames = [], []
    for k in range(round(SECONDS * rate_hz)):
        t = k / rate_hz
        swing = np.array([np.sin(7.1 * t) + 0.6 * np.sin(13.7 * t + 1), np.sin(5.9 * t + 2)])
        wanted = 0.12 * swing - 1.5 * s[plant.BALL] - s[plant.BALL_W]
        volts = 14 * (wanted - s[plant.ARM])
        rows.append((t, *volts, *s[plant.ARM]))
        history[1:] = history[:-1].copy()
        history[0] = volts
        due = (len(frames) + 1) / 60
        plant.advance(s, p, history, t, 1 / rate_hz, 0.0, 0.0, False, due, seen)
        if not np.isnan(seen[6]):
            at = (p["camera_scale_fraction"][0], p["camera_yaw_angle_rad"][0])
            measured = camera_map(seen[0], seen[1], *at, p["lens_distortion_k1_1_m2"][0])
            frames.append((seen[6] + p["camera_delay_extra_s"][0], *measured))
    r, f = np.array(rows), np.array(frames)
    return Signals(
        r[:, 0].copy(), r[:, 1:3].copy(), r[:, 3:].copy(), f[:, 0].copy(), f[:, 1:].copy()
    )


def sizes(found: Innovations, rate_hz: float) -> dict[str, float]:
    """RMS innovations of both channels after the filters have settled."""
    servo, ball = found.servo[round(SETTLED_S * rate_hz) :], found.ball[SETTLED_FRAMES:]
    return {
        "servo": float(np.sqrt(np.nanmean(servo**2))),
        "ball": float(np.sqrt(np.nanmean(ball**2))),
    }


def channel(name: str) -> str:
    return "servo" if BY_NAME[name].side == "servo" else "ball"


def residual(name: str | None, rate_hz: float, *, believed: bool = True) -> dict[str, float]:
    rig = table(name, rate_hz)
    model = rig if believed else replace(rig, effects={})
    return sizes(predict(model, log(name, rate_hz), LEVELS), rate_hz)


@pytest.mark.parametrize("name", [effect.name for effect in effects_of("voltage")])
def test_with_the_true_effect_the_innovations_shrink_with_the_tick(name: str):
    coarse, fine = (residual(name, rate)[channel(name)] for rate in (500.0, 2000.0))
    assert fine < 0.75 * coarse


@pytest.mark.parametrize("shape", [{"settling_s": 0.01}, {"softness_rad_s": 0.05}])
def test_friction_of_either_shape_is_followed_as_well(shape: dict[str, float]):
    """Both shrink with the tick; hard friction of the same size leaves a gap."""
    sizes_of = {}
    for rate_hz in (500.0, 2000.0):
        rig = table("coulomb_friction", rate_hz)
        pairs = rig.effects["coulomb_friction"]["x"]
        true, hard = (
            replace(rig, effects={"coulomb_friction": dict.fromkeys("xy", pairs | more)})
            for more in (shape, {})
        )
        run = simulated(true)
        sizes_of[rate_hz] = [sizes(predict(m, run, LEVELS), rate_hz)["servo"] for m in (true, hard)]
    assert sizes_of[2000.0][0] < 0.75 * sizes_of[500.0][0]
    assert all(hard > 1.5 * true for true, hard in sizes_of.values()), sizes_of


@pytest.mark.parametrize("name", [effect.name for effect in effects_of("voltage")])
def test_without_the_effect_its_own_channel_shows_a_gap_and_the_other_does_not(name: str):
    mine = channel(name)
    other = "ball" if mine == "servo" else "servo"
    true, without = residual(name, 2000.0), residual(name, 2000.0, believed=False)
    # Where teeth strike, the arm bounces, which rigid shafts cannot: that much gap stays.
    factor = 2 if name == "gear_backlash" else 10
    assert without[mine] > factor * true[mine]
    if name == "joint_backlash":  # the plate's friction lets go of the motor inside the joint's gap
        assert without[other] > true[other]
    else:
        assert without[other] == pytest.approx(true[other], rel=1e-9)


def test_where_little_friction_brakes_the_arm_it_coasts_through_the_gap_and_bounces():
    """The default shafts, the plate's joints free: the predictor is the simulator's two masses."""
    drive = Drive(arm_friction_nm=1.5e-3, joint_friction_nm=0.0, joint_stiffness_nm_rad=3000)
    hidden = {"gear_backlash": {"x": {"play_rad": 0.02}, "y": {"play_rad": 0.01}}}
    rig = replace(table(None, 500.0), drive=drive, effects=hidden)
    known = simulated(rig)
    true = sizes(predict(rig, known, LEVELS), 500.0)["servo"]
    held = replace(rig, drive=replace(drive, arm_friction_nm=0.0))
    assert sizes(predict(held, known, LEVELS), 500.0)["servo"] > 5 * true
    assert sizes(predict(replace(rig, effects={}), known, LEVELS), 500.0)["servo"] > 5 * true


def test_a_healthy_table_leaves_micrometres_and_microradians():
    found = residual(None, 500.0)
    assert found["servo"] < 1e-5
    assert found["ball"] < 1.5e-6


@pytest.mark.parametrize("name", [effect.name for effect in effects_of("voltage")])
def test_null_values_leave_the_predictor_unchanged_bit_for_bit(name: str):
    effect = BY_NAME[name]
    nulls = {name: {axis: {p.key: p.null for p in effect.parameters} for axis in effect.axes}}
    rig = table(None, 500.0)
    bare = predict(rig, log(None, 500.0), LEVELS)
    told = predict(replace(rig, effects=nulls), log(None, 500.0), LEVELS)
    assert np.array_equal(bare.servo, told.servo, equal_nan=True)
    assert np.array_equal(bare.ball, told.ball, equal_nan=True)


@pytest.mark.parametrize("drive", [STIFF, HELD["joint_backlash"]], ids=["light", "held"])
def test_the_weight_of_the_ball_on_the_motor_matters(drive: Drive):
    """A steel ball of 130 g, 1 to 3 cm off the middle, is worth some tenths of a volt."""
    rig = replace(table(None, 500.0), drive=drive)
    heavy = replace(rig, ball=replace(rig.ball, mass_kg=0.13))
    known = simulated(heavy)
    with_it = sizes(predict(heavy, known, LEVELS), 500.0)["servo"]
    without = sizes(predict(rig, known, LEVELS), 500.0)["servo"]
    assert without > 3 * with_it


def test_a_ball_that_nobody_sees_weighs_nothing():
    known = log(None, 500.0)
    seen = known.ball_at_ticks_m
    near = known.t_s < known.exposed_s[-1]
    np.testing.assert_allclose(
        seen[near][::50],
        [
            [np.interp(t, known.exposed_s, known.ball_m[:, a]) for a in (0, 1)]
            for t in known.t_s[near][::50]
        ],
    )
    lost = replace(known, ball_m=np.where(known.exposed_s[:, None] < 1.0, known.ball_m, np.nan))
    assert not lost.ball_at_ticks_m[known.t_s > 1.5].any()
    blind = replace(known, exposed_s=known.exposed_s[:0], ball_m=known.ball_m[:0])
    assert not blind.ball_at_ticks_m.any()


def test_the_moving_plate_matters():
    """Without its Euler and centrifugal terms (a ball of no radius) the gap is a hundred times."""
    rig = table(None, 500.0)
    flat = replace(rig, ball=replace(rig.ball, radius_m=1e-9))
    known = log(None, 500.0)
    assert sizes(predict(flat, known, LEVELS), 500.0)["ball"] > 100 * residual(None, 500.0)["ball"]


def test_a_log_of_the_loop_gives_signals_and_missing_channels_stay_empty():
    from experiments.runs.assemble import known as believed
    from experiments.runs.assemble import load_rig
    from experiments.runs.protocol import read_protocol
    from experiments.runs.runner import RunRequest, simulate_run

    rig = load_rig(None)
    run = simulate_run(RunRequest(rig, read_protocol("steps"), "with", 1, Path())).log
    found = signals(run, camera_delay_s=rig.camera.delay_s)
    assert len(found.t_s) == len(run)
    assert np.all(np.diff(found.exposed_s) > 0)
    result = predict(rig, found, noise())
    assert np.isfinite(result.servo[1:]).all()
    z = result.ball[60:] / result.ball_std[60:, None]
    assert 0.8 < np.sqrt(np.nanmean(z**2)) < 1.2  # the true model: white within its noise
    wrong = predict(believed(rig), found, noise())
    assert np.nanmean((wrong.ball[60:] / wrong.ball_std[60:, None]) ** 2) > 1.5 * np.nanmean(z**2)
    silent = Signals(found.t_s, np.empty((0, 2)), found.theta_rad, found.exposed_s, found.ball_m)
    only_ball = predict(rig, silent, noise())
    assert np.isnan(only_ball.servo).all()
    assert np.array_equal(only_ball.ball, result.ball, equal_nan=True)
