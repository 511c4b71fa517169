"""Centroids are means; what a controller does to a mean is known beforehand, play or not."""

import subprocess
import sys
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from experiments.analysis.centroids import centroid, two_clusters
from experiments.analysis.mean_of_run import expected_mean_m, integral_identity
from experiments.analysis.samples import ball_samples, place, run_part
from rig.course import Course
from rig.log import INDEX, Log
from rig.parameters import Gains, Rig
from rig.rigfile import read_rig
from rig.simulation import simulate
from tests.support import ROOT

DEFAULT = read_rig(ROOT / "experiments" / "rigs" / "default.toml")
PD = Gains(integral_rad_m_s=0.0)


@cache
def simulated(kind, *, arm=0, seconds=15.0, start=0.13, hold_s=0.0, seed=1):
    """A release from (-start, start): of the default table, one without effects, that with a PD."""
    rig = {"default": DEFAULT, "clean": Rig(), "pd": Rig(gains=PD)}[kind]
    n = round(seconds * 500)
    course = Course(np.zeros((n, 2)), np.zeros((n, 2)), (-start, start), hold_s)
    draws = simulate.draw(np.random.default_rng(seed), rig, course)
    return simulate.simulate(rig, replace(rig, effects={}), arm, course, draws).log


@settings(max_examples=15)
@given(arrays(float, st.tuples(st.integers(1, 60), st.just(2)), elements=st.floats(-0.13, 0.13)))
def test_k_means_with_one_cluster_is_the_mean(xy):
    np.testing.assert_allclose(centroid(xy), xy.mean(axis=0), atol=1e-12)


def test_a_machine_that_does_not_tell_its_cores_is_no_warning(monkeypatch: pytest.MonkeyPatch):
    from joblib.externals.loky.backend import context
    from sklearn.utils import _openmp_helpers

    nothing = ValueError("found 0 physical cores < 1")
    monkeypatch.setattr(context, "_count_physical_cores", lambda: ("not found", nothing))
    monkeypatch.delitem(_openmp_helpers._CPU_COUNTS, True, raising=False)
    assert centroid(np.array([[0.0, 0.0]])) == pytest.approx([0.0, 0.0])


def test_blank_samples_do_not_count():
    xy = np.array([[0.01, 0.02], [np.nan, 0.5], [0.03, 0.04]])
    np.testing.assert_allclose(centroid(xy), [0.02, 0.03])


def test_a_run_without_a_ball_has_no_centroid():
    with pytest.raises(ValueError, match="fewer than 1 different"):
        centroid(np.full((5, 2), np.nan))
    with pytest.raises(ValueError, match="shape"):
        centroid(np.zeros(4))
    with pytest.raises(ValueError, match="fewer than 2 different"):
        two_clusters(np.ones((9, 2)), np.arange(9) % 2)
    with pytest.raises(ValueError, match="one label each"):
        two_clusters(np.ones((9, 2)), np.zeros(8))


def test_two_clusters_tell_arms_that_lie_apart_and_no_others():
    r = np.random.default_rng(0)
    cloud = r.normal(0, 0.005, (2000, 2))
    labels = np.repeat(["without", "with"], 1000)
    apart = two_clusters(cloud + np.where(labels == "with", 0.05, -0.05)[:, None], labels)
    assert apart.adjusted_rand_index == 1.0
    np.testing.assert_allclose(
        np.sort(apart.centres_m, axis=0), [[-0.05] * 2, [0.05] * 2], atol=1e-3
    )
    np.testing.assert_allclose(apart.distances_m, 0.05 * np.sqrt(2), atol=1e-3)
    assert apart.explained > 0.95
    alike = two_clusters(cloud, labels)
    assert abs(alike.adjusted_rand_index) < 0.01
    assert alike.samples == 2000
    again = two_clusters(cloud, labels)
    assert np.array_equal(alike.centres_m, again.centres_m)


def test_two_clusters_do_not_find_the_arms_of_simulated_releases():
    xy, labels = [], []
    for arm in (0, 3):
        for seed in range(4):
            run = ball_samples(simulated("default", arm=arm, seed=seed)).xy_m
            xy.append(run)
            labels += [arm] * len(run)
    result = two_clusters(np.vstack(xy), np.array(labels))
    assert abs(result.adjusted_rand_index) < 0.02
    assert result.samples == len(labels)


