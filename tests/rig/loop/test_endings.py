"""What must not slip through: odd ticks, repeated exposures, late losses, effects out of range."""

import numpy as np
import pytest

from rig.course import Course
from rig.effects import check
from rig.estimation import observers
from rig.parameters import CameraTiming, Rig
from rig.plant import plant, plant_record
from rig.safety.limits import Braking, limit
from rig.simulation.simulate import draw, simulate
from rig.table import R_BALL, R_EXPOSED, R_NEW, R_TIME, blank_reading
from tests.support.simulated import free_release, run


def test_an_observation_given_twice_changes_nothing():
    b, q = observers.start(), observers.settings(Rig())
    for exposed in (0.1, 0.12, 0.12, 0.11):
        row = blank_reading()
        row[R_NEW], row[R_EXPOSED], row[R_TIME] = 1.0, exposed, 0.2
        row[R_BALL : R_BALL + 2] = exposed
        observers.observe_ball(b, q, row)
    assert np.isfinite(b["velocity"]).all()
    assert b["exposed"] == 0.12
    assert b["frames"] == 2


@pytest.mark.parametrize("rate_hz", [300.0, 500.0, 700.0, 5000.0])
def test_simulated_time_keeps_up_with_any_tick(rate_hz: float):
    """A free ball at 0.1 m/s on a level plate is 0.1 m on after a second, whatever the tick."""
    p = plant_record.pack(Rig(control_rate_hz=rate_hz))
    s, seen = plant.rest(), np.full(7, np.nan)
    s[plant.BALL_W, 0] = 0.1
    history = plant_record.no_volts(Rig())
    for k in range(round(rate_hz)):
        t = k / rate_hz
        plant.advance(s, p, history, t, 1 / rate_hz, 0.0, 0.0, False, np.inf, seen)
    assert s[plant.BALL, 0] == pytest.approx(0.1, rel=1e-6)


def test_a_ball_lost_shortly_before_the_end_is_lost():
    course = free_release(1.5, (0.0, 0.0))
    course.pushes_m_s2[100:300] = 4.0, 0.0
    assert run(Rig(), 0, course, 0).outcome == "ball lost"


def test_a_fallen_ball_loads_the_plate_no_more():
    p, s = plant_record.pack(Rig()), plant.rest((0.2, 0.0))
    before, seen = s.copy(), np.full(7, np.nan)
    for k in range(100):
        fell = plant.advance(
            s, p, plant_record.no_volts(Rig()), k * 0.002, 0.002, 0.0, 0.0, False, np.inf, seen
        )
        assert fell
    assert np.array_equal(s, before)


def test_plant_and_controller_must_share_their_tick_and_draws_must_suffice():
    n = 50
    way = Course(np.zeros((n, 2)), np.zeros((n, 2)))
    fast = Rig(control_rate_hz=1000.0)
    numbers = draw(np.random.default_rng(0), Rig(), way)
    with pytest.raises(ValueError, match="control_rate_hz"):
        simulate(fast, Rig(), 0, way, numbers)
    slow = Rig(camera=CameraTiming(rate_hz=10.0))
    few = draw(np.random.default_rng(0), slow, Course(np.zeros((5000, 2)), np.zeros((5000, 2))))
    long = Course(np.zeros((5000, 2)), np.zeros((5000, 2)))
    with pytest.raises(ValueError, match="too few"):
        simulate(Rig(), Rig(), 0, long, few)


def test_a_camera_faster_than_the_loop_is_refused():
    with pytest.raises(ValueError, match=r"camera\.rate_hz = 1000"):
        Rig(camera=CameraTiming(rate_hz=1000.0))


@pytest.mark.parametrize(
    ("name", "key", "value"),
    [
        ("stribeck_friction", "speed_rad_s", 0.0),
        ("stribeck_friction", "extra_V", -0.1),
        ("saturation", "limit_V", float("nan")),
        ("saturation", "limit_V", 0.0),
        ("dead_zone", "half_width_V", -0.1),
        ("gear_backlash", "offset_rad", 0.01),
        ("cross_coupling", "fraction", 1.5),
        ("input_delay", "delay_s", 1.0),
        ("level_offset", "slope_rad", float("inf")),
    ],
)
def test_effects_out_of_range_are_refused(name: str, key: str, value: float):
    with pytest.raises(ValueError, match=name):
        check({name: {"x": {key: value}}})
    assert check({"saturation": {"x": {"limit_V": float("inf")}}}) is None


def test_the_limiter_does_not_trip_over_the_smallest_numbers():
    stops = Braking(0.0, 0.025, 9.0)
    assert limit(5e-324, 0.3, 0.0, 0.0, 6.0, 0.1, 1.0, stops) == -1.0
    assert limit(-5e-324, 0.0, 0.0, 0.0, 6.0, 0.1, 1.0, stops) == -5e-324
