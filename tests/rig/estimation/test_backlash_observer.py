"""The estimated play against the true one, on a table as measured, from readings alone."""

import inspect
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from rig.control.controllers import WITH, WITHOUT
from rig.course import Course
from rig.estimation import backlash_observer
from rig.estimation.backlash_observer import (
    gear_backlash,
    joint_backlash,
    known_width,
    lost_in_gear,
    lost_in_joint,
)
from rig.parameters import Rig
from rig.table import R_NEW, R_THETA, R_TIME, READING_SIZE, blank_reading
from tests.support.simulated import DEGREE, TICK_S, free_release, random_steps, realistic, run

SEEDS = range(8)


@cache
def estimates(place, degrees, protocol, arm, offset_rad=0.0):
    """Estimated full play and its standard deviation at the end, (2, seeds x axes) [degrees]."""
    kind = {f"{place}_deg": degrees, f"{place}_offset_rad": offset_rad}
    rig, found = realistic(**kind), []
    for seed in SEEDS:
        if protocol == "steps":
            course = random_steps(np.random.default_rng(100 + seed), 30.0)
        else:
            course = free_release(15.0)
        log = run(rig, arm, course, seed).log
        found += [
            [log[f"estimated_{place}_play{s}_{a}_rad"][-1] / DEGREE for s in ("", "_std")]
            for a in "xy"
        ]
    return np.array(found).T


def allowed(degrees):
    """The agreed tolerance of the median error [degrees]."""
    return 0.2 * degrees + 0.1 if degrees else 0.15


@pytest.mark.parametrize("protocol", ["steps", "release"])
@pytest.mark.parametrize("degrees", [0.0, 0.5, 1.0, 2.0, 3.0])
@pytest.mark.parametrize("place", ["gear", "joint"])
def test_play_is_found(place, degrees, protocol):
    found, _ = estimates(place, degrees, protocol, WITHOUT)
    assert np.median(np.abs(found - degrees)) <= allowed(degrees)


@pytest.mark.parametrize("protocol", ["steps", "release"])
@pytest.mark.parametrize("degrees", [0.5, 1.0, 2.0, 3.0])
@pytest.mark.parametrize("place", ["gear", "joint"])
def test_asymmetric_play_is_found(place, degrees, protocol):
    """Break points at -0.3 and +0.7 of the width."""
    found, _ = estimates(place, degrees, protocol, WITHOUT, 0.2 * degrees * DEGREE)
    assert np.median(np.abs(found - degrees)) <= allowed(degrees)


@pytest.mark.parametrize("degrees", [0.0, 1.0, 3.0])
@pytest.mark.parametrize("place", ["gear", "joint"])
def test_play_is_found_while_the_inverse_acts_on_it(place, degrees):
    found, _ = estimates(place, degrees, "steps", WITH)
    assert np.median(np.abs(found - degrees)) <= allowed(degrees)


@pytest.mark.parametrize("place", ["gear", "joint"])
def test_more_play_is_found_as_more(place):
    medians = [
        np.median(estimates(place, d, "steps", WITHOUT)[0]) for d in (0.0, 0.5, 1.0, 2.0, 3.0)
    ]
    assert np.all(np.diff(medians) > 0.3)


@pytest.mark.parametrize("place", ["gear", "joint"])
def test_a_play_of_a_degree_counts_as_known_in_the_end(place):
    found, std = estimates(place, 1.0, "steps", WITHOUT)
    assert all(known_width(w, d) == w for w, d in zip(found, std, strict=True))


@pytest.mark.parametrize("scale", [-0.02, 0.0, 0.02])
@pytest.mark.parametrize("degrees", [0.0, 1.0])
def test_gear_play_under_slow_triangles_is_found_whatever_the_tachometers_scale(degrees, scale):
    """2 % of the tachometer over 0.7 rad, 0.8 degrees of twist, is no play.

    Stiff gears do not wind up and slow arms hardly coast: without play half an encoder count is
    left (0.044 degrees), with play what the start in the middle of the gap teaches wrongly.
    """
    rig = realistic(gear_deg=degrees, joint_deg=0.0)
    rig = replace(
        rig,
        drive=replace(rig.drive, gear_stiffness_nm_rad=300.0),
        servo=replace(rig.servo, tachometer_scale=scale),
    )
    t = TICK_S * np.arange(round(16 / TICK_S))
    triangle = 4 * np.abs((t / 4 + 0.25) % 1 - 0.5) - 1
    targets = 0.35 * np.column_stack([triangle, -triangle])
    course = Course(targets, np.zeros_like(targets), servo_only=True)
    log = run(rig, WITHOUT, course, 0).log
    found = [log[f"estimated_gear_play_{a}_rad"][-1] / DEGREE for a in "xy"]
    np.testing.assert_allclose(found, degrees, atol=0.15 if degrees else 0.044)


def still(seconds=5.0):
    """Readings of a table that does nothing: no motion, no news."""
    for k in range(round(seconds / TICK_S)):
        row = blank_reading()
        row[R_TIME], row[R_THETA], row[R_THETA + 1] = k * TICK_S, 0.0, 0.0
        yield row


def test_estimators_start_at_zero_play_and_do_not_claim_to_know_it():
    q = backlash_observer.settings(Rig())
    e = backlash_observer.start(q)
    for a in range(2):
        for place in (gear_backlash, joint_backlash):
            width, deviation = place(e, q, a)
            assert width == 0.0
            assert deviation >= 2 * DEGREE


