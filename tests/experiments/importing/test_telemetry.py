"""A robot's telemetry: an inertial sensor, desired angles, a flag for the ball, a slow radio."""

import numpy as np
import pytest

from experiments.importing.conversion import convert
from experiments.importing.formats.choose import read_recording
from experiments.importing.import_map import stated
from experiments.importing.names import hints
from experiments.importing.proposal import propose
from experiments.importing.recording import Stream
from tests.support.other_labs.bench import run

LOST = slice(300, 420)


def telemetry(every: int = 4, sign: int = 1) -> Stream:
    """Rows each `every` hundredths of a second of a robot that rolls about x to move its ball along
    y, and whose inertial sensor is mounted with `sign`."""
    x, y = (run(axis, seed=11, course_kind="squares", seconds=60.0) for axis in (0, 1))
    last = [
        np.maximum.accumulate(np.where(np.isfinite(a.seen), np.arange(len(a.t)), 0)) for a in (x, y)
    ]
    balls = [1000 * a.seen[at] for a, at in zip((x, y), last, strict=True)]
    seen = np.ones(len(x.t))
    seen[LOST] = 0
    for ball in balls:
        ball[LOST] = ball[LOST.start]  # the tracker keeps the last place
    columns = {
        "timestamp_ms": 1000 * x.t,
        "roll_imu": sign * np.degrees(y.angle),
        "pitch_imu": np.degrees(x.angle),
        "roll_d": np.degrees(y.command),
        "pitch_d": np.degrees(x.command),
        "Ballx": np.round(balls[0]),
        "Bally": np.round(balls[1]),
        "detected": seen,
    }
    return Stream({name: values[::every] for name, values in columns.items()})


@pytest.mark.parametrize(("every", "sign"), [(4, 1), (4, -1), (20, 1), (20, -1)])
def test_the_ball_pairs_the_sensor_and_the_sensor_pairs_what_was_asked(every: int, sign: int):
    found = propose(telemetry(every, sign), stated(["ball.unit=mm"]))
    assert not found.doubts, [doubt.why for doubt in found.doubts]
    of = {name: (keys["column"], keys["sign"]) for name, keys in found.draft["signals"].items()}
    assert of["theta_x_rad"] == ("pitch_imu", 1)
    assert of["theta_y_rad"] == ("roll_imu", sign)
    assert of["command_x_rad"] == ("pitch_d", 1)
    assert of["command_y_rad"] == ("roll_d", 1)
    assert {found.draft["signals"][name]["unit"] for name in of if "rad" in name} == {"deg"}


def test_a_flag_tells_where_there_was_no_ball():
    stream = telemetry()
    found = propose(stream, stated(["ball.unit=mm"]))
    assert "no ball where detected is 0 (2.0 % of the rows)" in found.reasons["ball"]
    log = convert(stream, found.map())[0]
    assert np.array_equal(np.isfinite(log["ball_x_m"]), stream.columns["detected"] > 0)
    kept = propose(stream, stated(["ball.unit=mm", "ball.seen=none"]))
    assert kept.draft["signals"]["ball_x_m"]["seen"] == ()


def test_a_flag_of_another_thing_is_none():
    stream = telemetry()
    columns = {**stream.columns, "control_valid": 1 - stream.columns["detected"]}
    columns["ball_visible"] = 3 * columns.pop("detected")
    signals = propose(Stream(columns), stated(["ball.unit=mm"])).draft["signals"]
    assert signals["ball_x_m"]["seen"] == ()


@pytest.mark.parametrize(
    ("names", "role"),
    [
        (["roll_d", "roll_imu"], "command"),
        (["roll_d_deg", "roll_deg"], "command"),
        (["ball_x_d", "ball_x_m"], "target"),
        (["roll_d", "roll_p", "roll_i"], "angle"),
        (["servo_d", "servo_a", "servo_c"], "angle"),
        (["d", "dt"], None),
    ],
)
def test_a_letter_means_what_its_neighbours_let_it(names: list[str], role: str | None):
    assert hints(names, {})[names[0]].role == role


@pytest.mark.parametrize(
    ("name", "role"),
    [
        ("Present Position [deg]", "theta"),
        ("theta_x_actuate_deg", "command"),
        ("trim_x_deg", "other"),
        ("Kugel gefunden", "seen"),
        ("ball_detected", "seen"),
        ("confidence", "likelihood"),
        ("x_dot_mps", "other"),
        ("vx", "other"),
        ("MV_x", "command"),
        ("PV_y", "ball"),
    ],
)
def test_words_of_telemetry(name: str, role: str | None):
    assert hints([name], {})[name].role == role


