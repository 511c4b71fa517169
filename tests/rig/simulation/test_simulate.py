"""Whole runs: the same whatever the threads, decided by the seed alone, ending as they ended."""

from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
import pytest

from rig.control.controllers import WITH, WITHOUT
from rig.course import Course
from rig.parameters import CameraTiming, Rig
from rig.simulation import simulate
from tests.support.simulated import DEGREE, TICK_S, free_release, random_steps, realistic, run


def jobs(count=6):
    for seed in range(count):
        course = random_steps(np.random.default_rng(seed), 2.0)
        yield partial(run, realistic(), WITH, course, seed)


def test_threads_do_not_change_a_bit():
    alone = [job().log.rows for job in jobs()]
    for cores in (1, 2, 5):
        with ThreadPoolExecutor(cores) as pool:
            together = list(pool.map(lambda job: job(), jobs()))
        for one, other in zip(alone, together, strict=True):
            np.testing.assert_array_equal(one, other.log.rows)


def test_the_seed_decides():
    course = random_steps(np.random.default_rng(0), 2.0)
    one, same, other = (run(Rig(), WITH, course, seed).log.rows for seed in (5, 5, 6))
    np.testing.assert_array_equal(one, same)
    assert not np.array_equal(one, other, equal_nan=True)


def test_a_run_does_not_touch_what_it_is_given():
    course = random_steps(np.random.default_rng(0), 1.0)
    draws = simulate.draw(np.random.default_rng(0), Rig(), course)
    before = [a.copy() for a in (course.targets_m, course.pushes_m_s2, draws.camera)]
    first = simulate.simulate(Rig(), Rig(), WITH, course, draws).log.rows
    again = simulate.simulate(Rig(), Rig(), WITH, course, draws).log.rows
    np.testing.assert_array_equal(first, again)
    for a, b in zip(before, (course.targets_m, course.pushes_m_s2, draws.camera), strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_longer_run_begins_like_a_shorter_one():
    """The same seed: more ticks draw more numbers, not other ones."""
    course = random_steps(np.random.default_rng(0), 3.0)
    short = Course(course.targets_m[:500], course.pushes_m_s2[:500])
    long_rows, short_rows = (run(Rig(), WITH, c, 1).log.rows for c in (course, short))
    np.testing.assert_array_equal(long_rows[:500], short_rows)


def test_observations_come_at_the_cameras_rate_and_delay():
    log = run(Rig(), WITHOUT, free_release(2.0, (0.02, 0.01)), 0).log
    t, exposed = log["t_s"], log["ball_exposed_s"]
    new = ~np.isnan(exposed)
    np.testing.assert_allclose(exposed[new], np.arange(1, new.sum() + 1) / 60, atol=1e-12)
    waited = t[new] - exposed[new]
    assert waited.min() >= 0.012 - 1e-9
    assert waited.max() < 0.012 + TICK_S


@pytest.mark.parametrize("rate_hz", [30.0, 60.0, 120.0])
def test_noise_and_dropouts_are_those_of_the_rig(rate_hz):
    camera = CameraTiming(rate_hz=rate_hz, noise_m=0.0005, dropout=0.2)
    course = free_release(20.0, (0.0, 0.0))
    log = run(Rig(camera=camera), WITHOUT, course, 0).log
    quiet = run(Rig(camera=CameraTiming(rate_hz=rate_hz, noise_m=0.0)), WITHOUT, course, 0).log
    assert np.abs(quiet.ball()[1]).max() == 0.0  # nothing moves a quiet table
    t, xy = log.ball()
    assert len(t) / (20 * rate_hz) == pytest.approx(0.8, abs=0.05)
    # White noise shows in the difference of neighbours, the ball's slow answer to it does not.
    steps = np.diff(xy, axis=0)
    assert steps.std() / np.sqrt(2) == pytest.approx(0.0005, rel=0.15)
    assert abs(np.corrcoef(steps.T)[0, 1]) < 0.25  # x and y err on their own


def test_encoder_angles_are_whole_counts():
    log = run(Rig(), WITHOUT, random_steps(np.random.default_rng(0), 2.0), 0).log
    counts = log["theta_x_rad"] / (2 * np.pi / 4096)
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
    assert np.ptp(counts) > 20


def test_applied_volts_keep_the_rigs_limit_and_wishes_do_not():
    log = run(Rig(), WITHOUT, free_release(2.0, (-0.13, 0.13)), 1).log
    assert np.abs(log["voltage_x_V"]).max() == 6.0
    assert np.abs(log["wanted_voltage_x_V"]).max() > 6.0


def test_a_ball_that_leaves_the_plate_is_lost_and_never_seen_again():
    course = free_release(6.0, (0.0, 0.0))
    course.pushes_m_s2[500:700] = 4.0, 0.0
    done = run(Rig(), WITHOUT, course, 0)
    assert done.outcome == "ball lost"
    seen = done.log["t_s"][~np.isnan(done.log["ball_x_m"])]
    assert 1.0 < seen[-1] < 1.6
    assert len(done.log) < 3000


def test_a_quiet_run_completes():
    done = run(Rig(), WITH, free_release(3.0, (-0.08, 0.08)), 0)
    assert done.outcome == "completed"
    assert len(done.log) == 1500


def test_held_ball_stays_until_it_is_let_go():
    course = free_release(2.0, (-0.08, 0.08))
    held = Course(course.targets_m, course.pushes_m_s2, course.start_m, hold_s=0.5)
    t, xy = run(Rig(), WITHOUT, held, 0).log.ball()
    np.testing.assert_allclose(xy[t < 0.5], np.tile([-0.08, 0.08], ((t < 0.5).sum(), 1)), atol=2e-3)
    assert np.abs(xy[-1] - [-0.08, 0.08]).max() > 0.02


def test_mirrored_table_gives_the_mirrored_run():
    """Start, targets and the camera's noise turned round: the whole loop turns round, exactly."""
    course = random_steps(np.random.default_rng(3), 3.0)
    rig = Rig(effects={"joint_backlash": {a: {"play_rad": DEGREE} for a in "xy"}})
    draws = simulate.draw(np.random.default_rng(0), rig, course)
    turned = Course(-course.targets_m, -course.pushes_m_s2)
    signs = np.array([-1.0, -1.0, 1.0])
    other = simulate.Draws(draws.camera * signs, -draws.tachometer)
    a = simulate.simulate(rig, Rig(), WITH, course, draws).log
    b = simulate.simulate(rig, Rig(), WITH, turned, other).log
    for name in ("theta_x_rad", "theta_y_rad", "voltage_x_V", "ball_x_m", "ball_y_m"):
        np.testing.assert_allclose(a[name], -b[name], rtol=0, atol=1e-9)
    name = "estimated_joint_play_x_rad"
    np.testing.assert_allclose(a[name], b[name], rtol=0, atol=1e-9)