def test_the_first_rows_of_a_run_say_zero():
    log = run(realistic(3.0, 3.0), WITH, free_release(0.2, (0.02, 0.02)), 0).log
    for place in ("gear", "joint"):
        assert log[f"estimated_{place}_play_x_rad"][0] == 0.0


def test_a_table_that_does_not_move_shows_no_play():
    q = backlash_observer.settings(Rig())
    e = backlash_observer.start(q)
    for row in still():
        backlash_observer.observe_backlash(e, q, row)
    for a in range(2):
        for place, known in ((gear_backlash, lost_in_gear), (joint_backlash, lost_in_joint)):
            assert place(e, q, a)[1] >= 2 * DEGREE
            assert known(e, q, a) == 0.0


@pytest.mark.parametrize("place", ["gear", "joint"])
def test_too_short_a_run_says_so(place):
    """Before anything has reversed, two degrees are not known."""
    course = free_release(0.1, (0.03, -0.03))
    log = run(realistic(2.0, 2.0), WITH, course, 0).log
    for a in "xy":
        width = log[f"estimated_{place}_play_{a}_rad"][-1]
        deviation = log[f"estimated_{place}_play_std_{a}_rad"][-1]
        assert deviation > 1.9 * DEGREE
        assert known_width(width, deviation) == 0.0


def test_gear_play_without_a_tachometer_is_never_known():
    rig = realistic(gear_deg=2.0, tachometer=False)
    log = run(rig, WITH, random_steps(np.random.default_rng(0), 20.0), 0).log
    for a in "xy":
        assert np.all(np.isnan(log[f"motor_speed_{a}_rad_s"]))
        assert np.all(log[f"estimated_gear_play_{a}_rad"] == 0.0)
        assert np.all(log[f"estimated_gear_play_std_{a}_rad"] > 2 * DEGREE)
        assert log[f"estimated_joint_play_{a}_rad"][-1] == pytest.approx(1 * DEGREE, rel=0.3)


def test_a_ball_that_is_not_seen_teaches_no_joint_play():
    q = backlash_observer.settings(Rig())
    e = backlash_observer.start(q)
    for k, row in enumerate(still()):
        row[R_THETA] = 0.1 * np.sin(0.02 * k)
        row[R_NEW] = 0.0
        backlash_observer.observe_backlash(e, q, row)
    assert joint_backlash(e, q, 0)[0] == 0.0
    assert joint_backlash(e, q, 0)[1] >= 2 * DEGREE


def last(log, place, axis):
    """Width and deviation [rad] at a log's end."""
    name = f"estimated_{place}_play"
    return log[f"{name}_{axis}_rad"][-1], log[f"{name}_std_{axis}_rad"][-1]


@pytest.mark.parametrize("degrees", [1.0, 2.0])
@pytest.mark.parametrize("seed", [0, *(pytest.param(n, marks=pytest.mark.slow) for n in (1, 2, 3))])
def test_a_plate_that_drops_to_the_balls_side_is_not_taken_for_one_without_play(degrees, seed):
    """Without friction in its pivots the plate keeps no place: no confident wrong width."""
    rig = realistic(joint_deg=degrees)
    loose = replace(rig, drive=replace(rig.drive, joint_friction_nm=0.0))
    log = run(loose, WITH, random_steps(np.random.default_rng(seed), 30.0), seed).log
    for a in "xy":
        width, deviation = last(log, "joint", a)
        assert abs(width - degrees * DEGREE) < 2.5 * deviation


@pytest.mark.parametrize("amplitude", [0.1, 0.2, 0.3])
def test_hard_braking_does_not_spoil_the_gears_play(amplitude):
    """The arm coasts across the gap when the motor brakes hard: those edges teach nothing."""
    n = 6000
    squares = np.where((np.arange(n) // 250) % 2 == 0, amplitude, -amplitude)
    way = Course(np.column_stack([squares, squares]), np.zeros((n, 2)), (0.0, 0.0), 0.0, True)
    log = run(realistic(gear_deg=1.0), WITHOUT, way, 0).log
    for a in "xy":
        assert last(log, "gear", a)[0] == pytest.approx(1.0 * DEGREE, abs=0.15 * DEGREE)


@pytest.mark.parametrize("stiffness", [10.0, 30.0])
def test_wind_up_that_the_rig_file_explains_is_no_play(stiffness):
    rig = realistic(gear_deg=0.0)
    soft = replace(rig, drive=replace(rig.drive, gear_stiffness_nm_rad=stiffness))
    log = run(soft, WITH, random_steps(np.random.default_rng(1), 30.0), 1).log
    for a in "xy":
        assert last(log, "gear", a)[0] < 0.15 * DEGREE


def test_estimators_see_readings_alone():
    """Their arguments are their state, their settings and the reading; settings know no effects."""
    plain = getattr(backlash_observer.observe_backlash, "py_func")  # noqa: B009
    assert list(inspect.signature(plain).parameters) == ["e", "q", "reading"]
    assert READING_SIZE == 10
    effects = {
        "joint_backlash": {"x": {"play_rad": 0.05}},
        "level_offset": {"x": {"slope_rad": 0.1}},
    }
    bare, told = backlash_observer.settings(Rig()), backlash_observer.settings(Rig(effects=effects))
    assert bare.tobytes() == told.tobytes()


def test_known_play_needs_two_deviations():
    assert known_width(0.02, 0.0099) == 0.02
    assert known_width(0.02, 0.0101) == 0.0
    assert known_width(0.0, 0.0) == 0.0
    assert known_width(0.02, np.nan) == 0.0
