"""Axes whose units differ, quaternions, and sessions that a column numbers."""

import numpy as np
import pytest

from experiments.importing.conversion import convert
from experiments.importing.import_map import stated
from experiments.importing.names import hints
from experiments.importing.proposal import propose
from experiments.importing.recording import Stream
from tests.support.strangers.bench import Run, run


def file_of(one: Run, y_unit: str = "mm") -> dict[str, np.ndarray]:
    """What a lab writes down of a run, the ball's y in another unit."""
    degrees = np.degrees(one.command_rad)
    size = {"mm": 1e3, "cm": 1e2}[y_unit]
    return {
        "t_s": one.t_s,
        "servo_cmd_x_deg": degrees[:, 0],
        "servo_cmd_y_deg": degrees[:, 1],
        "ball_x_mm": 1e3 * one.ball_m[:, 0],
        f"ball_y_{y_unit}": size * one.ball_m[:, 1],
    }


@pytest.fixture(scope="module")
def one() -> Run:
    return run(seed=5)


def test_units_that_differ_are_asked_axis_by_axis(one: Run):
    """`--set ball.unit=mm`, as the line said, made y's tenths, of a table's gain."""
    columns = file_of(one, "cm")
    options = [doubt.option for doubt in propose(Stream(columns)).doubts]
    assert options == ["--set ball_x_m.unit=mm or cm", "--set ball_y_m.unit=cm or mm"]
    said = ("ball_x_m.unit=mm", "ball_y_m.unit=cm")
    half = propose(Stream(columns), stated(list(said[:1])))
    assert [doubt.option for doubt in half.doubts] == ["--set ball_y_m.unit=cm or mm"]
    log = convert(Stream(columns), propose(Stream(columns), stated(list(said))).map())[0]
    np.testing.assert_allclose(log["ball_y_m"], one.ball_m[:, 1], atol=1e-9)


def test_a_column_that_numbers_runs_begins_sessions_though_the_time_goes_on(one: Run):
    """A hand puts the ball back in a pause of a second: no table's motion."""
    half = len(one.t_s) // 2
    columns = file_of(one) | {"trial": np.repeat([1.0, 2.0], [half, len(one.t_s) - half])}
    made = propose(Stream(columns)).map()
    assert made.time.session == "trial"
    assert [len(log) for log in convert(Stream(columns), made)] == [half, len(one.t_s) - half]
    stays = propose(Stream(columns | {"trial": np.full(len(one.t_s), 3.0)})).map()
    assert stays.time.session is None


def test_parts_of_a_quaternion_are_neither_angles_nor_places():
    names = [f"plate.orientation.{part}" for part in "xyzw"]
    assert {one.role for one in hints(names, {}).values()} == {"other"}
    assert hints(["Rotation X"], {})["Rotation X"].role == "angle"


@pytest.mark.parametrize("stem", ["", "ball_", "box."])
def test_a_box_in_a_picture_is_no_quaternion(stem: str):
    """Its w and h made x and y of a detector's box no places, and h was offered for the ball."""
    found = hints([f"{stem}{part}" for part in "xywh"], {})
    assert [found[f"{stem}{part}"].role for part in "xy"] == ["ball", "ball"]


def test_what_is_no_number_of_runs_begins_no_sessions(one: Run):
    columns, late = file_of(one), one.t_s > 20
    for name, numbers in [("run", (one.t_s > 5) & ~late), ("run_mode", late), ("take_x", late)]:
        made = propose(Stream(columns | {name: 1.0 * numbers})).map()
        assert made.time.session is None, name
    columns |= {"trial_id": 1.0 + late}
    assert propose(Stream(columns)).map().time.session == "trial_id"
    assert propose(Stream(columns), stated(["time.session=none"])).map().time.session is None


@pytest.mark.parametrize("rate_hz", [30.0, 50.0])
def test_a_clock_of_whole_seconds_gives_way_to_a_finer_one(rate_hz: float):
    """It stood first, and its rows were spread evenly though the milliseconds were told."""
    one = run(seed=5, rate_hz=rate_hz)
    columns = {"timestamp": np.floor(one.t_s) + 1.7e9, "millis": 1e3 * one.t_s} | file_of(one)
    del columns["t_s"]
    made = propose(Stream(columns)).map()
    assert (made.time.column, made.time.clock) == ("millis", "as recorded")
    del columns["millis"]
    assert propose(Stream(columns)).map().time.clock == "even"


def test_volts_of_a_panel_are_no_reason_to_go_without_a_ball(one: Run):
    """Commands beside volts that nothing measured follows made a log without a ball, unasked."""
    columns = file_of(one)
    for axis in "xy":
        columns[f"U{axis} (V)"] = 2.5 + columns.pop(f"ball_{axis}_mm") / 60
    found = propose(Stream(columns))
    assert found.doubts[0].option == "--set ball_x_m.column=Ux (V) or Uy (V)"


@pytest.mark.parametrize("sign", [1, -1])
def test_what_a_servo_follows_is_not_silently_the_balls_target(one: Run, sign: int):
    """set_x, degrees, became a target in millimetres, or was left out, as the servo was turned."""
    columns = {"t_s": one.t_s}
    for at, axis in enumerate("xy"):
        columns[f"set_{axis}"] = sign * np.degrees(one.command_rad[:, at])
        columns[f"servo_{axis}_meas_deg"] = sign * np.degrees(one.theta_rad[:, at])
        columns[f"ball_{axis}_mm"] = 1e3 * one.ball_m[:, at]
    options = [doubt.option for doubt in propose(Stream(columns)).doubts]
    assert options == [f"--set target_{axis}_m.column=none or set_{axis}" for axis in "xy"]
    said = [f"command_{axis}_rad.column=set_{axis}" for axis in "xy"]
    made = propose(Stream(columns), stated([*said, "command.unit=deg"])).map()
    assert "target_x_m" not in made.signals
    for at, axis in enumerate("xy"):
        columns[f"set_{axis}"] = 1e3 * one.target_m[:, at]
    assert propose(Stream(columns)).map().signals["target_x_m"].unit == "mm"
