"""The game of the hidden play: what is hidden, what is told, who was nearer."""

from math import degrees, radians

import numpy as np
import pytest

from experiments.gap.guess import LEAST_DEG, MOST_DEG, clues, draw_plays, score, swing_cm
from rig.log import COLUMNS, INDEX, Log


def test_what_is_hidden_is_of_the_seed_and_can_be_seen():
    drawn = [draw_plays(seed) for seed in range(40)]
    assert drawn[3] == draw_plays(3)
    all_deg = np.degrees([list(plays.values()) for plays in drawn])
    assert LEAST_DEG <= all_deg.min() < 0.8
    assert 2.7 < all_deg.max() <= MOST_DEG
    assert np.all(all_deg[:, 0] != all_deg[:, 1])


def test_the_swing_of_a_sine_is_its_amplitude():
    rows = np.full((8000, len(COLUMNS)), np.nan)
    t_s = rows[:, 0] = np.arange(8000) / 500
    rows[:, INDEX["phase"]] = 2.0
    for axis in "xy":
        rows[:, INDEX[f"target_{axis}_m"]] = 0.0
    rows[::8, INDEX["ball_x_m"]] = 0.003 + 0.01 * np.sin(np.pi * t_s[::8])
    rows[::8, INDEX["ball_y_m"]] = 0.0
    assert swing_cm(Log(rows)) == pytest.approx((1.0, 0.0), abs=0.02)


def test_the_nearer_one_is_named_axis_by_axis():
    hidden = {"x": radians(2.0), "y": radians(1.0)}
    found = {("joint_backlash", "x", "play_rad"): radians(2.1)}
    x, y = score(hidden, {"x": 2.5, "y": 0.0}, found)
    assert x == "x: hidden 2.00, you 2.50, the analysis 2.10 degrees: the analysis is nearer"
    assert y == "y: hidden 1.00, you 0.00, the analysis nothing degrees: you are nearer"


@pytest.mark.slow
def test_more_play_swings_more_in_the_examples(tmp_path):
    from experiments.gap.demo import demo_runs

    hidden = draw_plays(5)
    first, *examples = clues(demo_runs(tmp_path, seed=5, plays_rad=hidden), seed=5)
    assert first.startswith("The ball swings by ")
    swings = [float(line.split("by ")[1].split(" and ")[0]) for line in examples]
    assert swings == sorted(swings)
    told = dict(zip((0.5, 1.0, 2.0, 3.0), swings, strict=True))
    own = float(first.split("by ")[1].split(" cm")[0])
    guessed = np.interp(own, list(told.values()), list(told))
    assert guessed == pytest.approx(degrees(hidden["x"]), abs=0.6)
