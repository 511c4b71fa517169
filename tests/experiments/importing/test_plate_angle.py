"""Angles that are no servo's: the plate's own tilt beside a command, servos on a turned plate."""

from math import cos, radians, sin

import numpy as np
import pytest

from experiments.importing.import_map import stated
from experiments.importing.proposal import propose
from experiments.importing.recording import Stream
from tests.support.other_labs.bench import run

RATIO = 0.17


def table(turned_deg: float = 0.0) -> dict[str, np.ndarray]:
    """A table's columns, its ball's axes turned against those of the servos."""
    x, y = (run(axis, seconds=30.0, course_kind="wander", ratio=RATIO) for axis in (0, 1))
    c, s = cos(radians(turned_deg)), sin(radians(turned_deg))
    return {
        "time_s": x.t,
        "servo_a_cmd_deg": np.degrees(x.command),
        "servo_b_cmd_deg": np.degrees(y.command),
        "ball_x_mm": 1e3 * (c * x.seen - s * y.seen),
        "ball_y_mm": 1e3 * (s * x.seen + c * y.seen),
        "imu_pitch_deg": np.degrees(RATIO * x.angle),
        "imu_roll_deg": -np.degrees(RATIO * y.angle),
    }


def stream(columns: dict[str, np.ndarray], *prefixes: str) -> Stream:
    """The columns whose names begin so, behind the time."""
    return Stream({k: v for k, v in columns.items() if k.startswith(("time", *prefixes))})


def test_a_plates_own_tilt_is_not_taken_for_the_angle_that_its_servo_is_told():
    columns = stream(table(), "ball", "servo", "imu")
    doubts = {d.place: d for d in propose(columns).doubts}
    assert {"theta_x_rad", "theta_y_rad"} <= doubts.keys()
    assert doubts["theta_x_rad"].options == ("none", "imu_pitch_deg")
    assert "turns 0.17 rad for each radian of servo_a_cmd_deg" in doubts["theta_x_rad"].why
    found = propose(columns, stated(["theta_x_rad.column=none", "theta_y_rad.column=none"]))
    assert not found.doubts
    assert {*found.draft["signals"]} == {"ball_x_m", "ball_y_m", "command_x_rad", "command_y_rad"}


def test_a_commanded_tilt_is_left_out_beside_the_angle_of_the_servo():
    columns = table()
    for axis, told, tilt in (("x", "a", "pitch"), ("y", "b", "roll")):
        columns[f"theta_meas_{axis}_deg"] = columns[f"imu_{tilt}_deg"] / RATIO
        columns[f"tilt_cmd_{axis}_deg"] = RATIO * columns[f"servo_{told}_cmd_deg"]
    doubts = propose(stream(columns, "ball", "theta", "tilt")).doubts
    assert [d.option for d in doubts] == [
        f"--set command_{axis}_rad.column=none or tilt_cmd_{axis}_deg" for axis in "xy"
    ]


def test_a_measured_angle_in_the_commands_scale_is_its_servos():
    columns = table()
    columns["theta_x_deg"] = columns["imu_pitch_deg"] / RATIO
    assert not propose(stream(columns, "ball", "servo", "theta")).doubts


@pytest.mark.parametrize("said", [(), ("command_x_rad.column=servo_a_cmd_deg",)])
def test_servos_on_the_diagonals_are_no_axis_of_the_ball_whatever_is_stated(said: tuple[str, ...]):
    with pytest.raises(ValueError, match=r"turned by about 4\d degrees against the ball"):
        propose(stream(table(45.0), "ball", "servo"), stated(said))


@pytest.mark.parametrize(("turned_deg", "told"), [(0.0, False), (20.0, True)])
def test_a_plate_that_is_turned_a_little_is_told(turned_deg: float, told: bool):
    found = propose(stream(table(turned_deg), "ball", "servo"))
    assert not found.doubts
    assert any("turned by about" in reason for reason in found.reasons["angle"]) == told


@pytest.mark.parametrize("named", ["servo{}_deg", "servo_{}_cmd_deg"])
def test_three_arms_are_no_axes_and_a_ball_alone_has_the_unit_of_its_name(named: str):
    columns = table()
    arms = {named.format(i): columns["servo_a_cmd_deg"] * i for i in (1, 2, 3)}
    whole = stream({**columns, **arms}, "ball", *arms)
    (asked,) = propose(whole).doubts
    assert asked.option == "--set command.column=none"
    assert "tilt the plate together" in asked.why
    found = propose(whole, stated(["command.column=none"]))
    assert not found.doubts
    assert found.map().signals["ball_x_m"].unit == "mm"
    bare = {k.replace("_mm", ""): v for k, v in whole.columns.items()}
    (asked,) = propose(Stream(bare), stated(["command.column=none"])).doubts
    assert asked.option.startswith("--set ball.unit=")
