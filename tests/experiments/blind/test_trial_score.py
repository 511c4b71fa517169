"""Hand-made answers and what they must count as."""

from dataclasses import replace
from math import isnan

import pytest

from experiments.blind.results_table import markdown, rows
from experiments.blind.score_summary import calibration, confusion, power, summary
from experiments.blind.trial import BlindTrial
from experiments.blind.trial_score import score_trial

BASE = BlindTrial("t", "single", "", ("steps",), (1,), {}, {}, factor=2.0)
FRICTION = replace(BASE, hidden={"coulomb_friction": {"x": {"friction_V": 0.04}}})
YAW = replace(BASE, hidden={"camera_yaw": {"xy": {"angle_rad": 0.03}}})
PAIR = replace(BASE, kind="pair", hidden=FRICTION.hidden | YAW.hidden)


def interval(value: float, half: float = 0.1) -> dict[str, float]:
    return {"value": value, "low": value * (1 - half), "high": value * (1 + half)}


def effect(name: str, parameters: dict, probability: float = 0.9) -> dict:
    return {"name": name, "probability": probability, "twins": [], "parameters": parameters}


def named(*effects: dict, **more) -> dict:
    return {"verdict": "named", "effects": list(effects)} | more


RIGHT = effect("coulomb_friction", {"x": {"friction_V": interval(0.041)}, "y": {}})


def test_a_right_name_with_its_axis_size_and_interval():
    m = score_trial(FRICTION, named(RIGHT))
    assert m.right
    assert m.axes_right
    assert m.errors == (pytest.approx(0.025),)
    assert m.covered == (True,)
    assert m.stated == ((0.9, True),)
    far = effect("coulomb_friction", {"y": {"friction_V": interval(0.08)}})
    off = score_trial(FRICTION, named(far))
    assert off.right
    assert not off.axes_right
    assert off.errors == ()


def test_a_wrong_name_an_extra_one_and_a_confident_one():
    wrong = effect("dead_zone", {"x": {"half_width_V": interval(0.04)}}, 0.97)
    m = score_trial(FRICTION, named(wrong))
    assert (m.right, m.extra, m.confident_wrong) == (False, ("dead_zone",), True)
    both = score_trial(FRICTION, named(RIGHT, wrong))
    assert (both.right, both.found) == (False, ("coulomb_friction",))
    unsure = score_trial(FRICTION, {"verdict": "undecided", "effects": [wrong, RIGHT]})
    assert (unsure.right, unsure.truth_among, unsure.confident_wrong) == (False, True, False)
    assert unsure.named == ()


def test_a_pair_needs_both_and_nothing_else():
    yaw = effect("camera_yaw", {"xy": {"angle_rad": interval(0.03)}})
    assert score_trial(PAIR, named(RIGHT, yaw)).right
    assert not score_trial(PAIR, named(RIGHT)).right
    assert not score_trial(PAIR, named(RIGHT, yaw, effect("plate_bowl", {}))).right


def test_twins_are_the_same_data():
    scale = replace(BASE, hidden={"camera_scale": {"xy": {"fraction": 0.05}}})
    assert score_trial(scale, named(effect("ball_inertia", {}))).right
    sides = {"x": {"fraction": interval(-0.03)}, "y": {"fraction": interval(0.031)}}
    assert score_trial(YAW, named(effect("cross_coupling", sides))).right
    same = {"x": {"fraction": interval(0.03)}, "y": {"fraction": interval(0.031)}}
    assert not score_trial(YAW, named(effect("cross_coupling", same))).right
    assert not score_trial(
        YAW, named(effect("cross_coupling", {"x": {"fraction": interval(0.03)}}))
    ).right


def test_a_dead_zone_is_compared_by_its_sides():
    hidden = {"dead_zone": {"x": {"positive_V": 0.06, "negative_V": 0.02}}}
    shape = replace(BASE, kind="shape", hidden=hidden)
    sides = {"positive_V": interval(0.06), "negative_V": interval(0.03)}
    m = score_trial(shape, named(effect("dead_zone", {"x": sides})))
    assert m.errors == (pytest.approx(0.0), pytest.approx(0.5))
    assert m.covered == (True, False)
    half = score_trial(shape, named(effect("dead_zone", {"x": {"half_width_V": interval(0.04)}})))
    assert half.right
    assert half.covered == (True,)  # the sides differ by what an offset within tolerance does
    apart = {"dead_zone": {"x": {"positive_V": 0.08, "negative_V": 0.02}}}
    half = score_trial(
        replace(shape, hidden=apart),
        named(effect("dead_zone", {"x": {"half_width_V": interval(0.05)}})),
    )
    assert half.covered == (False, False)


def test_a_phase_is_compared_around_the_circle():
    values = {"amplitude_rad": 0.01, "phase_rad": 3.1, "periods_per_turn": 10.0}
    trial = replace(BASE, hidden={"transmission_ripple": {"x": values}})
    answered = {
        "amplitude_rad": interval(0.0102),
        "phase_rad": {"value": -3.15, "low": -3.3, "high": -3.0},
        "periods_per_turn": interval(10.1),
    }
    m = score_trial(trial, named(effect("transmission_ripple", {"x": answered})))
    assert m.covered == (True, True, True)
    assert m.errors == (pytest.approx(0.02),)
    assert m.shape_errors == (pytest.approx(0.01),)


