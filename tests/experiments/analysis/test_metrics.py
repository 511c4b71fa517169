"""A run's numbers: known signals give known numbers, simulated pushes are found, gaps are NaN."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from experiments.analysis.limit_cycle import FEW, limit_cycle, noise_std
from experiments.analysis.metrics import run_metrics, settled_interval, settling_time
from experiments.analysis.push_detection import detect_pushes
from experiments.analysis.samples import Samples, ball_samples
from rig.course import Course
from rig.log import INDEX, Log
from rig.rigfile import read_rig
from rig.simulation import simulate
from tests.support import ROOT

DEFAULT = read_rig(ROOT / "experiments" / "rigs" / "default.toml")


def made(xy, *, hz=60.0, **columns):
    """A log with a tick per ball sample; `xy` (n, 2) [m]; all rows of the run phase."""
    n = len(xy)
    given = {"t_s": np.arange(n) / hz, "ball_x_m": xy[:, 0], "ball_y_m": xy[:, 1]}
    given |= {"phase": np.full(n, 2.0), "push": np.zeros(n)} | columns
    return Log.from_columns(given)


def samples(t, xy):
    return Samples(t, xy, np.zeros_like(xy), np.zeros(len(t), bool), t)


def sine(seconds, amplitude, period, *, noise=0.0003, drift=0.0, seed=0, hz=60):
    r = np.random.default_rng(seed)
    t = np.arange(round(seconds * hz)) / hz
    x = amplitude * np.sin(2 * np.pi * t / period + r.uniform(0, 6)) + drift * np.exp(-t / 3)
    return samples(t, np.column_stack([x, x]) + noise * r.standard_normal((len(t), 2)))


@cache
def simulated(seed, *, arm=0, seconds=15.0, start=(-0.13, 0.13), hold_s=0.0, pushes=(), hz=60.0):
    """A run of the default table; pushes = ((time, vx, vy), ...) of 0.08 s each."""
    rig = replace(DEFAULT, camera=replace(DEFAULT.camera, rate_hz=hz))
    n = round(seconds * 500)
    push = np.zeros((n, 2))
    for t, vx, vy in pushes:
        push[round(t * 500) : round(t * 500) + 40] = vx / 0.08, vy / 0.08
    course = Course(np.zeros((n, 2)), push, start, hold_s)
    draws = simulate.draw(np.random.default_rng(seed), rig, course)
    return simulate.simulate(rig, replace(rig, effects={}), arm, course, draws).log


@pytest.mark.parametrize("delay_s", [0.0, 0.012, 0.05])
def test_a_ball_settles_whatever_the_cameras_delay(delay_s: float):
    """Exposures before the first row are held from it on, not to the end of the run."""
    t, tick = np.arange(0.0, 12.0, 1.0 / 60.0), np.arange(0.0, 12.0, 0.002)
    away = 0.18 * np.exp(-t)
    row = np.searchsorted(tick, t - 1e-9)
    columns = {name: np.full(len(tick), np.nan) for name in ("ball_x_m", "ball_y_m")}
    columns["ball_x_m"][row] = columns["ball_y_m"][row] = away
    columns["ball_exposed_s"] = np.full(len(tick), np.nan)
    columns["ball_exposed_s"][row] = t - delay_s
    given = {"t_s": tick, "phase": np.full(len(tick), 2.0), "push": np.zeros(len(tick))}
    log = Log.from_columns(given | columns)
    ball = ball_samples(log)
    assert np.all(np.diff(ball.until_s) > 0.0)
    assert np.all(ball.until_s[:-1] <= ball.t_s[1:] + 0.002)
    assert run_metrics(log).settling_s == pytest.approx(4.85 - delay_s, abs=0.05)


def test_place_of_known_points():
    xy = np.array([[0.03, 0.0], [0.01, 0.0], [0.02, 0.01], [0.02, -0.01]])
    m = run_metrics(made(xy))
    np.testing.assert_allclose(m.centroid_m, [0.02, 0])
    assert m.distance_m == pytest.approx(0.02)
    assert m.spread_m == pytest.approx(0.01)
    assert m.error_rms_m == pytest.approx(np.sqrt(np.mean((xy**2).sum(1))))
    assert (m.samples, m.pushes, m.duration_s) == (4, 0, pytest.approx(4 / 60))


def test_only_the_run_phase_counts_and_imports_are_a_run_throughout():
    xy = np.vstack([np.full((60, 2), 0.1), np.random.default_rng(0).normal(0, 0.001, (120, 2))])
    phase = np.repeat([0.0, 1.0, 2.0], [30, 30, 120])
    m = run_metrics(made(xy, phase=phase))
    assert m.samples == 120
    assert m.settling_s == 0.0
    assert m.duration_s == pytest.approx(2.0)
    assert run_metrics(made(xy, phase=np.full(180, np.nan))).samples > 120


def test_settling_needs_a_whole_stay():
    t = np.arange(600) / 60
    xy = np.zeros((600, 2))
    xy[:100, 0] = 0.05
    xy[130, 1] = -0.03  # half a second inside is no stay
    assert settling_time(samples(t, xy)) == pytest.approx(t[131])
    assert settling_time(samples(t, xy), band_m=0.06) == 0.0
    assert np.isnan(settling_time(samples(t, xy), stay_s=9.0))
    gap = np.delete(np.arange(600), np.arange(150, 190))  # unseen is not staying
    assert settling_time(samples(t[gap], xy[gap])) == pytest.approx(t[190])
    assert np.isnan(settling_time(samples(t[:0], xy[:0])))


def test_settling_is_measured_from_the_target():
    xy = 0.05 + np.random.default_rng(0).normal(0, 1e-4, (300, 2))
    assert np.isnan(run_metrics(made(xy)).settling_s)
    on = run_metrics(made(xy, target_x_m=np.full(300, 0.05), target_y_m=np.full(300, 0.05)))
    assert on.settling_s == 0.0
    assert on.distance_m < 2e-5


def test_a_still_ball_whose_values_are_held_is_there_and_a_blank_one_is_not():
    xy = np.zeros((300, 2))
    xy[:20] = 0.03
    for nudge in (0.0, 1e-5):
        xy[::60] += nudge
        m = run_metrics(made(xy))
        assert m.settling_s == pytest.approx(20 / 60)
        assert m.unseen_at_end_s < 0.05
    blank = np.arange(300) % 60 > 1
    xy[blank] = np.nan
    assert not run_metrics(made(xy)).has_settled


def test_a_run_that_never_settles_is_measured_over_its_last_half():
    xy = np.repeat([[0.08, 0.0], [0.04, 0.03]], 300, axis=0)
    m = run_metrics(made(xy))
    assert not m.has_settled
    assert np.isnan(m.settling_s)
    np.testing.assert_allclose(m.settled.centroid_m, [0.04, 0.03])
    assert m.settled.distance_m == pytest.approx(0.05)
    assert m.settled.spread_m == pytest.approx(0, abs=1e-12)


@settings(max_examples=40)
@given(
    amplitude=st.floats(0.0015, 0.012),
    period=st.floats(1.0, 4.0),
    drift=st.floats(-0.015, 0.015),
    seed=st.integers(0, 1000),
)
def test_a_sine_is_found_with_its_amplitude_and_period(amplitude, period, drift, seed):
    drift = np.clip(drift, -2 * amplitude, 2 * amplitude)
    for cycle in limit_cycle(sine(20, amplitude, period, drift=drift, seed=seed)):
        assert cycle.cycles >= 20 / period - 2.6
        assert cycle.period_s == pytest.approx(period, rel=0.05)
        assert cycle.amplitude_m == pytest.approx(amplitude, rel=0.05, abs=1e-4)


@given(st.integers(0, 200), st.floats(-0.01, 0.01))
def test_noise_and_drift_are_no_limit_cycle(seed, drift):
    for cycle in limit_cycle(sine(15, 0.0, 3.0, drift=drift, seed=seed)):
        assert np.isnan(cycle.amplitude_m)
        assert cycle.reason == FEW


def test_too_few_cycles_and_moving_targets_have_a_reason():
    assert limit_cycle(sine(5.5, 0.005, 3.0))[0].reason == FEW
    n = 1200
    angle = np.arange(n) / 60
    xy = 0.05 * np.column_stack([np.cos(angle), np.sin(angle)])
    m = run_metrics(made(xy, target_x_m=xy[:, 0], target_y_m=xy[:, 1]))
    assert m.cycle[0].reason == "the target moves"
    assert m.error_rms_m == 0


def test_a_swing_is_whole_from_passage_to_passage():
    """2.2 periods with two whole swings between passages, of which not all turning points show that
    bound them, as in the default run of 16 s."""
    t = np.arange(0.0, 2.2 * 3.0, 1 / 60)
    noise = 0.0003 * np.random.default_rng(1).standard_normal((len(t), 2))
    swings = 0.009 * np.sin(2 * np.pi * (t / 3.0 - 0.1))
    for cycle in limit_cycle(samples(t, swings[:, None] + noise)):
        assert cycle.cycles == 2
        assert cycle.period_s == pytest.approx(3.0, rel=0.05)
        assert cycle.amplitude_m == pytest.approx(0.009, rel=0.05)


def test_the_default_table_cycles_alike_however_long_it_is_watched():
    short, long = (run_metrics(simulated(1, seconds=t)) for t in (30.0, 60.0))
    for a, b in zip(short.cycle, long.cycle, strict=True):
        assert a.period_s == pytest.approx(b.period_s, rel=0.1)
        assert a.amplitude_m == pytest.approx(b.amplitude_m, rel=0.15)
        assert b.cycles >= 8


def test_pushes_do_not_enter_the_limit_cycle():
    pushed = simulated(1, seconds=30.0, pushes=((7.0, 0.15, 0.0), (10.0, -0.1, 0.1)))
    m, free = run_metrics(pushed), run_metrics(simulated(1, seconds=30.0))
    assert m.pushes == 2
    assert m.settled.spread_m > 1.3 * free.settled.spread_m
    for a, b in zip(m.cycle, free.cycle, strict=True):
        assert a.amplitude_m == pytest.approx(b.amplitude_m, rel=0.2)


def test_servo_numbers():
    n = 1200
    theta = 0.01 + 0.02 * np.sin(np.arange(n) / 60 * 2 * np.pi)
    columns = {
        "theta_x_rad": theta,
        "theta_y_rad": np.where(np.arange(n) % 7, -theta, np.nan),
        "desired_theta_x_rad": theta + 0.005,
        "voltage_x_V": np.full(n, -2.0),
        "estimated_gear_play_x_rad": np.linspace(0, 0.017, n),
        "estimated_gear_play_std_x_rad": np.linspace(1, 0.001, n),
    }
    m = run_metrics(made(np.zeros((n, 2)) + np.arange(n)[:, None] * 1e-9, **columns))
    np.testing.assert_allclose(m.servo_activity_rad, 0.02 / np.sqrt(2), rtol=0.01)
    np.testing.assert_allclose(m.servo_rms_rad, np.hypot(0.01, 0.02 / np.sqrt(2)), rtol=0.01)
    np.testing.assert_allclose(m.servo_tracking_rad, [0.005, np.nan])
    np.testing.assert_allclose(m.servo_tracking_whole_rad, [0.005, np.nan])
    np.testing.assert_allclose(m.voltage_rms_V, [2.0, np.nan])
    np.testing.assert_allclose(m.gear_play_rad, [0.017, np.nan])
    np.testing.assert_allclose(m.gear_play_std_rad, [0.001, np.nan])
    assert np.isnan(m.joint_play_rad).all()


def test_a_run_without_a_ball_and_a_servo_run_with_one():
    n = 500
    theta = np.random.default_rng(0).normal(0, 0.1, n)
    log = made(np.full((n, 2), np.nan), theta_x_rad=theta)
    for m in (
        run_metrics(log),
        run_metrics(made(np.zeros((n, 2)), theta_x_rad=theta), servo_only=True),
    ):
        assert m.samples == 0
        assert not m.has_settled
        assert np.isnan(m.centroid_m).all()
        assert np.isnan([m.distance_m, m.spread_m, m.settled.spread_m, m.unseen_at_end_s]).all()
        assert m.servo_rms_rad[0] == pytest.approx(np.sqrt(np.mean(theta[250:] ** 2)))
        assert m.cycle[0].reason
    assert len(detect_pushes(log)) == 0


def test_one_axis_is_enough():
    wave = sine(15, 0.006, 3.0)
    xy = wave.xy_m.copy()
    xy[:, 1] = np.nan
    m = run_metrics(made(xy))
    assert m.settling_s == 0.0
    assert m.spread_m == pytest.approx(0.006 / np.sqrt(2), rel=0.03)
    assert m.cycle[0].amplitude_m == pytest.approx(0.006, rel=0.05)
    assert np.isnan(m.cycle[1].amplitude_m)
    assert np.isnan(m.centroid_m[1])


def test_empty_and_tiny_run_phases():
    none = made(np.zeros((50, 2)), phase=np.ones(50))
    for log in (none, none.where(slice(0, 0)), made(np.zeros((1, 2)))):
        m = run_metrics(log)
        assert m.duration_s == 0.0
        assert not m.has_settled
        assert np.isnan(m.servo_rms_rad).all()
        assert len(detect_pushes(log)) == 0
        result = settled_interval(log, rng=np.random.default_rng(0))
        assert np.isnan(result.spread_low_m)


def test_a_lost_ball_is_told_and_its_time_not_counted_to_the_servos():
    n = 900
    xy = sine(15, 0.005, 3.0).xy_m.copy()
    xy[600:] = np.nan
    theta = np.where(np.arange(n) < 600, 0.02, 0.0)
    m = run_metrics(made(xy, theta_x_rad=theta, theta_y_rad=theta))
    assert m.unseen_at_end_s == pytest.approx(5.0, abs=0.05)
    np.testing.assert_allclose(m.servo_rms_rad, 0.02)
    assert m.has_settled


def test_pushes_are_counted_as_episodes():
    push = np.zeros(600)
    push[[0, 1, 2, 50, 51, 300]] = 1
    push[[51, 200]] = np.nan
    push[599] = 2
    xy = np.random.default_rng(0).normal(0, 1e-3, (600, 2))
    assert run_metrics(made(xy, push=push)).pushes == 4
    assert run_metrics(made(xy, push=np.full(600, np.nan))).pushes is None


def test_noise_is_told_from_motion():
    wave = sine(15, 0.01, 2.0, noise=0.0003).xy_m[:, 0]
    assert noise_std(wave) == pytest.approx(0.0003, rel=0.1)
    assert noise_std(np.round(wave / 0.000625) * 0.000625) > 0
    assert noise_std(np.zeros(2)) == 0.0


def drawn_pushes(seed, speed):
    r = np.random.default_rng([seed, 7])
    times = 4.0 + 3.0 * np.arange(4) + r.uniform(0, 1, 4)
    angles = r.uniform(0, 2 * np.pi, 4)
    return tuple(
        (t, speed * np.cos(a), speed * np.sin(a)) for t, a in zip(times, angles, strict=True)
    )


@pytest.mark.parametrize(("speed", "hz"), [(0.1, 60.0), (0.2, 30.0), (0.2, 60.0)])
def test_simulated_pushes_are_found_and_nothing_else(speed, hz):
    """Precision 1, recall at least 0.95, times within 60 ms, at 0.3 mm of noise."""
    found = asked = 0
    for seed in range(5):
        pushes = drawn_pushes(seed, speed)
        log = simulated(
            seed, arm=3 * (seed % 2), seconds=18.0, pushes=pushes, hz=hz, start=(-0.06, 0.06)
        )
        middles = np.array([p[0] for p in pushes]) + 0.04
        middles = middles[middles < log["t_s"][-1]]
        times = detect_pushes(log)
        near = np.abs(times[:, None] - middles).min(axis=1, initial=1.0)
        assert (near < 0.06).all(), (seed, times, middles)
        found, asked = found + len(times), asked + len(middles)
    assert found >= 0.95 * asked
    assert asked >= 12


@pytest.mark.parametrize("arm", [0, 3])
def test_no_push_is_seen_where_none_was(arm):
    for seed in range(12):
        log = simulated(seed, arm=arm, hold_s=0.5 * (seed % 2), hz=30.0 * (1 + seed // 6))
        assert len(detect_pushes(log)) == 0, seed


def test_without_servo_angles_the_bound_is_the_plates_largest_slope():
    pushes = drawn_pushes(1, 0.2)
    log = simulated(1, arm=3, seconds=18.0, pushes=pushes, start=(-0.06, 0.06))
    rows = log.rows.copy()
    rows[:, [INDEX["theta_x_rad"], INDEX["theta_y_rad"]]] = np.nan
    assert len(detect_pushes(Log.from_rows(rows))) == len(pushes)
    rows = simulated(2).rows.copy()
    rows[:, INDEX["theta_x_rad"]] = np.nan
    assert len(detect_pushes(Log.from_rows(rows))) == 0


def test_the_settled_interval_of_one_run_tells_what_longer_runs_show():
    """Intervals of 20 s hold the settled spread of 60 s (one table, no drift left after 10 s)."""
    log = simulated(3, seconds=60.0, start=(0.0, 0.0))
    late = log.where(log["t_s"] > 12.0)
    truth = run_metrics(late).settled
    part = settled_interval(late.where(late["t_s"] < 32.0), rng=np.random.default_rng(0))
    assert part.spread_low_m < truth.spread_m < part.spread_high_m
    assert (part.mean_low_m < truth.centroid_m).all()
    assert (truth.centroid_m < part.mean_high_m).all()
    assert part.block_s >= 2.5
    assert part.spread_high_m < 1.5 * part.spread_low_m
