"""Pushes put into synthetic innovations are found where they were, and told in the lab's words."""

import re

import numpy as np
import pytest

from calibration.gap.locate.channels import on_one_axis, segments
from calibration.gap.locate.coordinates import since_reversal, slope, turns
from calibration.gap.locate.disturbances import Coordinate, Pattern, Series, best, response, rhythm
from calibration.gap.locate.locate import strongest
from calibration.gap.locate.regions import region
from calibration.gap.model import parameters
from rig.parameters import Rig
from rig.prediction import innovations

RIG = Rig()
STEP_S, N = 1 / 60, 2400


def series(seed: int = 0, segments: tuple[slice, ...] = (slice(0, N),)) -> Series:
    """White innovations of an observer like the ball's."""
    z = np.random.default_rng(seed).normal(size=N)
    h = response(STEP_S, 0.002, 3e-4)
    return Series(z, np.ones(N), h, segments, np.arange(N) * STEP_S)


def pushed(quiet: Series, push: np.ndarray) -> Series:
    answer = quiet.responses(push[:, None])[:, 0]
    return Series(quiet.z + answer, quiet.w, quiet.h, quiet.segments, quiet.t_s)


def slow_walk(seed: int) -> np.ndarray:
    """A position (n,) that wanders over +-0.1 m."""
    t = np.arange(N) * STEP_S
    turns = np.random.default_rng(seed).uniform(0, 2 * np.pi, 3)
    waves = [np.sin(2 * np.pi * f * t + p) for f, p in zip((0.13, 0.31, 0.47), turns, strict=True)]
    return 0.035 * np.sum(waves, axis=0)


def on_plate(x: np.ndarray, axis: str = "x") -> Coordinate:
    return Coordinate("position", axis, np.clip(x, -0.1, 0.1), np.linspace(-0.1, 0.1, 11))


def words(found: Pattern, ball: bool = True, starts=(0.0,)) -> str:
    kept = np.ones(len(found.coordinate.value), bool)
    return region(found, ball=ball, kept=kept, half_side_m=0.1375, starts_s=np.array(starts))


def test_an_observer_answers_a_push_late_and_with_unit_power():
    h = response(STEP_S, 0.002, 3e-4)
    assert h @ h == pytest.approx(1.0)
    assert 3 <= np.argmax(h) <= 20
    assert abs(h[-1]) < 2e-3 * h.max()
    quicker = response(STEP_S, 0.02, 3e-4)
    assert np.argmax(quicker) < np.argmax(h)


def test_the_response_is_that_of_the_filter_that_made_the_innovations():
    """A kick of the ball's speed in a noise-free log answers as `response` says."""
    t = np.arange(0, 8, 0.002)
    exposed = np.arange(30, 460) * STEP_S
    ball = np.zeros((len(exposed), 2))
    ball[:, 0] = 0.01 * np.maximum(exposed - exposed[250] + STEP_S / 2, 0)
    known = innovations.Signals(t, np.zeros((len(t), 2)), np.zeros((len(t), 2)), exposed, ball)
    levels = innovations.noise(ball_process=0.002, ball_measured=3e-4)
    model = parameters.NominalModel(RIG, load_friction=False).model({})
    out, _ = innovations.ball_innovations(model.record, known, levels)
    got = out[250:, 0]
    h = response(STEP_S, 0.002, 3e-4)[: len(got)]
    got = got[: len(h)]
    assert got @ h / np.sqrt(got @ got) > 0.999


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize(("axis", "sides"), [("x", ("left", "right")), ("y", ("near", "far"))])
def test_a_push_on_one_side_of_the_plate_is_found_there(mirrored, axis, sides):
    x = slow_walk(1) * (-1 if mirrored else 1)
    there = x > 0.04 if mirrored else x < -0.04
    found = best(pushed(series(), 0.8 * there), on_plate(x, axis))
    assert found is not None
    assert found[0].gain > 50
    text = words(found[0])
    assert text.startswith(f"{sides[mirrored]} part of the plate")
    assert ("above 40 mm" if mirrored else "below -40 mm") in text


def test_the_edge_of_the_plate_is_its_outermost_part():
    x = slow_walk(1)
    assert words(Pattern(on_plate(x), 0, 1, 0, np.ones(2), 9.0)) == (
        "left part of the plate (x below -60 mm)"
    )
    assert words(Pattern(on_plate(x), 0, 0, 0, np.ones(1), 9.0)) == (
        "left edge of the plate (x below -80 mm)"
    )
    assert words(Pattern(on_plate(x), 3, 5, 0, np.ones(3), 9.0)) == (
        "where the ball is at x between -40 and 20 mm"
    )


def after_reversals(theta: np.ndarray) -> Coordinate:
    t = np.arange(N) * STEP_S
    after, way = since_reversal(t, theta, t, 0.006)
    edges = np.array([0, 0.1, 0.2, 0.4, 0.8, np.inf])
    return Coordinate("reversal", "x", after, edges, way, anchored=True)