def test_nothing_strangers_and_what_cannot_be_tested():
    nothing, stranger = replace(BASE, kind="nothing"), replace(BASE, kind="stranger")
    quiet = {"verdict": "nothing-missing", "effects": []}
    unknown = {"verdict": "unknown-effect", "effects": [], "unknown": {"channel": "ball_x"}}
    assert score_trial(nothing, quiet).right
    assert not score_trial(nothing, unknown).right
    assert score_trial(stranger, unknown).right
    assert not score_trial(stranger, named(RIGHT, unknown={"channel": "ball_x"})).right
    hidden = {"saturation": {"x": {"limit_V": 5.5}}}
    dark = replace(BASE, kind="untestable", hidden=hidden)
    stated = [{"name": "saturation", "why": "few volts", "smallest": {"limit_V": 2.0}}]
    assert score_trial(dark, quiet | {"untestable": stated}).right
    assert not score_trial(dark, quiet | {"untestable": [stated[0] | {"smallest": {}}]}).right
    assert not score_trial(dark, quiet).right
    blind = [{"name": "saturation", "why": "the log lacks volts and angles", "smallest": {}}]
    assert score_trial(dark, quiet | {"untestable": blind}).right


def test_closed_gap_and_error_ahead():
    gap = {
        "before": {"servo_x": 1.02, "ball_x": 5.0},
        "after": {"servo_x": 1.0, "ball_x": 1.04},
        "held_out": True,
        "ahead_1s_mm": {"before": 6.0, "after": 2.2, "floor": 2.0},
    }
    m = score_trial(FRICTION, named(RIGHT, gap=gap))
    assert m.closed == pytest.approx(0.99)
    assert m.ahead == pytest.approx(1.1)
    assert isnan(score_trial(FRICTION, named(RIGHT, gap=gap | {"held_out": False})).closed)
    assert isnan(score_trial(FRICTION, named(RIGHT)).ahead)


def test_the_confusion_matrix_counts_every_trial_once():
    wrong = effect("dead_zone", {})
    scores = [
        score_trial(FRICTION, named(RIGHT)),
        score_trial(FRICTION, named(wrong)),
        score_trial(FRICTION, named(RIGHT, wrong)),
        score_trial(FRICTION, {"verdict": "undecided", "effects": [wrong]}),
        score_trial(YAW, {"verdict": "nothing-missing"}),
    ]
    assert confusion(scores) == {
        "coulomb_friction": {"coulomb_friction": 1, "dead_zone": 1, "several": 1, "undecided": 1},
        "camera_yaw": {"nothing-missing": 1},
    }


def test_calibration_of_said_probabilities():
    perfect = [(0.75, True)] * 3 + [(0.75, False)]
    assert calibration(perfect)["error"] == pytest.approx(0.0)
    boast = [(0.95, True), (0.95, False), *perfect]
    assert calibration(boast)["error"] == pytest.approx(2 / 6 * 0.45)
    assert isnan(calibration([])["error"])


def test_power_is_sorted_into_amplitudes():
    weak = replace(FRICTION, kind="weak", factor=0.5)
    cells = power(
        [score_trial(weak, {"verdict": "nothing-missing"}), score_trial(FRICTION, named(RIGHT))]
    )
    assert [(c["from"], c["to"], c["detected"]["k"]) for c in cells] == [
        (0.3, 0.6, 0),
        (1.5, 2.5, 1),
    ]


def test_other_protocols_are_reported_beside_the_goals():
    scores = [score_trial(FRICTION, named(RIGHT)) for _ in range(4)]
    scores.append(
        score_trial(replace(FRICTION, protocols=("hold",)), {"verdict": "nothing-missing"})
    )
    numbers = summary(scores)
    assert numbers["kinds"]["single"]["right"]["n"] == 4
    assert {name: group["right"]["k"] for name, group in numbers["protocols"].items()} == {
        "steps": 4,
        "hold": 0,
    }
    alone = summary(scores[-1:])
    assert alone["kinds"]["single"]["right"]["n"] == 1


def test_the_table_has_its_goals_and_the_numbers():
    scores = [score_trial(FRICTION, named(RIGHT)) for _ in range(99)]
    scores.append(score_trial(FRICTION, {"verdict": "failed"}))
    scores += [
        score_trial(replace(BASE, kind="nothing", variant="plain"), {"verdict": "nothing-missing"})
    ]
    lines = {row.what: row for row in rows(summary(scores))}
    assert lines["right name, one hidden effect"].met is True
    assert lines["right name, one hidden effect"].reached == "99.0 % (94.6 to 99.8; 99/100)"
    assert lines["nothing missing, plain: named"].met is True
    assert lines["parameters, median error"].reached.startswith("2.5 % (n = 99)")
    assert lines["parameters, median error"].met is False
    assert lines["exactly both of two hidden effects"].met is None
    assert markdown(list(lines.values())).count("\n") == len(lines) + 2
