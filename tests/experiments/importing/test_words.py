"""The last line of an import says what to do with the logs."""

from pathlib import Path

import pytest

from experiments.importing.import_map import ImportMap
from experiments.importing.words import next_line


def made(*angles: str) -> ImportMap:
    signals = {name: {"column": name, "unit": "rad"} for name in angles}
    signals |= {f"ball_{a}_m": {"column": a, "unit": "mm"} for a in "xy"}
    return ImportMap.model_validate({"time": {"column": "t", "unit": "s"}, "signals": signals})


@pytest.mark.parametrize("angles", [("theta_x_rad",), ("command_x_rad", "theta_x_rad")])
def test_measured_angles_are_asked_what_is_missing(angles: tuple[str, ...]):
    logs = [Path("out/run 1.csv"), Path("out/run-2.csv")]
    wanted = "next: rig gap 'out/run 1.csv' out/run-2.csv --rig my.toml"
    assert next_line(logs, made(*angles)) == wanted


def test_commanded_angles_are_asked_how_late_the_servos_are_first():
    assert next_line([Path("out/run.csv")], made("command_x_rad", "command_y_rad")) == (
        "next: rig calibrate servo out/run.csv --rig my.toml --out out/calibration"
        " && rig gap out/run.csv --rig out/calibration/rig.toml"
    )
