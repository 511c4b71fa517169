"""Tables drawn from the intervals of a gap answer."""

import json
from pathlib import Path

import numpy as np
import pytest

from rig.intervals import check_intervals, drawn, read_intervals
from rig.parameters import Rig

ANSWER = Path(__file__).parents[2] / "experiments/own_controllers/gap.json"
PLAY, MIDDLE = "effects.joint_backlash.x.play_rad", "effects.joint_backlash.x.offset_rad"


def value_of(rig: Rig, name: str) -> float:
    kind, *words = name.split(".")
    if kind == "servo":
        return getattr(rig.servo, words[0])
    effect, axis, key = words
    return rig.effects[effect][axis][key]


def test_draws_stay_inside_and_reach_both_ends():
    intervals, told = read_intervals(ANSWER)
    assert not told
    assert {PLAY, "servo.gain_rad_s_V", "servo.time_constant_s"} <= set(intervals)
    rng = np.random.default_rng(1)
    rigs = [drawn(Rig(), intervals, rng) for _ in range(400)]
    for name, (low, high) in intervals.items():
        found = np.array([value_of(rig, name) for rig in rigs])
        assert low <= found.min() <= low + 0.05 * (high - low)
        assert high - 0.05 * (high - low) <= found.max() <= high


def test_what_has_no_interval_stays_and_one_seed_gives_one_table():
    rig = Rig(effects={"cogging": {"y": {"amplitude_V": 0.1}}})
    draws = [drawn(rig, {PLAY: (0.01, 0.02)}, np.random.default_rng(seed)) for seed in (4, 4, 5)]
    assert draws[0] == draws[1] != draws[2]
    assert draws[0].effects["cogging"] == rig.effects["cogging"]
    assert "joint_backlash" not in rig.effects
    assert draws[0].known == rig.known


def test_a_draw_that_the_rig_file_would_refuse_is_drawn_again():
    intervals = {PLAY: (0.0, 0.02), MIDDLE: (-0.01, 0.01)}
    rng = np.random.default_rng(2)
    for _ in range(200):
        found = drawn(Rig(), intervals, rng).effects["joint_backlash"]["x"]
        assert abs(found["offset_rad"]) <= found["play_rad"] / 2


@pytest.mark.parametrize(
    ("intervals", "said"),
    [
        ({"effects.joint_backlash.x": (0, 1)}, r"no number that can be drawn; known: effects.NAME"),
        ({"ball.radius_m": (0.01, 0.02)}, "no number that can be drawn"),
        ({"effects.gremlins.x.play_rad": (0, 1)}, "unknown effect 'gremlins'"),
        ({"effects.servo_lag.x.lag_s": (0.01, 0.02)}, "is not one of voltage servos"),
        ({PLAY: (0.02, 0.01)}, "must be finite and rise"),
        ({PLAY: (0.02, np.inf)}, "must be finite and rise"),
        ({PLAY: (-0.02, -0.01)}, "must be >= 0"),
        ({PLAY: (0.0, 0.001), MIDDLE: (0.01, 0.02)}, "at most half of play_rad"),
        ({"servo.time_constant_s": (1e-4, 2e-4)}, "raise time_constant_s"),
    ],
)
def test_intervals_that_are_no_good_are_one_line(intervals, said: str):
    with pytest.raises(ValueError, match=said) as error:
        check_intervals(Rig(), intervals)
    assert "\n" not in str(error.value)


def test_open_intervals_are_told_and_other_files_refused(tmp_path: Path):
    answer = json.loads(ANSWER.read_text())
    answer["effects"][0]["parameters"]["x"]["positive_V"]["high"] = None
    file = tmp_path / "gap.json"
    file.write_text(json.dumps(answer))
    found, told = read_intervals(file)
    assert "effects.dead_zone.x.positive_V" not in found
    assert told == ["The interval of effects.dead_zone.x.positive_V is open and not in it."]
    for text, said in (
        ("{}", "not what `rig gap LOG.*'effects' is missing"),
        ("null", "not what `rig gap LOG.*of another kind"),
        ("[" * 100_000, "brackets are too deep"),
        ('{"effects": [], "x": ' + "9" * 5000 + "}", "a number has too many digits"),
    ):
        file.write_text(text)
        with pytest.raises(ValueError, match=rf"randomise = .*gap.json: .*{said}") as error:
            read_intervals(file, "randomise = ")
        assert "Error" not in str(error.value)  # no word of Python's
