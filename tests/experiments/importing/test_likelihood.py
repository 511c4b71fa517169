"""Columns beside the ball's place that say how sure its detector was, or that it saw none."""

import csv
import json

import numpy as np
import pytest

from experiments.importing.absent_ball import jumps
from experiments.importing.agreement import contradiction
from experiments.importing.ball import MOST_JUMPS
from experiments.importing.conversion import convert
from experiments.importing.formats.choose import read_recording
from experiments.importing.import_map import stated
from experiments.importing.proposal import propose
from experiments.importing.recording import Stream
from tests.support.other_labs.bench import run

AXES = [run(axis, control_hz=50, delay=0.02, noise=0.0002) for axis in (0, 1)]
ROWS = len(AXES[0].t)
LOST = np.isin(np.arange(ROWS) % 50, range(5))  # a tenth, five rows at a time
RNG = np.random.default_rng(1)
PLACES = [np.where(LOST, 1e3 * one.seen + RNG.normal(0, 25, ROWS), 1e3 * one.seen) for one in AXES]
NEW = np.all([np.isfinite(one.seen) for one in AXES], axis=0)  # frames
BALL = NEW & ~LOST
SURE = np.where(LOST, RNG.uniform(0.0, 0.5, ROWS), RNG.uniform(0.8, 1.0, ROWS))


def table(more: dict[str, np.ndarray], ball=("ball_x_mm", "ball_y_mm")) -> Stream:
    """A time, angles and a ball that was wrong where LOST, and more columns."""
    commands = {f"command_{a}_rad": one.command for a, one in zip("xy", AXES, strict=True)}
    return Stream({"t": AXES[0].t, **dict(zip(ball, PLACES, strict=True)), **commands, **more})


CLEAN = table({}).columns | {f"ball_{'xy'[i]}_mm": 1e3 * AXES[i].seen for i in (0, 1)}


def seen(stream: Stream, *said: str) -> np.ndarray:
    """Rows (n,) in which the log that needs no question has a ball."""
    (log,) = convert(stream, propose(stream, stated(list(said))).map())
    return np.isfinite(log["ball_x_m"])


@pytest.mark.parametrize(
    "more",
    [
        {"ball_likelihood": SURE},
        {"confidence": SURE},
        {"ball.score": SURE, "instance.score": 3 * SURE},
        {"detector conf [%]": 100 * SURE},
        {"ball_probability": np.where(LOST, np.nan, SURE)},
        {"ball_lost": LOST.astype(float)},
        {"radius_px": np.where(LOST, 0.0, 18.0 + SURE)},
        {"blob_area": np.where(LOST, 0.0, 900.0)},
    ],
    ids=lambda more: next(iter(more)),
)
def test_a_place_that_its_detector_did_not_believe_is_none(more):
    np.testing.assert_array_equal(seen(table(more)), BALL)


def test_a_likelihood_of_another_point_is_not_the_balls():
    corner = {"corner1_x": SURE + 40, "corner1_y": SURE + 50, "corner1_likelihood": SURE[::-1]}
    stream = table({"servo_confidence": SURE[::-1], **corner, "ball_likelihood": SURE})
    np.testing.assert_array_equal(seen(stream), BALL)
    np.testing.assert_array_equal(seen(table({"ball_radius_mm": 20 + SURE}), "ball.seen=none"), NEW)


def test_a_number_that_is_no_share_or_rules_out_much_is_asked_about():
    for more in ({"score": 255 * SURE}, {"confidence": 0.65 * SURE}):
        (name,) = more
        (doubt,) = propose(table(more)).doubts
        assert (doubt.place, doubt.key) == ("ball", "seen")
        assert doubt.options[0].startswith(f"{name} >= ")
        limit = 0.6 * float(np.max(more[name]))
        np.testing.assert_array_equal(seen(table(more), f"ball.seen={name}>={limit}"), BALL)
    with pytest.raises(ValueError, match="no column 'lost'"):
        propose(table({}), stated(["ball.seen=lost < 1"]))


