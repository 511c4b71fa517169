"""`rig calibrate` on tables whose servos take an angle, as a user types it."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from calibration.bundle import load_draft
from experiments.records.importing import read_log
from rig.rigfile import read_rig
from tests.support.command import call

HOBBY, BUS = (Path("experiments/rigs") / f"{n}.toml" for n in ("hobby-two-servos", "bus-servos"))


@pytest.fixture(scope="module")
def hobby(tmp_path_factory) -> Path:
    """A folder in which the hobby table was measured by its ball."""
    out = tmp_path_factory.mktemp("hobby")
    assert call("calibrate", "servo", "--rig", HOBBY, "--out", out) == 0
    return out


@pytest.mark.slow
def test_a_table_without_angles_is_measured_by_its_ball(hobby: Path, capsys):
    found = load_draft(hobby / "calibration.json").position_servo
    assert found is not None
    assert found.source == "ball"
    for axis, lag in ((found.x, 0.066), (found.y, 0.046)):
        assert axis.together_s is not None
        assert axis.together_s.low <= lag <= axis.together_s.high
    assert cv2.imread(str(hobby / "servo.png")) is not None
    believed = read_rig(hobby / "rig.toml")
    assert believed.servo.pair("lag_s")[0] == pytest.approx(0.066, abs=0.01)
    assert believed.servo.pair("rate_limit_rad_s") == (7.0, 7.0)  # not seen: kept


@pytest.mark.slow
def test_its_level_is_found_through_the_servos_answer(hobby: Path):
    assert call("calibrate", "level", "--rig", HOBBY, "--out", hobby) == 0
    level = load_draft(hobby / "calibration.json").level
    assert level is not None
    assert level.slope_rad["y"].low <= 0.006 <= level.slope_rad["y"].high
    gains = [level.gain_m_s2["x"].value, level.gain_m_s2["y"].value]
    np.testing.assert_allclose(gains, (0.952, 1.225), rtol=0.02)


def test_what_cannot_be_measured_is_one_line(tmp_path: Path, capsys):
    assert call("calibrate", "time", "--rig", HOBBY, "--out", tmp_path) == 2
    assert "rig calibrate servo finds them together" in capsys.readouterr().err
    volts = tmp_path / "volts.csv"
    volts.write_text("t_s,voltage_x_V,theta_x_rad\n0,0,0\n0.002,1,0\n")
    assert call("calibrate", "servo", volts, "--rig", HOBBY, "--out", tmp_path / "a") == 2
    assert "holds no command_x_rad" in capsys.readouterr().err
    assert call("calibrate", "servo", volts, "--out", tmp_path / "b") == 2
    assert "leave the runs out" in capsys.readouterr().err


@pytest.mark.slow
def test_a_table_with_angles_is_measured_by_them_again_from_its_recording(tmp_path: Path, capsys):
    first, again = tmp_path / "first", tmp_path / "again"
    assert call("calibrate", "servo", "--rig", BUS, "--out", first) == 0
    assert "lag 34" in capsys.readouterr().out
    log = first / "servo_commands.csv"
    assert read_log(log).has("command_x_rad", "theta_y_rad")
    assert call("calibrate", "servo", log, "--rig", BUS, "--out", again) == 0
    found = [load_draft(folder / "calibration.json").position_servo for folder in (first, again)]
    assert found[0] is not None
    assert found[1] is not None
    assert found[0].x.dead_band_rad is not None
    assert found[1].x.lag_s is not None
    assert found[0].x.lag_s is not None
    assert found[0].x.dead_band_rad.value == pytest.approx(0.0046, abs=3e-4)
    assert found[1].x.lag_s.value == pytest.approx(found[0].x.lag_s.value, abs=1e-4)
    assert call("calibrate", "servo", log, log, "--rig", BUS, "--out", tmp_path / "c") == 2