def test_the_module_does_not_import_sklearn():
    code = (
        "import sys, experiments.analysis.centroids, experiments.analysis.metrics;"
        "sys.exit('sklearn' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False).returncode == 0


def test_the_expected_mean_is_the_facts_number():
    """0.079 m s/T from 13 cm: 10 mm at 8 s and 2.6 mm at 30 s."""
    np.testing.assert_allclose(expected_mean_m(1.0), [-0.0795, 0.0795], atol=5e-5)
    np.testing.assert_allclose(np.abs(expected_mean_m(8.0)), 0.010, atol=1e-4)
    np.testing.assert_allclose(np.abs(expected_mean_m(30.0)), 0.0026, atol=1e-4)
    np.testing.assert_allclose(expected_mean_m(10.0, integral_change_rad=(0.02, 0.0)), [-0.002, 0])
    with pytest.raises(ValueError, match="above 0"):
        expected_mean_m(0.0)
    with pytest.raises(ValueError, match="integral_rad_m_s"):
        expected_mean_m(9.0, integral_change_rad=(0.1, 0.1), rig=Rig(gains=PD))


def test_the_expected_mean_of_a_pd_by_integrating_its_equation():
    b, dt = Rig().ball_gain_m_s2, 1e-3
    x, v, total = 0.1, -0.05, 0.0
    for _ in range(20000):
        v += dt * b * (-PD.proportional_rad_m * x - PD.derivative_rad_s_m * v)
        x += dt * v
        total += dt * x
    expected = expected_mean_m(20.0, start_m=(0.1, 0.0), speed_m_s=(-0.05, 0.0))[0]
    assert total / 20 == pytest.approx(expected, rel=5e-3)


@pytest.mark.parametrize("seconds", [8.0, 15.0, 30.0])
@pytest.mark.parametrize(("start", "more"), [(0.05, 0.05), (0.13, 0.11)])
def test_a_pd_without_any_play_has_the_expected_mean(seconds, start, more):
    """More by the first frame's delay (28 ms, 5 %) and, from 13 cm, by the sine (5 %)."""
    mean = place(ball_samples(simulated("pd", seconds=seconds, start=start))).centroid_m
    expected = expected_mean_m(seconds, start_m=(-start, start))
    np.testing.assert_allclose(mean / expected, 1 + more, atol=0.04)


@pytest.mark.parametrize("kind", ["clean", "default"])
@pytest.mark.parametrize("arm", [0, 3])
@pytest.mark.parametrize(("seconds", "mm"), [(8.0, 0.2), (15.0, 0.1), (30.0, 0.06)])
def test_the_mean_error_is_what_the_integral_says(kind, arm, seconds, mm):
    for hold_s in (0.0, 0.5):
        log = simulated(kind, arm=arm, seconds=seconds, hold_s=hold_s)
        identity = integral_identity(log, 1.0)
        assert (identity.clipped == 0).all()
        gap = identity.mean_error_m - identity.predicted_m
        np.testing.assert_allclose(gap, 0, atol=mm * 1e-3)
        expected = expected_mean_m(
            identity.duration_s, integral_change_rad=tuple(identity.integral_change_rad)
        )
        np.testing.assert_allclose(expected, -identity.predicted_m)


def test_play_moves_the_mean_by_little():
    """Both arms, with and without play: the whole-run means differ by less than a pixel or two."""
    means = [place(ball_samples(simulated("default", arm=arm))).centroid_m for arm in (0, 3)]
    assert np.abs(means[0] - means[1]).max() < 1.25e-3


def test_an_identity_needs_an_integral_and_a_log_of_our_controller():
    log = simulated("clean")
    with pytest.raises(ValueError, match="ki above 0"):
        integral_identity(log, 0.0)
    rows = log.rows.copy()
    rows[:, INDEX["desired_theta_x_rad"]] = np.nan
    with pytest.raises(ValueError, match="desired_theta"):
        integral_identity(Log.from_rows(rows), 1.0)
    with pytest.raises(ValueError, match="4 s or more"):
        integral_identity(log.where(log["t_s"] < 3.0), 1.0)


def test_samples_have_their_time_target_and_push():
    n = 10
    log = Log.from_columns(
        {
            "t_s": 5 + 0.002 * np.arange(n),
            "phase": np.array([1.0] * 4 + [2.0] * 6),
            "ball_x_m": np.array([0.5, np.nan] * 5),
            "ball_y_m": np.array([0.25, np.nan] * 5),
            "ball_exposed_s": np.where(np.arange(n) % 2, np.nan, 5 + 0.002 * np.arange(n) - 0.002),
            "target_x_m": np.arange(n) / 100,
            "push": (np.arange(n) > 6).astype(float),
        }
    )
    ball = ball_samples(log)
    np.testing.assert_allclose(ball.t_s, [-0.002, 0.002, 0.006], atol=1e-12)
    np.testing.assert_allclose(ball.target_m, [[0.04, 0], [0.05, 0], [0.07, 0]])
    assert ball.pushed.tolist() == [False, False, True]
    assert len(run_part(log)) == 6
    assert len(ball_samples(log.where(slice(0, 0))).t_s) == 0