@pytest.mark.parametrize(
    ("name", "condition"),
    [
        ("packets_lost", "packets_lost < 1"),
        ("deadline_missed", "deadline_missed < 1"),
        ("crc_valid", "crc_valid"),
        ("hole_area", "hole_area"),
    ],
)
def test_a_flag_that_may_be_of_another_thing_is_asked_about(name: str, condition: str):
    of_it = (np.arange(ROWS) % 9 == 0) ^ (condition == name)
    stream = table({"lost": 1.0 * LOST, name: 1.0 * of_it})
    (doubt,) = propose(stream).doubts
    assert (doubt.place, doubt.key, doubt.options[1]) == ("ball", "seen", "lost < 1")
    assert {*doubt.options[0].split(",")} == {"lost < 1", condition}
    np.testing.assert_array_equal(seen(stream, "ball.seen=lost < 1"), BALL)
    never = Stream(stream.columns | {name: np.full(ROWS, 1.0 * (condition == name))})
    np.testing.assert_array_equal(seen(never), BALL)


def test_a_likelihood_in_doubt_leaves_the_flags_and_is_asked_before_the_angles_columns():
    stream = table({"lost": 1.0 * LOST, "score": np.floor(np.arange(ROWS) / 100)})
    doubt = propose(stream).doubts[0]
    assert (doubt.key, doubt.options) == ("seen", ("lost < 1,score >= 60", "lost < 1"))


def test_places_that_no_ball_can_be_at_are_asked_about():
    (doubt,) = propose(table({})).doubts
    assert (doubt.place, doubt.key, doubt.options) == ("ball", "seen", ("none",))
    assert "jumps as none can" in doubt.why
    np.testing.assert_array_equal(seen(table({}), "ball.seen=none"), NEW)


def test_a_further_file_whose_ball_jumps_does_not_fit_the_map_of_a_clean_one():
    made = propose(Stream(CLEAN)).map()
    assert contradiction(made, propose(Stream(CLEAN))) == ""
    assert "jumps as none can" in contradiction(made, propose(table({})))
    told = contradiction(made, propose(table({"ball_lost": LOST.astype(float)})))
    assert "seen is ('ball_lost < 1',), by which no ball is there" in told


def test_a_flag_that_never_says_lost_is_kept_for_the_files_in_which_it_does():
    for flag, ever in (("ball_lost", LOST), ("valid", ~LOST), ("confidence", 0.2 + ~LOST * 0.8)):
        still = np.full(ROWS, float(flag != "ball_lost"))
        made = propose(Stream(CLEAN | {flag: still})).map()
        file = table({flag: ever.astype(float)})
        (log,) = convert(file, made)
        np.testing.assert_array_equal(np.isfinite(log["ball_x_m"]), BALL)
        assert contradiction(made, propose(file)) == ""
    unused = propose(Stream(CLEAN | {"valid": np.zeros(ROWS), "lost": np.ones(ROWS)}))
    assert not unused.draft["signals"]["ball_x_m"]["seen"]


def test_a_column_that_explains_the_jumps_is_offered():
    age_ms = np.where(LOST, 20.0 * (1 + np.arange(ROWS) % 50), 0.0)
    more = {"mode": np.arange(ROWS) % 3 + 0.0, "code": 2.0 * LOST, "age_ms": age_ms}
    stream = table(more)
    doubt = propose(stream).doubts[0]
    assert doubt.options == ("code < 1", "age_ms < 1", "none")
    np.testing.assert_array_equal(seen(stream, f"ball.seen={doubt.options[1]}"), BALL)


