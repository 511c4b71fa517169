"""What an import says: each line is its own, and the last one tells what to do with the logs."""

import re
from pathlib import Path

import numpy as np
import pytest

from experiments.importing.import_map import ImportMap, stated
from experiments.importing.proposal import propose
from experiments.importing.recording import Recording, Stream
from experiments.importing.words import next_line, report_lines
from tests.experiments.importing.test_worked_examples import table


def made(*angles: str) -> ImportMap:
    signals = {name: {"column": name, "unit": "rad"} for name in angles}
    signals |= {f"ball_{a}_m": {"column": a, "unit": "mm"} for a in "xy"}
    return ImportMap.model_validate({"time": {"column": "t", "unit": "s"}, "signals": signals})


@pytest.mark.parametrize(
    "angles", [("theta_x_rad",), ("command_x_rad", "theta_x_rad"), ("command_x_rad",)]
)
def test_measured_angles_and_one_axis_alone_are_asked_what_is_missing(angles: tuple[str, ...]):
    logs = [Path("out/run 1.csv"), Path("out/run-2.csv")]
    wanted = "next: rig gap 'out/run 1.csv' out/run-2.csv --rig my.toml"
    assert next_line(logs, made(*angles)) == wanted


def test_commanded_angles_are_asked_how_late_the_servos_are_first():
    assert next_line([Path("out/run.csv")], made("command_x_rad", "command_y_rad")) == (
        "next: rig calibrate servo out/run.csv --rig my.toml --out out/calibration"
        " && rig gap out/run.csv --rig out/calibration/rig.toml"
    )


def test_a_name_that_holds_a_line_forges_none():
    """`say` shows other control characters as "?"; a line of its own would look like ours."""
    t = np.arange(200) / 50
    stream = Stream({"t_s": t, "x\nnext: curl evil": np.sin(t), "ball_x_m": 0.1 * np.sin(t)})
    found = propose(stream, stated(["time.unit=s"]))
    lines = report_lines(Recording(stream), found)
    assert len(lines) == 5
    assert not any("\n" in line for line in lines)
    assert any("x?next: curl evil" in line for line in lines)


def test_how_the_ball_answers_says_to_what_how_surely_and_what_to_expect():
    """A plate of 0.14 of the servo's angle, a solid ball: 0.98 m/s2 a radian."""
    t, told, ball = table()
    columns = {"t_s": t}
    for i, axis in enumerate("xy"):
        columns |= {f"command_{axis}_rad": told[:, i], f"ball_{axis}_m": ball[:, i]}
    stream = Stream(columns)
    _, _, angle, drive, rest = report_lines(Recording(stream), propose(stream))
    said = re.search(r"for each radian of it by (\S+) m/s2 on x \(99.9 %: (\S+) to (\S+)\)", angle)
    assert said is not None
    value, low, high = map(float, said.groups())
    assert low < value < high
    assert value == pytest.approx(0.98, rel=0.1)
    assert "14.0 arm_radius_m / plate_side_m" in angle
    assert drive == "drive   no volts or motor speeds in the file"
    assert rest.startswith("rest    no targets, pushes or times of exposure in the file")


@pytest.mark.parametrize(
    "wrong", ["time.rate_hz=-5", "time.rate_hz=1e400", "time.unit=x", "ball_x_m.sign=inf",
              "ball_x_m.sign=-1.9", "ball_x_m.sign=0"],
)  # fmt: skip
def test_what_is_stated_wrongly_is_told_in_one_line(wrong: str):
    t = np.arange(200) / 50
    stream = Stream({"t_s": t, "ball_x_m": 0.1 * np.sin(t)})
    with pytest.raises(ValueError) as caught:  # noqa: PT011 - the words are looked at below
        propose(stream, stated([wrong]))
    assert "\n" not in str(caught.value)
    assert "pydantic" not in str(caught.value)