@pytest.mark.parametrize("way", [1, -1])
def test_a_push_that_flips_with_a_reversal_is_found_after_it(way):
    c = after_reversals(slow_walk(2))
    assert c.side is not None
    soon = c.side * ((c.value < 0.4) & (c.value >= 0))
    found = best(pushed(series(), way * 3.0 * soon), c)
    assert found is not None
    assert re.match("within [24]00 ms after the x servo reverses$", words(found[0]))
    found = best(pushed(series(), way * 0.5 * c.side), c)
    assert found is not None
    assert words(found[0]) == "after the x servo reverses, until it reverses again"
    one_way = best(pushed(series(), 3.0 * soon * (c.side == way)), c)
    assert one_way is not None
    assert words(one_way[0]).endswith("towards plus" if way > 0 else "towards minus")


def test_slow_motion_and_its_sense_are_told():
    x = slow_walk(3)
    v = slope(np.arange(N) * STEP_S, x, 0.05)
    c = Coordinate("speed", "x", np.abs(v), np.array([0, 0.01, 0.02, 0.05, 0.1, np.inf]),
                   np.sign(v))  # fmt: skip
    slow = -np.sign(v) * (np.abs(v) < 0.02)
    found = best(pushed(series(), 1.5 * slow), c)
    assert found is not None
    assert words(found[0]) == "while the ball rolls slower than 20 mm/s, against its motion"
    servo = words(Pattern(c, 3, 4, 1, np.ones(2), 9.0), ball=False)
    assert servo == "while the x servo turns towards plus x faster than 2.9 deg/s"


def test_a_time_segment_is_told_on_its_logs_own_clock():
    t = np.arange(N) * STEP_S
    c = Coordinate("time", "", t, np.linspace(0, t[-1] + 1e-9, 41), whole=True)
    found = best(pushed(series(), 0.7 * ((t > 12) & (t < 20))), c)
    assert found is not None
    begin, end = (float(s) for s in re.findall(r"[\d.]+", words(found[0])))
    assert begin == pytest.approx(12, abs=1.1)
    assert end == pytest.approx(20, abs=1.1)
    assert words(found[0], starts=(0.0, 10.0)).startswith("in log 2, from 2.")
    across = Pattern(c, 5, 20, 0, np.ones(1), 9.0)
    assert words(across, starts=(0.0, 10.0)) == "from 5.0 s of log 1 to 11.0 s of log 2"


def test_voltages_beyond_a_limit():
    v = 40 * slow_walk(4)
    c = Coordinate("voltage", "x", np.abs(v), np.array([0, 0.5, 1, 2, 3, np.inf]), np.sign(v))
    found = best(pushed(series(), -1.5 * np.sign(v) * (np.abs(v) > 2)), c)
    assert found is not None
    assert words(found[0], ball=False) == "at voltages beyond 2 V"
    assert words(Pattern(c, 4, 4, -1, np.ones(1), 9.0), ball=False) == (
        "at negative voltages beyond 3 V"
    )


def test_a_rhythm_is_heard_over_noise_and_not_in_noise():
    quiet = series(5)
    hz, gain, sure = rhythm(pushed(quiet, 0.6 * np.sin(2 * np.pi * 1.7 * quiet.t_s)))
    assert hz == pytest.approx(1.7, abs=0.02)
    assert min(gain, sure) > 50
    assert all(rhythm(series(k))[2] < 8 for k in range(10))


def test_white_noise_has_no_region():
    x = slow_walk(6)
    tried = [on_plate(x), after_reversals(x)]
    assert not any(strongest(series(k), tried, "x") for k in range(20))


def test_turns_are_told_when_seen_and_tremor_is_none():
    theta = np.array([0, 1, 2, 3, 2.9, 3, 2, 1, 0, 0.1, 0, 1, 2.0])
    index, way = turns(theta, 0.5)
    assert index.tolist() == [6, 11]
    assert way.tolist() == [-1, 1]
    after, side = since_reversal(np.arange(13.0), theta, np.array([5.0, 6.0, 7.5, 12.0]), 0.5)
    np.testing.assert_array_equal(after, [np.nan, 0.0, 1.5, 1.0])
    assert side.tolist() == [0, -1, -1, 1]


def test_runs_follow_each_other_and_observers_start_anew():
    t_s, starts = on_one_axis([np.array([0.0, 1.0, 2.0]), np.array([0.5, 1.5])])
    assert t_s.tolist() == [0, 1, 2, 2.5, 3.5]
    assert starts.tolist() == [0, 2]
    times = [np.array([0, 0.1, 0.2, 0.9, 1.0]), np.zeros(0), np.array([0.0, 0.1, 0.2])]
    fresh = [np.zeros(5, bool), np.zeros(0, bool), np.array([True, False, True])]
    got = [(s.start, s.stop) for s in segments(times, fresh, 0.25)]
    assert got == [(0, 3), (3, 5), (5, 7), (7, 8)]


def test_a_push_is_not_answered_in_the_next_run():
    cut = series(0, (slice(0, 1000), slice(1000, N)))
    push = np.zeros((N, 1))
    push[999] = 1.0
    answer = cut.responses(push)
    assert answer[999, 0] > 0
    assert not answer[1000:].any()
