"""Level slopes, the ball's direction and the delay from a ball that is led about."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from calibration.camera.sheet import CalibrationError
from calibration.motion.level import level_record, timing_from_ball
from calibration.motion.rolling import Rolling, behind_backlash, fit_rolling, rolling
from experiments.runs.assemble import another_unit, known, load_rig
from rig.control.controllers import COMPENSATORS
from rig.course import Course
from rig.simulation.simulate import draw, simulate

SEEDS, DEGREE = (0, 1, 2, 3), np.radians(1)
KIND = known(load_rig(None))


def unit(seed: int):
    rig = load_rig(None)
    rig = another_unit(rig, seed) if seed else rig
    extra = {"xy": {"extra_s": 0.003 * (seed - 1)}}
    return replace(rig, effects={**rig.effects, "camera_delay": extra})


@cache
def log(seed: int):
    rig = unit(seed)
    t = np.arange(round(40 * rig.control_rate_hz)) / rig.control_rate_hz
    targets = 0.05 * np.column_stack([np.sin(2 * np.pi * f * t) for f in (0.35, 0.45)])
    way = Course(targets, np.zeros_like(targets))
    draws = draw(np.random.default_rng(seed), rig, way)
    return simulate(rig, KIND, COMPENSATORS["without"], way, draws).log


@cache
def record(seed: int):
    return level_record([rolling(log(seed), 0)], [rolling(log(seed), 1)], KIND)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("axis", ["x", "y"])
def test_the_slope_comes_back_within_5_thousandths_of_a_degree(seed, axis):
    found = record(seed).slope_rad[axis]
    true = unit(seed).effects["level_offset"][axis]["slope_rad"]
    assert found.value == pytest.approx(true, abs=0.005 * DEGREE)
    assert found.low <= true <= found.high


@pytest.mark.parametrize("seed", SEEDS)
def test_gain_and_play_come_with_it(seed):
    for axis in ("x", "y"):
        gain = record(seed).gain_m_s2[axis]
        assert gain.low <= KIND.ball_gain_m_s2 <= gain.high
        assert record(seed).play_rad[axis] == pytest.approx(1.5 * DEGREE, abs=0.35 * DEGREE)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_ball_tells_the_delay_within_its_interval(seed):
    axes = [[rolling(log(seed), a)] for a in range(2)]
    found = timing_from_ball(axes, KIND, KIND.camera.delay_s).delay_s
    true = KIND.camera.delay_s + 0.003 * (seed - 1)
    assert found.low <= true <= found.high
    assert found.high - found.low < 0.016  # what other motions may be off by is in it


def test_a_ball_that_runs_the_wrong_way_is_refused():
    run = rolling(log(0), 0)
    turned = replace(run, x_m=-run.x_m)
    with pytest.raises(CalibrationError, match=r"direction signs: .* towards -x"):
        level_record([turned], [rolling(log(0), 1)], KIND)
    with pytest.raises(CalibrationError, match="the rig file makes it"):
        level_record([replace(run, x_m=2 * run.x_m)], [rolling(log(0), 1)], KIND)


def test_too_little_is_said():
    run = rolling(log(0), 0)
    short = run.seen_s < 6
    with pytest.raises(CalibrationError, match="record longer"):
        fit_rolling([replace(run, seen_s=run.seen_s[short], x_m=run.x_m[short])], KIND)
    with pytest.raises(CalibrationError, match="lead the ball about"):
        fit_rolling([replace(run, theta_rad=0.01 * run.theta_rad)], KIND)
    pushed = log(0).rows.copy()
    with pytest.raises(CalibrationError, match="too short"):
        rolling(log(0).where(slice(0, 3)), 0)
    assert len(pushed)


def test_behind_backlash_follows_at_half_the_width():
    theta = np.concatenate((np.linspace(0, 1, 50), np.linspace(1, -1, 100)))
    out = behind_backlash(theta, 0.2)
    assert out[49] == pytest.approx(0.9)
    assert out[-1] == pytest.approx(-0.9)
    assert np.all(np.abs(out - theta) <= 0.1 + 1e-12)
    assert np.array_equal(behind_backlash(theta, 0.0), theta)


def test_an_exact_ball_gives_exact_numbers():
    """The equation itself, integrated finely: slope, gain and lateness without noise."""
    t = np.arange(0, 30, 0.002)
    theta = 0.2 * np.sin(2 * np.pi * 0.5 * t) + 0.1 * np.sin(2 * np.pi * 0.23 * t)
    gain, slope, ratio = KIND.ball_gain_m_s2, 0.002, KIND.linkage.ratio
    pull = gain * np.sin(theta) + gain / ratio * slope
    speed = np.concatenate(([0], np.cumsum(0.5 * (pull[1:] + pull[:-1]) * 0.002)))
    place = np.concatenate(([0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * 0.002)))
    x = place - KIND.ball.radius_m * ratio * np.sin(theta)
    seen = np.arange(0.1, 29, 1 / 60)
    run = Rolling(t, theta, seen + 0.007, np.interp(seen, t, x))
    fit = fit_rolling([run], KIND)
    assert fit.slope_rad[0] == pytest.approx(slope, abs=1e-6)
    assert fit.gain_m_s2[0] == pytest.approx(gain, rel=1e-4)
    assert fit.late_s[0] == pytest.approx(0.007, abs=1e-4)
    assert fit.backlash_rad[0] < 1e-3