def test_a_ball_that_is_pushed_hit_or_seen_seldom_does_not_jump():
    places = [1e3 * one.seen for one in AXES]
    assert jumps(places, AXES[0].t) == 0.0
    coarse = [np.round(p / 4) * 4 for p in places]  # a touch panel
    rare = [np.where(np.arange(ROWS) % 3, np.nan, p) for p in places]
    held = [p[np.arange(ROWS) // 3 * 3] for p in places]  # a slower camera
    walls = [np.abs((p + 20) % 80 - 40) for p in places]  # thrown back at rims
    pushed = [p + 300 * np.abs(AXES[0].t % 2 - 1) for p in places]  # each second, by 600 mm/s
    for columns in (coarse, rare, held, walls, pushed):
        assert jumps(columns, AXES[0].t) <= MOST_JUMPS
    late = AXES[0].t + np.random.default_rng(0).uniform(0, 0.018, ROWS)
    late_places = [np.interp(late, AXES[0].t, p) for p in places]
    assert jumps(late_places, late) <= MOST_JUMPS


def test_jumps_are_found_beside_stamps_that_stand_still_and_holes():
    t = AXES[0].t - np.where(np.arange(ROWS) % 40 < 3, np.arange(ROWS) % 40, 0) * 0.02
    assert jumps(PLACES, t) > MOST_JUMPS
    rows = np.arange(200.0)
    assert np.isnan(jumps([rows, rows], np.cumsum(np.where(rows % 2, 0.02, 0.2))))
    assert np.isnan(jumps([p[:0] for p in PLACES], t[:0]))


@pytest.mark.parametrize("condition", ["err < -2.5", "err <= -3", "err<-0.25e1"])
def test_a_condition_may_be_of_any_number(condition: str):
    errors = np.where(LOST, 0.5, -3.0)
    np.testing.assert_array_equal(seen(table({"err": errors}), f"ball.seen={condition}"), BALL)
    above = condition.replace("<", ">").replace("-", "")
    np.testing.assert_array_equal(seen(table({"err": -errors}), f"ball.seen={above}"), BALL)


WORDS = np.where(LOST, "lost", np.where(np.arange(ROWS) % 2, "Tracked", "found"))


def test_a_trackers_words_in_a_table(tmp_path):
    columns = table({}).columns
    with (tmp_path / "run.csv").open("w", newline="") as file:
        write = csv.writer(file)
        write.writerow([*columns, "state"])
        write.writerows([*(f"{c[i]:.5f}" for c in columns.values()), WORDS[i]] for i in range(ROWS))
    np.testing.assert_array_equal(seen(read_recording(tmp_path / "run.csv").stream), BALL)


def test_a_trackers_words_in_messages(tmp_path):
    columns = {name: values.tolist() for name, values in table({}).columns.items()}
    rows = ({**{n: c[i] for n, c in columns.items()}, "state": WORDS[i]} for i in range(ROWS))
    (tmp_path / "run.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    np.testing.assert_array_equal(seen(read_recording(tmp_path / "run.jsonl").stream), BALL)


def test_words_of_a_servo_say_nothing_of_the_ball(tmp_path):
    rows = "".join(f"{i / 50},{i},{i % 9},{'ok' if i % 7 else 'lost'}\n" for i in range(40))
    (tmp_path / "run.csv").write_text(f"t,x_mm,servo_x_deg,servo_state\n{rows}")
    stream = read_recording(tmp_path / "run.csv").stream
    assert not any(keys.get("seen") for keys in propose(stream).draft["signals"].values())


def test_deeplabcuts_three_rows_of_names(tmp_path):
    who, part = ("DLC_resnet50_rig",) * 3, ("ball",) * 3
    heads = [("scorer", *who), ("bodyparts", *part), ("coords", "x", "y", "likelihood")]
    more = [("rig",) * 3, ("clock", "servo1", "servo2"), ("time_s", "command_rad", "command_rad")]
    columns = [*PLACES, SURE, AXES[0].t, AXES[0].command, AXES[1].command]
    with (tmp_path / "DLC.csv").open("w", newline="") as file:
        write = csv.writer(file)
        write.writerows([*a, *b] for a, b in zip(heads, more, strict=True))
        write.writerows([i, *(f"{c[i]:.5f}" for c in columns)] for i in range(ROWS))
    stream = read_recording(tmp_path / "DLC.csv").stream
    np.testing.assert_array_equal(seen(stream, "ball.unit=mm"), BALL)
