"""`rig calibrate` on tables whose servos take an angle, as a user types it."""

import re
from math import degrees
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibration.bundle import load_draft
from calibration.motion.commanded_moves import moves_in_turn, tell
from experiments.records.importing import read_log
from experiments.runs.assemble import load_rig, virtual_renderer
from experiments.track.film import Film
from rig.rigfile import read_rig
from rig.simulation.rendered_camera import RenderedPlateCamera
from rig.simulation.simulator import SimulatedTable
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


@pytest.fixture(scope="module")
def lens_and_plate(tmp_path_factory) -> Path:
    """A folder with the virtual camera's lens and plate."""
    out = tmp_path_factory.mktemp("seen")
    for step in ("camera", "table"):
        assert call("calibrate", step, "--rig", HOBBY, "--out", out) == 0
    return out


def are_the_hobby_tables(servos, lag_width_s: float) -> None:
    """Lags, scales, and the dead band, 0.0079 rad, with half the play, 0.0087/2 rad, lie in their
    intervals."""
    both = degrees(0.0079 + 0.0087 / 2)
    assert servos.source == "plate"
    for axis, lag in ((servos.x, 0.066), (servos.y, 0.046)):
        assert axis.lag_s.low <= lag <= axis.lag_s.high
        assert axis.lag_s.high - axis.lag_s.low < lag_width_s
        assert axis.scale.low <= 0.0 <= axis.scale.high
        numbers = re.findall(r"\d\.\d+", axis.not_seen["dead_band_rad"])
        assert float(numbers[1]) <= both <= float(numbers[2])


@pytest.mark.slow
def test_once_the_plate_is_seen_its_markers_tell_what_its_servos_do(lens_and_plate: Path, capsys):
    assert call("calibrate", "servo", "--rig", HOBBY, "--out", lens_and_plate) == 0
    assert "servo x, by its plate: lag 6" in capsys.readouterr().out
    servos = load_draft(lens_and_plate / "calibration.json").position_servo
    are_the_hobby_tables(servos, lag_width_s=0.012)
    assert cv2.imread(str(lens_and_plate / "servo.png")) is not None
    believed = read_rig(lens_and_plate / "rig.toml")
    assert believed.servo.pair("dead_band_rad") == (0.0079, 0.0079)  # kept
    assert (lens_and_plate / "servo_angles.csv").is_file()


@pytest.mark.slow
def test_a_film_of_a_run_tells_them_too(lens_and_plate: Path, tmp_path: Path):
    rig, film = load_rig(HOBBY), tmp_path / "film.mkv"
    made, stamps = virtual_renderer(rig, np.random.default_rng(1)), []
    limit = rig.servo.angle_limit_rad
    camera = made.view.camera
    with Film(film, (camera.width_px, camera.height_px)) as frames:

        def keep(frame):
            stamps.append(frame.t_s)
            frames.add(frame.image, frame.t_s)

        eye = RenderedPlateCamera(made, rig.camera.delay_s, keep)
        with SimulatedTable(rig, np.random.default_rng(2), held=True, eye=eye) as table:
            told = tell(table, moves_in_turn(table.period_s, limit, 1), limit)
    log = tmp_path / "log.csv"
    rows = np.column_stack((told.t_s - stamps[0], told.told_rad, np.zeros_like(told.told_rad)))
    heads = "t_s,command_x_rad,command_y_rad,ball_x_m,ball_y_m"
    np.savetxt(log, rows, "%.9g", ",", header=heads, comments="")
    mine = tmp_path / "calibration"
    mine.mkdir()
    text = (lens_and_plate / "calibration.json").read_text("utf-8")
    (mine / "calibration.json").write_text(text.replace('"simulated"', '"measured"'), "utf-8")
    args = ("calibrate", "servo", log, "--video", film, "--rig", HOBBY, "--out", mine)
    assert call(*args) == 0
    servos = load_draft(mine / "calibration.json").position_servo
    are_the_hobby_tables(
        servos, lag_width_s=0.02
    )  # the codec and the film's reader keep one in ten


def test_a_film_needs_its_run_and_a_plate_that_was_calibrated(tmp_path: Path, capsys):
    log = tmp_path / "log.csv"
    log.write_text("t_s,command_x_rad,command_y_rad,ball_x_m\n0,0,0,0\n0.02,0.1,0,0\n")
    other = tmp_path / "other.csv"
    other.write_text("t_s,command_x_rad,command_y_rad,ball_x_m\n0,0,0,0\n0.02,0.2,0,0\n")
    for runs, said in (
        ((), "--video: name the one run whose frames these are, not 0"),
        ((log, other), "name the one run whose frames these are, not 2"),
        ((log,), f"{tmp_path} has no lens yet: run rig calibrate camera --out {tmp_path} first"),
    ):
        args = ("calibrate", "servo", *runs, "--video", "a.mp4", "--rig", HOBBY, "--out", tmp_path)
        assert call(*args) == 2
        assert said in capsys.readouterr().err
    assert call("calibrate", "servo", "--video", "a.mp4", "--out", tmp_path) == 2
    assert "servos that take volts" in capsys.readouterr().err


def test_what_cannot_be_measured_is_one_line(tmp_path: Path, capsys):
    assert call("calibrate", "time", "--rig", HOBBY, "--out", tmp_path) == 2
    assert "rig calibrate servo finds them together" in capsys.readouterr().err
    volts = tmp_path / "volts.csv"
    volts.write_text("t_s,voltage_x_V,theta_x_rad\n0,0,0\n0.002,1,0\n")
    assert call("calibrate", "servo", volts, "--rig", HOBBY, "--out", tmp_path / "a") == 2
    assert "holds no command_x_rad" in capsys.readouterr().err
    assert call("calibrate", "servo", volts, "--out", tmp_path / "b") == 2
    assert "leave the runs out" in capsys.readouterr().err


def test_a_run_that_is_named_twice_is_refused(tmp_path: Path, capsys):
    """It counted twice, and its intervals became narrower than they are."""
    logs = [tmp_path / "log.csv", tmp_path / "copy.csv"]
    for log in logs:
        log.write_text("t_s,command_x_rad,command_y_rad,ball_x_m\n0,0,0,0\n0.02,0.1,0,0\n")
    assert call("calibrate", "servo", *logs, "--rig", HOBBY, "--out", tmp_path / "out") == 2
    assert "copy.csv hold the same rows: give every log once" in capsys.readouterr().err


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