def test_a_flag_is_no_command_and_arms_beside_one_are_left_out():
    stream = telemetry()
    columns = {**stream.columns, "control_valid": stream.columns["detected"]}
    columns |= {f"servo{k}": 400 + 20 * np.sin(k + stream.columns["roll_d"]) for k in (1, 2, 3)}
    columns |= {f"sent_{name}": columns[name] for name in ("roll_d", "pitch_d")}
    found = propose(Stream(columns), stated(["ball.unit=mm"]))
    assert {doubt.key for doubt in found.doubts} == {"column"}, found.doubts
    for axis, angle in (("x", "roll_d"), ("y", "pitch_d")):
        (one,) = (d for d in found.doubts if d.place == f"command_{axis}_rad")
        assert one.options == (angle, f"sent_{angle}", "none")


def test_stamps_of_whole_seconds_are_seconds(tmp_path):
    stream = telemetry()
    rows = zip(*stream.columns.values(), strict=True)
    lines = [",".join(stream.columns)]
    for t_ms, *cells in rows:
        clock = f"15:{int(t_ms / 6e4):02d}:{int(t_ms / 1e3) % 60:02d}"
        lines.append(",".join([clock, *(f"{cell:.4f}" for cell in cells)]))
    path = tmp_path / "clock.csv"
    path.write_text("\n".join(lines).replace("timestamp_ms", "time"))
    found = propose(read_recording(path).stream, stated(["ball.unit=mm"]))
    assert found.draft["time"] | {"session": None} == {
        "column": "time",
        "unit": "s",
        "clock": "even",
        "session": None,
    }


def test_a_rotation_that_the_ball_does_not_tell_apart_is_asked_for():
    stream = telemetry()
    columns = {name: values[:100] for name, values in stream.columns.items()}
    for name in ("roll_imu", "pitch_imu", "detected"):
        del columns[name]
    known = ["ball.unit=mm", "ball.offset=0", "command.unit=deg"]
    found = propose(Stream(columns), stated(known))
    asked = {(doubt.place, doubt.key) for doubt in found.doubts}
    assert {(f"command_{axis}_rad", "sign") for axis in "xy"} <= asked
    assert ("command_x_rad", "column") in asked, "of one axis: the other angle is the other's"
    said = ["command_x_rad.column=pitch_d", "command.sign=1"]
    found = propose(Stream(columns), stated([*known, *said]))
    assert not found.doubts, found.doubts
    signals = found.draft["signals"]
    assert signals["command_x_rad"]["column"] == "pitch_d"
    assert signals["command_y_rad"]["column"] == "roll_d"


def test_a_ball_that_rolls_one_way_is_no_clock():
    t = np.arange(60) / 30
    columns = {"column 1": 0.3 - 0.1 * t**2, "column 2": 0.05 + 0.04 * t**2}
    found = propose(Stream(columns))
    assert [(doubt.place, doubt.key) for doubt in found.doubts] == [("time", "rate_hz")]
    named = propose(Stream({"column 0": 7.0 + t, **columns}))
    assert named.draft["time"]["column"] == "column 0"


@pytest.mark.parametrize(
    ("name", "axis"), [("Y_u_PWM", "y"), ("X_meas_2", "x"), ("theta_2", "y"), ("u_px", "x")]
)
def test_an_axis_named_by_its_letter_goes_before_one_by_its_number(name: str, axis: str):
    assert hints([name], {})[name].axis == axis


def test_a_code_is_asked_for_axis_by_axis_and_must_be_there():
    stream = telemetry()
    columns = dict(stream.columns)
    del columns["detected"]
    with pytest.raises(ValueError, match="no row of Ballx, Bally has it"):
        propose(Stream(columns), stated(["ball.unit=mm", "ball.absent=-77.5"]))
    known = stated(["ball.unit=mm", "ball_x_m.absent=none", "ball_y_m.absent=none"])
    assert propose(Stream(columns), known).draft["signals"]["ball_x_m"]["absent"] == ()


def test_a_time_that_runs_backwards_is_told_and_not_made_up():
    t = np.arange(200) * 0.01
    columns = {"t_s": t[::-1], "theta_x_rad": np.sin(5 * t), "ball_x_m": 0.05 * np.sin(3 * t)}
    whys = [doubt.why for doubt in propose(Stream(columns)).doubts if doubt.place == "time"]
    assert whys == ["t_s is a time by its name, but does not grow (sort the rows)"]
